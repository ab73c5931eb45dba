"""Jitted loops of the event simulator: when to render each tile, and what its pixels report."""

# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from data_tools.simulation._raycast_kernels import (
    boxes_in_cone,
    exit_room,
    place,
    render_pixels,
    turn,
)
from evcalib.kernels.jit import jit

DARK = 1e-3
"""Light below which the logarithm is flattened: log(light + DARK)."""


class View(NamedTuple):
    """The camera cut into tiles."""

    bearings: np.ndarray  # (pixels, samples, 3) rays of each pixel, camera frame
    centres: np.ndarray  # (pixels, 1, 3) ray through each pixel's centre
    pixel_angle: np.ndarray  # (tiles,) angle between neighbouring pixels [rad], the smallest
    corners: np.ndarray  # (tiles, 4, 3) bearings at the corners
    axes: np.ndarray  # (tiles, 4) bearing of the centre, half angle around it [rad]
    bounds: np.ndarray  # (tiles, 4) int64, first and past-last column, first and past-last row
    width: int


class Poses(NamedTuple):
    """Camera poses on an even grid of times."""

    rows: np.ndarray  # (n, 16): position, R_world_cam row by row, velocity [m/s], |omega| [rad/s]
    start: float  # time of row 0 [us]
    step: float  # [us]


class Sensor(NamedTuple):
    """Settings shared by all pixels; with `plain` none but the first three count."""

    plain: bool
    refractory: float  # [us]
    seed: np.uint64
    light: float  # of the scene
    cutoff: float  # bandwidth [rad/us] where the light is 1; 0 for none
    shot: float  # noise events per microsecond where it is dark
    leak: float  # fall of the reference [log intensity per us]
    flicker: float  # depth
    pulse: float  # of the lamps [rad/us]
    step: float  # longest straight piece of the light while lamps flicker [us]


# Columns of the state of the pixels, one row each.
LEVEL = 0  # log intensity at the last render
REFERENCE = 1  # log intensity memorised at the last event; NaN while held in reset
READY = 2  # end of the last reset [us]
NOISE_AT = 3  # next noise event [us]
DRAWS = 4  # noise events drawn so far
ON = 5  # ON threshold
OFF = 6  # OFF threshold, positive
RATE = 7  # noise events per microsecond, before those of bright pixels are thinned out
SCENE = 8  # log intensity of the scene under steady light
PASSED = 9  # what the low-pass made of it
COLUMNS = 10

BRIGHT_SHOT = 0.25
"""Share of the shot noise that is left where the light is 1: v2e's SHOT_NOISE_INTEN_FACTOR."""

STILL, FINEST = 0.01, 64
"""A pixel whose light is within so much of what the low-pass holds needs no finer steps; and the
largest number of them between two renders."""


class Buffer(NamedTuple):
    """Events written so far; `used` goes on beyond the capacity, so that the need is known."""

    t: np.ndarray  # int64 [us]
    pixel: np.ndarray  # int32
    p: np.ndarray  # bool
    used: np.ndarray  # (1,) int64


@jit
def hashed(seed, pixel, draw):
    """Return 53 random bits as a number in [0, 1) (splitmix64's finalizer on a counter)."""
    z = seed + np.uint64(pixel) * np.uint64(0x9E3779B97F4A7C15)
    for _ in range(2):
        z += np.uint64(draw) + np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@jit
def draw_noise(i, after, sensor, state):
    """Set a pixel's next noise event beyond `after` [us]: a Poisson process."""
    while state[i, NOISE_AT] <= after:
        u = hashed(sensor.seed, i, 2.0 * state[i, DRAWS])
        state[i, NOISE_AT] -= math.log(1.0 - u) / state[i, RATE]
        state[i, DRAWS] += 1.0


@jit
def emit(i, t, p, buffer):
    """Write one event, stamped with the first microsecond not before it."""
    n = buffer.used[0]
    buffer.used[0] = n + 1
    if n < buffer.t.size:
        buffer.t[n] = np.int64(math.ceil(t))
        buffer.pixel[n] = i
        buffer.p[n] = p


@jit
def is_thinned(i, sensor, state):
    """Say whether a noise event of a pixel is left out, because the pixel is too bright for it."""
    bright = min(math.exp(state[i, SCENE]), 1.0)
    excess = (1.0 - BRIGHT_SHOT) * sensor.shot * bright / state[i, RATE]
    return hashed(sensor.seed, i + (1 << 40), state[i, DRAWS]) < excess


@jit
def is_quiet(i, t1, l1, state):
    """Say whether a pixel that is not held reports nothing up to t1 [us] and log intensity l1."""
    reference = state[i, REFERENCE]
    within = reference - state[i, OFF] < l1 < reference + state[i, ON]
    return within and state[i, NOISE_AT] > t1


@jit
def advance(i, t0, t1, l1, sensor, state, buffer):
    """Carry a pixel from t0 to t1 [us], its log intensity moving on a line to `l1`.

    An event leaves when the intensity has moved from the reference by the threshold, or as noise.
    The pixel is then held in reset for the refractory period, at whose end the reference is
    memorised anew: with period 0 the reference moves by just the threshold.
    """
    l0, reference = state[i, LEVEL], state[i, REFERENCE]
    on, off = state[i, ON], state[i, OFF]
    state[i, LEVEL] = l1
    slope = (l1 - l0) / (t1 - t0)
    now = t0
    while True:
        if math.isnan(reference):
            if state[i, READY] > t1:
                break
            now = state[i, READY]
            reference = l0 + slope * (now - t0)
            draw_noise(i, now, sensor, state)
        rising = slope > 0.0
        target = reference + on if rising else reference - off
        crossing = math.inf
        if slope != 0.0 and (l1 >= target if rising else l1 <= target):
            crossing = min(max(t0 + (target - l0) / slope, now), t1)
        noise = state[i, NOISE_AT]
        when = min(crossing, noise)
        if when > t1:
            break
        now = when
        if noise < crossing:
            if sensor.shot > 0.0 and is_thinned(i, sensor, state):
                draw_noise(i, noise, sensor, state)
                continue
            rising = hashed(sensor.seed, i, 2.0 * state[i, DRAWS] + 1.0) < 0.5
            target = l0 + slope * (noise - t0)
            draw_noise(i, noise, sensor, state)
        emit(i, now, rising, buffer)
        reference = target
        if sensor.refractory > 0.0:
            state[i, READY] = now + sensor.refractory
            reference = math.nan
    state[i, REFERENCE] = reference


@jit
def lamps(t, sensor):
    """Return what flickering lamps add to the log intensity at `t` [us]."""
    if sensor.flicker == 0.0:
        return 0.0
    return math.log(1.0 + sensor.flicker * math.sin(sensor.pulse * t))


@jit
def follow(i, t0, t1, l1, sensor, state, buffer):
    """Carry a pixel from t0 to t1 [us] while the scene's log intensity moves on a line to `l1`.

    Flicker is added to that, the low-pass follows it, and the reference leaks, which is the same
    as a rise of the signal.  The low-pass is that of a line, exactly, in steps short against its
    time constant and against a period of the lamps.
    """
    l0 = state[i, SCENE]
    state[i, SCENE] = l1
    steps = math.ceil((t1 - t0) / sensor.step) if sensor.flicker > 0.0 else 1
    slowness = 0.0
    if sensor.cutoff > 0.0:
        slowness = 1.0 / (sensor.cutoff * math.exp(l1))
        if abs(l1 - l0) + abs(l0 - state[i, PASSED]) > STILL:
            steps = max(steps, min(math.ceil(4.0 * (t1 - t0) / slowness), FINEST))
    before, x0 = t0, l0 + lamps(t0, sensor)
    for k in range(1, steps + 1):
        now = t1 if k == steps else t0 + k * (t1 - t0) / steps
        x1 = l0 + (l1 - l0) * k / steps + lamps(now, sensor)
        passed = x1
        if slowness > 0.0:
            behind = slowness * (x1 - x0) / (now - before)
            fade = math.exp((before - now) / slowness)
            passed = x1 - behind + (state[i, PASSED] - x0 + behind) * fade
        state[i, PASSED] = passed
        level = passed + sensor.leak * now
        if is_quiet(i, now, level, state):
            state[i, LEVEL] = level
        else:
            advance(i, before, now, level, sensor, state, buffer)
        before, x0 = now, x1


@jit
def pose_at(t, poses, pose):
    """Interpolate the camera's pose linearly between two rows of the grid into `pose`."""
    k = (t - poses.start) / poses.step
    j = min(int(k), poses.rows.shape[0] - 2)
    f = k - j
    for c in range(pose.size):
        pose[c] = poses.rows[j, c] + f * (poses.rows[j + 1, c] - poses.rows[j, c])


@jit
def cross_length(a, b):
    """Return the length of a cross product."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    z = a[0] * b[1] - a[1] * b[0]
    return math.sqrt(x * x + y * y + z * z)


@jit
def image_rate(tile, pose, gap, view, room):
    """Return the largest rate [rad/s] at which the scene moves over a tile.

    At depth d it is |v x b| / d + |omega|.  The room is convex, so its 1/d is largest at a corner
    of the tile; for boxes d is at least `gap`.
    """
    rate = 0.0
    for k in range(4):
        x, y, z = view.corners[tile, k]
        ray = turn(pose, x, y, z)
        distance, _ = exit_room((pose[0], pose[1], pose[2]), ray, room)
        across = cross_length((pose[12], pose[13], pose[14]), ray)
        rate = max(rate, across / max(min(distance, gap), 1e-6))
    return rate + pose[15]


@jit
def boxes_of_tile(tile, pose, time, view, boxes, near):
    """Write the boxes that a tile may show within `time` [s] of a pose; return their number."""
    x, y, z, half_angle = view.axes[tile]
    speed = math.sqrt(pose[12] ** 2 + pose[13] ** 2 + pose[14] ** 2)
    axis = turn(pose, x, y, z)
    return boxes_in_cone(pose, axis, half_angle + time * pose[15], time * speed, near, boxes)


@jit
def plan(tile, t0, t1, fraction, view, poses, scene, near):
    """Return how often to render a tile between t0 and t1 [us], and how many boxes it may show.

    No image point moves by more than `fraction` pixels between two renders.
    """
    pose = np.empty(16)
    pose_at(0.5 * (t0 + t1), poses, pose)
    half = 0.75e-6 * (t1 - t0)  # half of the time, and half as much again if the speed grows
    count = boxes_of_tile(tile, pose, half, view, scene.boxes, near)
    rate = 0.0
    for k in range(3):
        pose_at(t0 + 0.5 * k * (t1 - t0), poses, pose)
        place(pose, near[:count], scene.boxes)
        gap = near[0, 3] if count else math.inf
        rate = max(rate, image_rate(tile, pose, gap, view, scene.room))
    moved = rate * 1e-6 * (t1 - t0) / view.pixel_angle[tile]
    return max(np.int64(math.ceil(moved / fraction)), 1), count


@jit
def render_tile(tile, pose, near, bearings, view, scene, light, depth):
    """Write the light and the distance of a tile's pixels, seen along these rays of theirs."""
    place(pose, near, scene.boxes)
    left, right, top, bottom = view.bounds[tile]
    pixels = (left, right, top, bottom, view.width)
    angle = 0.5 * view.pixel_angle[tile]
    render_pixels(pixels, pose, bearings, angle, near, scene, light, depth)


@jit
def render(pose, bearings, view, scene, light, depth):
    """Render a whole image."""
    near = np.empty((scene.boxes.shape[0], 5))
    for tile in range(view.bounds.shape[0]):
        count = boxes_of_tile(tile, pose, 0.0, view, scene.boxes, near)
        render_tile(tile, pose, near[:count], bearings, view, scene, light, depth)


@jit
def start_pixels(t, levels, sensor, state):
    """Set every pixel to a log intensity at `t` [us], and draw the first noise events.

    Pixels that leak have done so before: the next event of each is anywhere in its period.
    """
    for i in range(levels.size):
        state[i, SCENE] = levels[i]
        state[i, PASSED] = levels[i] + lamps(t, sensor)
        state[i, LEVEL] = state[i, REFERENCE] = state[i, PASSED] + sensor.leak * t
        if sensor.leak > 0.0:
            state[i, REFERENCE] -= state[i, ON] * hashed(sensor.seed, i + (2 << 40), 0.0)
        state[i, NOISE_AT] = math.inf
        if state[i, RATE] > 0.0:
            state[i, NOISE_AT] = t
            draw_noise(i, t, sensor, state)


@jit
def simulate_tiles(tiles, blocks, fraction, view, poses, scene, sensor, state, buffer):
    """Carry tiles through blocks of time, whose edges are `blocks` [us]."""
    pose, near = np.empty(16), np.empty((scene.boxes.shape[0], 5))
    light, depth = np.empty(state.shape[0]), np.empty(state.shape[0])
    for tile in tiles:
        left, right, top, bottom = view.bounds[tile]
        for b in range(blocks.size - 1):
            t0, t1 = blocks[b], blocks[b + 1]
            steps, count = plan(tile, t0, t1, fraction, view, poses, scene, near)
            before = t0
            for k in range(1, steps + 1):
                now = t1 if k == steps else t0 + k * (t1 - t0) / steps
                pose_at(now, poses, pose)
                render_tile(tile, pose, near[:count], view.bearings, view, scene, light, depth)
                for y in range(top, bottom):
                    for i in range(y * view.width + left, y * view.width + right):
                        if not sensor.plain:
                            level = math.log(light[i] * sensor.light + DARK)
                            follow(i, before, now, level, sensor, state, buffer)
                            continue
                        level = math.log(light[i] + DARK)
                        if is_quiet(i, now, level, state):
                            state[i, LEVEL] = level
                        else:
                            advance(i, before, now, level, sensor, state, buffer)
                before = now


@jit
def advance_lines(times, levels, sensor, state, buffer):
    """Carry pixels along log intensities given at times [us], shape (times, pixels)."""
    for k in range(1, times.size):
        for i in range(levels.shape[1]):
            if sensor.plain:
                advance(i, times[k - 1], times[k], levels[k, i], sensor, state, buffer)
            else:
                follow(i, times[k - 1], times[k], levels[k, i], sensor, state, buffer)
