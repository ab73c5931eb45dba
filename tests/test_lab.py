"""`evcalib lab`: the notebooks in a folder of the user's, and never a change of his lost.

That a wheel's own notebooks are served is tried by ``.ci/package.sh``.
"""

import json
import re
import socket
import sys
from pathlib import Path

import nbformat
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data_tools.course import _copy, copy_notebooks, course_files, home_of_notebooks
from data_tools.course._copy import RECORD
from evcalib import __version__
from evcalib.errors import InputError

CHECKOUT = Path(__file__).parents[1] / "notebooks"
A, B = "00_quickstart.ipynb", "data/sweep/wheels.csv"
BESIDE = f"00_quickstart.{__version__}.ipynb"


def write(folder, **files):
    for name, text in {A: files["a"], B: files["b"]}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def home(tmp_path):
    return write(tmp_path / "home", a="a1", b="b1")


@pytest.fixture
def mine(tmp_path):
    return tmp_path / "mine"


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and path.name != RECORD
    }


def test_first_copy_is_whole_and_the_second_changes_nothing(home, mine):
    assert copy_notebooks(mine, home=home).new == (A, B)
    assert contents(mine) == {A: "a1", B: "b1"}
    before = {path: path.stat().st_mtime_ns for path in mine.rglob("*")}
    again = copy_notebooks(mine, home=home)
    assert again == _copy.Copied(mine, (), (), (), {})
    assert again.text() == ""
    assert {path: path.stat().st_mtime_ns for path in mine.rglob("*")} == before


def test_newer_files_replace_what_was_not_changed(home, mine):
    copy_notebooks(mine, home=home)
    write(home, a="a2", b="b1")
    assert copy_notebooks(mine, home=home).updated == (A,)
    assert contents(mine) == {A: "a2", B: "b1"}


def test_changed_file_is_kept_and_the_newer_one_put_beside_it_once(home, mine):
    copy_notebooks(mine, home=home)
    (mine / A).write_text("my own")
    kept = copy_notebooks(mine, home=home)
    assert (kept.kept, kept.beside, kept.text()) == ((A,), {}, "")
    write(home, a="a2", b="b2")
    newer = copy_notebooks(mine, home=home)
    assert (newer.updated, newer.kept, newer.beside) == ((B,), (A,), {A: BESIDE})
    assert f"{A} was changed by you: kept, the new one is {BESIDE}" in newer.text()
    assert contents(mine) == {A: "my own", B: "b2", BESIDE: "a2"}
    (mine / BESIDE).unlink()
    copy_notebooks(mine, home=home)
    assert contents(mine) == {A: "my own", B: "b2"}


def test_deleted_file_comes_back(home, mine):
    copy_notebooks(mine, home=home)
    (mine / A).unlink()
    assert copy_notebooks(mine, home=home).new == (A,)
    assert contents(mine) == {A: "a1", B: "b1"}


@pytest.mark.parametrize("record", ["", "{", "[]", '{"files": 3}', '{"files": {"x": []}}'])
def test_without_a_readable_record_every_other_content_is_the_users(home, mine, record):
    copy_notebooks(mine, home=home)
    (mine / RECORD).write_text(record)
    write(home, a="a2", b="b1")
    assert copy_notebooks(mine, home=home).beside == {A: BESIDE}
    assert contents(mine) == {A: "a1", B: "b1", BESIDE: "a2"}


def test_copy_cut_short_goes_on_where_it_was(home, mine):
    copy_notebooks(mine, home=home)
    (mine / A).write_text("my own")
    record = (mine / RECORD).read_text()
    write(home, a="a2", b="b2")
    copy_notebooks(mine, home=home)
    (mine / RECORD).write_text(record)
    copy_notebooks(mine, home=home)
    assert contents(mine) == {A: "my own", B: "b2", BESIDE: "a2"}


steps = st.lists(
    st.one_of(
        st.tuples(st.just("user"), st.sampled_from([A, B, BESIDE]), st.sampled_from("xyz")),
        st.tuples(st.just("release"), st.sampled_from([A, B]), st.sampled_from("1234")),
        st.just(("lose the record", RECORD, "")),
    ),
    max_size=12,
)


@settings(max_examples=40, deadline=None)
@given(steps)
def test_no_word_of_the_user_is_ever_lost(tmp_path_factory, steps):
    top = tmp_path_factory.mktemp("steps")
    home, mine = write(top / "home", a="0", b="0"), top / "mine"
    copy_notebooks(mine, home=home)
    written = {}
    for who, name, text in steps:
        if who == "lose the record":
            (mine / RECORD).unlink()
        else:
            ((mine if who == "user" else home) / name).write_text(text)
        if who == "user":
            written[name] = text
        copy_notebooks(mine, home=home)
        found = contents(mine)
        assert found.items() >= written.items()
        assert set(contents(home)) <= set(found)


def test_folder_that_cannot_be_used_is_refused(home, mine, tmp_path):
    mine.write_text("a file")
    with pytest.raises(InputError, match=r"cannot make the folder .*mine"):
        copy_notebooks(mine, home=home)
    (tmp_path / "other" / A).mkdir(parents=True)
    with pytest.raises(InputError, match=rf"cannot read .*{A}"):
        copy_notebooks(tmp_path / "other", home=home)


def test_installation_without_notebooks_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(_copy, "SHIPPED", tmp_path)
    monkeypatch.setattr(_copy, "CHECKOUT", tmp_path)
    with pytest.raises(InputError, match="holds no notebooks"):
        home_of_notebooks()


@pytest.fixture
def checkout(monkeypatch, tmp_path):
    """Make the installation one of a checkout, also where the tests run on a wheel."""
    monkeypatch.setattr(_copy, "SHIPPED", tmp_path / "none")
    monkeypatch.setattr(_copy, "CHECKOUT", CHECKOUT)


def test_wheel_comes_before_a_checkout(checkout, monkeypatch, home):
    assert home_of_notebooks() == (CHECKOUT, True)
    monkeypatch.setattr(_copy, "SHIPPED", home)
    assert home_of_notebooks() == (home, False)


PAGES = [*sorted(CHECKOUT.glob("[0-9]*.ipynb")), *CHECKOUT.glob("README.md")]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_every_file_that_a_page_names_is_copied(path):
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        text = "\n".join(cell["source"] for cell in nbformat.reads(text, as_version=4).cells)
    names = set(re.findall(r"""["' ]((?:data|pictures)/[\w./-]+\.\w+)""", text))
    names |= set(re.findall(r"\]\((\w[\w./-]*\.\w+)\)", text))
    assert names <= set(course_files(CHECKOUT))


class Server:
    """Stands for JupyterLab's application."""

    def __init__(self):
        self.words = []

    def launch_instance(self, words):
        self.words = words


@pytest.fixture
def server(monkeypatch):
    fake = Server()
    labapp = pytest.importorskip("jupyterlab.labapp")
    monkeypatch.setattr(labapp, "LabApp", fake)
    return fake


def test_checkout_opens_its_own_notebooks(run, server, checkout, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("lab")[:2] == (0, "")
    assert f"--ServerApp.root_dir={CHECKOUT.parent}" in server.words
    assert "--LabApp.default_url=/lab/tree/notebooks/00_quickstart.ipynb" in server.words
    assert "--ServerApp.open_browser=True" in server.words
    assert list(tmp_path.iterdir()) == []


def test_wheel_copies_to_a_folder_here(run, server, tmp_path, monkeypatch, home):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_copy, "SHIPPED", home)
    code, out, _ = run("lab", "--no-browser", "--port", 0x7E57)
    assert (code, out) == (0, "2 files copied to evcalib-notebooks\n")
    assert contents(tmp_path / "evcalib-notebooks") == {A: "a1", B: "b1"}
    assert f"--ServerApp.root_dir={tmp_path / 'evcalib-notebooks'}" in server.words
    assert {"--ServerApp.open_browser=False", f"--ServerApp.port={0x7E57}"} < set(server.words)


def test_folder_of_the_user_is_filled_from_a_checkout_too(run, server, checkout, mine):
    assert run("lab", mine)[0] == 0
    for name in course_files(CHECKOUT):
        assert (mine / name).read_bytes() == (CHECKOUT / name).read_bytes()
    assert set(json.loads((mine / RECORD).read_text())["files"]) == set(course_files(CHECKOUT))


def test_port_in_use_is_refused_before_anything_is_copied(run, server, mine):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code, _, err = run("lab", mine, "--port", port)
    assert (code, err.count("\n")) == (2, 1)
    assert f"cannot use port {port}" in err
    assert not mine.exists()


def test_missing_jupyterlab_names_the_extra(run, monkeypatch, mine):
    monkeypatch.setitem(sys.modules, "jupyterlab.labapp", None)
    code, _, err = run("lab", mine)
    assert (code, err) == (
        2,
        'evcalib: JupyterLab is not installed: pip install "evcalib[notebooks]"\n',
    )
    assert not mine.exists()
