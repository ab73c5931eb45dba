"""Tracking and mapping in turns, over a stream that comes in pieces."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.checks import instance
from evcalib.display import Shown
from evcalib.errors import InputError, NoAnswerError
from evcalib.events import Events
from evcalib.geometry import rotation_angle, rotation_vector, rotation_vector_to_matrix
from evcalib.kernels.odometry.space_sweep import Planes
from evcalib.odometry._bootstrap import Start, find_start
from evcalib.odometry._lens import Lens, Rays
from evcalib.odometry.mapping import PLANES, DepthMap, depth_map, fill_volume, packets_of
from evcalib.odometry.tracking import Pose, ProjectedMap, event_image
from evcalib.poses import MIN_POSES, PoseSeries

STRETCH_US, STRIDE_US, PROOF_US = 2_000_000, 1_000_000, 1_000_000
"""Length of the stretches in which a start is looked for, from one to the next, and time after a
stretch over which tracking has to go on from its start [us]."""

FEWEST = 500
"""Fewest events of an event image."""

LONGEST = 0.1
"""Most time over which events are added up [s]."""

FILLED = 0.25
"""With less than this share of its events by then, the camera is taken to stand still."""

STALE = 4.0
"""The projected map is drawn anew when its points have moved by this much [px]."""

KEYFRAME, SWEPT = 0.08, 0.3
"""A new map is made when typical points have moved by this share of the image's width by a change
of place, from the events over the second share."""

MOST_SWEPT = 400_000
"""Most events of a map."""

NEAR, MARGIN = 95.0, 1.5
"""The last plane of the next map is at this percentile of the inverse depths, times the margin."""

AGREES = 0.3
"""Least correlation of an event image with the projected map."""

WEAK = 0.4
"""With a lower median correlation of the last images the end of a trajectory is doubted; where
poses are right it is about 0.6."""

CONFIRMED = 3
"""Fewest maps of a trajectory that is not doubted: the first two are of the start alone."""

PATIENCE = 10
"""After this many images in a row that do not agree, tracking is lost."""

FEWEST_POINTS = 200
"""Fewest points of a map that can be tracked."""

FLAT = 0.03
"""Edges lie in one plane if half of their inverse depths are nearer to one than this share of the
typical inverse depth; the planes of the volume alone scatter them by about a hundredth."""


@dataclass(frozen=True, eq=False)
class Trajectory(Shown):
    """What visual odometry finds.

    Attributes
    ----------
    poses : PoseSeries
        Of the camera, in a world whose unit of length is free; on the clock of the events.
    correlation : ndarray, shape (n,)
        Of event image and projected map at each pose; NaN where the camera stood still.
    maps : int
        Maps that were made.
    depth : DepthMap
        The last of them.
    events : int
        Events taken in.
    lost : str
        Why the trajectory ends before the recording; empty if it does not.
    skipped : float
        Time before the first pose, in which there was no start [s].
    doubts : tuple of str
        Why the poses may be wrong though tracking was not lost.
    """

    poses: PoseSeries
    correlation: Floats
    maps: int
    depth: DepthMap
    events: int
    lost: str
    skipped: float
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Frame:
    """Events of a moment, and where the camera was."""

    rays: Rays
    t: Floats
    middle: float
    pose: Pose
    correlation: float


class VisualOdometry:
    """Trajectory of an event camera from a stream that comes in pieces; see `estimate_trajectory`.

    Call `update` with each piece, then `finish`.  What grows with the recording are the poses.

    Parameters
    ----------
    camera : Camera
        Of the sensor that the events come from.
    seed : int
        Of the matches of corners that it starts from.
    """

    def __init__(self, camera: Camera, *, seed: int = 0) -> None:
        instance(camera, "camera", Camera)
        self._lens, self._seed = Lens(camera), seed
        self._waiting: list[Events] = []
        self._reasons: list[str] = []
        self._tracker: _Tracker | None = None
        self._events = 0
        self._first = 0.0

    def update(self, events: Events) -> None:
        """Take in the next events of the stream."""
        instance(events, "events", Events)
        self._lens.camera.require_size(events.width, events.height)
        if not len(events):
            return
        if not self._events:
            self._first = 1e-6 * float(events.t[0])
        self._events += len(events)
        if self._tracker is not None:
            self._tracker.update(*self._lens.rays(events))
            return
        self._waiting.append(events)
        while self._waiting and self._tracker is None:
            begin = int(self._waiting[0].t[0])
            if int(self._waiting[-1].t[-1]) < begin + STRETCH_US + PROOF_US:
                break
            self._try(begin)

    def finish(self) -> Trajectory:
        """Return the trajectory of all events taken in.

        Raises
        ------
        NoAnswerError
            If there was no start in them.
        """
        if not self._events:
            raise InputError("the stream holds no events")
        while self._tracker is None and self._waiting:
            begin, end = int(self._waiting[0].t[0]), int(self._waiting[-1].t[-1])
            if self._reasons and end - begin < STRIDE_US:
                break
            self._try(begin)
        if self._tracker is None:
            raise NoAnswerError(
                "no map could be made, so there is no trajectory. A start needs a part of up to"
                f" {1e-6 * STRETCH_US:.0f} s in which the camera moves straight and sees edges at"
                f" several depths; tried {len(self._reasons)}, the last one: {self._reasons[-1]}"
            )
        return self._tracker.finish(self._events, self._first)

    def _try(self, begin: int) -> None:
        """Look for a start in a stretch; without one, forget its first part."""
        whole = Events.concatenate(self._waiting)
        stretch = whole.between(begin, begin + STRETCH_US)
        found = find_start(stretch, self._lens.camera, self._seed)
        if isinstance(found, Start):
            proof = whole.between(begin, begin + STRETCH_US + PROOF_US)
            tracker = _Tracker(self._lens, found, *self._lens.rays(proof))
            if not (tracker.fault or tracker.lost):
                tracker.update(*self._lens.rays(whole[len(proof) :]))
                self._tracker, self._waiting = tracker, []
                return
            found = tracker.fault or tracker.lost
        self._reasons.append(found)
        rest = whole.between(begin + STRIDE_US, int(whole.t[-1]) + 1)
        self._waiting = [rest] if len(rest) else []


class _Tracker:
    """What goes on from a start."""

    def __init__(self, lens: Lens, start: Start, rays: Rays, t: Floats) -> None:
        self._view = lens.view
        self.fault, self.lost = "", ""
        self.maps, self._mapping = 0, False
        self._path = start.poses
        begin, end = start.poses.t[0], start.poses.t[-1]
        inside = slice(*np.searchsorted(t, [begin, end]))
        half = len(start.poses) // 2
        middle = Pose(start.poses.matrices[half], start.poses.position[half])
        planes = Planes(0.0, start.last / (PLANES - 1), PLANES)
        first = self._swept(rays[inside], t[inside], start.poses, middle, planes)
        if len(first) < FEWEST_POINTS:
            self.fault = f"too few of its edges are sharp ({len(first)} of {FEWEST_POINTS})"
            return
        if is_flat(first):
            self.fault = "all edges lie in one plane, before which a turn looks like a motion"
            return
        self._set_map(first)
        self._restart()
        self.update(rays[inside], t[inside])
        if self.lost or len(self._frames) < MIN_POSES:
            self.fault = "its events do not fit the map that is made of them"
            return
        self._new_map()
        self._mapping = True
        self.update(rays[inside.stop :], t[inside.stop :])

    def _restart(self) -> None:
        self._frames: deque[_Frame] = deque()
        self._t: list[float] = []
        self._poses: list[Pose] = []
        self._correlation: list[float] = []
        self._pending: tuple[Rays, Floats] | None = None
        self._misses = 0
        first = Pose(self._path.matrices[0], self._path.position[0])
        self._template = ProjectedMap(self._points, first, self._view)

    def update(self, rays: Rays, t: Floats) -> None:
        """Track the next events."""
        if self.lost:
            return
        if self._pending is not None:
            rays = np.concatenate([self._pending[0], rays])
            t = np.concatenate([self._pending[1], t])
        at = 0
        while at < t.size and not self.lost:
            want = max(self._template.count, FEWEST)
            late = int(np.searchsorted(t, t[at] + LONGEST))
            end = min(at + want, late)
            if end >= t.size:
                break
            if end - at < FILLED * want:
                self._hold(t[at], t[at] + LONGEST)
            else:
                self._track(rays[at:end], t[at:end])
            at = end
        self._pending = rays[at:], t[at:]

    def _track(self, rays: Rays, t: Floats) -> None:
        middle = float(t.mean())
        guess = self._guess(middle)
        self._refresh(guess)
        found = self._template.locate(event_image(rays, self._view), guess)
        if found.correlation < AGREES:
            self._misses += 1
            if self._misses > PATIENCE:
                self.lost = f"tracking was lost at {middle:.3f} s: the events no longer fit the map"
            return
        self._misses = 0
        self._append(_Frame(rays, t, middle, found.pose, found.correlation))
        if self._mapping and self._due(found.pose):
            self._new_map()

    def _hold(self, start: float, end: float) -> None:
        none = np.empty((0, 2), dtype=np.float32)
        middle = 0.5 * (start + end)
        self._append(_Frame(none, np.empty(0), middle, self._guess(start, still=True), np.nan))

    def _append(self, frame: _Frame) -> None:
        self._frames.append(frame)
        self._t.append(frame.middle)
        self._poses.append(frame.pose)
        self._correlation.append(frame.correlation)
        total = sum(len(one.rays) for one in self._frames)
        while total > MOST_SWEPT and len(self._frames) > 50:
            total -= len(self._frames.popleft().rays)

    def _guess(self, t: float, still: bool = False) -> Pose:
        """Return where the camera will be if it goes on as it did."""
        if not self._frames:
            p, R = self._path.at([np.clip(t, self._path.t[0], self._path.t[-1])])
            return Pose(R[0], p[0])
        last = self._frames[-1]
        if still or len(self._frames) < 4:
            return last.pose
        first = self._frames[-4]
        share = min((t - last.middle) / (last.middle - first.middle), 1.0)
        turn = rotation_vector(first.pose.R.T @ last.pose.R)
        R = last.pose.R @ rotation_vector_to_matrix(share * turn)
        move = last.pose.position - first.pose.position
        return Pose(R, last.pose.position + share * move)

    def _moved(self, one: Pose, other: Pose) -> float:
        """Return by how much typical points move by a change of place [px]."""
        way = float(np.linalg.norm(one.position - other.position))
        return way * self._typical * self._view.fx

    def _refresh(self, pose: Pose) -> None:
        turn = rotation_angle(self._template.pose.R, pose.R) * self._view.fx
        if turn + self._moved(self._template.pose, pose) > STALE:
            self._template = ProjectedMap(self._points, pose, self._view)

    def _due(self, pose: Pose) -> bool:
        return self._moved(self._reference, pose) > KEYFRAME * self._view.width

    def _past(self) -> PoseSeries:
        frames = self._frames
        return PoseSeries(
            np.array([frame.middle for frame in frames]),
            np.array([frame.pose.position for frame in frames]),
            np.array([frame.pose.R for frame in frames]),
            max_gap=1e9,
        )

    def _new_map(self) -> None:
        """Sweep the latest events along their tracked poses, seen from the present one."""
        now = self._frames[-1].pose
        moved = np.array([self._moved(frame.pose, now) for frame in self._frames])
        far = np.flatnonzero(moved > SWEPT * self._view.width)
        first = int(far[-1]) if far.size else 0
        frames = list(self._frames)[first:]
        rays = np.concatenate([frame.rays for frame in frames])
        t = np.concatenate([frame.t for frame in frames])
        local = (self._points - now.position) @ now.R
        ahead = local[:, 2] > 0
        last = MARGIN * float(np.percentile(1.0 / local[ahead, 2], NEAR))
        planes = Planes(0.0, last / (PLANES - 1), PLANES)
        found = self._swept(rays, t, self._past(), now, planes)
        if len(found) >= FEWEST_POINTS:
            self._set_map(found)
            self._template = ProjectedMap(self._points, now, self._view)
        else:
            self._reference = now

    def _swept(
        self, rays: Rays, t: Floats, poses: PoseSeries, seen_from: Pose, planes: Planes
    ) -> DepthMap:
        reference = seen_from.R, seen_from.position
        volume = fill_volume(rays, packets_of(t, poses), reference, self._view, planes)
        return depth_map(volume, reference, self._view, planes)

    def _set_map(self, depth: DepthMap) -> None:
        self.depth, self._points = depth, depth.world_points
        self._reference = Pose(depth.R_world_ref, depth.position)
        self._typical = float(np.median(depth.inverse_depth[depth.mask]))
        self.maps += 1

    def finish(self, events: int, first: float) -> Trajectory:
        """Return the trajectory."""
        if self._misses and not self.lost:
            self.lost = f"after {self._t[-1]:.3f} s no event image fits the map"
        poses = PoseSeries(
            np.array(self._t),
            np.array([pose.position for pose in self._poses]),
            np.array([pose.R for pose in self._poses]),
        )
        return Trajectory(
            poses,
            np.array(self._correlation),
            self.maps,
            self.depth,
            events,
            self.lost,
            float(poses.t[0]) - first,
            doubts_of(self._correlation, self.maps),
        )


def doubts_of(correlation: Sequence[float], maps: int) -> tuple[str, ...]:
    """Return why poses may be wrong, by the correlation at each of them and the number of maps."""
    doubts = []
    known = np.array(correlation)
    end = known[np.isfinite(known)][-PATIENCE:]
    if end.size and np.median(end) < WEAK:
        doubts.append(
            f"the last {end.size} event images hardly fit the map (correlation"
            f" {np.median(end):.2f}): the last poses may be wrong"
        )
    if maps < CONFIRMED:
        doubts.append(
            "no map was made beyond the start: nothing shows that the camera moved straight"
            " there, and with a turn all poses are wrong"
        )
    return tuple(doubts)


def is_flat(depth: DepthMap) -> bool:
    """Return whether the edges of a map lie in one plane, whose inverse depth is linear in x, y."""
    rows, columns = np.nonzero(depth.mask)
    inverse = depth.inverse_depth[depth.mask]
    plane = np.stack([columns, rows, np.ones(rows.size)], axis=1).astype(np.float64)
    off = inverse - plane @ np.linalg.lstsq(plane, inverse, rcond=None)[0]
    return bool(np.median(np.abs(off)) < FLAT * np.median(inverse))


def estimate_trajectory(
    events: Events | Iterable[Events], camera: Camera, *, seed: int = 0
) -> Trajectory:
    """Find the way of an event camera from its events alone.

    Mapping: the latest events are rays through a volume of inverse depths, seen from the present
    pose; where rays meet, there are edges.  Tracking: an image of as many events as the map has
    points in view is laid on the projected map, over all six unknowns of the pose.  A new map is
    made when the camera has moved on.  It starts with a straight part of the motion.

    Parameters
    ----------
    events : Events or iterable of Events
        The stream, whole or in pieces; of pieces only one is held at a time, and before the start
        three seconds more.
    camera : Camera
        Calibrated for the size of the events.
    seed : int
        Of the matches of corners that it starts from.

    Returns
    -------
    Trajectory
        The poses, up to where tracking is lost; the unit of length is that of the first map.

    Raises
    ------
    NoAnswerError
        If there is no start: the recording is too short or too dark, the camera turns or stands
        still all the time, or all that it sees lies in one plane.
    InputError
        If the events do not fit the camera.

    Notes
    -----
    Each map is made along the path that the last one gave, so errors add up: the trajectory drifts.
    Departures from EVO: the start, and images in units of their mean around each pixel, as near
    edges make more events than far ones and would pull the pose.

    References
    ----------
    Rebecq et al., "EVO: A Geometric Approach to Event-Based 6-DOF Parallel Tracking and Mapping in
    Real Time", RA-L 2(2), 2017.  Rebecq et al., "EMVS: Event-Based Multi-View Stereo", IJCV 126,
    2018.
    """
    odometry = VisualOdometry(camera, seed=seed)
    if not isinstance(events, Events | Iterable):
        raise InputError(f"Events or pieces of them are needed, not {type(events).__name__}")
    for piece in [events] if isinstance(events, Events) else events:
        odometry.update(piece)
    return odometry.finish()
