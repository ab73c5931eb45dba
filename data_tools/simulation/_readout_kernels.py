"""The jitted arbiter of the rows."""

# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np

from evcalib.kernels.jit import jit


@jit
def serve_rows(t, y, rows, busy):
    """Return the times at which events are read, their order, and when the readout is free again.

    `busy` is the time for a row, the time for an event, and when the readout is free [us].  Each
    time, the row of the event that has waited longest is read, with all of its that wait.
    """
    row_time, event_time, free = busy
    n = t.size
    out, order = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    first, last = np.full(rows, -1), np.full(rows, -1)
    following, read = np.full(n, -1), np.zeros(n, dtype=np.bool_)
    done, arrived, oldest = 0, 0, 0
    while done < n:
        while read[oldest]:
            oldest += 1
        now = max(free, float(t[oldest]))
        while arrived < n and t[arrived] <= now:
            row = y[arrived]
            if first[row] < 0:
                first[row] = arrived
            else:
                following[last[row]] = arrived
            last[row] = arrived
            arrived += 1
        row = y[oldest]
        free = now + row_time
        stamp = math.ceil(free)
        k = first[row]
        while k >= 0:
            out[done], order[done], read[k] = stamp, k, True
            done += 1
            free += event_time
            k = following[k]
        first[row] = -1
    return out, order, free
