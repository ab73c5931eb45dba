"""Cross-correlation of one scalar that both sensors know (cf. Mair et al. 2011), then Kabsch."""

from __future__ import annotations

from evcalib.baselines.rival import RivalCalibration, RivalInput, finish, paired, track_of
from evcalib.offset import find_offset, weights
from evcalib.rotation import estimate_rotation


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
