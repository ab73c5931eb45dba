"""The front door of events: what it takes, what it refuses, and what slices keep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from evcalib._event_columns import MAX_TIME_US
from evcalib.errors import InputError
from evcalib.events import Events

X, Y, T, P = [0, 3, 2], [1, 0, 2], [0, 5, 5], [0, 1, 1]


def three(**changes):
    columns = {"x": X, "y": Y, "t": T, "p": P, "width": 4, "height": 3, **changes}
    return Events.from_arrays(**columns)


def test_columns_have_their_types_whatever_they_came_from():
    events = three(x=np.array(X, np.int8), t=np.array(T, np.uint64), p=np.array(P, bool))
    types = [getattr(events, name).dtype for name in "xytp"]
    assert types == [np.uint16, np.uint16, np.int64, np.bool_]
    assert (len(events), events.shape, events.duration) == (3, (3, 4), 5e-6)
    assert list(zip(events.x, events.y, events.t, events.p, strict=True)) == [
        (0, 1, 0, False),
        (3, 0, 5, True),
        (2, 2, 5, True),
    ]


@pytest.mark.parametrize("p", [[False, True, True], [0, 1, 1], [-1, 1, 1], np.array(P, np.uint8)])
def test_polarity_codings_agree(p):
    assert three(p=p).p.tolist() == [False, True, True]


def test_a_single_valued_polarity_is_clear():
    assert three(p=[-1, -1, -1]).p.tolist() == [False] * 3
    assert three(p=[1, 1, 1]).p.tolist() == [True] * 3
    assert three(p=[0, 0, 0]).p.tolist() == [False] * 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"x": [0, 4, 2]}, r"event 1 has x = 4, outside the sensor \(width 4\)"),
        ({"y": [0, 1, -1]}, r"event 2 has y = -1, outside the sensor \(height 3\)"),
        ({"x": [0.0, 1.0, 2.0]}, "x must hold integers, not float64"),
        ({"x": [0, 1]}, "differ in length: x has 2, t has 3"),
        ({"p": [0, 1]}, "differ in length: p has 2, t has 3"),
        ({"x": [[0], [1], [2]]}, r"must have shape \(n,\)"),
        ({"x": ["a", "b", "c"]}, "must hold integers"),
        ({"t": [0, 7, 6]}, r"event 2 \(t = 6 us\) comes before event 1 \(t = 7 us\)"),
        ({"t": [-1, 0, 1]}, "event 0 has t = -1 us"),
        ({"t": [0.1, 0.2, 0.3]}, "time_unit='s'.* if seconds"),
        ({"t": np.array([0, 1, 1.7e15], np.int64)}, "Unix time"),
        ({"t": np.array([0, 1, 2**64 - 1], np.uint64)}, "Unix time"),
        ({"p": [-1, 0, 1]}, "mixes codings: -1 at event 0, 0 at event 1"),
        ({"p": [0, 1, 2]}, "event 2 has polarity 2"),
        ({"p": [0.0, 1.0, 1.0]}, "p must hold integers"),
        ({"width": 0}, "width must be a whole number"),
        ({"height": 70_000}, "height must be a whole number"),
        ({"width": 4.0}, "width must be a whole number"),
        ({"time_unit": "h"}, "time_unit must be one of"),
    ],
)
def test_bad_input_is_refused_with_its_place(changes, message):
    with pytest.raises(InputError, match=message):
        three(**changes)


@pytest.mark.parametrize(
    ("t", "unit", "expected"),
    [
        ([0.0, 0.0000014, 1.5], "s", [0, 1, 1_500_000]),
        (np.array([0, 1, 2], np.int32), "s", [0, 1_000_000, 2_000_000]),
        ([0.0, 0.5, 2.0006], "ms", [0, 500, 2001]),
        ([499, 500, 1499], "ns", [0, 1, 1]),
    ],
)
def test_other_units_are_converted_when_asked(t, unit, expected):
    assert three(t=t, time_unit=unit).t.tolist() == expected


def test_unix_time_comes_down_by_a_named_origin():
    t = 1_700_000_000_000_000 + np.array(T)
    assert three(t=t, origin_us=1_700_000_000_000_000).t.tolist() == T
    assert three(t=t * 1000, time_unit="ns", origin_us=1_700_000_000_000_000).t.tolist() == T


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": np.array([0, 50, 100], np.float32), "time_unit": "s"}, "cannot tell microseconds"),
        ({"t": [0, 1, np.nan], "time_unit": "s"}, "event 2 has t = nan s"),
        ({"t": [0, 1, 1e300], "time_unit": "s"}, "not a usable time"),
        ({"t": [0, 1, 2**60], "time_unit": "s"}, "not a usable time"),
        ({"t": [0.0, 1.0, 2.0], "time_unit": "ns"}, "must hold integers"),
        ({"t": [0, 1, 2**63 - 1], "origin_us": -(2**63)}, "too large"),
        ({"t": ["a", "b", "c"], "time_unit": "s"}, "must hold numbers"),
        ({"origin_us": 0.5}, "origin_us must be whole microseconds"),
    ],
)
def test_conversions_do_not_lose_or_wrap_silently(changes, message):
    with pytest.raises(InputError, match=message):
        three(**changes)


@pytest.mark.parametrize("names", ["xytp", ("x", "y", "ts", "pol"), ("x", "y", "timestamp", "on")])
def test_structured_arrays(names):
    kinds = [np.uint16, np.uint16, np.int64, np.uint8]
    array = np.zeros(3, dtype=list(zip(names, kinds, strict=True)))
    for name, column in zip(names, (X, Y, T, P), strict=True):
        array[name] = column
    events = Events.from_structured(array, 4, 3)
    assert [getattr(events, name).tolist() for name in "xyt"] == [X, Y, T]
    assert events.x.flags.c_contiguous
    assert events.t.flags.aligned


def test_a_structured_array_without_a_column_is_refused():
    with pytest.raises(InputError, match="no field t or ts"):
        Events.from_structured(np.zeros(2, dtype=[("x", "u2"), ("y", "u2"), ("p", "?")]), 4, 3)
    with pytest.raises(InputError, match="structured array"):
        Events.from_structured(np.zeros((2, 4)), 4, 3)


def test_columns_cannot_be_changed():
    events = three()
    with pytest.raises(ValueError, match="read-only"):
        events.x[0] = 9
    with pytest.raises(AttributeError):
        events.x = np.zeros(3)


def test_slices_share_memory_and_keep_the_sensor():
    events = three()
    part = events[1:]
    assert np.shares_memory(part.t, events.t)
    assert (len(part), part.shape) == (2, (3, 4))
    assert not part.t.flags.writeable
    assert events[np.array([True, False, True])].x.tolist() == [0, 2]


@pytest.mark.parametrize("rows", [slice(None, None, -1), slice(0, 3, 2), 1, [0, 1], [True, False]])
def test_selections_that_could_break_the_order_are_refused(rows):
    with pytest.raises(InputError, match=r"slice"):
        three()[rows]


@given(st.lists(st.integers(0, 40), max_size=30), st.integers(-5, 50), st.integers(-5, 50))
@settings(deadline=None)
def test_between_is_half_open(times, start, stop):
    t = np.sort(np.array(times, dtype=np.int64))
    events = Events.from_arrays(0 * t, 0 * t, t, 0 * t, 1, 1)
    expected = [value for value in t.tolist() if start <= value < stop]
    assert events.between(start, stop).t.tolist() == expected


def test_between_takes_any_integer_and_no_seconds():
    assert len(three().between(-(10**30), 10**30)) == 3
    with pytest.raises(InputError, match=r"t1_us must be whole microseconds .int., not 0.5"):
        three().between(0, 0.5)


def test_concatenate_joins_in_order_only():
    events = three()
    joined = Events.concatenate([events[:1], Events.empty(4, 3), events[1:]])
    assert joined.t.tolist() == T
    assert joined.p.tolist() == [False, True, True]
    with pytest.raises(InputError, match="order of time"):
        Events.concatenate([events[1:], events[:1]])
    with pytest.raises(InputError, match="has shape"):
        Events.concatenate([events, Events.empty(3, 4)])
    with pytest.raises(InputError, match="nothing to concatenate"):
        Events.concatenate([])


def test_an_empty_stream_is_a_stream():
    for empty in (Events.empty(4, 3), Events.from_arrays([], [], [], [], 4, 3)):
        assert (len(empty), empty.duration, len(empty.between(0, 9))) == (0, 0.0, 0)


def test_a_time_near_the_largest_float_is_refused_without_overflow():
    with pytest.raises(InputError, match="not a usable time"):
        Events.from_arrays([0], [0], [1e305], [1], 4, 3, time_unit="s")


_columns = hnp.arrays(
    dtype=st.one_of(
        hnp.integer_dtypes(), hnp.floating_dtypes(sizes=(32, 64)), hnp.boolean_dtypes()
    ),
    shape=hnp.array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=4),
)


@given(
    x=_columns, y=_columns, t=_columns, p=_columns, unit=st.sampled_from(["us", "s", "ms", "ns"])
)
@settings(deadline=None, max_examples=300)
def test_random_arrays_are_refused_or_become_valid_events(x, y, t, p, unit):
    try:
        events = Events.from_arrays(x, y, t, p, 9, 7, time_unit=unit)
    except InputError:
        return
    assert len(events) == t.size == events.x.size == events.y.size == events.p.size
    assert (events.x < 9).all()
    assert (events.y < 7).all()
    assert (np.diff(events.t) >= 0).all()
    assert not len(events) or 0 <= events.t[0] <= events.t[-1] <= MAX_TIME_US
