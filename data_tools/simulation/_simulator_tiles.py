"""The simulator's camera, cut into tiles, and the work on a set of them."""

from __future__ import annotations

import numpy as np

from data_tools.simulation import _simulator_kernels as kernels
from data_tools.simulation.sensor import empty_buffer
from evcalib.arrays import Floats, Integers
from evcalib.camera import Camera
from evcalib.errors import InputError

TILE = 8
"""Side of a tile [px]."""

RAYS = np.array([[-0.375, -0.125], [0.125, -0.375], [0.375, 0.125], [-0.125, 0.375]])
"""Rays of a pixel against its centre [px]: a rotated grid, so that edges meet them one by one."""


def camera_view(camera: Camera) -> kernels.View:
    """Return a camera's rays and tiles."""
    width, height = camera.width, camera.height
    rows, columns = np.mgrid[0:height, 0:width]
    centres = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64)
    left, top = (a.ravel() for a in np.meshgrid(range(0, width, TILE), range(0, height, TILE)))
    bounds = np.stack(
        [left, np.minimum(left + TILE, width), top, np.minimum(top + TILE, height)], axis=1
    )
    low, high = bounds[:, [0, 2]] - 0.5, bounds[:, [1, 3]] - 0.5
    middle = _bearings(camera, 0.5 * (low + high))
    corners = np.stack(
        [_bearings(camera, np.where(pick, high, low)) for pick in np.ndindex(2, 2)], axis=1
    )
    spread = np.linalg.norm(np.cross(corners, middle[:, None]), axis=2)
    half = np.arctan2(spread, np.einsum("nij,nj->ni", corners, middle)).max(axis=1)
    rays = np.stack([_bearings(camera, centres + shift) for shift in RAYS], axis=1)
    return kernels.View(
        bearings=rays,
        centres=_bearings(camera, centres)[:, None],
        pixel_angle=_pixel_angle(camera, low, high),
        corners=corners,
        axes=np.column_stack([middle, half]),
        bounds=bounds.astype(np.int64),
        width=width,
    )


def _bearings(camera: Camera, pixels: Floats) -> Floats:
    bearings = camera.bearings(pixels)
    blind = np.isnan(bearings).any(axis=1)
    if blind.any():
        x, y = pixels[blind][0]
        raise InputError(
            f"no direction maps to pixel ({x:.1f}, {y:.1f}): the camera's distortion turns back"
            " before it; use a smaller sensor or another distortion"
        )
    return np.ascontiguousarray(bearings)


def _pixel_angle(camera: Camera, low: Floats, high: Floats) -> Floats:
    """Return the smallest angle [rad] per pixel in any direction, over five points of a tile."""
    smallest = np.full(len(low), np.inf)
    for share in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0), (0.5, 0.5)):
        at = low + 0.5 + np.array(share) * (high - low - 1.0)
        steps = [
            _bearings(camera, at + step) - _bearings(camera, at - step)
            for step in ((0.25, 0.0), (0.0, 0.25))
        ]
        stretch = np.linalg.svd(2.0 * np.stack(steps, axis=2), compute_uv=False)
        smallest = np.minimum(smallest, stretch[:, -1])
    return smallest


def simulate_part(tiles: Integers, world: tuple, state: Floats) -> kernels.Buffer:
    """Return the events of some tiles over a span of time, and advance their pixels.

    `world` is (edges of the blocks, fraction, View, Poses, SceneArrays, Sensor).  If the events
    do not fit, the pixels are put back and the span is run again with enough room.
    """
    edges, fraction, view, poses, scene, sensor = world
    own = np.concatenate([_pixels_of(bounds, view.width) for bounds in view.bounds[tiles]])
    before = state[own]
    buffer = empty_buffer(20_000)
    while True:
        kernels.simulate_tiles(tiles, edges, fraction, view, poses, scene, sensor, state, buffer)
        count = int(buffer.used[0])
        if count <= buffer.t.size:
            return buffer
        state[own] = before
        buffer = empty_buffer(count)


def _pixels_of(bounds: Integers, width: int) -> Integers:
    left, right, top, bottom = bounds
    return (np.arange(top, bottom)[:, None] * width + np.arange(left, right)).ravel()
