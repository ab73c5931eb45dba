"""Rivals that take headings and velocities."""

from __future__ import annotations

from evcalib.alignment import weights
from evcalib.alignment.offset import find_offset
from evcalib.alignment.rotation import estimate_rotation
from evcalib.baselines._interface import RivalCalibration, RivalInput, finish, paired, track_of


def vc(streams: RivalInput, *, max_offset: float = 1.0) -> RivalCalibration:
    """Align by velocity correlation as in the paper: trace correlation, then L1 registration.

    The correlation is mended as in :func:`evcalib.alignment.offset.find_offset`.  The peak is
    taken as it is, also where the motion does not determine the offset, and velocities are not
    smoothed.
    """
    headings, track = streams.usable_headings(), track_of(streams)
    curve = find_offset(headings, track, max_offset=max_offset, method="trace")
    part, d = paired(headings, track, curve.offset)
    found = estimate_rotation(part.v, d, method="l1", weight=weights(part))
    return finish(
        streams,
        found.R_body_cam,
        curve.offset,
        method="vc",
        curve=curve,
        settings={"max_offset": max_offset},
    )


def vc_wota(streams: RivalInput) -> RivalCalibration:
    """Register headings with the velocities of the same instants, as if the clocks were one."""
    part, d = paired(streams.usable_headings(), track_of(streams), 0.0)
    found = estimate_rotation(part.v, d, method="kabsch", weight=weights(part))
    return finish(streams, found.R_body_cam, 0.0, method="vc_wota")


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


def correlate(streams: RivalInput, *, max_offset: float = 1.0) -> RivalCalibration:
    """Align by the correlation of the rates at which the two directions of travel turn."""
    headings, track = streams.usable_headings(), track_of(streams)
    curve = find_offset(headings, track, max_offset=max_offset, method="scalar")
    part, d = paired(headings, track, curve.offset)
    found = estimate_rotation(part.v, d, method="kabsch", weight=weights(part))
    return finish(
        streams,
        found.R_body_cam,
        curve.offset,
        method="cross_correlation",
        curve=curve,
        settings={"max_offset": max_offset},
    )
