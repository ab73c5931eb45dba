"""The whole chain, and each of its stages."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from zipfile import is_zipfile

import numpy as np
import typer

from data_tools.cli import _options as common
from data_tools.cli._options import app
from evcalib.errors import InputError

if TYPE_CHECKING:
    from evcalib.alignment import Calibration
    from evcalib.series import HeadingSeries, VelocitySeries

Camera = Annotated[
    Path, typer.Option(help="Camera file (calib.txt, ROS, Kalibr, OpenCV, DV, Metavision, ...).")
]
CameraName = Annotated[
    str | None, typer.Option(help="Which camera of the camera file, like cam1, if several fit.")
]
Vehicle = Annotated[Path | None, typer.Option(help="Vehicle file (YAML).")]
Columns = Annotated[
    Path | None, typer.Option(help="Column map of the wheel log or velocities (YAML).")
]
Topic = Annotated[
    str | None, typer.Option(help="Topic of the bag, or entry of the log, that tells the motion.")
]
WheelRadius = Annotated[
    float | None, typer.Option(help="Wheel radius in metres, for wheels given in rad/s.")
]
MotionTimeUnit = Annotated[
    str | None,
    typer.Option(help="s, ms, us or ns: unit of the motion's times (CSV), if not seconds."),
]
ClockShift = Annotated[
    float,
    typer.Option(help="Seconds to add to the motion's times, such as -3600 for a time zone."),
]
TwistFrame = Annotated[
    str | None,
    typer.Option(
        help="body or ground: the frame of a bag's twists, if the bag contradicts itself."
    ),
]


OdometrySd = Annotated[
    float | None,
    typer.Option(
        help="Error of all directions of the odometry in degrees (sd), such as of a steering zero;"
        " by default that of the kind of wheels."
    ),
]
Denoise = Annotated[
    bool,
    typer.Option(help="Leave out noise, hot pixels and flicker of lamps, where there is much."),
]


@app.command()
def calibrate(
    recording: Annotated[Path, typer.Argument(help="Events, in any format that is known.")],
    camera: Camera,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")],
    wheels: Annotated[
        Path | None, typer.Option(help="Wheel log (CSV, ROS bag or .wpilog).")
    ] = None,
    vehicle: Vehicle = None,
    velocities: Annotated[
        Path | None, typer.Option(help="Velocities (CSV, ROS bag or .wpilog), in place of wheels.")
    ] = None,
    max_offset: common.MaxOffset = 1.0,
    size: common.Size = None,
    camera_name: CameraName = None,
    offset: Annotated[
        float | None, typer.Option(help="Offset in seconds, to use if the motion does not tell it.")
    ] = None,
    camera_position: Annotated[
        str | None,
        typer.Option(help="Where the camera sits in the body: X,Y,Z in metres; else found."),
    ] = None,
    camera_height: Annotated[
        float | None,
        typer.Option(help="Height of the camera in the body in metres, which no drive shows."),
    ] = None,
    refinement: Annotated[str, typer.Option(help="tracks, or none for the paper's chain.")] = (
        "tracks"
    ),
    max_slip: Annotated[
        float | None, typer.Option(help="Leave out wheel rows that slip more, in m/s.")
    ] = None,
    max_yaw_rate: Annotated[
        float | None,
        typer.Option(help="Leave out rows that turn faster, in rad/s; turning is no fault."),
    ] = None,
    columns: Columns = None,
    topic: Topic = None,
    wheel_radius: WheelRadius = None,
    motion_time_unit: MotionTimeUnit = None,
    clock_shift: ClockShift = 0.0,
    twist_frame: TwistFrame = None,
    imu: common.Imu = None,
    imu_rotation: common.ImuRotation = None,
    imu_unit: common.ImuUnit = None,
    imu_columns: common.ImuColumns = None,
    imu_time_unit: common.ImuTimeUnit = None,
    imu_stream: common.ImuStream = None,
    time_unit: common.TimeUnit = None,
    format: common.Format = None,
    disorder: common.Disorder = "refuse",
    stream: common.Stream = None,
    surface: Annotated[str, typer.Option(help="tos_ts, tos, ts, silc or dist.")] = "tos_ts",
    rate: Annotated[float, typer.Option(help="Keyframes per second.")] = 20.0,
    odometry_sd: OdometrySd = None,
    denoise: Denoise = True,
    seed: common.Seed = 0,
    overwrite: common.Overwrite = False,
    as_json: common.Json = False,
) -> None:
    """Find offset and rotation from a raw recording and wheel states, with a report."""
    from data_tools.runs.calibrate import run_files
    from data_tools.runs.export import noise_dict

    run = run_files(
        recording,
        camera,
        wheels=wheels,
        vehicle=vehicle,
        velocities=velocities,
        size=size,
        camera_name=camera_name,
        output=output,
        overwrite=overwrite,
        command=common.command_line(),
        max_slip=max_slip,
        max_yaw_rate=max_yaw_rate,
        reading={
            "time_unit": time_unit,
            "format": format,
            "disorder": disorder,
            "stream": stream,
        },
        motion={
            "columns": columns,
            "topic": topic,
            "wheel_radius": wheel_radius,
            "time_unit": motion_time_unit,
            "clock_shift": clock_shift,
            "twist_frame": twist_frame,
        },
        imu=common.imu_options(imu, imu_rotation, imu_unit, imu_columns, imu_time_unit, imu_stream),
        on_stage=lambda name: common.note(f"{name} ..."),
        max_offset=max_offset,
        offset=offset,
        camera_position=_position(camera_position),
        camera_height=camera_height,
        refinement=refinement,
        surface=surface,
        rate=rate,
        odometry_sd=_radians(odometry_sd),
        denoise=denoise,
        seed=seed,
    )
    common.print_calibration(run.calibration, as_json, noise_dict(run))
    for key, text in run.recording.items():
        if key.startswith("note") and not as_json:
            print(common.as_given(f"note: {text}"))
    if not as_json:
        print(f"\nWritten to {output}: calibration.yaml, report.html and the data behind them.")
    common.exit_by(run.calibration)


@app.command()
def headings(
    recording: Annotated[Path, typer.Argument(help="Events, in any format that is known.")],
    camera: Camera,
    output: Annotated[Path, typer.Option("-o", "--output", help="Headings to write (CSV).")],
    surface: Annotated[str, typer.Option(help="tos_ts, tos, ts, silc or dist.")] = "tos_ts",
    solver: Annotated[str, typer.Option(help="two_point or five_point.")] = "two_point",
    rate: Annotated[float, typer.Option(help="Keyframes per second.")] = 20.0,
    size: common.Size = None,
    camera_name: CameraName = None,
    imu: common.Imu = None,
    imu_rotation: common.ImuRotation = None,
    imu_unit: common.ImuUnit = None,
    imu_columns: common.ImuColumns = None,
    imu_time_unit: common.ImuTimeUnit = None,
    imu_stream: common.ImuStream = None,
    time_unit: common.TimeUnit = None,
    format: common.Format = None,
    disorder: common.Disorder = "refuse",
    stream: common.Stream = None,
    denoise: Denoise = True,
    seed: common.Seed = 0,
) -> None:
    """Find the direction of motion of an event camera from its events."""
    from data_tools.files.atomic import write_file
    from data_tools.logs.series_files import write_headings
    from data_tools.runs.headings import headings_from_files

    result = headings_from_files(
        recording,
        camera,
        size=size,
        camera_name=camera_name,
        surface=surface,
        solver=solver,
        rate=rate,
        denoise=denoise,
        seed=seed,
        time_unit=time_unit,
        format=format,
        disorder=disorder,
        stream=stream,
        imu=common.imu_options(imu, imu_rotation, imu_unit, imu_columns, imu_time_unit, imu_stream),
    )
    write_file(output, lambda path: write_headings(path, result.estimate.headings))
    common.tell(result.summary, output)
    if not len(result.estimate.headings):
        raise typer.Exit(common.NO_ANSWER)


@app.command()
def trajectory(
    recording: Annotated[Path, typer.Argument(help="Events, in any format that is known.")],
    camera: Camera,
    output: Annotated[Path, typer.Option("-o", "--output", help="Trajectory to write (TUM).")],
    size: common.Size = None,
    camera_name: CameraName = None,
    time_unit: common.TimeUnit = None,
    format: common.Format = None,
    disorder: common.Disorder = "refuse",
    stream: common.Stream = None,
    seed: common.Seed = 0,
) -> None:
    """Follow an event camera through its surroundings by its events alone (visual odometry).

    The scale is free, and the trajectory drifts.  If tracking is lost, what came before is written
    and the exit code is 3; if the poses may be wrong though it was not, the exit code is 4.
    """
    from data_tools.files.atomic import write_file
    from data_tools.logs.trajectory_files import write_tum
    from data_tools.runs.trajectory import trajectory_from_files

    result = trajectory_from_files(
        recording,
        camera,
        size=size,
        camera_name=camera_name,
        seed=seed,
        time_unit=time_unit,
        format=format,
        disorder=disorder,
        stream=stream,
    )
    write_file(output, lambda path: write_tum(path, result.trajectory.poses))
    common.tell(result.summary, output)
    if result.trajectory.lost:
        raise typer.Exit(common.NO_ANSWER)
    if result.trajectory.doubts:
        raise typer.Exit(common.DOUBTS)


@app.command()
def velocities(
    wheels: Annotated[
        Path, typer.Argument(help="Wheel log (CSV, ROS bag or .wpilog).", metavar="WHEELS")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Velocities to write (CSV).")],
    vehicle: Vehicle = None,
    max_slip: Annotated[
        float | None, typer.Option(help="Remove rows that slip more, in m/s.")
    ] = None,
    max_yaw_rate: Annotated[
        float | None, typer.Option(help="Remove rows that turn faster, in rad/s.")
    ] = None,
    columns: Columns = None,
    topic: Topic = None,
    wheel_radius: WheelRadius = None,
    time_unit: MotionTimeUnit = None,
    clock_shift: ClockShift = 0.0,
    twist_frame: TwistFrame = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="PNG to draw: the vehicle with its arrows, and the path it claims."),
    ] = None,
) -> None:
    """Turn a wheel log into body velocities.

    Steering angles turn counter-clockwise from above: positive is to the left.  A negative speed
    rolls backwards.  A mecanum vehicle's rollers form an X, seen from above.  No check can see a
    sign that is wrong for all wheels, or left and right exchanged: look at --plot.
    """
    from data_tools.files.atomic import write_file
    from data_tools.logs.series_files import write_velocities
    from data_tools.logs.velocity_sources import read_body_velocities

    source = read_body_velocities(
        wheels,
        vehicle=vehicle,
        columns=columns,
        topic=topic,
        wheel_radius=wheel_radius,
        time_unit=time_unit,
        clock_shift=clock_shift,
        twist_frame=twist_frame,
        max_slip=max_slip,
        max_yaw_rate=max_yaw_rate,
    )
    write_file(output, lambda path: write_velocities(path, source.velocities))
    if plot is not None:
        from evcalib.plots.kinematics import motion_figure
        from evcalib.plots.style import png

        picture = png(motion_figure(source.velocities, source.vehicle, source.states))
        write_file(plot, lambda path: path.write_bytes(picture))
    common.tell(f"{len(source.velocities)} rows written to {output}", output, plot)
    for line in source.notes:
        common.tell(line, output, plot)


@app.command()
def align(
    headings: Annotated[
        Path, typer.Argument(help="Headings (CSV), or the authors' .npz.", metavar="HEADINGS.csv")
    ],
    velocities: Annotated[
        Path | None,
        typer.Argument(help="Velocities (CSV or ROS bag).", metavar="[VELOCITIES.csv]"),
    ] = None,
    columns: Columns = None,
    topic: Topic = None,
    motion_time_unit: MotionTimeUnit = None,
    clock_shift: ClockShift = 0.0,
    twist_frame: TwistFrame = None,
    max_offset: common.MaxOffset = 1.0,
    offset_method: Annotated[
        str, typer.Option(help="profile, trace, canonical, scalar or none.")
    ] = "profile",
    rotation_method: Annotated[str, typer.Option(help="tukey, l1, kabsch, gnc or cca.")] = "tukey",
    offset: Annotated[
        float | None, typer.Option(help="Offset in seconds, to use if the motion does not tell it.")
    ] = None,
    max_gap: Annotated[
        float | None,
        typer.Option(help="Longest step to interpolate over, in seconds."),
    ] = None,
    odometry_sd: OdometrySd = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the bootstrap.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder for calibration.yaml and the plots."),
    ] = None,
    overwrite: common.Overwrite = False,
    as_json: common.Json = False,
) -> None:
    """Find offset and rotation between headings and velocities."""
    from evcalib.alignment import align as run

    camera, body, hold = streams(
        headings,
        velocities,
        columns=columns,
        topic=topic,
        time_unit=motion_time_unit,
        clock_shift=clock_shift,
        twist_frame=twist_frame,
        notes=None if as_json else common.tell,
    )
    calibration = run(
        camera,
        body,
        max_offset=max_offset,
        offset_method=offset_method,
        rotation_method=rotation_method,
        offset=offset,
        max_gap=max_gap,
        hold=hold,
        odometry_sd=_radians(odometry_sd),
        seed=seed,
    )
    if output is not None:
        _write_alignment(output, calibration, overwrite)
    common.print_calibration(calibration, as_json)
    if output is not None and not as_json:
        print(f"\nWritten to {output}: calibration.yaml and the plots.")
    common.exit_by(calibration)


def streams(
    headings: Path,
    velocities: Path | None,
    *,
    notes: Callable[[str], object] | None = common.tell,
    **motion: Any,
) -> tuple[HeadingSeries, VelocitySeries, float]:
    """Read both streams of an alignment, and how long rows hold beyond gaps [s].

    What was held or left out goes to `notes`, a line each.
    """
    from data_tools.logs.series_files import read_headings, read_paired_streams
    from data_tools.logs.velocity_sources import read_body_velocities

    if headings.suffix == ".npz" or is_zipfile(headings):
        if velocities is not None:
            raise InputError(f"{headings} holds both streams: give no velocities beside it")
        pairs = read_paired_streams(headings)
        return pairs.headings, pairs.velocities, pairs.hold
    if velocities is not None and _one_file(headings, velocities):
        raise InputError(f"{headings} is given twice: headings and velocities are two files")
    if velocities is None:
        raise InputError(f"a velocities file is needed beside {headings}")
    found: list[str] = []
    camera = read_headings(headings, found)
    source = read_body_velocities(velocities, **motion)
    lines = [f"{headings}: {line}" for line in found]
    for line in (*lines, *(f"{velocities}: {line}" for line in source.notes)):
        if notes is not None:
            notes(line)
    return camera, source.velocities, 0.0


def _one_file(one: Path, other: Path) -> bool:
    return one.exists() and other.exists() and one.samefile(other)


def _write_alignment(output: Path, calibration: Calibration, overwrite: bool) -> None:
    from data_tools.runs.export import write_calibration
    from data_tools.runs.folder import RunFolder
    from evcalib.plots.alignment import alignment_figures
    from evcalib.plots.style import png

    with RunFolder(output, overwrite=overwrite, command=common.command_line()) as folder:
        for name, figure in alignment_figures(calibration).items():
            picture = png(figure)
            writer: Any = lambda path, data=picture: path.write_bytes(data)  # noqa: E731
            folder.write(f"{name}.png", writer)
        folder.write("calibration.yaml", lambda path: write_calibration(path, calibration))


def _radians(degrees: float | None) -> float | None:
    return None if degrees is None else float(np.radians(degrees))


def _position(text: str | None) -> tuple[float, float, float] | None:
    if text is None:
        return None
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        raise InputError(
            f"--camera-position must be X,Y,Z in metres, like 0.3,0,0.8, not {text!r}"
        ) from None
    return x, y, z
