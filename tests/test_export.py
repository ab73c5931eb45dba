"""Exports: what each file says, checked against scipy and by reading it back."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from data_tools.runs import export
from evcalib.errors import InputError

seeds = st.integers(0, 2**32 - 1)


def stored(seed):
    rng = np.random.default_rng(seed)
    R, offset, place = (
        Rotation.random(None, rng).as_matrix(),
        float(rng.normal()),
        rng.normal(size=3),
    )
    return export.StoredCalibration(R, offset, position=tuple(map(float, place)))


@pytest.mark.parametrize("form", export.FORMATS)
@given(seed=seeds)
@settings(deadline=None, max_examples=30)
def test_what_is_exported_reads_back(tmp_path_factory, form, seed):
    path = tmp_path_factory.mktemp("x") / "file"
    wrote = stored(seed)
    path.write_text(export.export(wrote, form))
    read = export.read_export(path, form)
    np.testing.assert_allclose(read.R_body_cam, wrote.R_body_cam, atol=1e-14)
    assert read.offset == wrote.offset
    np.testing.assert_allclose(read.position, wrote.position, atol=1e-14)


def test_kalibr_holds_the_inverse_rotation():
    calibration = stored(1)
    camera = yaml.safe_load(export.export(calibration, "kalibr"))["cam0"]
    T = np.array(camera["T_cam_imu"])
    np.testing.assert_array_equal(T[:3, :3], calibration.R_body_cam.T)
    # The camera's own place is its origin.
    np.testing.assert_allclose(T @ [*calibration.position, 1.0], [0, 0, 0, 1], atol=1e-14)
    assert camera["T_cam_imu"][3] == [0, 0, 0, 1]


def test_tf_holds_the_quaternion_of_the_camera_in_the_body():
    calibration = stored(2)
    found = yaml.safe_load(export.export(calibration, "ros-tf"))
    turn = Rotation.from_quat(found["rotation_xyzw"]).as_matrix()
    np.testing.assert_allclose(turn, calibration.R_body_cam, atol=1e-14)
    assert found["translation"] == list(calibration.position)
    assert (found["frame_id"], found["child_frame_id"]) == ("base_link", "camera_optical_frame")


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2])
def test_urdf_angles_are_fixed_axis_roll_pitch_yaw(pitch):
    R = Rotation.from_euler("xyz", [0.7, pitch, -2.0]).as_matrix()
    text = export.export(export.StoredCalibration(R, 0.0), "urdf")
    angles = [float(x) for x in text.split('rpy="')[1].split('"')[0].split()]
    np.testing.assert_allclose(Rotation.from_euler("xyz", angles).as_matrix(), R, atol=1e-9)


@pytest.mark.parametrize("form", export.FORMATS)
def test_every_file_states_its_direction_and_what_is_known_of_the_position(tmp_path, form):
    calibration = replace(stored(3), position=(0.2, np.nan, 0.8), position_sd=(0.004, np.inf))
    text = export.export(calibration, form)
    (tmp_path / "file").write_text(text)
    read = export.read_export(tmp_path / "file", form)
    np.testing.assert_allclose(read.position, (0.2, 0.0, 0.8), atol=1e-14)
    said = " ".join(text.replace("#", " ").split())
    assert "p_cam = T_cam_imu p_body" in said or "p_body = R p_cam" in said
    assert "x is found to 4.0 mm (sd), y is not observed and written as zero, z is as given" in said
    assert "t_body = t_cam +" in said


REST = "\noffset_s: 0\noffset_observable: true\nrotation_observable: true\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "needs the keys"),
        ("R_body_cam: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]" + REST, "must be a 3 x 3 rotation"),
        ("R_body_cam: [[2, 0, 0], [0, 1, 0], [0, 0, 1]]" + REST, "must be a 3 x 3 rotation"),
        ("R_body_cam: [[1, 0], [0, 1]]" + REST, "must be a 3 x 3 rotation"),
        ("R_body_cam: text" + REST, "must be numbers"),
        ("R_body_cam: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\noffset_s: 0\n", "no whole calibration"),
        (
            "R_body_cam: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]" + REST + "position_m: [0, 1]",
            "three numbers or null",
        ),
        ("a: [", "is not YAML"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused(tmp_path, text, message):
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        export.read_calibration(tmp_path / "c.yaml")


def test_an_unknown_form_is_refused():
    with pytest.raises(InputError, match="one of kalibr, ros-tf, urdf"):
        export.export(stored(1), "xml")
