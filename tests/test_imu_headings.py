"""Headings of a camera whose gyro takes its turning out: real, by the command line, told wrong."""

import struct

import numpy as np
import pytest

from data_tools.recordings import open_recording, read_imu
from data_tools.runs.imu import imu_of
from evcalib.camera import Camera
from evcalib.errors import InputError
from evcalib.heading import HeadingEstimator
from evcalib.heading.gyro import as_seen, refuse_harm, shared_turn
from evcalib.imu import attitude_of

CAMERA = Camera(240, 180, fx=200, fy=200, cx=120, cy=90)


def estimated(recording, attitude):
    estimator = HeadingEstimator(CAMERA, attitude=attitude, keep_correspondences=True)
    for piece in recording:
        estimator.update(piece)
    return estimator.finish()


def test_a_real_roll_is_that_of_the_events(data):
    """A DAVIS240C rolls: keypoints turn by as much against the camera as its gyro says.

    So axes, signs and unit of the reader are right; rolled the other way it is refused.
    """
    path = data / "formats" / "davis240_imu.aedat"
    recording, imu = open_recording(path), read_imu(path).imu
    assert (len(imu), recording.width) == (7384, 240)
    assert np.linalg.norm(imu.acceleration[:100], axis=1).mean() == pytest.approx(10.0, abs=0.4)
    right = attitude_of(imu)
    found = estimated(recording, right).correspondences
    left = shared_turn(found, CAMERA.focal)
    # About the optical axis nothing is left, of 29.5 deg/s; the rest is bias, usual for the chip.
    assert np.degrees(np.abs(imu.rate[:, 2].mean())) == pytest.approx(29.5, abs=0.1)
    assert np.degrees(abs(left[2])) < 1.0
    assert np.degrees(np.linalg.norm(left)) < 6.0
    seen = as_seen(found, right)
    refuse_harm(seen, imu, right, CAMERA.focal)
    R = np.diag([-1.0, 1.0, -1.0])
    with pytest.raises(InputError, match="the events contradict the gyro"):
        refuse_harm(seen, imu, attitude_of(imu, R), CAMERA.focal)


@pytest.fixture
def still(tmp_path):
    """Return a recording of jAER that stands still, with an IMU of 1 kHz."""
    words = []
    for k in range(400):
        for code, value in enumerate((0, -8192, 0, 0, 10, 0, 0)):
            words += [1 << 31 | code << 28 | (value & 0xFFFF) << 12 | 3 << 10, 1000 * k]
        words += [10 << 22 | 20 << 12 | 1 << 11, 1000 * k + 500]
    path = tmp_path / "still.aedat"
    head = b"#!AER-DAT2.0\r\n# AEChip: a.b.DAVIS240C\r\n"
    path.write_bytes(head + struct.pack(f">{len(words)}I", *words))
    return path


def test_the_command_line(run, still, tmp_path):
    camera = tmp_path / "calib.txt"
    camera.write_text("200 200 120 90 0 0 0 0 0\n")
    headings = tmp_path / "h.csv"
    asked = ("headings", still, "--camera", camera, "-o", headings)
    code, out, _ = run(*asked, "--imu", "auto")
    assert code == 3
    assert "too little is seen to tell its bias" in out
    code, _, err = run(*asked, "--imu-unit", "deg/s")
    assert (code, "--imu-unit needs an IMU" in err) == (2, True)
    late = tmp_path / "imu.csv"
    imu = imu_of(open_recording(still), "auto").imu
    rows = np.column_stack([imu.t + 5.0, imu.rate])
    np.savetxt(late, rows, delimiter=",", header="t,wx,wy,wz", comments="")
    code, out, _ = run(*asked, "--imu", late)
    assert code == 3
