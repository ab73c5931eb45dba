"""Write the measured table of notebooks/README.md from what the last runs left.

pytest notebooks --junitxml=.artefacts/nbval.xml
pytest tests/browser
python tests/browser/table.py
"""

import json
import re
import statistics
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).parents[2]
NBVAL = ROOT / ".artefacts" / "nbval.xml"
BROWSER = ROOT / ".artefacts" / "browser" / "results.json"
PAGE = ROOT / "notebooks" / "README.md"
BLOCK = re.compile(r"(<!-- measured: begin -->\n).*?(<!-- measured: end -->)", re.DOTALL)
HEAD = (
    "| notebook | cells | kB | nbval [s] | in JupyterLab [s] | controls moved | sliders: key press"
    " to picture, median (worst) [ms] | without an answer | in the browser |\n"
    "|---|---|---|---|---|---|---|---|---|\n"
)


def nbval_seconds(path: Path) -> dict[str, float]:
    """Return seconds by notebook, the start of its kernel included; none of what failed."""
    seconds: dict[str, float] = {}
    failed = set()
    for case in ET.parse(path).iter("testcase"):
        name = case.get("classname", "").removesuffix(".ipynb").split(".")[-1]
        seconds[name] = seconds.get(name, 0.0) + float(case.get("time", 0.0))
        if case.find("failure") is not None or case.find("error") is not None:
            failed.add(name)
    return {name: value for name, value in seconds.items() if name not in failed}


def row(path: Path, nbval: dict[str, float], lab: dict, voila: dict) -> str:
    """Return the line of one notebook."""
    name = path.stem
    cells = sum(c["cell_type"] == "code" for c in json.loads(path.read_text("utf-8"))["cells"])
    entry = lab.get(name, {})
    moves = [move for panel in entry.get("panels", ()) for move in panel["moves"]]
    times = [m["ms"] for m in moves if m["control"].startswith("slider") and m["ms"]]
    update = f"{statistics.median(times):.0f} ({max(times)})" if times else "-"
    result = entry.get("result", "not run")
    if name in voila:
        result += f"; Voila {voila[name]['result']}"
    without = ", ".join(control for control in entry.get("without_answer", ())) or "none"
    columns = (
        f"[{name}]({path.name})",
        cells,
        round(path.stat().st_size / 1000),
        f"{nbval[name]:.0f}" if name in nbval else "-",
        entry.get("seconds", "-"),
        len(moves),
        update,
        without,
        result,
    )
    return f"| {' | '.join(map(str, columns))} |\n"


def table() -> str:
    """Return the table, and a line on where it was measured."""
    browser = json.loads(BROWSER.read_text("utf-8"))
    nbval = nbval_seconds(NBVAL) if NBVAL.is_file() else {}
    lab, voila, machine = browser["lab"], browser.get("voila", {}), browser["machine"]
    paths = sorted(PAGE.parent.glob("[0-9]*.ipynb"))
    rows = "".join(row(path, nbval, lab, voila) for path in paths)
    return (
        f"{HEAD}{rows}\n{machine['cores']} cores, load {machine['load']} at the start, Python"
        f" {machine['python']}, JupyterLab {machine['jupyterlab']}, ipywidgets"
        f" {machine['ipywidgets']}, Chromium {machine['chromium']}.\n"
    )


def main() -> None:
    """Write the table between the two marks of the page."""
    text = PAGE.read_text("utf-8")
    new, count = BLOCK.subn(lambda found: f"{found[1]}{table()}{found[2]}", text)
    if count != 1:
        sys.exit(f"{PAGE} has no place for the table: {BLOCK.pattern}")
    PAGE.write_text(new, "utf-8")


if __name__ == "__main__":
    main()
