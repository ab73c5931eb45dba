"""Tracking: the pose from which the event image of a moment looks like the projected map.

After Rebecq et al., "EVO: A Geometric Approach to Event-Based 6-DOF Parallel Tracking and Mapping
in Real Time", RA-L 2, 2017.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from evcalib.arrays import Flags, Floats
from evcalib.kernels.odometry import tracking as kernels
from evcalib.kernels.odometry.space_sweep import View
from evcalib.kernels.odometry.tracking import Limits, Template
from evcalib.odometry._lens import Rays

SIGMA = 1.0
"""Smoothing of map and event image [px]: the reach of an alignment, and what it averages over."""

FAINT = 0.1
"""Pixels of the template are those brighter than this share of its brightest."""

MOST_EVENTS = 2.0
"""Events of a pixel that count: more of them are no more of an edge."""

AROUND, LEVEL = 25, 0.5
"""Side of the square of that mean [px], and the share of the mean of all that is added to it."""

LIMITS = Limits(steps=15, rest=0.02)


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a camera is: R_world_cam and its position in the world."""

    R: Floats
    position: Floats

    def from_world(self) -> tuple[Floats, Floats]:
        """Return R, t that take points of the world to the camera's frame."""
        return np.ascontiguousarray(self.R.T), -self.R.T @ self.position


@dataclass(frozen=True, eq=False)
class Tracked:
    """A pose, how well image and map agree there, and the share of the map that is seen."""

    pose: Pose
    correlation: float
    seen: float


def event_image(rays: Rays, view: View) -> NDArray[np.float32]:
    """Return the smoothed image of events, as an edge map."""
    image = np.zeros((view.height, view.width), dtype=np.float32)
    kernels.draw(rays, view, image)
    return _levelled(_smooth(np.minimum(image, MOST_EVENTS)))


def _levelled(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return an image in units of its mean around: near edges make more events than far ones."""
    mean = cv2.blur(image, (AROUND, AROUND))
    return image / (mean + LEVEL * mean.mean())


def _smooth(image: NDArray) -> NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), SIGMA), dtype=np.float32)


class ProjectedMap:
    """A map as it looks from one pose, made ready for alignment.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        The map, in the world.
    pose : Pose
        From where it is seen.
    view : View
        The camera.
    """

    def __init__(self, points: Floats, pose: Pose, view: View) -> None:
        self.pose, self.view = pose, view
        marked, inverse = np.zeros((2, view.height, view.width), dtype=np.float32)
        self.count = kernels.project(points, *pose.from_world(), view, marked, inverse)
        # Points that fall together are one edge.
        plain = _smooth(np.minimum(marked, 1.0))
        self.image = _levelled(plain)
        depths = _smooth(inverse) / np.maximum(_smooth(marked), 1e-9)
        used = plain > FAINT * plain.max()
        used[[0, -1]] = used[:, [0, -1]] = False
        self.template = self._template(used, depths) if self.count else None

    def _template(self, used: Flags, inverses: NDArray) -> Template:
        view, image = self.view, self.image
        rows, columns = np.nonzero(used)
        # The depth of a pixel beside an edge is that of the edge.
        inverse = np.maximum(inverses[used].astype(np.float64), 1e-9)
        x, y = (columns - view.cx) / view.fx, (rows - view.cy) / view.fy
        gx = 0.5 * view.fx * (image[rows, columns + 1] - image[rows, columns - 1])
        gy = 0.5 * view.fy * (image[rows + 1, columns] - image[rows - 1, columns])
        gz = -(gx * x + gy * y)
        slopes = np.stack(
            [y * gz - gy, gx - x * gz, x * gy - y * gx, inverse * gx, inverse * gy, inverse * gz],
            axis=1,
        )
        values = image[used].astype(np.float64)
        # What a factor or an offset of the image explains is no motion.
        centred = values - values.mean()
        slopes -= slopes.mean(axis=0)
        slopes -= np.outer(centred, centred @ slopes / max(float(centred @ centred), 1e-9))
        points = np.stack([x / inverse, y / inverse, 1.0 / inverse], axis=1)
        return Template(points, values, slopes, np.linalg.pinv(slopes.T @ slopes))

    def locate(self, image: NDArray[np.float32], guess: Pose) -> Tracked:
        """Return the pose of an event image, found from a guess."""
        if self.template is None:
            return Tracked(guess, 0.0, 0.0)
        R = np.ascontiguousarray(guess.R.T @ self.pose.R)
        t = guess.R.T @ (self.pose.position - guess.position)
        correlation, seen = kernels.align(self.template, image, self.view, LIMITS, R, t)
        R_world = self.pose.R @ R.T
        # Orthonormal again, to first order: rounding would add up from pose to pose.
        R_world = R_world @ (1.5 * np.eye(3) - 0.5 * R_world.T @ R_world)
        found = Pose(R_world, self.pose.position - R_world @ t)
        return Tracked(found, correlation, seen / len(self.template.points))
