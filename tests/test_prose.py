"""Links lead somewhere, names and commands exist, words are spelt right; a test of these tests."""

import shutil
import subprocess
from pathlib import Path

import pytest
from prose import (
    NAME,
    NOTEBOOKS,
    PAGES,
    ROOT,
    Document,
    broken_link,
    documents,
    find,
    markdown_of,
    source_of,
    wrong_command,
)

TYPOS = shutil.which("typos")
CONFIG = Path(__file__).with_name("typos.toml")
each = pytest.mark.parametrize("document", documents(), ids=lambda document: document.path.name)
spelling = pytest.mark.skipif(TYPOS is None, reason="needs typos: pip install typos")


@each
def test_links_lead_somewhere(document):
    found = {target: broken_link(document, target) for _, target in document.links()}
    assert {target: fault for target, fault in found.items() if fault} == {}


@each
def test_no_line_becomes_a_list_by_accident(document):
    assert document.lonely_items() == []


@each
def test_names_in_the_text_exist(document):
    for name in filter(NAME.fullmatch, document.code()):
        find(name)


@each
def test_a_link_under_a_name_leads_to_the_file_that_defines_it(document):
    for name, target in document.links():
        if NAME.fullmatch(name) and target.endswith(".py"):
            path = (document.path.parent / target).resolve()
            assert source_of(find(name)) == path, f"{name} is not in {target}"


@each
def test_commands_and_their_options_exist(document):
    found = {command: wrong_command(command) for command in document.commands()}
    assert {command: fault for command, fault in found.items() if fault} == {}


def test_the_tests_above_find_what_is_broken():
    page = Document(
        ROOT / "README.md",
        "[a](no.md) [b](../outside.md) [c](CONTRIBUTING.md#no-such) [d](evcalib/geometry.py#L99999)"
        ' [e](http://plain.org) <img src="notebooks/pictures/none.png">\n\n'
        "# A `title`: (1)\n[f](#a-title-1) [g](https://host.org/x) [h](evcalib/geometry.py#L1)\n\n"
        "Call `evcalib nothing` or `evcalib demo --nothing` or `evcalib demo`.\n\n"
        "```sh\nevcalib calibrate a.h5 --camera b \\\n  --wheel c && evcalib lab  # --x\n```\n",
    )
    faults = [broken_link(page, target) for _, target in page.links()]
    assert faults == [
        "leads nowhere",
        "leads nowhere",
        "has no such heading",
        faults[3],
        "no https address",
        "leads nowhere",
        "has no such heading",
        None,
        None,
    ]
    assert faults[3].startswith("has ")
    assert page.anchors() == {"a-title-1"}
    assert [wrong_command(command) for command in page.commands()] == [
        "no options ['--wheel']",
        None,
        "no command nothing",
        "no options ['--nothing']",
        None,
    ]
    page = Document(ROOT / "README.md", "1. one\n2. two\n\nIt comes from\n1. this.\n")
    assert page.lonely_items() == ["this."]
    for name in (
        "evcalib.nothing",
        "evcalib.alignment.offset.nothing",
        "evcalib.alignment.offset.find_offset.nothing",
    ):
        with pytest.raises((AttributeError, ImportError)):
            find(name)


def misspelt(*paths):
    """Return what typos complains about."""
    command = [TYPOS, "--config", str(CONFIG), "--format", "brief", *map(str, paths)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT).stdout


@spelling
def test_code_and_pages_are_spelt_right():
    folders = ("evcalib", "data_tools", "tests", "notebooks", ".ci")
    python = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    assert misspelt(*PAGES, *python) == ""


@spelling
def test_notebooks_are_spelt_right_and_in_british(tmp_path):
    for source in NOTEBOOKS:
        (tmp_path / f"{source.stem}.md").write_text(markdown_of(source), encoding="utf-8")
    assert misspelt(tmp_path) == ""


@spelling
def test_a_misspelt_word_is_found(tmp_path):
    page, slip = tmp_path / "page.md", "rec" + "ieve"
    page.write_text(f"To {slip} is one thing, to be normalized another, colour fine.")
    found = misspelt(page)
    assert f"`{slip}` should be `receive`" in found
    assert "`normalized` should be `normalised`" in found
    assert found.count("\n") == 2
