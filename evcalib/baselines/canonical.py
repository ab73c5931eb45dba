"""Canonical correlation analysis of the two streams (Qiu et al. 2020), offset and rotation."""

from __future__ import annotations

from evcalib.baselines.rival import RivalCalibration, RivalInput, finish, paired, track_of
from evcalib.offset import find_offset, weights
from evcalib.rotation import estimate_rotation


def cca(streams: RivalInput, *, max_offset: float = 1.0) -> RivalCalibration:
    """Align by the first canonical correlation, and take the rotation from S_oo^+ S_oe.

    Qiu et al., "Real-time temporal and rotational calibration of heterogeneous sensors using motion
    correlation analysis" (2020), correlate angular rates; here it is directions of travel.
    """
    headings, track = streams.usable_headings(), track_of(streams)
    curve = find_offset(headings, track, max_offset=max_offset, method="canonical")
    part, d = paired(headings, track, curve.offset)
    found = estimate_rotation(part.v, d, method="cca", weight=weights(part))
    return finish(
        streams,
        found.R_body_cam,
        curve.offset,
        method="cca",
        curve=curve,
        settings={"max_offset": max_offset},
    )
