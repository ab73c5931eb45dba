"""What fuzzing found, each with the smallest input that shows it; all of it is fixed.

Findings that are tested elsewhere: in test_fuzz_bombs, YAML nested so deep that PyYAML's C loader
crashed the process, and definitions in bags that lack fields; in test_fuzz_flips, lines that became
comments.
"""

import pytest
from fuzz import seeds
from fuzz.targets import TARGETS, read_events

from data_tools.recordings import open_recording
from evcalib.errors import InputError


@pytest.fixture
def write(tmp_path):
    def write(content, suffix):
        path = tmp_path / f"input{suffix}"
        path.write_bytes(content)
        return path

    return write


ZIPS = {"text-zip": seeds.text_zip, "npz": seeds.npz, "authors-npz": seeds.authors_npz}


@pytest.mark.parametrize("name", ZIPS)
@pytest.mark.parametrize(
    ("at", "new"),
    [
        (6, b"\x79"),  # version 12.1 needed to extract: NotImplementedError
        (9, b"\x08\0\0"),  # names are UTF-8
        (8, b"\x01"),  # encrypted: RuntimeError
        (10, b"\x63"),  # method 99: NotImplementedError
    ],
)
def test_the_directory_of_a_zip_may_hold_anything(write, name, at, new):
    """UnicodeDecodeError and NotImplementedError in text._names and read_paired_rows."""
    content = bytearray(ZIPS[name]())
    entry = content.rindex(b"PK\x01\x02")
    content[entry + at : entry + at + len(new)] = new
    if at == 9:
        content[entry + 46] = 0xD8
    with pytest.raises(InputError):
        TARGETS[name].read(write(bytes(content), TARGETS[name].suffix))


def test_messages_are_short(write):
    """A damaged zip made zipfile quote kilobytes of it."""
    content = bytearray(seeds.npz())
    content[content.index(b"x.npy") - 4] = 0xFF  # the length of a name
    content[content.index(b"x.npy") - 3] = 0x07
    with pytest.raises(InputError) as refusal:
        read_events(write(bytes(content), ".npz"))
    assert len(str(refusal.value)) < 1000


def test_a_recording_whose_first_events_are_all_outside_the_sensor(write):
    """ValueError in Recording, or IndexError at a later piece: a piece was left empty."""
    with pytest.raises(InputError, match=r"holds no events \(1 events outside the sensor"):
        open_recording(write(b"x,y,t,p\n9,1,0.5,1\n", ".csv"), size=(8, 8))


@pytest.mark.parametrize(
    ("mark", "message"),
    [
        (b"width=8 height=8 time_unit=zs", "its time_unit is 'zs'"),  # KeyError in to_us
        ("width=\u00b2 height=8".encode(), "does not tell the sensor size"),  # int() of a digit
        (b"width=0 height=8", "width must be a whole number of 1 to 65535"),
        (b"width=999999 height=8", "width must be a whole number of 1 to 65535"),
    ],
)
def test_what_the_comment_of_a_csv_says_is_checked(write, mark, message):
    content = b"# evcalib-events " + mark + b"\nx,y,t,p\n1,1,5,1\n"
    with pytest.raises(InputError, match=message):
        open_recording(write(content, ".csv"))


@pytest.mark.parametrize("key", ["offset_observable", "rotation_observable"])
def test_a_calibration_that_was_cut_off_is_not_taken_for_a_sure_one(write, key):
    """Without its flags a calibration was taken for observable."""
    lines = seeds.calibration().splitlines(keepends=True)
    path = write(b"".join(line for line in lines if not line.startswith(key.encode())), ".yaml")
    with pytest.raises(InputError, match=f"no whole calibration.*{key}"):
        TARGETS["calibration"].read(path)


def test_a_header_of_aedat4_that_made_a_library_abort(write):
    """The library `aedat` 2.3 ended the process ("panic in a destructor") at such a description.

    It is no longer used to read; here the description of the streams is no XML.
    """
    pytest.importorskip("lz4")
    content = seeds.aedat4_made()
    path = write(content.replace(b"</dv>", b"<\x13v>"), ".aedat4")
    with pytest.raises(InputError, match="is damaged in its header"):
        open_recording(path)
    path = write(content.replace(b"<dv>", b"<!--"), ".aedat4")
    with pytest.raises(InputError, match="is damaged in its header"):
        open_recording(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,vx,vy\n0,1,0.25\n1,1,0.2", "ends within a line"),
        ("t,vx,vy\n0,1,0.25\n1,1,0.", "ends within a line"),
    ],
)
def test_a_table_that_ends_within_a_number_is_refused(write, text, message):
    """A logger that was killed wrote half a number, which was taken for the whole."""
    with pytest.raises(InputError, match=message):
        TARGETS["velocities"].read(write(text.encode(), ".csv"))


@pytest.mark.parametrize(
    ("names", "row", "count"),
    [
        ("t,p,y,x", "2.5,1,10,1", 1),  # x may have been 10
        ("x,y,p,t", "1,1,1,2.", 1),
        ("x,y,t,p", "1,1,2.5", 1),
        ("x,y,t,p", "1,1,2.5,1", 2),  # a polarity has one digit
        ("x,y,t,p", "1,1,2.5,-", 1),
        ("x,y,t,p,note", "1,1,2.5,1,wo", 2),
    ],
)
def test_events_whose_line_is_cut_are_left_out_and_counted(write, names, row, count):
    first = {"x": "3", "y": "4", "t": "1.5", "p": "1", "note": "word"}
    whole = ",".join(first[name] for name in names.split(","))
    path = write(f"{names}\n{whole}\n{row}".encode(), ".csv")
    found, losses = read_events(path, size=(64, 48))
    assert found[0].size == count
    assert losses == ({} if count == 2 else {"bytes of a cut-off last line": len(row)})
