"""Import paths from before the folders; see `evcalib._moved`."""

MOVED = {
    "data_tools.atomic_files": "data_tools.files.atomic",
    "data_tools.bag_velocities": "data_tools.logs.bag_velocities",
    "data_tools.baseline_runs": "data_tools.studies.baseline_runs",
    "data_tools.batch": "data_tools.studies.batch",
    "data_tools.batch_list": "data_tools.studies.batch_list",
    "data_tools.calibrate_files": "data_tools.runs.calibrate",
    "data_tools.camera_files": "data_tools.logs.camera_files data_tools.logs.cameras._content",
    "data_tools.clock_map": "data_tools.bags.clock_map",
    "data_tools.column_maps": "data_tools.logs.column_maps",
    "data_tools.convert": "data_tools.recordings.convert",
    "data_tools.csv_table": "data_tools.files.csv_table",
    "data_tools.datasets": "data_tools.files.datasets",
    "data_tools.demo": "data_tools.runs.demo",
    "data_tools.events_text": "data_tools.recordings.formats.events_text",
    "data_tools.export": "data_tools.runs.export",
    "data_tools.formats": "data_tools.recordings.formats",
    "data_tools.formats.aedat4": "data_tools.recordings.formats.aedat4",
    "data_tools.formats.csv": "data_tools.recordings.formats.csv",
    "data_tools.formats.hdf5": "data_tools.recordings.formats.hdf5",
    "data_tools.formats.npz": "data_tools.recordings.formats.npz",
    "data_tools.formats.prophesee_dat": "data_tools.recordings.formats.prophesee_dat",
    "data_tools.formats.prophesee_raw": "data_tools.recordings.formats.prophesee_raw",
    "data_tools.formats.rosbag": "data_tools.recordings.formats.rosbag",
    "data_tools.formats.text": "data_tools.recordings.formats.text",
    "data_tools.headings": "data_tools.runs.headings",
    "data_tools.input_files": "data_tools.runs._inputs",
    "data_tools.lag_study": "data_tools.studies.lag",
    "data_tools.matches": "data_tools.simulation.point_matches",
    "data_tools.motion": (
        "data_tools.simulation.drives "
        "data_tools.simulation.random_drives "
        "data_tools.simulation.streams"
    ),
    "data_tools.plans": "data_tools.simulation.drives",
    "data_tools.recorded_drive": (
        "data_tools.simulation.recorded_drive data_tools.simulation.random_drives"
    ),
    "data_tools.recording_info": "data_tools.recordings._info",
    "data_tools.run_folder": "data_tools.files.atomic data_tools.runs.folder",
    "data_tools.samples": "data_tools.course.samples",
    "data_tools.scenes": "data_tools.simulation.scenes",
    "data_tools.sensor": "data_tools.simulation.sensor",
    "data_tools.series_files": "data_tools.logs.series_files",
    "data_tools.sighting_drives": "data_tools.studies.sighting_drives",
    "data_tools.sightings": "data_tools.studies.sightings",
    "data_tools.simulator": "data_tools.simulation.simulator",
    "data_tools.studies.drives": "data_tools.simulation.random_drives",
    "data_tools.text_files": "data_tools.files.text",
    "data_tools.trajectory": "data_tools.simulation.trajectory",
    "data_tools.trajectory_files": "data_tools.logs.trajectory_files",
    "data_tools.vehicles": "data_tools.logs.vehicle_files",
    "data_tools.velocity_sources": "data_tools.logs.velocity_sources",
    "data_tools.wheel_logs": "data_tools.logs.wheel_logs",
    "data_tools.zip_files": "data_tools.files.archives",
}
"""Old modules, and where their names are now; the first that has a name is taken."""
