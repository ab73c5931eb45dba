"""Events as kernels take them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class EventColumns(NamedTuple):
    """Columns of events in the order of their times, pixels on the sensor."""

    x: np.ndarray  # uint16 [px]
    y: np.ndarray  # uint16 [px]
    t: np.ndarray  # int64 [us]
    p: np.ndarray  # bool, True = ON

    @classmethod
    def of(cls, events: Any) -> EventColumns:
        """Take the columns out of `Events`."""
        return cls(events.x, events.y, events.t, events.p)
