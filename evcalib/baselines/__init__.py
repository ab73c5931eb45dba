"""The rivals of our method, and ours, behind one call.

========================  ======================================================================
``ours``                  :func:`evcalib.align` with its defaults
``vc``                    the paper: trace correlation, then L1 registration
``vc_wota``               the paper without time alignment: registration of what is simultaneous
``authors``               the procedure that the paper's authors released
``cross_correlation``     correlation of the rates of turning, then least squares
``cca``                   canonical correlation for both (Qiu et al. 2020)
``hand_eye``              AX = XB by non-linear least squares, clocks taken as one
``hand_eye_offset``       the same with the offset as an unknown
``cgoc``                  AX = XB to certified global optimality (Giamou et al. 2019)
========================  ======================================================================

The last three align trajectories; the others take headings and velocities.
"""

from __future__ import annotations

from collections.abc import Callable

from evcalib import checks
from evcalib.alignment import Calibration, align
from evcalib.baselines import _streams, authors, trajectories
from evcalib.baselines._interface import (
    CertifiedCalibration,
    RivalCalibration,
    RivalInput,
    TrajectoryCalibration,
)

__all__ = [
    "METHODS",
    "TRAJECTORY_METHODS",
    "CertifiedCalibration",
    "RivalCalibration",
    "RivalInput",
    "TrajectoryCalibration",
    "calibrate_with",
]

METHODS: dict[str, Callable[[RivalInput, float, int], Calibration]] = {
    "ours": lambda s, reach, seed: align(
        s.headings, s.velocities, max_offset=reach, hold=s.hold, seed=seed
    ),
    "vc": lambda s, reach, _: _streams.vc(s, max_offset=reach),
    "vc_wota": lambda s, *_: _streams.vc_wota(s),
    "authors": lambda s, *_: authors.authors(s),
    "cross_correlation": lambda s, reach, _: _streams.correlate(s, max_offset=reach),
    "cca": lambda s, reach, _: _streams.cca(s, max_offset=reach),
    "hand_eye": lambda s, *_: trajectories.hand_eye(s),
    "hand_eye_offset": lambda s, reach, _: trajectories.hand_eye(s, max_offset=reach),
    "cgoc": lambda s, *_: trajectories.cgoc(s),
}
"""Every method by its name: a function of streams, half width of the search [s] and seed."""

TRAJECTORY_METHODS = ("hand_eye", "hand_eye_offset", "cgoc")
"""Those that need trajectories."""


def calibrate_with(
    name: str, streams: RivalInput, *, max_offset: float = 1.0, seed: int = 0
) -> Calibration:
    """Calibrate with the method of this name.

    Parameters
    ----------
    name : str
        A key of `METHODS`.
    streams : RivalInput
        Headings and velocities, and both trajectories for the methods that align trajectories.
    max_offset : float
        Offsets from -max_offset to max_offset [s] are searched, by the methods that search.
    seed : int
        Seed, for the methods that draw.

    Returns
    -------
    Calibration
        Of rivals a :class:`RivalCalibration`, which states no uncertainty.

    Raises
    ------
    InputError
        If the name is unknown, or the streams are unusable.
    """
    checks.one_of(name, "method", tuple(METHODS))
    checks.positive(max_offset, "max_offset", "seconds")
    return METHODS[name](streams, max_offset, seed)
