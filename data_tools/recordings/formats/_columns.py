"""Raw arrays of a file to `Columns`: checked, converted, piece by piece."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_tools.recordings.formats import Columns
from evcalib import _event_columns as take
from evcalib import checks
from evcalib.arrays import Flags, Integers
from evcalib.errors import InputError

ALIASES = {
    "x": ("x", "xs"),
    "y": ("y", "ys"),
    "t": ("t", "ts", "time", "timestamp", "timestamps"),
    "p": ("p", "ps", "pol", "polarity", "on"),
}
"""Names under which files keep the four columns; the first is ours."""

_LATEST = 1 << 62


def find_columns(names: list[str] | tuple[str, ...]) -> dict[str, str] | None:
    """Return the name in a file of each of x, y, t, p, or None if one is missing or ambiguous."""
    found = {}
    for key, aliases in ALIASES.items():
        fitting = [name for name in names if name.lower() in aliases]
        if len(fitting) != 1:
            return None
        found[key] = fitting[0]
    return found


class Converter:
    """Convert pieces of raw columns, of whatever types, with the number of the event in errors.

    Parameters
    ----------
    whole, fractional : {"s", "ms", "us", "ns"}, optional
        Unit of times that are integers and of times that are floats; without it they are refused.
    """

    def __init__(self, whole: str | None, fractional: str | None) -> None:
        self._units = {"i": whole, "u": whole, "f": fractional}
        self._row = 0
        self._minus = self._zero = False

    def __call__(self, x: NDArray, y: NDArray, t: NDArray, p: NDArray) -> Columns:
        """Return a piece as `Columns`.

        Raises
        ------
        InputError
            If a column is not of numbers, a pixel is no whole number or negative, a time is no
            usable number, or polarity codings are mixed, also from one piece to another.
        """
        sizes = {name: column.size for name, column in (("x", x), ("y", y), ("t", t), ("p", p))}
        if len(set(sizes.values())) > 1 or any(a.ndim != 1 for a in (x, y, t, p)):
            lengths = ", ".join(f"{name} {size}" for name, size in sizes.items())
            raise InputError(f"the columns of events differ in length: {lengths}")
        columns = Columns(
            self._pixels(x, "x"), self._pixels(y, "y"), self._times(t), self._polarity(p)
        )
        self._row += t.size
        return columns

    def _pixels(self, values: NDArray, name: str) -> NDArray[np.unsignedinteger]:
        whole = self._whole(values, name)
        bad = (whole < 0) | (whole > checks.MAX_SIDE)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(f"event {self._row + row} has {name} = {whole[row]}, no pixel")
        return whole.astype(np.uint16)

    def _whole(self, values: NDArray, name: str) -> NDArray:
        """Return whole numbers, also where they are kept as floats or booleans."""
        if values.dtype.kind in "iu":
            return values
        if values.dtype == np.bool_:
            return values.astype(np.uint8)
        if values.dtype.kind != "f":
            raise InputError(f"column {name} must hold numbers, not {values.dtype}")
        bad = ~((np.abs(values) < 2.0**31) & (np.rint(values) == values))
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"event {self._row + row} has {name} = {values[row]}, not a whole number"
            )
        return values.astype(np.int64)

    def _times(self, values: NDArray) -> Integers:
        kind = values.dtype.kind
        if kind not in self._units:
            raise InputError(f"times must be numbers, not {values.dtype}")
        unit = self._units[kind]
        if unit is None:
            raise InputError(
                f"times are {'fractions' if kind == 'f' else 'whole numbers'}; say their unit:"
                " time_unit='us' (--time-unit us) or another"
            )
        if kind == "f" and unit in ("us", "ns"):
            values = self._whole_times(values)
        late = values > _LATEST if kind == "u" else np.zeros(0, dtype=np.bool_)
        if late.any():
            row = int(np.argmax(late))
            raise InputError(f"event {self._row + row} has t = {values[row]} {unit}, not a time")
        try:
            return take.to_us(values, unit).astype(np.int64)
        except InputError as error:
            raise InputError(f"counted from event {self._row}: {error}") from None

    def _whole_times(self, values: NDArray) -> Integers:
        bad = ~((np.abs(values) < 2.0**53) & (np.rint(values) == values))
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"event {self._row + row} has t = {values[row]}, not whole; is the unit right?"
            )
        return values.astype(np.int64)

    def _polarity(self, values: NDArray) -> Flags:
        if values.dtype == np.bool_:
            return values
        p = self._whole(values, "p")
        if not p.size:
            return p.astype(np.bool_)
        bad = (p > 1) | (p < -1)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"event {self._row + row} has polarity {p[row]}; it must be 0 or 1, or -1 or 1"
            )
        self._minus |= bool((p < 0).any())
        self._zero |= bool((p == 0).any())
        if self._minus and self._zero:
            raise InputError(
                f"polarities mix codings, -1 and 0, before event {self._row + values.size}"
            )
        return p > 0
