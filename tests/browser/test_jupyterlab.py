"""Each notebook opens in JupyterLab, runs without a complaint, and its widgets answer.

pip install -e ".[tests,browser]" && pytest tests/browser
pytest tests/browser -k 04_offset          # one notebook
"""

import statistics

import nbformat
import pytest

pytest.importorskip("playwright", reason='needs playwright: pip install "evcalib[browser]"')

import lab
import panels

NAMES = [path.stem for path in sorted((lab.ROOT / "notebooks").glob("*.ipynb"))]
BROKEN = """
import sys, ipywidgets
from IPython.display import HTML
print("a line on stderr", file=sys.stderr)
HTML('<img src="http://elsewhere.invalid/x.png">')
---
picture = ipywidgets.Image(value=open("pictures/demo.png", "rb").read(), width=40)
sliders = [ipywidgets.IntSlider(description=name) for name in ("dead", "failing")]
button = ipywidgets.Button(description="stumble")
sliders[1].observe(lambda change: 1 / 0, names="value")
button.on_click(lambda button: {}["nothing"])
ipywidgets.VBox([picture, *sliders, button])
"""


@pytest.fixture(scope="module")
def server(browser, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    lab.copy_notebooks(folder)
    with lab.lab_server(folder) as server:
        yield server


def faults_of(notebook, reports, elsewhere):
    """Return all that is wrong with a notebook that was run and exercised."""
    faults = [f"complaint: {text}" for text in notebook.complaints()]
    counts = notebook.counts()
    if counts != list(range(1, len(counts) + 1)):
        faults.append(f"cells were not run once in order: {counts}")
    if not reports:
        faults.append("no widgets")
    for report in reports:
        if not any(move.changed for move in report.of("slider")):
            faults.append(f"no slider changes a picture: {report.moves}")
    return faults + [f"request to {address}" for address in elsewhere]


@pytest.mark.parametrize("name", NAMES)
def test_the_notebook_runs_and_its_widgets_answer(name, browser, server, results):
    entry = results.setdefault("lab", {})[name] = {"result": "did not finish"}
    with (
        lab.open_page(browser, lab.LabNotebook.address(server, name)) as (page, elsewhere),
        lab.LabNotebook(page) as notebook,
    ):
        entry["seconds"] = round(notebook.run(), 1)
        entry["screens"] = lab.photograph(page, f"{name}-light")
        reports = []
        for number, panel in enumerate(panels.panels(page)):
            reports.append(panels.exercise(panel, patience=1_500))
            panel.screenshot(path=lab.ARTEFACTS / f"{name}-panel-{number}.png")
        notebook.use_theme("JupyterLab Dark")
        lab.photograph(page, f"{name}-dark", most=99 if name == NAMES[0] else 1)
        for number, panel in enumerate(panels.panels(page)):
            panel.screenshot(path=lab.ARTEFACTS / f"{name}-panel-{number}-dark.png")
        faults = faults_of(notebook, reports, elsewhere)
    moves = [move for report in reports for move in report.moves]
    times = [move.ms for move in moves if move.control.startswith("slider") and move.ms]
    entry.update(
        panels=[report.summary() for report in reports],
        widgets=len(moves),
        sliders_moved=sum(m.control.startswith("slider") and m.changed for m in moves),
        ms_per_update=statistics.median(times) if times else None,
        without_answer=[
            m.control for m in moves if not (m.changed or m.words or m.control.startswith("fold"))
        ],
        requests_elsewhere=len(elsewhere),
        faults=faults,
        result="failed" if faults else "passed",
    )
    print(f"\n{name}: run in {entry['seconds']} s")
    for move in moves:
        print(f"  {move.control:32s} {move.ms or '-':>8} ms")
    assert not faults


def test_what_is_broken_is_seen(browser, server):
    """A test of this test: stderr, failing callbacks, a dead slider, a request to elsewhere."""
    folder = server.folder
    cells = [nbformat.v4.new_code_cell(source.strip()) for source in BROKEN.split("---")]
    metadata = nbformat.read(folder / f"{NAMES[0]}.ipynb", as_version=4).metadata
    broken = nbformat.v4.new_notebook(cells=cells, metadata=metadata)
    nbformat.write(broken, folder / "broken.ipynb")
    with (
        lab.open_page(browser, lab.LabNotebook.address(server, "broken")) as (page, elsewhere),
        lab.LabNotebook(page) as notebook,
    ):
        notebook.run()
        (panel,) = panels.panels(page)
        reports = [panels.exercise(panel, patience=500)]
        faults = "\n".join(faults_of(notebook, reports, elsewhere))
    for sign in (
        "complaint: a line on stderr",
        "complaint: ZeroDivisionError",
        "complaint: KeyError",
        "no slider changes a picture",
        "request to http://elsewhere.invalid/x.png",
    ):
        assert sign in faults
