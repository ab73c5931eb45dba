"""The paper's own methods: VC, and VC without time alignment (VC-woTA)."""

from __future__ import annotations

from evcalib.baselines.rival import RivalCalibration, RivalInput, finish, paired, track_of
from evcalib.offset import find_offset, weights
from evcalib.rotation import estimate_rotation


def vc(streams: RivalInput, *, max_offset: float = 1.0) -> RivalCalibration:
    """Align by velocity correlation as in the paper: trace correlation, then L1 registration.

    The correlation is mended as in :func:`evcalib.offset.find_offset`.  The peak is taken as it is,
    also where the motion does not determine the offset, and velocities are not smoothed.
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
