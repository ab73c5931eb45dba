"""Slow twins of the kernels of `evcalib.odometry`, one ray, pixel or step at a time."""

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation


def volume(rays, poses, view, depths):
    """Ray by ray and plane by plane, by intersecting the ray with the plane in space.

    `poses` has one (R, C) per ray, in the frame of the reference view; depths are those of planes.
    """
    out = np.zeros((len(depths), view.height, view.width))
    for (x, y), (R, C) in zip(rays, poses, strict=True):
        d = R @ [x, y, 1.0]
        for k, depth in enumerate(depths):
            way = (depth - C[2]) / d[2]
            if d[2] <= 0 or way <= 0:
                continue
            X = C + way * d
            add(out[k], view.fx * X[0] / depth + view.cx, view.fy * X[1] / depth + view.cy, 1.0)
    return out


def add(image, u, v, value):
    """Bilinear, by the area that a unit square around (u, v) shares with each pixel."""
    height, width = image.shape
    if not (0 <= u < width - 1 and 0 <= v < height - 1):
        return
    for row in range(height):
        for col in range(width):
            shared = max(0.0, 1 - abs(u - col)) * max(0.0, 1 - abs(v - row))
            image[row, col] += value * shared


def median_of_marked(values, marked, radius):
    out = np.zeros(values.shape)
    for y, x in zip(*np.nonzero(marked), strict=True):
        window = (
            slice(max(y - radius, 0), y + radius + 1),
            slice(max(x - radius, 0), x + radius + 1),
        )
        out[y, x] = np.median(values[window][marked[window]])
    return out


def align(template, image, view, steps, R, t):
    """The inverse compositional iteration with whole matrices; ends after all its steps."""
    K = np.array([[view.fx, 0, view.cx], [0, view.fy, view.cy], [0, 0, 1.0]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, t
    for _ in range(steps):
        X = template.points @ pose[:3, :3].T + pose[:3, 3]
        pixels = X @ K.T
        u, v = pixels[:, 0] / pixels[:, 2], pixels[:, 1] / pixels[:, 2]
        inside = (X[:, 2] > 0) & (u >= 0) & (v >= 0) & (u < view.width - 1) & (v < view.height - 1)
        seen = map_coordinates(image.astype(float), [v[inside], u[inside]], order=1)
        gain, offset = np.polyfit(template.values[inside], seen, 1)
        residual = (seen - offset) / gain - template.values[inside]
        change = template.inverse @ (template.slopes[inside].T @ residual)
        step = np.eye(4)
        step[:3, :3] = Rotation.from_rotvec(change[:3]).as_matrix()
        step[:3, 3] = change[3:]
        pose = pose @ np.linalg.inv(step)
    return pose[:3, :3], pose[:3, 3]
