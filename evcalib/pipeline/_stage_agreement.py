"""Whether headings and sightings agree, and what all checks of the model say together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from evcalib.alignment import Calibration
from evcalib.alignment.observability import HEADING_BIAS, DirectionSpread
from evcalib.arrays import Floats
from evcalib.display import Shown
from evcalib.geometry import rotation_vector
from evcalib.joint import SURE, SYSTEMATIC, JointRefinement

ROTATIONS_APART = float(stats.chi2.isf(0.001, 3))
"""Square of the distance, in standard deviations, from which two rotations differ: that of one pair
in a thousand.  The floor of `HEADING_BIAS` makes it rarer: the largest of the campaign's clean
drives is a third of it (tests/README.md)."""

OFFSETS_APART = 3.0
"""Standard deviations from which two offsets differ: one pair in 370."""

OFFSET_BIAS = 0.005
"""Systematic error [s] of an offset from headings alone, which trail as corners do: clean drives of
the campaign differ by up to 8 ms at a stated 5 (tests/README.md)."""

GROSS = 2.0
"""Times these distances beyond which nothing counts as determined: a choice.  Either answer is then
beyond any error bar of the other, and nothing says which of them is right."""

STRAINED = float(stats.chi2.isf(1 / 300, 4))
"""Sum of squares from which all checks together speak against the model: one clean drive in 300.
Clocks, directions and lag are standard normal then; turning, rotations and offsets have floors, and
add as much as one more (mean of the campaign's clean drives: 3.5, tests/README.md)."""


@dataclass(frozen=True, eq=False)
class StageAgreement(Shown):
    """How far alignment and refinement are apart.

    Attributes
    ----------
    rotation : float
        Square of the distance between both rotations at the refined offset, in standard deviations
        of both and of `HEADING_BIAS`; as chi-square of three degrees of freedom.
    rotation_apart : float
        Angle between them [rad].
    offset : float
        Distance between both offsets in standard deviations of both and of `OFFSET_BIAS`; 0 where
        the alignment has none of its own.
    offset_apart : float
        The same [s].
    """

    rotation: float
    rotation_apart: float
    offset: float
    offset_apart: float

    @classmethod
    def of(
        cls,
        R_body_cam: Floats | None,
        covariance: Floats,
        joint: JointRefinement,
        spread: DirectionSpread,
        aligned: Calibration | None = None,
    ) -> StageAgreement:
        """Compare the rotation of headings with a refinement's, and the offsets where both have.

        Parameters
        ----------
        R_body_cam, covariance : ndarray, shape (3, 3)
            Rotation of the headings at the refinement's offset, and its covariance [rad^2]; None
            where they agree with nothing there, so that there is nothing to compare.
        joint : JointRefinement
            The refinement.
        spread : DirectionSpread
            Of the body directions: what headings share turns the rotation about their main axis
            the more, the less they spread.
        aligned : Calibration, optional
            With the offset of the headings; None where it was given to the refinement.
        """
        apart = np.zeros(3)
        if R_body_cam is not None:
            apart = rotation_vector(R_body_cam @ joint.R_body_cam.T)
        along = np.outer(spread.axis, spread.axis)
        lever = 1.0 / max(spread.spread, 1e-3)
        shared = HEADING_BIAS**2 * (np.eye(3) - along + lever**2 * along)
        both = covariance + joint.covariance[:3, :3] + shared
        offset = distance = 0.0
        if aligned is not None and aligned.offset_observable:
            offset = aligned.offset - joint.offset
            variance = aligned.offset_sd**2 + joint.covariance[3, 3] + OFFSET_BIAS**2
            distance = abs(offset) / float(np.sqrt(variance))
        return cls(
            rotation=float(apart @ np.linalg.solve(both, apart)),
            rotation_apart=float(np.linalg.norm(apart)),
            offset=distance,
            offset_apart=offset,
        )

    @property
    def gross(self) -> bool:
        """Whether they are so far apart that neither is believed."""
        return self.rotation > GROSS**2 * ROTATIONS_APART or self.offset > GROSS * OFFSETS_APART

    def doubts(self) -> tuple[str, ...]:
        """Return in words where they differ beyond their error bars."""
        said = []
        if self.rotation > ROTATIONS_APART:
            said.append(
                "The rotation of the headings and that of the sightings are"
                f" {np.degrees(self.rotation_apart):.1f} deg apart, beyond the error bars of both."
            )
        if self.offset > OFFSETS_APART:
            said.append(
                "The offset of the headings and that of the sightings are"
                f" {1e3 * abs(self.offset_apart):.0f} ms apart, beyond the error bars of both."
            )
        return tuple(said)


def strain(joint: JointRefinement, agreement: StageAgreement, turning: float) -> float:
    """Return how much all checks of the model say against it together, as a chi-square.

    The sum of the squares of what each says in standard deviations: errors that many checks see,
    each just not enough, show so (as Fisher's method has it).

    Parameters
    ----------
    joint : JointRefinement
        Its drift, distortion, turning and lag.
    agreement : StageAgreement
        With the headings.
    turning : float
        Untold yaw rate [rad/s] that counts as `SURE` standard deviations.

    Returns
    -------
    float
        Above `STRAINED` by chance for one drive in 300.
    """
    rare = float(stats.chi2.sf(agreement.rotation, 3))
    said = (
        joint.drift.z,
        joint.distortion.z,
        SURE * joint.turning / turning,
        joint.lag / SYSTEMATIC.lag_sd,
        float(stats.norm.isf(max(rare, 1e-300) / 2)),
        agreement.offset,
    )
    return float(np.sum(np.square(said)))
