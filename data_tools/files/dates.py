"""Columns of dates or times of day (ISO 8601), as seconds."""

from __future__ import annotations

from datetime import UTC, datetime, time

import numpy as np

from evcalib.arrays import Floats


def seconds_of(cells: list[str]) -> tuple[Floats, str] | None:
    """Return the seconds of dates or times of day, and what they count from; None if it is neither.

    Empty cells are NaN.  Dates without a zone are taken to be in UTC, all alike.

    Parameters
    ----------
    cells : list of str, length n
        Such as ``2024-05-01T12:00:00.25`` or ``12:00:00.25``.
    """
    for read, since in ((_date, "since 1970 (UTC, unless a zone is told)"), (_clock, "of the day")):
        try:
            values = [read(cell.strip()) if cell.strip() else np.nan for cell in cells]
        except ValueError:
            continue
        if not np.isnan(values).all():
            return np.array(values), since
    return None


def _date(cell: str) -> float:
    if ":" not in cell or len(cell) < len("2024-05-01T12:00"):
        raise ValueError
    read = datetime.fromisoformat(cell)
    return (read if read.tzinfo else read.replace(tzinfo=UTC)).timestamp()


def _clock(cell: str) -> float:
    if ":" not in cell:
        raise ValueError
    read = time.fromisoformat(cell)
    return read.hour * 3600 + read.minute * 60 + read.second + read.microsecond / 1e6
