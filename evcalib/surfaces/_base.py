"""What all surfaces share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evcalib import checks
from evcalib._event_columns import MAX_TIME_US
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.kernels.surfaces.time_surface import NEVER

LARGEST_PATCH = 31


class Surface:
    """What all surfaces share: the sensor, the polarities, the order of time.

    Attributes
    ----------
    last_us : int
        Time of the last event taken [us]; -1 before the first.
    """

    def __init__(self, width: int, height: int, polarity: str) -> None:
        empty = Events.empty(width, height)
        self.width, self.height = empty.width, empty.height
        self.polarity = checks.one_of(polarity, "polarity", ("merged", "split"))
        self.reset()

    def reset(self) -> None:
        """Forget all events."""
        self.last_us = NEVER
        self._clear()

    def update(self, events: Events) -> None:
        """Take the next events, none earlier than those taken before.

        Raises
        ------
        InputError
            If they are of another sensor, or earlier; nothing is taken then.
        """
        _of_sensor(events, self.width, self.height)
        if not len(events):
            return
        if events.t[0] < self.last_us:
            raise InputError(
                f"events start at {events.t[0]} us, before the last one taken ({self.last_us} us);"
                " update in order of time, or reset first"
            )
        self._take(events)
        self.last_us = int(events.t[-1])

    def render(self, t_us: int | None = None) -> NDArray:
        """Return the image at `t_us` [us], by default the time of the last event.

        Raises
        ------
        InputError
            If the time is not whole microseconds, or before the last event taken.
        """
        t = max(self.last_us, 0) if t_us is None else whole_us(t_us)
        if t < self.last_us:
            raise InputError(
                f"t_us = {t} is before the last event taken ({self.last_us} us):"
                " the past is gone; render before updating, or start anew"
            )
        image = self._image(t).reshape(self._planes, self.height, self.width)
        return image[0] if self.polarity == "merged" else image

    @property
    def _planes(self) -> int:
        return 1 if self.polarity == "merged" else 2

    def _plane(self, cells: int) -> int:
        """Return the distance between polarities in a flat array: 0 merges them."""
        return cells if self.polarity == "split" else 0

    def _clear(self) -> None:
        raise NotImplementedError

    def _take(self, events: Events) -> None:
        raise NotImplementedError

    def _image(self, t: int) -> NDArray:
        raise NotImplementedError


def render_once(
    kind: Callable[..., Surface], events: Events, t_us: int | None, **options: Any
) -> NDArray:
    """Return the image of the events up to and including `t_us`, by default all."""
    checks.instance(events, "events", Events)
    surface = kind(events.width, events.height, **options)
    if t_us is None and not len(events):
        raise InputError("there are no events, hence no time to render at: give t_us")
    surface.update(events if t_us is None else events.between(0, whole_us(t_us) + 1))
    return surface.render(t_us)


def whole(value: int, name: str, least: int, most: int) -> int:
    """Return a whole number within bounds."""
    number = int(value) if isinstance(value, int | np.integer) else least - 1
    if not least <= number <= most:
        raise InputError(f"{name} must be a whole number of {least} to {most}, not {value!r}")
    return number


def whole_us(t_us: int) -> int:
    """Return a time that events can have [us]."""
    return whole(checks.whole_us(t_us, "t_us"), "t_us", 0, MAX_TIME_US)


def odd_side(value: int, name: str) -> int:
    """Return the side of a patch [px]."""
    side = whole(value, name, 3, LARGEST_PATCH)
    if side % 2 == 0:
        raise InputError(f"{name} must be odd, so that a patch has a centre, not {side}")
    return side


def _of_sensor(events: Events, width: int, height: int) -> None:
    checks.instance(events, "events", Events)
    if events.shape != (height, width):
        raise InputError(
            f"events of {events.width}x{events.height} pixels do not fit a surface of"
            f" {width}x{height}"
        )
