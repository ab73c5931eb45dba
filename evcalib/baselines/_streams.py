"""Rivals that take headings and velocities."""

from __future__ import annotations

from evcalib.alignment.offset import find_offset
from evcalib.alignment.rotation import estimate_rotation
from evcalib.baselines._interface import RivalCalibration, RivalInput, finish


def vc(streams: RivalInput, *, max_offset: float = 1.0) -> RivalCalibration:
    """Align by velocity correlation as in the paper: trace correlation, then L1 registration.

    The correlation is mended as in :func:`evcalib.alignment.offset.find_offset`.  The peak is
    taken as it is, also where the motion does not determine the offset, and velocities are not
    smoothed.
    """
    return _aligned(streams, "vc", "trace", "l1", max_offset)


def vc_wota(streams: RivalInput) -> RivalCalibration:
    """Register headings with the velocities of the same instants, as if the clocks were one."""
    part, d = streams.pair().covered(0.0)
    found = estimate_rotation(part.headings.v, d, method="kabsch", weight=part.weight)
    return finish(streams, found.R_body_cam, 0.0, method="vc_wota")


def cca(streams: RivalInput, *, max_offset: float = 1.0) -> RivalCalibration:
    """Align by the first canonical correlation, and take the rotation from S_oo^+ S_oe.

    Qiu et al., "Real-time temporal and rotational calibration of heterogeneous sensors using motion
    correlation analysis" (2020), correlate angular rates; here it is directions of travel.
    """
    return _aligned(streams, "cca", "canonical", "cca", max_offset)


def correlate(streams: RivalInput, *, max_offset: float = 1.0) -> RivalCalibration:
    """Align by the correlation of the rates at which the two directions of travel turn."""
    return _aligned(streams, "cross_correlation", "scalar", "kabsch", max_offset)


def _aligned(
    streams: RivalInput, name: str, score: str, rotation: str, max_offset: float
) -> RivalCalibration:
    """Take the peak of a score, and register what the odometry covers there."""
    pair = streams.pair()
    curve = find_offset(pair.headings, pair.track, max_offset=max_offset, method=score)
    part, d = pair.covered(curve.offset)
    found = estimate_rotation(part.headings.v, d, method=rotation, weight=part.weight)
    settings = {"max_offset": max_offset}
    R = found.R_body_cam
    return finish(streams, R, curve.offset, method=name, curve=curve, settings=settings)
