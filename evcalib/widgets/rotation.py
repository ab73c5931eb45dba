"""Spoil the headings, choose a loss, and see which residuals it listens to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import ipywidgets as widgets
import numpy as np

from evcalib.alignment.rotation import METHODS, RotationEstimate, estimate_rotation
from evcalib.arrays import Floats
from evcalib.geometry import rotation_angle
from evcalib.plots import style
from evcalib.plots.rotation import draw_losses
from evcalib.widgets._parts import Panel, bare_figure, choices, encode, pixels, whole_slider, wipe

MAX_SHARE = 90
"""Range of the outlier slider [%]."""


class Pairs(Protocol):
    """Paired directions with the rotation that is true of them."""

    @property
    def e(self) -> Floats: ...  # noqa: D102

    @property
    def d(self) -> Floats: ...  # noqa: D102

    @property
    def R_body_cam(self) -> Floats: ...  # noqa: D102


class RotationPanel(Panel):
    """Outlier share and loss against the residuals on the sphere.

    Parameters
    ----------
    pairs : callable
        Makes paired directions: ``pairs(kind, share)``, share of outliers in 0 to 1.
    kinds : sequence of str
        Kinds of outliers to choose from.
    """

    def __init__(self, pairs: Callable[[str, float], Pairs], kinds: Sequence[str]) -> None:
        names = choices(kinds, "kind", Iterable)
        super().__init__()
        self._make = pairs
        self.share = whole_slider("outliers [%]", 0, MAX_SHARE, 5, 30)
        self.share.continuous_update = False
        self.kind = widgets.Dropdown(options=names, description="kind")
        self.loss = widgets.Dropdown(options=list(METHODS), value="kabsch", description="loss")
        self.picture, self.numbers = widgets.Image(format="png"), widgets.HTML()
        self._figure = bare_figure((9.4, 3.3), bottom=0.145, top=0.9, right=0.985)
        with style.context():
            left = self._figure.add_axes((0.04, 0.06, 0.5, 0.8), projection="hammer")
            self._axes = left, self._figure.add_axes((0.635, 0.145, 0.35, 0.755))
        self._of: tuple[str, int] | None = None
        first = widgets.HBox([self.kind, self.loss])
        second = widgets.HBox([self.share, self.reset])
        controls = (self.share, self.kind, self.loss)
        self._start(controls, [first, second, self.picture, self.numbers])

    def _spoil(self) -> None:
        """Make new pairs, and fit every loss to them."""
        self._of = self.kind.value, self.share.value
        self.pairs = self._make(self.kind.value, self.share.value / 100)
        self.estimates: dict[str, RotationEstimate] = {
            loss: estimate_rotation(self.pairs.e, self.pairs.d, method=loss) for loss in METHODS
        }

    def _draw(self) -> None:
        if self._of != (self.kind.value, self.share.value):
            self._spoil()
        self.picture.value = self.draw()
        self.numbers.value = self.table()

    def errors(self) -> dict[str, float]:
        """Return the error of each loss [deg] on the current pairs."""
        true = self.pairs.R_body_cam
        return {
            loss: float(np.degrees(rotation_angle(estimate.R_body_cam, true)))
            for loss, estimate in self.estimates.items()
        }

    def draw(self) -> bytes:
        """Return the map of the sphere and the weights as a PNG picture."""
        loss = self.loss.value
        wipe(self._axes)
        with style.context():
            draw_losses(self._axes, self.pairs.e, self.pairs.d, self.estimates[loss], title=loss)
        return encode(pixels(self._figure))

    def table(self) -> str:
        """Return the errors of all losses as an HTML table, the chosen one in bold."""
        cells = []
        for loss, error in self.errors().items():
            words = f"{loss} {error:.2f}"
            chosen = loss == self.loss.value
            cells.append(f"<td style='padding:2px 10px'>{f'<b>{words}</b>' if chosen else words}")
        return f"error [deg]: <table><tr>{'</td>'.join(cells)}</td></tr></table>"
