"""Names of columns as people write them: ``T``, ``Time (ms)``, ``speed_fl [m/s]``."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection

from evcalib.errors import InputError

TIMES = ("time", "timestamp", "stamp")
"""Names of a column that is taken for ``t`` where no column has that name."""

_UNIT = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_SPELLED = {
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("\u00b5s", "\u03bcs", "usec", "microseconds"), "us"),
    **dict.fromkeys(("msec", "milliseconds"), "ms"),
    **dict.fromkeys(("nsec", "nanoseconds"), "ns"),
    **dict.fromkeys(("\u00b0", "degree", "degrees"), "deg"),
    **dict.fromkeys(("\u00b0/s", "deg/sec", "dps"), "deg/s"),
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("", "-", "1"), ""),
}


def parted(name: str) -> tuple[str, str]:
    """Return a name without the unit in brackets behind it, and that unit as we write it."""
    match = _UNIT.fullmatch(name.strip())
    if match is None:
        return name.strip(), ""
    unit = (match[2] if match[2] is not None else match[3]).strip()
    return match[1], _SPELLED.get(unit.lower(), unit)


def our_names(
    header: list[str], ours: Collection[str], alias: Callable[[str], str] | None = None
) -> dict[str, tuple[int, str]]:
    """Return, by our name, the place of a column of a header and the unit that stands behind it.

    Names may differ from ours in upper and lower case, have a unit in brackets behind them, and be
    one of `TIMES` for ``t``.  One that is ours to the letter goes before others.

    Parameters
    ----------
    header : list of str
        Names in the order of the file.
    ours : collection of str
        Names that the reader knows.
    alias : callable, optional
        Returns our name of a column of another name.

    Raises
    ------
    InputError
        If two columns are one of ours.
    """
    exact = {name: (k, "") for k, name in enumerate(header) if name in ours}
    found: dict[str, tuple[int, str]] = {}
    for k, given in enumerate(header):
        name, unit = parted(given)
        low = name.lower()
        ours_there = [own for own in ours if own.lower() == low and own not in exact]
        if not ours_there and alias is not None and alias(low) in ours and alias(low) not in exact:
            ours_there = [alias(low)]
        if not ours_there and low in TIMES and "t" in ours and "t" not in exact:
            ours_there = ["t"]
        for own in ours_there:
            if own in found:
                raise InputError(
                    f"both {header[found[own][0]]} and {given} may be the column {own}; rename one"
                    " of them"
                )
            found[own] = (k, unit)
    return found | exact
