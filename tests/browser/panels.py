"""Move everything that can be moved in a panel of widgets, as a reader would, and see it change.

Works in any page that shows ipywidgets: JupyterLab and Voila.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field

from playwright.sync_api import Locator, Page

PANEL = ".jp-OutputArea-output:has(> .jupyter-widgets, > * > .jupyter-widgets)"
PLAYING = 1_500
"""How long a play button is left on [ms]."""
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
        name, move = todo[0]
        pixels, words = panel.evaluate(_PIXELS), _words(panel)
        panel.evaluate("panel => probe.watch(panel)")
        move()
        ms = panel.evaluate("(panel, patience) => probe.awaited(patience)", patience)
        panel.evaluate("(panel, quiet) => probe.steady(panel, quiet)", QUIET)
        changed = panel.evaluate(_PIXELS) != pixels
        report.moves.append(Move(name, ms and round(ms), changed, _words(panel) != words))
    return report


def _controls(panel: Locator) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield the kind and name of each control that can be moved now, and what moves it."""
    for slider in _seen(panel, ".widget-slider:has(.noUi-handle)"):
        handle = slider.locator(".noUi-handle").first
        yield f"slider {_name(slider)}", lambda handle=handle: _step(handle)
    for choice in _seen(panel, ".widget-dropdown:has(select:enabled)"):
        yield f"choice {_name(choice)}", lambda choice=choice: _next(choice.locator("select"))
    for box in _seen(panel, "input[type=checkbox]:enabled"):
        name = box.locator("xpath=..").inner_text().strip()
        yield f"box {name}", lambda box=box: box.press("Space")
    for toggle in _seen(panel, "button.widget-toggle-button:enabled:not(.mod-active)"):
        yield f"toggle {toggle.inner_text().strip()}", lambda toggle=toggle: toggle.press("Enter")
    for title in _seen(panel, ".jupyter-widget-Collapse-header"):
        yield f"fold {title.inner_text().strip()}", lambda title=title: title.click()
    buttons = _seen(panel, "button.widget-button:enabled")
    for button in sorted(buttons, key=lambda button: _label(button) == "reset"):
        if _label(button) == "reset":
            yield from _plays(panel)
        yield f"button {_label(button)}", lambda button=button: button.press("Enter")
    yield from _plays(panel)


def _plays(panel: Locator) -> Iterator[tuple[str, Callable[[], None]]]:
    for number, play in enumerate(_seen(panel, ".widget-play:has(button:enabled)")):
        yield f"play {number}", lambda play=play: _play(play)


def _seen(panel: Locator, selector: str) -> list[Locator]:
    return [part for part in panel.locator(selector).all() if part.is_visible()]


def _step(handle: Locator) -> None:
    """Move a slider by one step to the right, or to the left if it stands at its end."""
    at_end = handle.get_attribute("aria-valuenow") == handle.get_attribute("aria-valuemax")
    handle.focus()
    handle.press("ArrowLeft" if at_end else "ArrowRight")


def _next(box: Locator) -> None:
    """Choose the next option, or the first after the last."""
    count, index = box.evaluate("s => [s.options.length, s.selectedIndex]")
    box.select_option(index=(index + 1) % count)


def _play(play: Locator) -> None:
    """Let it play a moment, then pause."""
    button = play.locator("button").first
    button.click()
    play.page.wait_for_timeout(PLAYING)
    button.click()


def _label(button: Locator) -> str:
    return button.inner_text().strip()


def _name(control: Locator) -> str:
    return control.locator(".widget-label").first.inner_text().strip()


def _words(panel: Locator) -> list[str]:
    return panel.locator(".widget-html").all_inner_texts()
