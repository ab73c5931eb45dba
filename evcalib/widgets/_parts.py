"""What panels share: sliders, a play button, a way back to the start, and pictures made fast."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from threading import RLock
from typing import Any

import cv2
import ipywidgets as widgets
import matplotlib.colors
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from evcalib import checks
from evcalib.errors import InputError
from evcalib.plots import style

DPI = 90
"""Of the pictures in panels, so that the widest have room beside JupyterLab's file browser."""

Picture = NDArray[np.uint8]

_DRAWING = RLock()
"""Callbacks may come in several threads (subshells of the kernel); figures stand one at a time."""


def slider(
    name: str, low: float, high: float, step: float, value: float, digits: str = ".0f"
) -> widgets.FloatSlider:
    """Return a slider whose name has room."""
    return widgets.FloatSlider(
        min=low,
        max=high,
        step=step,
        value=value,
        description=name,
        readout_format=digits,
        **_roomy(),
    )


def whole_slider(name: str, low: int, high: int, step: int, value: int) -> widgets.IntSlider:
    """Return a slider of whole numbers whose name has room."""
    return widgets.IntSlider(
        min=low,
        max=high,
        step=step,
        value=value,
        description=name,
        **_roomy(),
    )


def choices(given: Any, name: str, kind: type = Mapping) -> list[str]:
    """Return the names that a panel lets choose from, or raise an InputError if there are none."""
    what = f"names to {name}s: {{'one': ...}}" if kind is Mapping else f"names of {name}s: ['one']"
    checks.instance(given, f"{name}s", kind, how=what)
    names = list(given)
    if not names:
        raise InputError(f"at least one {name} is needed")
    return names


def _roomy() -> dict[str, Any]:
    return {"style": {"description_width": "95px"}, "layout": {"width": "305px"}}


def player(over: widgets.IntSlider, interval_ms: int) -> widgets.Play:
    """Return buttons that move a slider on, step by step; the browser does it by itself."""
    play = widgets.Play(
        min=over.min, max=over.max, step=over.step, value=over.value, interval=interval_ms
    )
    widgets.jslink((play, "value"), (over, "value"))
    return play


def bare_figure(size: tuple[float, float], **margins: float) -> Figure:
    """Return a figure with given margins (`Figure.subplots_adjust`), which saves half of the time.

    To find margins that fit is what takes longest in a figure with constrained layout.
    """
    figure = Figure(figsize=size, dpi=DPI, layout="none")  # type: ignore[arg-type]
    figure.subplots_adjust(**margins)
    FigureCanvasAgg(figure)
    return figure


def wipe(axes: Iterable[Axes]) -> None:
    """Take everything out of axes but their frames and ticks, which take longest to make anew."""
    for ax in axes:
        legend = ax.get_legend()
        if legend is not None:
            legend.remove()
        for artist in (*ax.lines, *ax.collections, *ax.patches, *ax.images, *ax.texts):
            artist.remove()
        ax.containers.clear()
        ax.relim()
        ax.set_autoscale_on(True)


def pixels(figure: Figure) -> Picture:
    """Return a figure as an image in OpenCV's order of colours, shape (height, width, 3)."""
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    with style.context():
        canvas.draw()
    shown = np.asarray(canvas.buffer_rgba())
    return np.ascontiguousarray(shown[..., 2::-1])


def bgr(color: str) -> tuple[int, int, int]:
    """Return a colour in OpenCV's order."""
    red, green, blue = (round(255 * part) for part in matplotlib.colors.to_rgb(color))
    return blue, green, red


def encode(picture: Picture) -> bytes:
    """Return an image as the bytes of a PNG file, the same for the same image."""
    return cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()


class Panel(widgets.VBox):
    """Controls that draw when they change, and a button that takes all of them back.

    A panel says what to draw in `_draw`, and calls `_start` once everything is there.
    """

    def __init__(self) -> None:
        super().__init__()
        self.reset = widgets.Button(description="reset", icon="undo", layout={"width": "90px"})

    def _start(
        self,
        controls: Sequence[Any],
        children: Sequence[widgets.Widget],
        *,
        marks: Sequence[Any] = (),
    ) -> None:
        """Show the children, draw, and draw again whenever a control changes.

        Parameters
        ----------
        controls : sequence of Widget
            Have a value, and what is drawn depends on it.
        children : sequence of Widget
            Of the panel, from top to bottom.
        marks : sequence of Widget
            Have a value on which only marks on the picture depend; see `_mark`.
        """
        self._controls = (*controls, *marks)
        self._first = [control.value for control in self._controls]
        self._held = False
        self.reset.on_click(lambda button: self.restart())
        for control in controls:
            control.observe(lambda change: self._changed(), names="value")
        for control in marks:
            control.observe(lambda change: self._changed(self._mark), names="value")
        for child in children:
            if isinstance(child, widgets.Image):
                child.layout.align_self, child.layout.max_width = "flex-start", "100%"
        self.children = tuple(children)
        self._changed()

    def restart(self) -> None:
        """Set all controls to what they were at first."""
        with self._at_once():
            for control, value in zip(self._controls, self._first, strict=True):
                control.value = value

    @contextmanager
    def _at_once(self) -> Iterator[None]:
        """Let several controls change, and draw once."""
        self._held = True
        try:
            yield
        finally:
            self._held = False
        self._changed()

    def _changed(self, draw: Callable[[], None] | None = None) -> None:
        if self._held:
            return
        with _DRAWING:
            (draw or self._draw)()

    def _draw(self) -> None:
        raise NotImplementedError

    def _mark(self) -> None:
        raise NotImplementedError
