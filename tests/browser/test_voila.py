"""The quickstart and the cockpit as pages without code: Voila shows them, and the sliders work."""

import time
from urllib.parse import urlsplit

import pytest

pytest.importorskip("playwright", reason='needs playwright: pip install "evcalib[browser]"')
pytest.importorskip("voila", reason='needs voila: pip install "evcalib[browser]"')

import lab
import panels

ICONS = "cdn.jsdelivr.net"
"""Voila asks it for its icon font, whatever the notebook."""
COMPLAINTS = "[data-mime-type$=stderr], [data-mime-type$=error]"


def wait_for_widgets(page, log):
    """Wait for the last cell to have run; Voila leaves the cells after a failing one out."""
    end = time.monotonic() + lab.LONGEST_RUN
    while not page.locator(f"{panels.PANEL} .noUi-handle").count():
        assert "Traceback" not in (text := log.read_text(encoding="utf-8")), text[-2000:]
        assert time.monotonic() < end, "no widgets came"
        page.wait_for_timeout(200)
    page.wait_for_function("() => [...document.images].every(image => image.complete)")


@pytest.mark.parametrize("name", ["00_quickstart", "06_full_calibration"])
def test_the_page_shows_widgets_that_answer(name, browser, results, tmp_path):
    entry = results.setdefault("voila", {})[name] = {"result": "did not finish"}
    lab.copy_notebooks(tmp_path)
    with (
        lab.voila_server(tmp_path, name) as server,
        lab.open_page(browser, server.url(""), patience=lab.LONGEST_RUN) as (page, elsewhere),
    ):
        wait_for_widgets(page, server.log)
        reports = [panels.exercise(panel, patience=2_000) for panel in panels.panels(page)]
        lab.photograph(page, f"{name}-voila")
        complaints = page.locator(COMPLAINTS).all_inner_texts()
        log = server.log.read_text(encoding="utf-8")
    moves = [move for report in reports for move in report.moves]
    hosts = {urlsplit(address).hostname for address in elsewhere}
    entry.update(
        panels=[report.summary() for report in reports],
        requests_for_icons=len(elsewhere),
        result="passed",
    )
    assert not complaints
    assert "Traceback" not in log
    assert hosts <= {ICONS}, elsewhere
    assert any(move.changed for move in moves if move.control.startswith("slider")), moves
