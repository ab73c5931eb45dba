"""Move everything that can be moved in a panel of widgets, as a reader would, and see it change.

Works in any page that shows ipywidgets: JupyterLab and Voila.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field

from playwright.sync_api import ElementHandle, Locator, Page

PANEL = ".jp-OutputArea-output:has(> .jupyter-widgets, > * > .jupyter-widgets)"
PLAYING = 1.0
"""How long a play button is left on [s]."""
RESET = "button.widget-button:text-is('reset')"
QUIET = 120
"""A panel that has not changed for so long is done [ms]."""
_PIXELS = "panel => probe.pixels(panel)"


@dataclass
class Move:
    """One control moved by one step.

    Attributes
    ----------
    control : str
        Kind and name, as *slider offset [s]*.
    ms : int or None
        From the key press to the new picture; None if no new picture came.
    changed : bool
        Whether pixels of the panel's pictures changed.
    words : bool
        Whether its text changed.
    """

    control: str
    ms: int | None
    changed: bool
    words: bool


@dataclass
class Report:
    """What happened in one panel."""

    pictures: int
    moves: list[Move] = field(default_factory=list)

    def names(self) -> set[str]:
        """Return the names of the controls that were moved."""
        return {move.control for move in self.moves}

    def of(self, kind: str) -> list[Move]:
        """Return the moves of one kind of control."""
        return [move for move in self.moves if move.control.startswith(kind)]

    def summary(self) -> dict:
        """Return it as plain data."""
        return {"pictures": self.pictures, "moves": [asdict(move) for move in self.moves]}


def panels(page: Page) -> list[Locator]:
    """Return the panels of a page, in order."""
    return page.locator(PANEL).all()


def exercise(panel: Locator, *, patience: int) -> Report:
    """Move all that can be seen and moved in a panel once, and press each button, reset last.

    What a move brings to light or enables is moved in its turn.

    Parameters
    ----------
    panel : Locator
        One of `panels`.
    patience : int
        Wait for a new picture while the kernel has nothing to do, as far as the page knows [ms].
    """
    panel.scroll_into_view_if_needed()
    report = Report(panel.locator("img, canvas").count())
    while todo := [item for item in _controls(panel) if item[0] not in report.names()]:
        for name, part, move in todo:
            if part.is_visible() and part.is_enabled():
                report.moves.append(_watched(panel, name, part, move, patience))
    for button in _seen(panel, RESET):
        report.moves.append(_watched(panel, "button reset", button, _press, patience))
    return report


def _watched(panel: Locator, name: str, part: ElementHandle, move: Callable, patience: int) -> Move:
    pixels, words = panel.evaluate(_PIXELS), _words(panel)
    panel.evaluate("panel => probe.watch(panel)")
    move(part)
    ms = panel.evaluate("(panel, patience) => probe.awaited(patience)", patience)
    panel.evaluate("(panel, quiet) => probe.steady(panel, quiet)", QUIET)
    changed = panel.evaluate(_PIXELS) != pixels
    return Move(name, ms and round(ms), changed, _words(panel) != words)


def _controls(panel: Locator) -> Iterator[tuple[str, ElementHandle, Callable]]:
    """Yield kind and name of each control that can be moved now, what to move, and how.

    Toggles come last, since they may hide others.
    """
    for part in _seen(panel, ".widget-slider .noUi-handle"):
        yield f"slider {_label(part)}", part, _step
    for part in _seen(panel, ".widget-dropdown select:enabled"):
        yield f"choice {_label(part)}", part, _next
    for part in _seen(panel, "input[type=checkbox]:enabled"):
        yield f"box {_own(part)}", part, _tick
    for part in _seen(panel, ".jupyter-widget-Collapse-header"):
        yield f"fold {_own(part)}", part, _click
    for part in _seen(panel, f"button.widget-button:enabled:not({RESET})"):
        yield f"button {_own(part)}", part, _press
    for number, part in enumerate(_seen(panel, ".widget-play button:enabled:first-child")):
        yield f"play {number}", part, _play
    for part in _seen(panel, "button.widget-toggle-button:enabled:not(.mod-active)"):
        yield f"toggle {_own(part)}", part, _press


def _seen(panel: Locator, selector: str) -> list[ElementHandle]:
    return [part for part in panel.locator(selector).element_handles() if part.is_visible()]


def _step(handle: ElementHandle) -> None:
    """Move a slider by one step to the right, or to the left if it stands at its end."""
    at_end = handle.get_attribute("aria-valuenow") == handle.get_attribute("aria-valuemax")
    handle.press("ArrowLeft" if at_end else "ArrowRight")


def _next(choice: ElementHandle) -> None:
    """Choose the next option, or the first after the last."""
    count, index = choice.evaluate("s => [s.options.length, s.selectedIndex]")
    choice.select_option(index=(index + 1) % count)


def _tick(box: ElementHandle) -> None:
    box.press("Space")


def _press(button: ElementHandle) -> None:
    button.press("Enter")


def _click(part: ElementHandle) -> None:
    part.click()


def _play(button: ElementHandle) -> None:
    """Let it play a moment, then pause."""
    button.click()
    time.sleep(PLAYING)
    button.click()


def _label(part: ElementHandle) -> str:
    """Return the name that stands beside a control."""
    return str(part.evaluate("e => e.closest('.widget-inline-hbox').firstChild.innerText")).strip()


def _own(part: ElementHandle) -> str:
    """Return the text of a control, or of what it stands in."""
    return str(part.evaluate("e => e.innerText || e.parentElement.innerText")).strip()


def _words(panel: Locator) -> list[str]:
    return panel.locator(".widget-html").all_inner_texts()
