"""Scenes for the event simulator: a furnished room, textured from a seed."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter

from data_tools.simulation._random import generator
from data_tools.simulation._raycast_kernels import SceneArrays
from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError


@dataclass(frozen=True, eq=False)
class Scene:
    """A room with boxes in it; every face carries a periodic texture.

    The world frame has Z up.  Light is constant and the same from all sides: brightness is fixed
    to the surfaces.

    Attributes
    ----------
    room : ndarray, shape (2, 3)
        Lower and upper corner [m].  The camera must stay inside.
    textures : ndarray, shape (k, side, side)
        Reflectances, positive; the side is a power of two.  Axis 2 runs along a face's first
        coordinate.  Between texels the light is bilinear; from afar it is averaged over areas.
    texel : float
        Size of a texel [m].
    boxes : ndarray, shape (n, 7)
        Centre (3), half sizes (3) [m], yaw [rad] of boxes that stand in the room.
    faces : ndarray, shape (6 (n + 1), 4), optional
        Texture index, shift of the texture [m] along the face's two coordinates, gain.  The
        coordinates are those of x, y, z that vary on the face, in this order, of the world for
        the room and of its own axes and centre for a box; coordinate u shows column
        (u + shift) / texel of the texture.  Row 6 b + 2 a + s: body b (0 the room, then the
        boxes), axis a, side s (1 = larger coordinate).  By default texture 0, not shifted.

    Raises
    ------
    InputError
        If a shape or a value is unusable.
    """

    room: Floats
    textures: NDArray[np.float32]
    texel: float
    boxes: Floats = field(default_factory=lambda: np.empty((0, 7)))
    faces: Floats | None = None

    def __post_init__(self) -> None:
        room = checks.floats(self.room, "room", (2, 3))
        if (room[1] <= room[0]).any():
            raise InputError("room must be its lower corner, then its upper corner")
        boxes = checks.floats(self.boxes, "boxes", (None, 7))
        if (boxes[:, 3:6] <= 0).any():
            raise InputError("boxes must have positive half sizes (columns 3 to 5)")
        textures = checks.floats(self.textures, "textures", (None, None, None))
        side = textures.shape[1]
        if textures.shape[2] != side or side & (side - 1) or not textures.size:
            raise InputError(
                f"textures must be square with a power of two as side, not {textures.shape[1:]}"
            )
        if textures.min() <= 0:
            raise InputError("textures must be positive: nothing is perfectly black")
        count = 6 * (len(boxes) + 1)
        plain = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
        faces = checks.floats(plain if self.faces is None else self.faces, "faces", (count, 4))
        if not np.isin(faces[:, 0], np.arange(len(textures))).all() or (faces[:, 3] <= 0).any():
            raise InputError("faces need the index of a texture (column 0) and a gain above 0")
        checked = {"room": room, "boxes": boxes, "faces": faces}
        for name, value in {**checked, "textures": textures.astype(np.float32)}.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "texel", checks.positive(self.texel, "texel", "metres"))

    def arrays(self) -> SceneArrays:
        """Return the scene as the kernels want it, with the area-averaged levels of textures."""
        levels = [np.asarray(self.textures, dtype=np.float64)]
        while levels[-1].shape[1] > 1:
            a = levels[-1]
            levels.append(
                0.25 * (a[:, ::2, ::2] + a[:, 1::2, ::2] + a[:, ::2, 1::2] + a[:, 1::2, 1::2])
            )
        flat = [level.reshape(len(level), -1) for level in levels]
        faces = np.asarray(self.faces).copy()
        faces[:, 1:3] /= self.texel
        yaw = self.boxes[:, 6:]
        return SceneArrays(
            room=np.asarray(self.room),
            boxes=np.hstack([self.boxes[:, :6], np.cos(yaw), np.sin(yaw)]),
            faces=faces,
            texels=np.concatenate(flat, axis=1).astype(np.float32).ravel(),
            side=int(self.textures.shape[1]),
            per_metre=1.0 / self.texel,
        )

    def clearance(self, positions: ArrayLike) -> Floats:
        """Return the distance [m] of points (n, 3) to the nearest surface; negative where outside.

        Inside a box it is 0.
        """
        points = checks.floats(positions, "positions", (None, 3))
        free = np.minimum(points - self.room[0], self.room[1] - points).min(axis=1)
        for x, y, z, hx, hy, hz, yaw in self.boxes:
            dx, dy = points[:, 0] - x, points[:, 1] - y
            along = np.cos(yaw) * dx + np.sin(yaw) * dy
            across = np.cos(yaw) * dy - np.sin(yaw) * dx
            out = np.abs(np.stack([along, across, points[:, 2] - z], axis=1)) - [hx, hy, hz]
            free = np.minimum(free, np.linalg.norm(np.maximum(out, 0.0), axis=1))
        return free


def dead_leaves(seed: int, side: int = 1024, smallest: float = 10.0) -> NDArray[np.float32]:
    """Return a periodic texture of opaque polygons that cover each other.

    The dead-leaves model: random shapes of all sizes, with a density of sizes falling as their
    cube, occlude one another.  It has the edges, corners and spectrum of natural images.  Edges
    are area-sampled and about one texel wide.

    Parameters
    ----------
    seed : int
        Same seed, same texture.
    side : int
        Texels along each side.
    smallest : float
        Radius of the smallest shape [texel]; the largest has a fifth of the side.

    Returns
    -------
    ndarray of float32, shape (side, side)
        Reflectances between 0.08 and 0.92.
    """
    rng = generator(seed, "texture")
    canvas = np.full((2 * side, 2 * side), 0.4, dtype=np.float32)
    count = 8 * side
    radii = _radii(rng, 2 * smallest, 0.4 * side, count)
    albedos = 0.08 * 11.5 ** rng.random(count)
    centres = rng.uniform(0, 2 * side, (count, 2))
    corners = rng.integers(3, 7, count)
    turns = 2 * np.pi * (np.arange(6) + rng.uniform(0.2, 0.8, (count, 6))) / corners[:, None]
    outlines = radii[:, None, None] * np.stack([np.cos(turns), np.sin(turns)], axis=2)
    outlines = np.rint(outlines + centres[:, None]).astype(np.int32)
    for outline, n, albedo in zip(outlines, corners, albedos.tolist(), strict=True):
        _stamp(canvas, outline[:n], albedo)
    halved = canvas.reshape(side, 2, side, 2).mean(axis=(1, 3))
    return gaussian_filter(halved, 0.6, mode="wrap")


def _radii(rng: np.random.Generator, low: float, high: float, count: int) -> Floats:
    """Draw sizes with a density that falls as their cube."""
    u = rng.random(count)
    return 1.0 / np.sqrt(u / high**2 + (1 - u) / low**2)


def _stamp(canvas: NDArray[np.float32], outline: NDArray[np.int32], value: float) -> None:
    """Fill a polygon on a periodic canvas."""
    for dx in _shifts(outline[:, 0], len(canvas)):
        for dy in _shifts(outline[:, 1], len(canvas)):
            cv2.fillConvexPoly(canvas, outline + np.array([dx, dy], dtype=np.int32), value)


def _shifts(values: NDArray[np.int32], side: int) -> list[int]:
    """Return the shifts at which a periodic shape shows: itself, and once per border it crosses."""
    return [0] + [side] * bool(values.min() < 0) + [-side] * bool(values.max() >= side)


def furnished_room(
    positions: ArrayLike,
    seed: int,
    *,
    margin: float = 3.0,
    clearance: float = 0.6,
    density: float = 0.3,
) -> Scene:
    """Return a room around a path, furnished with boxes that the path does not touch.

    Parameters
    ----------
    positions : array_like, shape (n, 3)
        Path of the camera [m].
    seed : int
        Same seed, same scene.
    margin : float
        Distance of the walls [m] from the path's bounding rectangle.
    clearance : float
        Least horizontal distance [m] between the path and a box.
    density : float
        Boxes tried per square metre of floor.

    Returns
    -------
    Scene
        Floor at z = 0 or 0.3 m below the path, whichever is lower; the ceiling at 3 m or 1 m
        above the path.
    """
    path = checks.floats(positions, "positions", (None, 3))
    if not len(path):
        raise InputError("positions hold no point: a room needs a path to stand around")
    rng = generator(seed, "room")
    low, high = path.min(axis=0), path.max(axis=0)
    room = np.array([low, high]) + np.array([[-margin], [margin]])
    room[0, 2], room[1, 2] = min(0.0, low[2] - 0.3), max(3.0, high[2] + 1.0)
    boxes = _furniture(path, room, clearance, density, rng)
    textures = np.stack([dead_leaves(seed * 4 + k) for k in range(4)])
    texel = 0.005
    count = 6 * (len(boxes) + 1)
    period = texel * textures.shape[1]
    faces = np.column_stack(
        [
            rng.integers(0, len(textures), count),
            rng.uniform(0, period, (count, 2)),
            rng.uniform(0.55, 1.0, count),
        ]
    )
    return Scene(room, textures, texel, boxes, faces)


def _furniture(
    path: Floats, room: Floats, clearance: float, density: float, rng: np.random.Generator
) -> Floats:
    """Draw boxes of many sizes; most stand on the floor, some hang at any height."""
    width, length, height = room[1] - room[0]
    kept = []
    for _ in range(int(density * width * length)):
        half = rng.uniform([0.1, 0.1, 0.15], [0.45, 0.45, 0.5 * height])
        centre = rng.uniform(room[0], room[1])
        if rng.random() < 0.7:
            centre[2] = room[0, 2] + half[2]
        reach = float(np.hypot(half[0], half[1]))
        if np.hypot(*(path[:, :2] - centre[:2]).T).min() > clearance + reach:
            kept.append([*centre, *half, rng.uniform(0, np.pi)])
    return np.array(kept).reshape(-1, 7)
