"""The methods that align trajectories, with the same result type as the others."""

from __future__ import annotations

from typing import Any

from evcalib.baselines._interface import (
    CertifiedCalibration,
    RivalInput,
    TrajectoryCalibration,
    finish,
)
from evcalib.baselines.cgoc import cgoc as _cgoc
from evcalib.baselines.hand_eye import HandEye
from evcalib.baselines.hand_eye import hand_eye as _hand_eye


def hand_eye(
    streams: RivalInput, *, max_offset: float | None = None, monocular: bool = True
) -> TrajectoryCalibration:
    """Align trajectories by AX = XB; with `max_offset` [s], the offset is an unknown too."""
    found = _hand_eye(*streams.trajectories("hand_eye"), max_offset=max_offset, monocular=monocular)
    return finish(
        streams,
        found.R_body_cam,
        found.offset,
        method="hand_eye" if max_offset is None else "hand_eye_offset",
        kind=TrajectoryCalibration,
        curve=found.curve,
        settings={"max_offset": max_offset, "monocular": monocular},
        **_extra(found),
    )


def cgoc(streams: RivalInput, *, monocular: bool = True) -> CertifiedCalibration:
    """Align trajectories by AX = XB to certified global optimality, clocks taken as one."""
    found = _cgoc(*streams.trajectories("cgoc"), monocular=monocular)
    certificate = found.certificate
    return finish(
        streams,
        found.solution.R_body_cam,
        found.solution.offset,
        method="cgoc",
        kind=CertifiedCalibration,
        settings={"monocular": monocular},
        duality_gap=certificate.gap,
        relative_gap=certificate.relative_gap,
        min_eigenvalue=certificate.min_eigenvalue,
        certified=certificate.certified,
        **_extra(found.solution),
    )


def _extra(found: HandEye) -> dict[str, Any]:
    return {
        "lever_arm": found.lever_arm,
        "reason": found.reason,
        "unknown_axis": found.unknown_axis,
        "scale": found.scale,
        "cost": found.cost,
    }
