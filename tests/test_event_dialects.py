"""Texts of events as people have them: each read as it is meant, or refused for the true reason."""

import gzip

import numpy as np
import pytest

from data_tools.recordings import open_recording
from data_tools.recordings.convert import convert
from evcalib.errors import InputError

SIZE = (640, 480)
RNG = np.random.default_rng(4)
T = np.cumsum(RNG.integers(1, 3000, 500)) + 100_000
X, Y, P = RNG.integers(0, 640, 500), RNG.integers(0, 480, 500), RNG.integers(0, 2, 500)
COLUMNS = {"t": [f"{t // 10**6}.{t % 10**6:06d}" for t in T], "x": X, "y": Y, "p": P}


def rows(order="txyp", separator=" ", **columns):
    table = zip(*({**COLUMNS, **columns}[name] for name in order), strict=True)
    return [separator.join(map(str, row)) for row in table]


def text(lines, end="\n"):
    return "".join(line + end for line in lines).encode()


def savetxt(order, separator=" "):
    numbers = {"t": T / 1e6, "x": X, "y": Y, "p": P}
    return [separator.join(f"{numbers[n][k]:.18e}" for n in order) for k in range(500)]


COMMA = [t.replace(".", ",") for t in COLUMNS["t"]]
SIGNED = np.where(P > 0, "+1", "-1")
DIALECTS = {
    "plain": text(rows()),
    "mark of UTF-8": b"\xef\xbb\xbf" + text(rows()),
    "Windows": text(rows(), "\r\n"),
    "old Mac": text(rows(), "\r"),
    "comments": text(["# what", "", "# t x y p", *rows()]),
    "tabs": text(rows(separator="\t")),
    "commas": text(rows(separator=",")),
    "semicolons": text(rows(separator=";")),
    "semicolons, decimal commas": text(rows(separator=";", t=COMMA)),
    "blanks, decimal commas": text(rows(t=COMMA)),
    "x y t p": text(rows("xytp")),
    "x,y,p,t": text(rows("xypt", ",")),
    "signs": text(rows(p=SIGNED)),
    "savetxt": text(savetxt("txyp")),
    "savetxt x y t p": text(savetxt("xytp", ",")),
    "header": text(["t,x,y,p", *rows(separator=",")]),
    "header of blanks": text(["x y t p", *rows("xytp")]),
    "header, mark of UTF-8, Windows": b"\xef\xbb\xbf"
    + text(["p;t;x;y", *rows("ptxy", ";")], "\r\n"),
    "header, old Mac": text(["timestamp\tx\ty\tpolarity", *rows(separator="\t")], "\r"),
    "header, decimal commas": text(["y;x;t;p", *rows("yxtp", ";", t=COMMA)]),
    "header, quotes": text(['"t","x","y","p"', *rows(separator=",")]),
    "header, savetxt": text(["t,x,y,p", *savetxt("txyp", ",")]),
}


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("name", DIALECTS)
def test_dialects_are_read_alike(tmp_path, name, packed):
    content = DIALECTS[name]
    (tmp_path / "e").write_bytes(gzip.compress(content) if packed else content)
    recording = open_recording(tmp_path / "e", size=SIZE)
    pieces = list(recording)
    for key, wanted in zip("xytp", (X, Y, T, P == 1), strict=True):
        found = np.concatenate([getattr(piece, key) for piece in pieces])
        np.testing.assert_array_equal(found, wanted)
    told = [note for note in recording.notes if "the columns were taken as" in note]
    assert bool(told) is not name.startswith("header")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (text(rows()).decode().encode("utf-16"), "UTF-16; save it as UTF-8"),
        (text(rows("xytp", t=T)), "say its unit|say time_unit='us'|say their unit"),
        (text([*rows(), "nan 3 4 1"]), "line 501: four numbers t x y p are needed: 'nan 3 4 1'"),
        (text(["t,x,y,p", *rows(separator=","), "nan,3,4,1"]), "nan"),
        (text(["t,x,y,p", *rows(separator=","), "1.5,nan,4,1"]), "nan"),
        (
            text(["t,x,y,p", *rows(separator=","), "1.5,,4,1"]),
            "line 502, column 2: '' is no number",
        ),
        (text([*rows(), "1.5 3 4"]), "line 501: four numbers"),
        (text(rows(p=P + 1)), "polarity must be 0 or 1"),
        (text(["1 2 3 4 5"]), "line 1: four numbers"),
    ],
)
def test_what_cannot_be_read_is_refused_for_the_true_reason(tmp_path, content, words):
    (tmp_path / "e").write_bytes(content)
    with pytest.raises(InputError, match=words):
        list(open_recording(tmp_path / "e", size=SIZE))


def test_a_table_whose_header_or_commas_mislead_is_told_what_is_wrong(tmp_path):
    path = tmp_path / "e.csv"
    path.write_bytes(text(["t|x|y|p", *rows(separator="|")]))
    with pytest.raises(InputError, match=r"its first line must name .* not 't\|x\|y\|p'"):
        open_recording(path, size=SIZE)
    path.write_bytes(text(["stamp,x,y,p", *rows(separator=",")]))
    with pytest.raises(InputError, match=r"must name the columns x, y, t and p.*'stamp,x,y,p'"):
        open_recording(path, size=SIZE)
    path.write_bytes(text(["t,x,y,p", *rows(separator=",", t=COMMA)]))
    with pytest.raises(InputError, match="first row has 5 values: decimal commas between commas"):
        open_recording(path, size=SIZE)
    path.write_bytes(text(["t,x,y,p", *(row + "," for row in rows(separator=","))]))
    assert sum(map(len, open_recording(path, size=SIZE))) == 500


@pytest.mark.parametrize("end", [".csv", ".txt"])
def test_what_convert_wrote_is_read_back_as_it_is(tmp_path, end):
    (tmp_path / "e").write_bytes(DIALECTS["plain"])
    recording = open_recording(tmp_path / "e", size=SIZE)
    convert(recording, tmp_path / f"c.{end}")
    again = open_recording(tmp_path / f"c.{end}")
    assert again.shape == recording.shape
    assert [piece.t.tolist() for piece in again] == [T.tolist()]
    with pytest.raises(InputError, match="640x480 px, not of 240x180"):
        open_recording(tmp_path / f"c.{end}", size=(240, 180))


HABITS = {
    "size first": (text(["640 480", *rows()]), {}, "640 480, was taken for the size"),
    "size first, commas": (text(["# e2vid", "640,480", *rows(separator=",")]), {}, "640,480, was"),
    "Metavision": (text(["%geometry:640,480", *rows("xypt", ",", t=T)]), {}, "taken as x y p t"),
    "Metavision with %": (
        text(["%camera 3", "%geometry: 640x480", "% end", *rows("xypt", ",", t=T)]),
        {},
        "taken as x y p t",
    ),
    "slashes": (text(["// t x y p", *rows()]), {"size": SIZE}, "taken as t x y p"),
    "words": (
        text(["t,x,y,on", *rows(separator=",", p=np.where(P, "True", "False"))]),
        {"size": SIZE},
        "",
    ),
    "on and off": (
        text(["t;x;y;p", *rows(separator=";", p=np.where(P, "ON", "off"))]),
        {"size": SIZE},
        "",
    ),
    "units": (text(["t [us],x [px],y (px),p", *rows(separator=",", t=T)]), {"size": SIZE}, ""),
    "faery": (
        text(["t,x,y,on", *rows(separator=",", t=T)]),
        {"size": SIZE, "time_unit": "us"},
        "",
    ),
    "v2e": (
        text(["#!events.txt", "# Format is time (s), x, y, polarity (0=off, 1=on)", *rows()]),
        {"size": SIZE},
        "taken as t x y p",
    ),
}


@pytest.mark.parametrize("name", HABITS)
def test_heads_and_words_of_other_programs(tmp_path, name):
    content, options, told = HABITS[name]
    (tmp_path / "e").write_bytes(content)
    recording = open_recording(tmp_path / "e", **options)
    assert (recording.width, recording.height) == SIZE
    pieces = list(recording)
    for key, wanted in zip("xytp", (X, Y, T, P == 1), strict=True):
        found = np.concatenate([getattr(piece, key) for piece in pieces])
        np.testing.assert_array_equal(found, wanted)
    assert any(told in note for note in recording.notes) or not told


def test_a_size_that_a_text_tells_is_not_contradicted(tmp_path):
    (tmp_path / "e").write_bytes(HABITS["Metavision"][0])
    with pytest.raises(InputError, match="of a sensor of 640x480 px, not of 346x260"):
        open_recording(tmp_path / "e", size=(346, 260))
    with pytest.raises(InputError, match="its times are in us, as it says itself, not in ms"):
        open_recording(tmp_path / "e", time_unit="ms")


def test_words_that_are_no_numbers_are_named_with_their_place(tmp_path):
    (tmp_path / "e").write_bytes(text(["t,x,y,p", *rows(separator=",")[:3], "0.5,12,high,1"]))
    with pytest.raises(InputError, match=r"line 5, column 3: 'high' is no number"):
        list(open_recording(tmp_path / "e", size=SIZE))
