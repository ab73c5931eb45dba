"""Data sets of others: fetched once, checked by hash, from a server on this machine."""

import hashlib
import http.server
import threading
from functools import partial

import pytest

from data_tools.files import datasets
from data_tools.logs.series_files import read_paired_streams
from evcalib.errors import InputError


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *args):
        pass


@pytest.fixture
def served(tmp_path, monkeypatch):
    """Serve a data set of two files; yield its folder on the server."""
    folder = tmp_path / "server"
    folder.mkdir()
    hashes = {}
    for name in ("a.bin", "b.bin"):
        (folder / name).write_bytes(name.encode() * 100)
        hashes[name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=folder))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    base = f"http://127.0.0.1:{server.server_address[1]}/"
    monkeypatch.setitem(datasets.DATA_SETS, "tiny", datasets.DataSet(base, hashes))
    yield folder
    server.shutdown()
    server.server_close()
    thread.join()


def test_files_are_fetched_once_and_then_serve_alone(served, tmp_path):
    place = tmp_path / "kept"
    assert datasets.fetch("tiny", folder=place) == place
    assert sorted(path.name for path in place.iterdir()) == ["a.bin", "b.bin"]
    assert (place / "a.bin").read_bytes() == (served / "a.bin").read_bytes()
    for path in served.iterdir():
        path.unlink()
    assert datasets.fetch("tiny", folder=place) == place
    (place / "b.bin").unlink()
    with pytest.raises(InputError, match=r"cannot fetch b\.bin from http://.* put the file into"):
        datasets.fetch("tiny", folder=place)


def test_files_that_are_not_what_they_should_be_are_refused(served, tmp_path):
    (served / "a.bin").write_bytes(b"another")
    with pytest.raises(InputError, match=r"cannot fetch a\.bin.*[Hh]ash"):
        datasets.fetch("tiny", folder=tmp_path / "kept")
    assert not (tmp_path / "kept" / "a.bin").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.bin").write_bytes(b"mine")
    with pytest.raises(InputError, match=r"is not the file of the data set: its sha256 is"):
        datasets.fetch("tiny", folder=tmp_path / "mine")
    assert (tmp_path / "mine" / "a.bin").read_bytes() == b"mine"


def test_unknown_names_and_folders_are_refused(tmp_path):
    with pytest.raises(InputError, match="there is no data set 'all', only paper-data"):
        datasets.fetch("all")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is no folder"):
        datasets.fetch("paper-data", folder=tmp_path / "file")


def test_the_hashes_of_the_paper_fit_the_real_files(data):
    known = datasets.DATA_SETS["paper-data"].sha256
    present = sorted((data / "evcalib").glob("*.npz"))
    assert present
    for path in present:
        assert hashlib.sha256(path.read_bytes()).hexdigest() == known[path.name]
        assert len(read_paired_streams(path).headings)
