"""Vehicle files: written and read again, and refused with a reason."""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.logs.vehicle_files import read_vehicle, write_vehicle
from evcalib.errors import InputError
from evcalib.kinematics import Mecanum, Omni, OmniWheel, Swerve, Wheel

SWERVE = """
type: swerve
wheels:
  fl: {x: 0.30, y: 0.25}
  fr: {x: 0.30, y: -0.25}
  rear: {x: -1, y: 0}
"""
OMNI = """
type: omni
wheels:
  a: {x: 0.2, y: 0, drive_deg: 90}
  b: {x: -0.1, y: 0.1732, drive_deg: 210}
  c: {x: -0.1, y: -0.1732, drive_deg: -30}
"""
MECANUM = "type: mecanum\nwheelbase: 0.5\ntrack: 0.4\n"


@pytest.fixture
def read(tmp_path):
    def from_text(text):
        path = tmp_path / "vehicle.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode() + b"\n")
        return read_vehicle(path)

    return from_text


def test_swerve_file(read):
    want = Swerve((Wheel("fl", 0.3, 0.25), Wheel("fr", 0.3, -0.25), Wheel("rear", -1.0, 0.0)))
    assert read(SWERVE) == want
    assert read(SWERVE + "method: average").method == "average"


def test_mecanum_file_gives_full_distances(read):
    assert read(MECANUM) == Mecanum(half_length=0.25, half_width=0.2)


def test_omni_file_gives_degrees(read):
    vehicle = read(OMNI)
    assert vehicle.names == ("a", "b", "c")
    np.testing.assert_allclose([w.drive for w in vehicle.wheels], np.radians([90, 210, -30]))


def test_a_byte_order_mark_does_no_harm(read):
    assert read(b"\xef\xbb\xbf" + MECANUM.encode()) == Mecanum(0.25, 0.2)


coordinates = st.floats(-3, 3)
lengths = st.floats(0.01, 10)


@settings(deadline=None)
@given(st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=6), lengths, lengths)
def test_files_written_are_read_as_the_same_vehicle(tmp_path_factory, places, length, width):
    path = tmp_path_factory.getbasetemp() / "vehicle_vehicle.yaml"
    vehicles = [Mecanum(length, width)]
    wheels = [Wheel(f"w{i}", *place) for i, place in enumerate(places)]
    if np.std(places, axis=0).max() > 0.01:
        vehicles += [Swerve(wheels), Swerve(wheels, "average")]
    for vehicle in vehicles:
        write_vehicle(path, vehicle)
        assert read_vehicle(path) == vehicle


def test_omni_file_written_is_read_as_the_same_vehicle(tmp_path):
    drives = (math.pi / 2, 3.7, -0.5)
    wheels = [OmniWheel(n, d, -d / 3, d) for n, d in zip("abc", drives, strict=True)]
    write_vehicle(tmp_path / "kiwi.yaml", Omni(wheels))
    again = read_vehicle(tmp_path / "kiwi.yaml")
    np.testing.assert_allclose(again.matrix, Omni(wheels).matrix, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must hold `key: value` lines"),
        ("- a\n- b\n", "must hold `key: value` lines"),
        ("wheels: {}", "there is no type; type must be one of swerve, mecanum, omni"),
        ("type: tank", "unknown type 'tank'; type must be one of swerve, mecanum, omni"),
        ("type: [swerve]", "unknown type ['swerve']"),
        ("type: swerve", "a swerve vehicle needs wheels"),
        ("type: swerve\nwheel: {}", "a swerve vehicle needs wheels, but has wheel"),
        (SWERVE + "speed: 3", "a swerve vehicle has no speed; it has type, wheels, method"),
        (SWERVE + "method: mean", "method must be one of least_squares, average, not 'mean'"),
        (SWERVE + "method: 3", "method must be least_squares or average, not 3"),
        ("type: swerve\nwheels: [fl, fr]", "wheels must hold one line per wheel"),
        (SWERVE + "  rl: {x: 1}", "wheel rl needs y"),
        (SWERVE + "  rl: {x: 1, y: 2, z: 3}", "wheel rl has no z; it has x, y"),
        (SWERVE + "  rl: 3", "wheel rl must hold x, y, not 3"),
        (SWERVE + "  rl: {x: wide, y: 2}", "x of wheel rl must be a number, not 'wide'"),
        (SWERVE + "  rl: {x: 1e-3, y: 2}", "'1e-3' (write 1.0e-3 for 1e-3)"),
        (SWERVE + "  rl: {x: yes, y: 2}", "x of wheel rl must be a number, not True"),
        (SWERVE + "  rl: {x: .nan, y: 2}", "x of wheel rl must be a finite number, not nan"),
        (SWERVE + "  rl: {x: -.inf, y: 2}", "x of wheel rl must be a finite number, not -inf"),
        (SWERVE + f"  rl: {{x: {'9' * 400}, y: 2}}", "x of wheel rl is too large"),
        (SWERVE + "  fl: {x: 1, y: 2}", "fl is given twice (line 7)"),
        (SWERVE + "  rl: {x: 1, y: 2, x: 3}", "x is given twice (line 7)"),
        (SWERVE + "  on: {x: 1, y: 2}", "wheel name True is not text for YAML"),
        (SWERVE + "  7: {x: 1, y: 2}", "wheel name 7 is not text for YAML"),
        (SWERVE + "  a b: {x: 1, y: 2}", "wheel name 'a b' must be a word"),
        ("type: swerve\nwheels: {a: {x: 1, y: 1}}", "at least 2 wheels are needed"),
        ("type: swerve\nwheels: {a: {x: 1, y: 1}, b: {x: 1, y: 1}}", "yaw rate is not observable"),
        (OMNI.replace(", drive_deg: 90", ""), "wheel a needs drive_deg"),
        (OMNI.replace("drive_deg: 90", "drive: 90"), "wheel a needs drive_deg, but has drive"),
        ("type: mecanum\nwheelbase: 1", "a mecanum vehicle needs track"),
        ("type: mecanum\nwheelbase: 1\ntrack: -1", "track must be a positive number of m"),
        ("type: swerve\nwheels: {fl: {x: 1, y", "is not YAML (line 3)"),
        ("type: mecanum\n\twheelbase: 1", "is not YAML (line 2)"),
        ("type: &a swerve\nwheels: *a", "aliases (*name) are not supported"),
        ("a: &a {b: *a}", "aliases (*name) are not supported"),
        ("type: !!bool maybe", "is not YAML"),
        ("type: 2001-99-99", "is not YAML"),
        ("type: !!python/object/apply:os.system [ls]", "is not YAML (line 1)"),
        (b"\xff\xfe\x00type", "is not a text file"),
    ],
)
def test_bad_files_are_refused_with_their_name_and_reason(read, text, message):
    with pytest.raises(InputError, match=r"vehicle\.yaml") as refusal:
        read(text)
    assert re.search(re.escape(message), str(refusal.value)), str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"cannot read .*none\.yaml: No such file"):
        read_vehicle(tmp_path / "none.yaml")


fragments = st.sampled_from(
    ["type: ", "swerve", "omni", "\n", "wheels:", "  a: ", "{x: 1, y: 2}", "x", "[", "]", "{", "}"]
    + [
        ": ",
        "&a ",
        "*a",
        "!!int ",
        "!!float ",
        "!!timestamp ",
        "- ",
        "? ",
        "|",
        "'",
        '"',
        "\t",
        "#",
    ]
)


@settings(deadline=None, max_examples=300)
@given(st.one_of(st.text(), st.lists(fragments, max_size=20).map("".join)))
def test_any_text_is_a_vehicle_or_a_clear_refusal(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any_vehicle.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        vehicle = read_vehicle(path)
    except InputError:
        return
    assert isinstance(vehicle, Swerve | Mecanum | Omni)


def test_very_deep_nesting_is_refused(read):
    with pytest.raises(InputError, match="is not YAML"):
        read("[" * 1000)
