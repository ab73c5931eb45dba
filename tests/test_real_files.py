"""All real recordings: read, with their counts, or refused for a reason that is true.

The real camera files are in `test_camera_files.py`.
"""

import pytest

from data_tools.recordings import open_recording
from evcalib.errors import InputError

COUNTS = {
    "davis240_imu.aedat": ("aedat2", 374_296),
    "davis346.aedat4": ("aedat4", 78_830),
    "dv_2020.aedat4": ("aedat4", 6_676),
    "dv_sample.aedat4": ("aedat4", 9_193),
    "dvs.es": ("es", 473_225),
    "evt2.raw": ("evt2", 521_252),
    "evt3.raw": ("evt3", 1_218_618),
    "gen4.dat": ("dat", 1_218_618),
    "ros1_evt3_packets.bag": ("rosbag", 343_474),
    "ros2_evt3.db3": ("rosbag", 343_474),
    "ros2_evt3_trigger.db3": ("rosbag", 82_469),
    "ros2_libcaer.mcap": ("rosbag", 571_266),
    "ros2_libcaer_rollover.db3": ("rosbag", 334_331),
}
REFUSED = {
    "dv_frames_only.aedat4": "has no stream of events",
    "dv_empty_stereo.aedat4": "several streams of events: say which",
}


@pytest.mark.parametrize("name", [*COUNTS, *REFUSED])
def test_every_real_recording(data, name):
    for module in ("lz4", "rosbags"):
        pytest.importorskip(module)
    path = data / "formats" / name
    if name in REFUSED:
        with pytest.raises(InputError, match=REFUSED[name]):
            open_recording(path)
        return
    recording = open_recording(path)
    assert (recording.format, sum(map(len, recording))) == COUNTS[name]


def test_no_real_recording_is_left_out(data):
    assert {path.name for path in (data / "formats").iterdir()} == {*COUNTS, *REFUSED}
