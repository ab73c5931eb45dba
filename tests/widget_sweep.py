"""Move every control of a panel through the ends of its range, in any order, without a browser.

Values arrive as the browser sends them (`set_state`).  After each move the panel must still show
whole pictures and numbers.  ipywidgets keeps the error of a callback of a button, or of `interact`,
to itself and logs it: the sweep listens.
"""

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import ipywidgets as widgets
import numpy as np

NONSENSE = ("", "nonsense", "0 0\n0 0", "nan inf", "1e308 1e308\n-1e308 0", "1 2\n" * 3000)
"""What a reader may leave in a field for text."""
NO_NUMBER = re.compile(r"\b(nan|inf|None)\b")
BLANK = 1.0
"""A picture whose grey levels spread less shows nothing."""


def parts(widget) -> Iterator[widgets.Widget]:
    """Yield a widget and all that is inside it, in order."""
    yield widget
    for child in getattr(widget, "children", ()):
        yield from parts(child)


def controls(panel) -> list[widgets.Widget]:
    """Return all that a reader can move, choose, write into or press."""
    return [part for part in parts(panel) if places(part)]


def places(control) -> list[dict]:
    """Return the states of a control at the ends and in the middle of its range."""
    if isinstance(control, widgets.Button):
        return [{}]
    if isinstance(control, widgets.widget_selection._Selection):
        last = len(control.options) - 1
        return [{"index": index} for index in sorted({0, last // 2, last})]
    if isinstance(control, widgets.Checkbox | widgets.ToggleButton):
        return [{"value": False}, {"value": True}]
    if isinstance(control, widgets.Text | widgets.Textarea):
        return [{"value": text} for text in NONSENSE]
    if isinstance(control, widgets.IntSlider | widgets.FloatSlider | widgets.Play):
        count = round((control.max - control.min) / control.step)
        middle = control.min + (count // 2) * control.step
        return [{"value": value} for value in (control.min, middle, control.max)]
    return []


def sweep(panel, *, steps: int = 0, seed: int = 0) -> int:
    """Visit every place of every control one by one, then places in a random order.

    Parameters
    ----------
    panel : Widget
        A container.
    steps : int
        Moves in random order.
    seed : int
        Of the order.

    Returns
    -------
    int
        How many different things were shown.

    Raises
    ------
    AssertionError
        If a callback fails or says anything in the log, or the panel shows something broken;
        with the moves that led there.
    """
    rng = np.random.default_rng(seed)
    movable, done, seen = controls(panel), [], set()
    around = [(control, place) for control in movable for place in places(control)]
    chances = (movable[k] for k in rng.integers(len(movable), size=steps))
    wander = ((control, rng.choice(places(control))) for control in chances)
    with _listening(panel) as heard:
        look(panel)
        for control, place in (*around, *wander):
            if getattr(control, "disabled", False):
                continue
            done.append(f"{name(control)} {place}")
            try:
                _move(control, place)
                assert not heard, heard
                look(panel)
                seen.add(tuple(shown(panel)))
            except Exception as error:
                raise AssertionError(f"after {'; '.join(done[-12:])}: {error!r}") from error
    return len(seen)


def name(control) -> str:
    """Return what a control is called on the screen."""
    return control.description or type(control).__name__


def look(panel) -> None:
    """Check what a panel shows."""
    for part in parts(panel):
        if isinstance(part, widgets.Image):
            picture = cv2.imdecode(np.frombuffer(part.value, np.uint8), cv2.IMREAD_GRAYSCALE)
            assert picture is not None, "no picture"
            assert picture.std() > BLANK, "a blank picture"
        elif isinstance(part, widgets.HTML):
            found = NO_NUMBER.search(re.sub("<[^>]*>", " ", part.value))
            assert not found, f"{found[0]} in {part.value!r}"
        elif isinstance(part, widgets.Output):
            kinds = {output["output_type"] for output in part.outputs}
            assert "error" not in kinds, part.outputs


def shown(panel) -> list[bytes | str]:
    """Return all pictures and texts of a panel."""
    kinds = widgets.Image | widgets.HTML
    values = [part.value for part in parts(panel) if isinstance(part, kinds)]
    return [value if isinstance(value, str) else bytes(value) for value in values]


def _move(control, place) -> None:
    if isinstance(control, widgets.Button):
        control.click()
    else:
        control.set_state(dict(place))


@contextmanager
def _listening(panel) -> Iterator[list[str]]:
    heard: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: heard.append(
        f"{record.getMessage()} {record.exc_info[1]!r}" if record.exc_info else record.getMessage()
    )
    panel.log.addHandler(handler)
    try:
        yield heard
    finally:
        panel.log.removeHandler(handler)
