"""Slow twin of `evcalib.design._information`: bearings by projection, one corner at a time."""

import numpy as np
from scipy.spatial.transform import Rotation

from evcalib.design._information import (
    NO_YAW_RATE,
    OBSERVATIONS,
    SLOWEST,
    SPREAD,
    STEP,
    TILT_SD,
)


class Path:
    """Where the body is and how it is turned, at any time, by fine sums."""

    def __init__(self, velocities):
        self.t = np.arange(velocities.t[0], velocities.t[-1] + 1e-9, STEP)
        self.v = np.stack([np.interp(self.t, velocities.t, c) for c in velocities.v.T], axis=1)
        self.rate = np.interp(self.t, velocities.t, velocities.yaw_rate)

    def arrive(self, values):
        steps = 0.5 * (values[1:] + values[:-1]) * STEP
        return np.concatenate([0 * values[:1], np.cumsum(steps, axis=0)])

    def poses(self, late, position):
        """Return turns and camera positions at all times, `late` seconds on (first order)."""
        yaw = self.arrive(self.rate)
        turns = Rotation.from_rotvec(np.outer(yaw, [0, 0, 1]))
        places = self.arrive(turns.apply(self.v))
        yaw_late = Rotation.from_rotvec(np.outer(yaw + late * self.rate, [0, 0, 1]))
        return yaw_late, places + late * turns.apply(self.v) + yaw_late.apply(position)

    def pull(self, position):
        """Return the acceleration of the camera in the frame of the body."""
        v = self.v + self.rate[:, None] * np.cross([0, 0, 1], position)
        turn = self.rate[:, None] * np.cross([0, 0, 1], v)
        return np.gradient(v, self.t, axis=0) + turn


def naive_information(velocities, viewing, systematic):
    """Return the information on rotation, offset, lag, position and lean, (9, 9)."""
    path = Path(velocities)
    position = np.array([*viewing.position, 0.0])
    n = path.t.size
    pull = path.pull(position)
    near = np.resize([SPREAD, SPREAD[::-1]], len(viewing.bearings)) / viewing.distance
    whole = np.zeros((9 + n, 9 + n))

    def seen(unknown, u, distance, first, turned):
        """Return bearings (times, 3) of a corner under all unknowns."""
        late, moved = unknown[3], position + [*unknown[5:7], 0.0]
        turns, places = path.poses(late, moved)
        turns0, places0 = path.poses(0.0, position)
        corner = places0[first] + turns0[first].apply(distance * u)
        rows = first + np.arange(OBSERVATIONS + 1)
        lean = np.stack([unknown[7] * pull[rows, 1], -unknown[8] * pull[rows, 0], 0 * rows], axis=1)
        lean[:, 2] = turned
        lean -= lean[0]  # what counts is by how much it changed since the first observation
        mount = Rotation.from_rotvec(unknown[:3])
        ray = turns[rows].inv().apply(corner - places[rows])
        ray = Rotation.from_rotvec(lean).inv().apply(ray)
        ray = mount.inv().apply(ray)
        return ray / np.linalg.norm(ray, axis=1)[:, None]

    for first in range(n - OBSERVATIONS):
        rows = first + np.arange(OBSERVATIONS + 1)
        for u, inverse in zip(viewing.bearings, near, strict=True):
            across = np.stack([np.cross([0, 0, 1], u), np.cross(u, np.cross([0, 0, 1], u))])
            across /= np.linalg.norm(across, axis=1)[:, None]

            def at(x, u=u, inverse=inverse, across=across, first=first):
                turned = x[9 : 9 + OBSERVATIONS + 1]
                distance = 1 / (inverse + x[-3])
                return seen(x[:9], u + x[-2:] @ across, distance, first, turned)

            size = 9 + OBSERVATIONS + 1 + 3
            h = 1e-5
            J = np.stack([(at(h * e) - at(-h * e)) / (2 * h) for e in np.eye(size)], axis=-1)
            here = at(np.zeros(size))
            # Flow: what the times do, with the corner where it is.
            turns, places = path.poses(0.0, position)
            corner = places[first] + turns[first].apply(u / inverse)
            later_turns, later = path.poses(h, position)
            ray = later_turns[rows].inv().apply(corner - later[rows])
            flow = (ray / np.linalg.norm(ray, axis=1)[:, None] - here) / h
            length = np.linalg.norm(flow, axis=1)
            J[:, :, 4] = -flow / length[:, None]
            yaw = path.arrive(path.rate)
            inside = np.clip(1 - np.abs(yaw[rows] - yaw[first]) / viewing.field, 0, 1)
            weight = np.sqrt(inside * (viewing.focal * length > SLOWEST))
            normal = np.eye(3) - here[:, :, None] * here[:, None, :]
            J = (weight[:, None, None] * (normal @ J)).reshape(-1, size)
            info = J.T @ J
            known, place = info[:-3, :-3], info[-3:, -3:]
            known = known - info[:-3, -3:] @ np.linalg.pinv(place) @ info[-3:, :-3]
            index = np.r_[np.arange(9), 9 + rows]
            whole[np.ix_(index, index)] += known
    whole *= viewing.corners / OBSERVATIONS / len(viewing.bearings)
    whole /= (viewing.noise / viewing.focal) ** 2
    sd = systematic.yaw_rate_sd
    if velocities.yaw_rate is None:
        sd = np.hypot(sd, NO_YAW_RATE)
    step = np.diff(np.eye(n), axis=0) / (sd * STEP)
    whole[9:, 9:] += step.T @ step + 1e-6 * (sd * STEP) ** -2 * np.eye(n)
    out = whole[:9, :9] - whole[:9, 9:] @ np.linalg.solve(whole[9:, 9:], whole[9:, :9])
    out[4, 4] += (systematic.lag_sd / viewing.focal) ** -2
    out[7:, 7:] += np.eye(2) * TILT_SD**-2
    return out
