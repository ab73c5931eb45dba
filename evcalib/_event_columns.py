"""Checks and conversions of event columns: any integers in, the four types out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evcalib.arrays import Flags, Integers
from evcalib.checks import whole_us
from evcalib.errors import InputError

MAX_TIME_US = 10**14
"""Times above this [us], about three years, are taken for Unix time or for nanoseconds.

A choice between what is found: recordings last hours (1e10), Unix time is 1.7e15, and an hour in
nanoseconds 3.6e12; a day of these is as large as this.
"""

_PER_UNIT = {"s": 1_000_000, "ms": 1_000}


def _owned(values: NDArray, dtype: type) -> NDArray:
    """Return the column as the kernels take it: native, aligned, contiguous."""
    return np.require(values, dtype, ("C", "A"))


def _column(values: ArrayLike, name: str) -> NDArray:
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"event column {name} is not an array: {error}") from None
    if array.ndim != 1:
        raise InputError(f"event column {name} must have shape (n,), not {array.shape}")
    return array if array.size else array.astype(np.int64 if array.dtype == float else array.dtype)


def integers(values: ArrayLike, name: str) -> NDArray:
    """Return a column of integers of any size."""
    array = _column(values, name)
    if array.dtype.kind in "iu":
        return array
    advice = "convert it, e.g. with astype(numpy.int64), if nothing is lost"
    if name == "t":
        advice = (
            "say what they are: Events.from_arrays(..., time_unit='s') if seconds,"
            " astype(numpy.int64) if microseconds"
        )
    raise InputError(f"event column {name} must hold integers, not {array.dtype}; {advice}")


def pixels(column: ArrayLike, name: str, side: int, side_name: str) -> NDArray[np.uint16]:
    """Return coordinates within the sensor."""
    values = integers(column, name)
    if values.size and (values.min() < 0 or values.max() >= side):
        row = int(np.argmax((values < 0) | (values >= side)))
        raise InputError(
            f"event {row} has {name} = {values[row]}, outside the sensor ({side_name} {side});"
            f" is {side_name} right, are x and y swapped?"
        )
    return _owned(values, np.uint16)


def times_us(column: ArrayLike) -> Integers:
    """Return ascending times of a plausible size [us]."""
    t = integers(column, "t")
    if not t.size:
        return t.astype(np.int64)
    back = t[1:] < t[:-1]
    if back.any():
        row = int(np.argmax(back)) + 1
        raise InputError(
            f"event {row} (t = {t[row]} us) comes before event {row - 1} (t = {t[row - 1]} us);"
            " sort the events by time, stably, or find out why they are not"
        )
    if t[0] < 0:
        raise InputError(f"event 0 has t = {t[0]} us; times start at 0 or later: shift them")
    if t[-1] > MAX_TIME_US:
        raise InputError(
            f"event {t.size - 1} has t = {t[-1]} us, more than three years: Unix time or"
            " nanoseconds? Use Events.from_arrays(..., origin_us=...) or time_unit='ns'"
        )
    return _owned(t, np.int64)


def polarity(values: ArrayLike) -> Flags:
    """Return polarities from booleans or from one of the two codings."""
    p = _column(values, "p")
    if p.dtype == np.bool_:
        return _owned(p, np.bool_)
    p = integers(p, "p")
    if not p.size:
        return p.astype(np.bool_)
    if p.min() < -1 or p.max() > 1:
        row = int(np.argmax((p < -1) | (p > 1)))
        raise InputError(f"event {row} has polarity {p[row]}; use booleans, {{0, 1}} or {{-1, 1}}")
    if p.min() == -1 and (p == 0).any():
        raise InputError(
            f"polarity mixes codings: -1 at event {int(np.argmax(p == -1))}, 0 at event"
            f" {int(np.argmax(p == 0))}; use booleans, {{0, 1}} or {{-1, 1}}"
        )
    return p > 0


def to_us(values: ArrayLike, unit: str) -> NDArray:
    """Return times as integer microseconds, rounded to the nearest."""
    if unit == "us":
        return integers(values, "t")
    t = _column(values, "t")
    if unit == "ns":
        t = integers(t, "t")
        t = t.astype(np.uint64 if t.dtype.kind == "u" else np.int64)
        half_up = t % 1000 >= 500
        return t // 1000 + half_up
    scale = _PER_UNIT[unit]
    if t.dtype.kind not in "iuf":
        raise InputError(f"event column t must hold numbers, not {t.dtype}")
    bad = ~(np.abs(t.astype(np.float64)) < 2.0**62 / scale)
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(f"event {row} has t = {t[row]} {unit}, not a usable time")
    if t.dtype.kind in "iu":
        return t.astype(np.int64) * scale
    if t.size and np.spacing(np.abs(t).max()) * scale > 1:
        raise InputError(
            f"{t.dtype} cannot tell microseconds apart at t = {np.abs(t).max()} {unit};"
            " read the times with more digits"
        )
    return np.rint(t.astype(np.float64) * scale).astype(np.int64)


def minus(t: NDArray, origin: int) -> Integers:
    """Subtract an origin [us] without wrapping around."""
    origin = whole_us(origin, "origin_us")
    limit = np.iinfo(np.int64).max
    if t.size and (abs(origin) > limit // 2 or max(-int(t.min()), int(t.max())) > limit // 2):
        raise InputError("times or origin_us are too large for microseconds")
    return t.astype(np.int64) - origin
