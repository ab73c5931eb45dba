"""Spoil the headings, choose a loss, and see which residuals it listens to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import ipywidgets as widgets
import numpy as np
from numpy.typing import NDArray

from evcalib.geometry import rotation_angle
from evcalib.plots import style
from evcalib.plots.rotation import draw_map, draw_weights
from evcalib.rotation import METHODS, RotationEstimate, estimate_rotation

MAX_SHARE = 90
"""Range of the outlier slider [%]."""


class Pairs(Protocol):
    """Paired directions with the rotation that is true of them."""

    @property
    def e(self) -> NDArray[np.float64]: ...  # noqa: D102

    @property
    def d(self) -> NDArray[np.float64]: ...  # noqa: D102

    @property
    def R_body_cam(self) -> NDArray[np.float64]: ...  # noqa: D102


class RotationPanel(widgets.VBox):
    """Outlier share and loss against the residuals on the sphere.

    Parameters
    ----------
    pairs : callable
        Makes paired directions: ``pairs(kind, share)``, share of outliers in 0 to 1.
    kinds : sequence of str
        Kinds of outliers to choose from.
    """

    def __init__(self, pairs: Callable[[str, float], Pairs], kinds: Sequence[str]) -> None:
        self._make = pairs
        self.share = widgets.IntSlider(max=MAX_SHARE, step=5, value=30, description="outliers [%]")
        self.kind = widgets.Dropdown(options=list(kinds), description="kind")
        self.loss = widgets.Dropdown(options=list(METHODS), value="kabsch", description="loss")
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        for control in (self.share, self.kind):
            control.observe(lambda change: self._spoil(), names="value")
        self.loss.observe(lambda change: self._draw(), names="value")
        controls = widgets.HBox([self.share, self.kind, self.loss])
        super().__init__([controls, self.picture, self.numbers])
        self._spoil()

    def _spoil(self) -> None:
        self.pairs = self._make(self.kind.value, self.share.value / 100)
        self.estimates: dict[str, RotationEstimate] = {
            loss: estimate_rotation(self.pairs.e, self.pairs.d, method=loss) for loss in METHODS
        }
        self._draw()

    def _draw(self) -> None:
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
        e, d, estimate = self.pairs.e, self.pairs.d, self.estimates[self.loss.value]
        figure = style.new_figure((9.4, 3.6))
        with style.context():
            left = figure.add_subplot(1, 2, 1, projection="hammer")
            right = figure.add_subplot(1, 2, 2)
            draw_map(left, e, d, estimate)
            draw_weights(right, e, d, estimate)
            figure.legend(*left.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        return style.png(figure)

    def table(self) -> str:
        """Return the errors of all losses as an HTML table, the chosen one in bold."""
        cells = []
        for loss, error in self.errors().items():
            words = f"{loss} {error:.2f}"
            chosen = loss == self.loss.value
            cells.append(f"<td style='padding:2px 10px'>{f'<b>{words}</b>' if chosen else words}")
        return f"error [deg]: <table><tr>{'</td>'.join(cells)}</td></tr></table>"
