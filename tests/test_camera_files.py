"""Camera files of every layout, each written by hand; bad ones; the real ones."""

import json

import cv2
import numpy as np
import pytest

from data_tools.logs.camera_files import (
    OFF_CENTRE,
    read_calib_txt,
    read_camchain,
    read_camera,
    read_camera_file,
)
from data_tools.runs.headings import open_with_camera
from evcalib.camera import Camera
from evcalib.errors import InputError

RADTAN = Camera(240, 180, 199.5, 198.25, 132.0, 110.5, (-0.37, 0.15, 0.001, -0.002, 0.03))
PLAIN = Camera(240, 180, 199.5, 198.25, 132.0, 110.5)
FOUR = Camera(240, 180, 199.5, 198.25, 132.0, 110.5, (-0.37, 0.15, 0.001, -0.002))
FISHEYE = Camera(240, 180, 199.5, 198.25, 132.0, 110.5, (-0.02, 0.01, -0.003, 0.001), "fisheye")

K = "[199.5, 0.0, 132.0, 0.0, 198.25, 110.5, 0.0, 0.0, 1.0]"
ROS = f"""\
image_width: 240
image_height: 180
camera_name: davis
camera_matrix:
  rows: 3
  cols: 3
  data: {K}
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.37, 0.15, 0.001, -0.002, 0.03]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [150, 0, 120, 0, 0, 150, 90, 0, 0, 0, 1, 0]
"""
ECHO = f"""\
header:
  seq: 3
  frame_id: "davis"
height: 180
width: 240
distortion_model: "equidistant"
D: [-0.02, 0.01, -0.003, 0.001]
K: {K}
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [150.0, 0.0, 120.0, 0.0, 0.0, 150.0, 90.0, 0.0, 0.0, 0.0, 1.0, 0.0]
roi:
  height: 0
  width: 0
---
"""
OPENCV = f"""\
%YAML:1.0
---
calibration_time: "Mon 02 Mar 2020 10:11:12"
image_Width: 240
image_Height: 180
Camera_Matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: {K}
Distortion_Coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -3.7e-01, 1.5e-01, 1e-03, -2e-03, 3.0e-02 ]
"""
DV_XML = """\
<?xml version="1.0"?>
<opencv_storage>
<DAVIS346_00000132>
  <camera_matrix type_id="opencv-matrix">
    <rows>3</rows>
    <cols>3</cols>
    <dt>d</dt>
    <data>
      199.5 0. 132. 0. 198.25
      110.5 0. 0. 1.</data></camera_matrix>
  <distortion_coefficients type_id="opencv-matrix">
    <rows>1</rows>
    <cols>5</cols>
    <dt>d</dt>
    <data>
      -3.7e-01 1.5e-01 1e-03 -2e-03 3e-02</data></distortion_coefficients>
  <image_width>240</image_width>
  <image_height>180</image_height></DAVIS346_00000132>
<use_fisheye_model>0</use_fisheye_model>
<type>camera</type>
<pattern_width>9</pattern_width>
</opencv_storage>
"""
DV_JSON = json.dumps(
    {
        "version": "2.0",
        "cameras": {
            "C0": {
                "name": "DVXplorer",
                "resolution": ["240", "180"],
                "principalPoint": ["132", "110.5"],
                "focalLength": ["199.5", "198.25"],
                "distortionCoefficients": ["-0.37", "0.15", "0.001", "-0.002", "0.03"],
                "distortionModel": "radialTangential",
            }
        },
        "imus": {"S0": {"name": "DVXplorer", "omegaMax": "0.1"}},
    },
    indent="\t",
)
METAVISION = json.dumps(
    {
        "type": "PINHOLE",
        "img_size": [240, 180],
        "K": [199.5, 0, 132, 0, 198.25, 110.5, 0, 0, 1],
        "D": [-0.37, 0.15, 0.001, -0.002, 0.03],
    }
)
TUM_VIE = {
    "value0": {
        "T_imu_cam": [{"px": 0.1, "qw": 1}],
        "intrinsics": [
            {
                "camera_type": "kb4",
                "intrinsics": {
                    **{"fx": 199.5, "fy": 198.25, "cx": 132, "cy": 110.5},
                    **{"k1": -0.02, "k2": 0.01, "k3": -0.003, "k4": 0.001},
                },
            }
        ],
        "resolution": [[240, 180]],
        "mocap_time_offset_ns": 0,
    }
}
CAMCHAIN = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.37, 0.15, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [199.5, 198.25, 132.0, 110.5]
  resolution: [240, 180]
  rostopic: /dvs/image_raw
"""
SECOND = """\
cam1:
  camera_model: pinhole
  distortion_coeffs: [-0.02, 0.01, -0.003, 0.001]
  distortion_model: equidistant
  intrinsics: [190.0, 191.0, 318.0, 242.0]
  resolution: [640, 480]
"""
DSEC = """\
intrinsics:
  cam0:
    camera_matrix: [199.5, 198.25, 132.0, 110.5]
    camera_model: pinhole
    distortion_coeffs: [-0.37, 0.15, 0.001, -0.002]
    distortion_model: radtan
    resolution: [240, 180]
  camRect1:
    camera_matrix: [1150.0, 1150.0, 720.0, 540.0]
    resolution: [1440, 1080]
extrinsics:
  T_10: [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""
VINS = """\
%YAML:1.0
---
model_type: PINHOLE
camera_name: davis
image_width: 240
image_height: 180
distortion_parameters:
   k1: -0.37
   k2: 0.15
   p1: 0.001
   p2: -0.002
projection_parameters:
   fx: 199.5
   fy: 198.25
   cx: 132.0
   cy: 110.5
"""
CAMODOCAL = """\
%YAML:1.0
model_type: KANNALA_BRANDT
image_width: 240
image_height: 180
projection_parameters:
  {k2: -0.02, k3: 0.01, k4: -0.003, k5: 0.001, mu: 199.5, mv: 198.25, u0: 132, v0: 110.5}
"""
VIKIT = """\
cam0:
  cam_model: PinholeEquidistant
  cam_width: 240
  cam_height: 180
  cam_fx: 199.5
  cam_fy: 198.25
  cam_cx: 132
  cam_cy: 110.5
  cam_d0: -0.02
  cam_d1: 0.01
  cam_d2: -0.003
  cam_d3: 0.001
  T_cam_base: {tx: 0.1, qw: 1}
"""
IKALIBR = """\
Intrinsics:
  polymorphic_name: pinhole_brown_t2
  ptr_wrapper:
    id: 2147483649
    data:
      img_width: 240
      img_height: 180
      focal_length: [199.5, 198.25]
      principal_point: [132, 110.5]
      disto_param: [-0.37, 0.15, 0.03, 0.001, -0.002]
"""
ORB_SLAM = """\
%YAML:1.0
Camera.type: "PinHole"
Camera.fx: 199.5
Camera.fy: 198.25
Camera.cx: 132.0
Camera.cy: 110.5
Camera.k1: -0.37
Camera.k2: 0.15
Camera.p1: 0.001
Camera.p2: -0.002
Camera.k3: 0.03
Camera.width: 240
Camera.height: 180
ORBextractor.nFeatures: 1000
"""
SVO = """\
label: stereo
cameras:
- camera:
    label: left
    type: pinhole
    image_width: 240
    image_height: 180
    intrinsics: {cols: 1, rows: 4, data: [199.5, 198.25, 132.0, 110.5]}
    distortion:
      type: equidistant
      parameters: {cols: 1, rows: 4, data: [-0.02, 0.01, -0.003, 0.001]}
"""
LINE = "199.5 198.25 132 110.5 -0.37 0.15 0.001 -0.002 0.03\n"
LAYOUTS = {
    "calib.txt": (LINE, RADTAN),
    "calib.txt-without-k3": ("199.5 198.25 132 110.5 -0.37 0.15 0.001 -0.002\n", FOUR),
    "calib.txt-without-distortion": ("# fx fy cx cy\n199.5, 198.25, 132, 110.5\n", PLAIN),
    "calib.txt-with-size": (LINE + "240 180\n", RADTAN),
    "matrix": ("199.5 0 132\n0 198.25 110.5\n0 0 1\n-0.37 0.15 0.001 -0.002 0.03\n", RADTAN),
    "ros": (ROS, RADTAN),
    "ros-echo": (ECHO, FISHEYE),
    "ros-rational-of-zeros": (
        ROS.replace("plumb_bob", "rational_polynomial").replace("0.03]", "0.03, 0, 0, 0]"),
        RADTAN,
    ),
    "opencv": (OPENCV, RADTAN),
    "dv-xml": (DV_XML, RADTAN),
    "dv-json": (DV_JSON, RADTAN),
    "metavision": (METAVISION, RADTAN),
    "tum-vie": (json.dumps(TUM_VIE), FISHEYE),
    "kalibr": (CAMCHAIN, FOUR),
    "openvins": ("%YAML:1.0 # need to specify the file type at the top!\n\n" + CAMCHAIN, FOUR),
    "dsec": (DSEC, FOUR),
    "vins": (VINS, FOUR),
    "camodocal": (CAMODOCAL, FISHEYE),
    "vikit": (VIKIT, FISHEYE),
    "ikalibr": (IKALIBR, RADTAN),
    "orb-slam": (ORB_SLAM, RADTAN),
    "svo": (SVO, FISHEYE),
}


@pytest.fixture
def write(tmp_path):
    def write(text, name="camera.any"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_gives_the_same_camera(write, name):
    text, expected = LAYOUTS[name]
    assert read_camera(write(text), 240, 180) == expected


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_files_that_opencv_wrote(tmp_path, suffix):
    path = tmp_path / f"camera{suffix}"
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    store.write("image_width", 240)
    store.write("image_height", 180)
    store.write("camera_matrix", RADTAN.matrix)
    store.write("distortion_coefficients", np.array([RADTAN.distortion]))
    store.release()
    assert read_camera(path) == RADTAN


def test_what_dv_says_beside_its_cameras_holds_for_them(write):
    fisheye = DV_XML.replace("-2e-03 3e-02", "-2e-03")
    told = Camera(*(240, 180, 199.5, 198.25, 132, 110.5), (-0.37, 0.15, 0.001, -0.002), "fisheye")
    for old, new in (
        ("model>0<", "model>1<"),
        ("<type>", "<distortion_model>Equidistant</distortion_model><type>"),
    ):
        assert read_camera(write(fisheye.replace(old, new))) == told
    with pytest.raises(InputError, match="model 'fov'"):
        read_camera(
            write(fisheye.replace("<type>", "<distortion_model>FOV</distortion_model><type>"))
        )


def test_of_several_cameras_the_only_one_of_the_size_or_the_named_one_is_taken(write):
    path = write(CAMCHAIN + SECOND)
    assert read_camera(path, 240, 180) == FOUR
    assert read_camera(path, name="cam0") == FOUR
    assert read_camera(path, 640, 480).model == "fisheye"
    assert read_camera(path, name="cam1").width == 640
    with pytest.raises(
        InputError, match=r"several cameras: cam0 \(240x180\), cam1 \(640x480\); say"
    ):
        read_camera(path)
    with pytest.raises(InputError, match=r"no camera for 346x260 px: cam0 \(240x180\)"):
        read_camera(path, 346, 260)
    with pytest.raises(InputError, match="no camera cam2, but cam0, cam1"):
        read_camera(path, name="cam2")
    with pytest.raises(InputError, match="cam1: the camera is calibrated for 640x480"):
        read_camera(path, 240, 180, name="cam1")
    twins = write(CAMCHAIN + CAMCHAIN.replace("cam0", "cam1"))
    with pytest.raises(InputError, match=r"cameras for 240x180 px: cam0 .*, cam1 .*--camera-name"):
        read_camera(twins, 240, 180)
    other = CAMCHAIN.replace("cam0", "cam1").replace("pinhole", "omni")
    assert read_camera(write(CAMCHAIN + other), 240, 180) == FOUR
    with pytest.raises(InputError, match="cam1: camera_model 'omni' is not supported"):
        read_camera(write(CAMCHAIN + other), 240, 180, name="cam1")


def test_stereo_files_of_opencv_hold_two(write):
    text = "".join(f"M{k}:\n   data: {K}\nD{k}:\n   data: [0.1, 0, 0, 0]\n" for k in (1, 2))
    assert list(read_camera_file(write("%YAML:1.0\n---\n" + text)).cameras) == ["cam1", "cam2"]


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("kalibr", "camera_model: pinhole", "camera_model: ds", "only pinhole"),
        ("kalibr", "radtan", "fov", "model 'fov'; radial-tangential .* are supported"),
        ("kalibr", "  resolution: [240, 180]\n", "", "misses resolution"),
        (
            "kalibr",
            "  distortion_coeffs: [-0.37, 0.15, 0.001, -0.002]\n",
            "",
            "misses distortion_co",
        ),
        ("kalibr", "  distortion_model: radtan\n", "", "but no distortion_model"),
        ("kalibr", "[240, 180]", "[240]", "must be a list of 2"),
        ("kalibr", "[240, 180]", "[240.5, 180]", "two whole numbers"),
        ("kalibr", "[199.5, 198.25, 132.0, 110.5]", "[a, 1, 2, 3]", "intrinsics must be numbers"),
        ("kalibr", "132.0", ".nan", "intrinsics must be numbers"),
        ("kalibr", "132.0", "332.0", "another resolution"),
        ("kalibr", "cam0:", "cam0: [", "is not YAML"),
        ("ros", "plumb_bob", "rational_polynomial", None),
        ("ros", "0.03]", "0.03, 0.1, 0, 0]", "rational or thin-prism"),
        ("ros", "plumb_bob", "omni", "model 'omni'"),
        ("ros", "[199.5, 0.0", "[199.5, 3.0", "skew of 3"),
        ("ros", "[199.5, 0.0", "[199.5", "8 numbers, not 9"),
        ("ros", "0.0, 198.25", "1.0, 198.25", "no .fx 0 cx"),
        ("ros", "image_width: 240\n", "image_width: many\n", "the size must be numbers"),
        ("dv-json", '"198.25"', '"x"', "focalLength must be numbers"),
        ("dv-xml", "<?xml", "<!DOCTYPE a [<!ENTITY b 'c'>]><?xml", "document type|not XML"),
        (
            "dv-xml",
            "<opencv_storage>",
            "<!DOCTYPE a [<!ENTITY b 'c'>]><opencv_storage>",
            "document",
        ),
        ("dv-xml", "</opencv_storage>", "", "it is not XML"),
        ("dv-xml", "<type>", "<use_fisheye_model>1</use_fisheye_model><type>", "given twice"),
        ("tum-vie", "kb4", "ds", "model 'ds'"),
        ("tum-vie", '"fx"', '"f"', "misses fx"),
        ("camodocal", "KANNALA_BRANDT", "MEI", "model 'mei'"),
        ("vikit", "PinholeEquidistant", "ATAN", "model 'atan'"),
        ("vikit", "cam_fy: 198.25", "cam_f: 1", "misses camfy"),
        ("ikalibr", "focal_length", "length", "misses focal_length"),
        ("svo", "type: pinhole", "type: omni", "only pinhole"),
        ("calib.txt", LINE, "", "holds 0 numbers"),
        ("calib.txt", LINE, "1 2 3\n", "holds 3 numbers"),
        ("calib.txt", "132 110.5", "x 110.5", "not a line of numbers"),
        ("calib.txt", "132 110.5", "420 110.5", "another resolution"),
        ("calib.txt", "199.5", "-199.5", "fx must be a positive"),
        ("calib.txt", "\n", "", "ends within a line"),
        ("calib.txt-with-size", "240 180", "346 260", "calibrated for 346x260 pixels, the events"),
        ("matrix", "0.03\n", "0.03 1 2\n", "7 numbers follow its matrix"),
    ],
)
def test_bad_cameras_are_refused_for_what_is_wrong(write, name, old, new, message):
    text = LAYOUTS[name][0]
    assert old in text
    path = write(text.replace(old, new, 1))
    if message is None:
        read_camera(path)
        return
    with pytest.raises(InputError, match=message) as refusal:
        read_camera(path, 240, 180)
    assert str(path) in str(refusal.value)


def test_a_file_without_a_camera_says_what_it_holds(write):
    with pytest.raises(
        InputError, match=r"holds no camera in a form that is known .* but calib_imu, td"
    ):
        read_camera(write("calib_imu: true\ntd: 1.5\n"))
    with pytest.raises(InputError, match="holds no camera"):
        read_camera(write("just a word\n"))


def test_sizes_come_from_the_file_or_the_caller(write, tmp_path):
    with pytest.raises(InputError, match="give width and height"):
        read_camera(write(LINE))
    with pytest.raises(InputError, match="cannot read"):
        read_camera(tmp_path / "missing", 240, 180)
    assert read_calib_txt(write(LINE), 240, 180) == RADTAN
    assert read_camchain(write(CAMCHAIN)) == FOUR
    assert read_camera_file(write(CAMCHAIN + SECOND)).size() is None
    assert read_camera_file(write(CAMCHAIN + SECOND)).size("cam1") == (640, 480)


@pytest.mark.parametrize("focal", ["0.83", "0.004", "23.9", "24001"])
def test_focal_lengths_in_another_unit_are_refused(write, focal):
    with pytest.raises(InputError, match=f"focal length of {focal} pixels .*not in mm, or as a sh"):
        read_camera(write(f"{focal} {focal} 120 90\n"), 240, 180)


def test_a_name_is_not_asked_for_where_none_fits(write):
    with pytest.raises(InputError, match=r"no camera for 346x260 px: .*; is it the right file\?$"):
        read_camera_file(write(CAMCHAIN + SECOND)).choose(346, 260)


def test_what_may_be_wrong_with_a_camera_is_told(write):
    half = CAMCHAIN.replace("132.0, 110.5", "60.0, 45.0")
    camera, notes = read_camera_file(write(half)).choose(240, 180)
    assert camera.cx == 60
    assert "the principal point (60, 45) is far from the centre of 240x180 pixels" in notes[0]
    assert read_camera_file(write(CAMCHAIN)).choose()[1] == ()
    panorama = write("199.5 0 132\n0 198.25 110.5\n0 0 1\n800\n400\n-0.37\n")
    camera, notes = read_camera_file(panorama).choose(240, 180)
    assert camera.distortion == (-0.37, 0, 0, 0)
    assert "800 and 400 were taken for the size of a panorama" in notes[0]


def test_a_camera_that_is_cut_off_before_its_distortion_is_none_without(write):
    start = ROS.index("distortion_coefficients")
    for text in (ROS[:start], ROS[: start + 35]):
        with pytest.raises(InputError, match=r"misses the (coefficients of its )?distortion"):
            read_camera(write(text))
    camera, notes = read_camera_file(write(OPENCV[: OPENCV.index("Distortion")])).choose()
    assert camera == PLAIN
    assert "says nothing of distortion" in notes[0]
    assert read_camera(write(ROS.replace("[-0.37, 0.15, 0.001, -0.002, 0.03]", "[]"))) == PLAIN


def test_a_last_number_that_may_be_cut_off_is_told_where_the_camera_hangs_on_it(write):
    block = IKALIBR.replace("[-0.37, 0.15, 0.03, 0.001, -0.002]\n", "")
    block += "".join(f"\n        - {k}" for k in (-0.37, 0.15, 0.03, 0.001, -0.002))
    camera, notes = read_camera_file(write(block)).choose()
    assert camera == RADTAN
    assert "the last line is not ended" in notes[0]
    assert read_camera_file(write(block + "\n")).choose()[1] == ()
    assert read_camera_file(write(CAMCHAIN + "T_cam_imu: 0.712903")).choose()[1] == ()


def test_a_recording_takes_the_camera_of_its_size_and_its_notes(write, tmp_path):
    events = tmp_path / "events.csv"
    events.write_text("# evcalib-events width=240 height=180 time_unit=us\nx,y,t,p\n1,2,3,1\n")
    chain = write(CAMCHAIN + SECOND)
    assert open_with_camera(events, chain)[1] == FOUR
    with pytest.raises(InputError, match="calibrated for 640x480 pixels, the events have 240x180"):
        open_with_camera(events, write(SECOND))
    half = write((CAMCHAIN + CAMCHAIN.replace("cam0", "cam1")).replace("132.0, 110.5", "60, 45"))
    with pytest.raises(InputError, match="say which with --camera-name"):
        open_with_camera(events, half)
    recording, _ = open_with_camera(events, half, camera_name="cam1")
    list(recording)
    assert "far from the centre" in recording.notes[-1]
    unsized = tmp_path / "events.txt"
    unsized.write_text("0.5 1 2 1\n")
    assert open_with_camera(unsized, write(CAMCHAIN))[0].width == 240
    chain = write(CAMCHAIN + SECOND)
    assert open_with_camera(unsized, chain, camera_name="cam1")[0].width == 640
    assert open_with_camera(unsized, chain, size="640x480")[1].width == 640
    with pytest.raises(InputError, match="does not tell the sensor size"):
        open_with_camera(unsized, chain)


def test_calib_txt_of_the_slider(data):
    camera = read_camera(data / "slider_depth" / "calib.txt", 240, 180)
    assert (camera.fx, camera.cy, camera.distortion[0]) == (
        335.419462958,
        99.1864303447,
        -0.138592767408,
    )
    x, y = np.meshgrid(np.arange(0, 240, 7.5), np.arange(0, 180, 7.5))
    pixels = np.column_stack((x.ravel(), y.ravel()))
    np.testing.assert_allclose(camera.project(camera.bearings(pixels)), pixels, rtol=0, atol=1e-9)


WITHOUT = ("DEIO__config_davis240c.yaml", "EvMultiCalib__config_calib_params.yaml", "SOURCES.tsv")
"""Of the real files, those of settings, and the list of sources: they hold no camera."""


def test_all_real_files_are_read_or_hold_no_camera(data):
    paths = sorted((data / "cameras").iterdir())
    assert len(paths) == 26
    for path in (path for path in paths if path.name in WITHOUT):
        with pytest.raises(InputError, match="holds no camera"):
            read_camera_file(path)
    found = {p.name: read_camera_file(p).cameras for p in paths if p.name not in WITHOUT}
    broken = [
        one for cameras in found.values() for one in cameras.values() if isinstance(one, InputError)
    ]
    assert not broken
    several = {name for name, cameras in found.items() if len(cameras) > 1}
    assert {name.split("__")[0] for name in several} == {
        "ES-PTAM",
        "Event_based_VO-VIO-SLAM",
        "neuromorphic-data-gathering",
    }
    ikalibr = next(one for name, one in found.items() if name.startswith("iKalibr"))
    same = next(one for name, one in found.items() if name.startswith("mpl_calib"))
    (left,), (right,) = ikalibr.values(), same.values()
    assert (left.focal, left.distortion, left.size) == (right.focal, right.distortion, right.size)


def test_real_principal_points_are_not_called_far(data):
    """Most are within 0.06 of the centre; the farthest has a fit of 0.19 px to its chessboards."""
    paths = [path for path in (data / "cameras").iterdir() if path.name not in WITHOUT]
    every = [one for path in paths for one in read_camera_file(path).cameras.values()]
    sized = [one for one in every if one.size is not None]
    off = [shares(one, one.size) for one in sized]
    assert len(off) == 21
    assert np.median(off) < 0.06
    tilt = read_camera_file(data / "rotation" / "evbench" / "calib.txt").cameras["camera"]
    off.append(shares(tilt, (240, 180)))
    assert 0.15 < max(off) < OFF_CENTRE
    larger = [one for one in sized if one.size == (346, 260)]
    assert all(shares(one, (240, 180)) > OFF_CENTRE for one in larger)
    assert len(larger) == 7


def shares(one, size):
    centre = np.array(one.focal[2:])
    return np.abs((centre - (np.array(size) - 1) / 2) / size).max()
