"""The joint refinement as a calibration asks for it, the camera's position found or compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from evcalib.arrays import Floats
from evcalib.heading import Correspondences
from evcalib.heading.gyro import as_seen
from evcalib.joint import JointRefinement, Start, Systematic, global_start, refine_jointly
from evcalib.joint.tracks import Tracks, tracks_of
from evcalib.kinematics.velocity_track import VelocityTrack
from evcalib.pipeline._gyro import Gyro
from evcalib.pipeline._position import Told, contradicts
from evcalib.pipeline._turning import TURNS
from evcalib.series import VelocitySeries


class Asked(NamedTuple):
    """What is asked for; see `evcalib.calibrate`."""

    focal: float
    max_offset: float
    offset: float | None
    told: Told
    refinement: str
    systematic: Systematic
    odometry_sd: float | None
    seed: int
    gyro: Gyro | None = None


@dataclass(frozen=True, eq=False)
class Refiner:
    """Refines on some tracks; `turning` is the body's yaw rate beyond noise [rad/s], rms.

    Where a gyro turned the tracks back, `seen` holds them as the camera saw them: the global start
    takes the turning out by the odometry's yaw.
    """

    tracks: Tracks
    velocities: VelocitySeries
    track: VelocityTrack
    turning: float
    asked: Asked
    seen: Tracks

    @classmethod
    def of(
        cls,
        found: Correspondences,
        velocities: VelocitySeries,
        track: VelocityTrack,
        turning: float,
        asked: Asked,
    ) -> Refiner:
        """Return that of correspondences, turned back where a gyro is asked for."""
        tracks = seen = tracks_of(found)
        if asked.gyro is not None:
            seen = tracks_of(as_seen(found, asked.gyro.attitude))
        return cls(tracks, velocities, track, turning, asked, seen)

    def start(self) -> Start | None:
        """Return where to begin without headings; None where too few tracks are covered."""
        return global_start(
            self.seen,
            self.velocities,
            self.track,
            focal=self.asked.focal,
            max_offset=self.asked.max_offset,
            lever=self.asked.told.lever,
            seed=self.asked.seed,
        )

    def __call__(
        self,
        R_body_cam: Floats,
        offset: float,
        position: Floats | None = None,
        *,
        estimate_offset: bool = True,
        estimate_position: bool = True,
    ) -> tuple[JointRefinement | None, JointRefinement | None]:
        """Return the refinement, and the one that estimated the position, if one did.

        A position that was given holds, unless the data contradict it; another one is where the
        search for it starts.  Without that search it holds, too.
        """
        told = self.asked.told
        lever = told.lever
        if told.position is None and position is not None:
            lever = float(position[0]), float(position[1]), lever[2]
        start = R_body_cam, offset
        if self.turning <= TURNS or not estimate_position:
            return self._refine(start, lever, estimate_offset, False), None
        free = self._refine(start, lever, estimate_offset, True)
        if free is None or told.position is None or contradicts(free, told):
            return free, free
        start = free.R_body_cam, free.offset
        return self._refine(start, told.lever, estimate_offset, False), free

    def _refine(
        self,
        start: tuple[Floats, float],
        lever: tuple[float, float, float],
        estimate_offset: bool,
        estimate_position: bool,
    ) -> JointRefinement | None:
        return refine_jointly(
            self.tracks,
            self.velocities,
            self.track,
            *start,
            focal=self.asked.focal,
            estimate_offset=estimate_offset,
            estimate_position=estimate_position,
            max_offset=self.asked.max_offset,
            systematic=self.asked.systematic,
            lever=lever,
            gyro_sd=None if self.asked.gyro is None else self.asked.gyro.rate_sd,
        )
