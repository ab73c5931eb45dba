"""Surfaces as objects: their state, and the input and options that they refuse."""

import math

import numpy as np
import pytest
from surface_streams import random_events

from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.surfaces import (
    SURFACES,
    Dist,
    Silc,
    TimeSurface,
    Tos,
    TosTs,
    dist,
    silc,
    time_surface,
    tos,
    tos_ts,
)

CLASSES = list(SURFACES.values())


def test_events_after_the_time_do_not_count():
    events = Events.from_arrays([0, 1], [0, 0], [100, 101], [1, 1], 2, 1)
    assert tos(events, 100).tolist() == [[255, 0]]
    assert tos(events, 99).tolist() == [[0, 0]]


def test_reset_forgets():
    events = random_events(10, 10, 100, 4, 10)
    for kind in CLASSES:
        surface = kind(10, 10)
        empty = surface.render()
        surface.update(events)
        assert surface.render().any()
        surface.reset()
        np.testing.assert_array_equal(surface.render(), empty)
        surface.update(events)


@pytest.mark.parametrize("kind", CLASSES)
def test_a_rendered_image_is_not_changed_by_later_events(kind):
    events = random_events(10, 10, 100, 4, 10)
    surface = kind(10, 10)
    surface.update(events[:50])
    image = surface.render()
    copy = image.copy()
    surface.update(events[50:])
    np.testing.assert_array_equal(image, copy)


@pytest.mark.parametrize("kind", CLASSES)
def test_surfaces_refuse_what_does_not_fit(kind):
    events = random_events(10, 10, 100, 4, 10)
    surface = kind(10, 10)
    surface.update(events)
    before = surface.render()
    with pytest.raises(InputError, match="order of time"):
        surface.update(events)
    with pytest.raises(InputError, match="do not fit a surface"):
        surface.update(Events.empty(10, 9))
    with pytest.raises(InputError, match="the past is gone"):
        surface.render(int(events.t[-1]) - 1)
    with pytest.raises(InputError, match="whole microseconds"):
        surface.render(0.5)
    with pytest.raises(InputError, match="must be Events"):
        surface.update([1, 2, 3])
    np.testing.assert_array_equal(surface.render(), before)
    with pytest.raises(InputError, match="polarity must be one of"):
        kind(10, 10, polarity="both")
    with pytest.raises(InputError, match="width"):
        kind(0, 10)


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        (TimeSurface, {"tau": 0}, "tau"),
        (TimeSurface, {"tau": math.nan}, "tau"),
        (TimeSurface, {"tau": 1e-320}, "tau"),
        (Tos, {"k": 6}, "odd"),
        (Tos, {"k": 33}, "k must be"),
        (Tos, {"k": 7.0}, "k must be"),
        (Tos, {"threshold": 255}, "threshold"),
        (Tos, {"threshold": 0}, "threshold"),
        (Silc, {"r": 16}, "r must be"),
        (Dist, {"alpha": -1}, "alpha"),
        (Dist, {"patch": 4}, "odd"),
        (Dist, {"clip": 1.5}, "clip"),
        (TosTs, {"ts_threshold": 1}, "ts_threshold"),
        (TosTs, {"ts_threshold": math.nan}, "ts_threshold"),
    ],
)
def test_options_are_checked(kind, options, message):
    with pytest.raises(InputError, match=message):
        kind(10, 10, **options)


@pytest.mark.parametrize("function", [time_surface, tos, silc, dist, tos_ts])
def test_an_empty_stream_has_an_image_only_at_a_given_time(function):
    nothing = Events.empty(4, 3)
    with pytest.raises(InputError, match="no events"):
        function(nothing)
    assert not function(nothing, 5).any()
