"""Reading recordings: all events of the real files, against another library and plain NumPy.

The front (`open_recording`) checks sensor, order and types besides, and gives `Events`.
"""

import numpy as np
import pytest

from data_tools.recordings import open_recording
from data_tools.recordings.formats._evt import Evt2Decoder, Evt3Decoder
from data_tools.recordings.formats._prophesee_header import read_header

COUNTS = {"evt2.raw": 521_252, "evt3.raw": 1_218_618, "gen4.dat": 1_218_618}
DECODERS = {"evt2.raw": Evt2Decoder, "evt3.raw": Evt3Decoder}
ENCODINGS = {"evt2.raw": "evt2", "evt3.raw": "evt3", "gen4.dat": "dat"}


def front(path):
    return sum(map(len, open_recording(path)))


@pytest.mark.parametrize("name", COUNTS)
def test_front(benchmark, data, name):
    benchmark.group = name
    assert benchmark(front, data / "formats" / name) == COUNTS[name]


@pytest.mark.parametrize("name", DECODERS)
def test_decoder_alone(benchmark, data, name):
    benchmark.group = name
    path = data / "formats" / name
    words = path.read_bytes()[read_header(path).end :]
    columns = benchmark(lambda: DECODERS[name]().decode(words))
    assert columns.t.size == COUNTS[name]


@pytest.mark.parametrize("name", COUNTS)
def test_expelliarmus(benchmark, data, name):
    library = pytest.importorskip("expelliarmus")
    benchmark.group = name
    path = data / "formats" / name
    read = lambda: library.Wizard(encoding=ENCODINGS[name], fpath=str(path)).read()  # noqa: E731
    assert abs(benchmark(read).size - COUNTS[name]) < 0.01 * COUNTS[name]


def test_dat_numpy_alone(benchmark, data):
    benchmark.group = "gen4.dat"
    path = data / "formats" / "gen4.dat"

    def read():
        with path.open("rb") as file:
            file.seek(read_header(path).end + 2)
            records = np.fromfile(file, "<u4").reshape(-1, 2)
        place = records[:, 1]
        x, y = (place & 0x3FFF).astype(np.uint16), (place >> 14 & 0x3FFF).astype(np.uint16)
        return x, y, records[:, 0].astype(np.int64), (place >> 28 & 1).astype(np.bool_)

    assert benchmark(read)[0].size == COUNTS["gen4.dat"]


def test_aedat4_front(benchmark, data):
    pytest.importorskip("aedat")
    benchmark.group = "davis346.aedat4"
    assert benchmark(front, data / "formats" / "davis346.aedat4") == 78_830


def test_aedat4_library_alone(benchmark, data):
    library = pytest.importorskip("aedat")
    benchmark.group = "davis346.aedat4"

    def read():
        packets = library.Decoder(data / "formats" / "davis346.aedat4")
        return sum(packet["events"].size for packet in packets if "events" in packet)

    assert benchmark(read) == 78_830
