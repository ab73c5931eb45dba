"""Space sweep: rays of events vote for the depths of edges, without any event being matched.

After Rebecq et al., "EMVS: Event-Based Multi-View Stereo", IJCV 126, 2018.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from evcalib import checks
from evcalib.arrays import Flags, Floats, Integers
from evcalib.camera import Camera
from evcalib.display import Shown
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.kernels.odometry import space_sweep as kernels
from evcalib.kernels.odometry.space_sweep import Planes, View
from evcalib.odometry._lens import Lens, Rays
from evcalib.poses import PoseSeries

PLANES = 100
"""Planes of the volume, as in EMVS."""

PACKET = 256
"""Events that share a pose."""

WINDOW, MARGIN = 11, 8.0
"""Adaptive threshold: a pixel is kept if its ray density, on a scale to 255, exceeds the mean
around it (Gaussian, of this side [px]) by this much; EMVS has 5 and 5 to 10."""

MEDIAN = 2
"""Radius of the median filter [px]."""

BORDER = 0.02
"""Share of the planes at either end that say nothing: what lies beyond piles up there."""


@dataclass(frozen=True, eq=False)
class DepthMap(Shown):
    """A semi-dense map: edges with their depths, seen from one place.

    Attributes
    ----------
    R_world_ref : ndarray, shape (3, 3)
        Rotation of the reference view.
    position : ndarray, shape (3,)
        Its place in the world, in the units of the trajectory.
    view : View
        The reference view, a camera without distortion.
    density : ndarray of float32, shape (height, width)
        Most rays through one cell along each pixel's line of sight.
    mask : ndarray of bool, shape (height, width)
        Pixels with a depth.
    inverse_depth : ndarray, shape (height, width)
        There, of the median of the depths around; 0 elsewhere.
    """

    R_world_ref: Floats
    position: Floats
    view: View
    density: NDArray[np.float32]
    mask: Flags
    inverse_depth: Floats

    def __len__(self) -> int:
        return int(self.mask.sum())

    @property
    def points(self) -> Floats:
        """The edges in the frame of the reference view, shape (n, 3)."""
        rows, columns = np.nonzero(self.mask)
        depth = 1.0 / self.inverse_depth[self.mask]
        view = self.view
        x, y = (columns - view.cx) / view.fx, (rows - view.cy) / view.fy
        return np.stack([x * depth, y * depth, depth], axis=1)

    @property
    def world_points(self) -> Floats:
        """The edges in the world, shape (n, 3)."""
        return self.points @ self.R_world_ref.T + self.position


def packets_of(t: Floats, poses: PoseSeries) -> tuple[Integers, Floats, Floats]:
    """Return where packets of events end, and the rotation and place of each packet's camera.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the events [s], ascending.
    poses : PoseSeries
        The camera's; beyond its ends it stands still.
    """
    ends = np.append(np.arange(PACKET, t.size, PACKET), t.size)
    starts = np.append(0, ends[:-1])
    middle = 0.5 * (t[starts] + t[ends - 1])
    position, R = poses.at(np.clip(middle, poses.t[0], poses.t[-1]))
    return ends, np.ascontiguousarray(R), position


def fill_volume(
    rays: Rays,
    packets: tuple[Integers, Floats, Floats],
    reference: tuple[Floats, Floats],
    view: View,
    planes: Planes,
) -> NDArray[np.float32]:
    """Return the ray density over (plane, row, column), seen from a reference (R, position)."""
    ends, R, position = packets
    R_ref, origin = reference
    rotations, centres = np.ascontiguousarray(R_ref.T @ R), (position - origin) @ R_ref
    lines = np.empty((len(rays), 5), dtype=np.float32)
    kernels.trace(rays, ends, rotations, centres, view, planes, lines)
    volume = np.zeros((planes.total, view.height, view.width), dtype=np.float32)
    kernels.vote(lines, volume)
    return volume


def depth_map(
    volume: NDArray[np.float32], reference: tuple[Floats, Floats], view: View, planes: Planes
) -> DepthMap:
    """Return the edges where the ray density has its peaks."""
    best = volume.argmax(axis=0)
    density = _cells(volume, best)
    # cv2 subtracts its constant from the mean: a negative one asks for more than the mean.
    scaled = np.rint(density * (255.0 / max(float(density.max()), 1e-9))).astype(np.uint8)
    method = cv2.ADAPTIVE_THRESH_GAUSSIAN_C
    kept = cv2.adaptiveThreshold(scaled, 255, method, cv2.THRESH_BINARY, WINDOW, -MARGIN)
    edge = max(round(BORDER * planes.total), 1)
    mask = (kept > 0) & (best >= edge) & (best < planes.total - edge)
    place = best + _vertex(volume, best)
    smooth = np.zeros(mask.shape)
    kernels.median_of_marked(place, mask, MEDIAN, smooth)
    inverse = np.where(mask, planes.first + planes.step * smooth, 0.0)
    mask &= inverse > 0
    return DepthMap(*reference, view, density, mask, np.where(mask, inverse, 0.0))


def _cells(volume: NDArray[np.float32], plane: Integers) -> NDArray[np.float32]:
    return np.take_along_axis(volume, plane[None], axis=0)[0]


def _vertex(volume: NDArray[np.float32], best: Integers) -> Floats:
    """Return by how much a parabola's vertex is off the best plane, in planes."""
    inner = np.clip(best, 1, len(volume) - 2)
    left, mid, right = (_cells(volume, inner + k).astype(np.float64) for k in (-1, 0, 1))
    bend = left - 2 * mid + right
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.where(bend < 0, 0.5 * (left - right) / bend, 0.0)
    return np.where(inner == best, np.clip(shift, -0.5, 0.5), 0.0)


def space_sweep(
    events: Events,
    camera: Camera,
    poses: PoseSeries,
    inverse_depths: tuple[float, float],
    *,
    at: float | None = None,
    planes: int = PLANES,
) -> tuple[DepthMap, NDArray[np.float32]]:
    """Map the edges that a camera of known motion has seen.

    Parameters
    ----------
    events : Events
        What it saw.
    camera : Camera
        Calibrated for the size of the events.
    poses : PoseSeries
        Its poses, on the clock of the events; all events outside their time are left out.
    inverse_depths : (float, float)
        Inverse depths of the first and the last plane, in one over the units of the poses.
    at : float, optional
        Time of the reference view [s]; the middle of the poses if not given.
    planes : int
        Planes, evenly spaced in inverse depth.

    Returns
    -------
    depth : DepthMap
        The edges.
    volume : ndarray of float32, shape (planes, height, width)
        The ray density.

    Raises
    ------
    InputError
        If the sizes differ, the depths are unusable, or no event falls into the time of the poses.
    """
    checks.instance(events, "events", Events)
    checks.instance(camera, "camera", Camera)
    camera.require_size(events.width, events.height)
    first, last = checks.floats(inverse_depths, "inverse_depths", (2,))
    if not (0 <= first < last and planes >= 3):
        raise InputError("inverse_depths must rise from 0 or more, over at least 3 planes")
    lens = Lens(camera)
    rays, t = lens.rays(events)
    inside = (t >= poses.t[0]) & (t <= poses.t[-1])
    if not inside.any():
        raise InputError(
            f"no event falls into the time of the poses ({poses.t[0]:.3f} to {poses.t[-1]:.3f} s)"
        )
    middle = 0.5 * (poses.t[0] + poses.t[-1]) if at is None else float(at)
    position, R = poses.at([middle])
    reference, grid = (R[0], position[0]), Planes(first, (last - first) / (planes - 1), planes)
    packets = packets_of(t[inside], poses)
    volume = fill_volume(rays[inside], packets, reference, lens.view, grid)
    return depth_map(volume, reference, lens.view, grid), volume
