"""Rays through a volume of disparities, and the median of the depths found there.

A ray leaves a camera at C with direction (a, b, 1), both in the frame of the reference view.  At
inverse depth rho it is seen there at

    (a, b) + rho (C_xy - C_z (a, b)),

so from one plane of the volume to the next, evenly spaced in rho, it moves by a constant step
(Rebecq et al., EMVS, IJCV 126, 2018, section 5.2, in this parameter).
"""

from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit


class View(NamedTuple):
    """A pinhole camera without distortion."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


class Planes(NamedTuple):
    """Inverse depths at which a volume is cut: first, first + step, ... (total of them)."""

    first: float
    step: float
    total: int


@jit
def trace(rays, ends, rotations, centres, view, planes, lines):
    """Find where each ray is seen in the first plane, its step to the next, and its last plane.

    Parameters
    ----------
    rays : ndarray of float32, shape (n, 2)
        Directions (x, y, 1) of the events, each in the frame of its own camera.
    ends : ndarray of int64, shape (m,)
        Where each packet of rays ends; the rays of a packet share a pose.
    rotations, centres : ndarray of float64, shapes (m, 3, 3) and (m, 3)
        Pose of each packet's camera in the frame of the reference view.
    view : View
        The reference view.
    planes : Planes
        Inverse depths of the planes.
    lines : ndarray of float32, shape (n, 5)
        Output: column, row, their steps [px], and the number of planes that lie before the
        event's own camera.
    """
    start = 0
    for m in range(ends.size):
        R, C = rotations[m], centres[m]
        ahead = planes.total
        if C[2] > 0.0:
            while ahead > 0 and (planes.first + (ahead - 1) * planes.step) * C[2] >= 1.0:
                ahead -= 1
        for i in range(start, ends[m]):
            x, y = rays[i, 0], rays[i, 1]
            z = R[2, 0] * x + R[2, 1] * y + R[2, 2]
            if z <= 0.0:
                lines[i] = 0.0
                continue
            a = (R[0, 0] * x + R[0, 1] * y + R[0, 2]) / z
            b = (R[1, 0] * x + R[1, 1] * y + R[1, 2]) / z
            u, v = view.fx * (C[0] - C[2] * a), view.fy * (C[1] - C[2] * b)
            lines[i, 0] = view.fx * a + view.cx + planes.first * u
            lines[i, 1] = view.fy * b + view.cy + planes.first * v
            lines[i, 2], lines[i, 3] = planes.step * u, planes.step * v
            lines[i, 4] = ahead
        start = ends[m]


@jit
def vote(lines, volume):
    """Let every ray vote for the cells that it passes, bilinear within each plane.

    Plane after plane, so that the votes of all rays fall into memory that is near.

    Parameters
    ----------
    lines : ndarray of float32, shape (n, 5)
        From `trace`.
    volume : ndarray of float32, shape (count, height, width)
        Takes the votes.
    """
    count, height, width = volume.shape
    one = np.float32(1.0)
    for k in range(count):
        plane, away = volume[k], np.float32(k)
        for i in range(len(lines)):
            u, v = lines[i, 0] + away * lines[i, 2], lines[i, 1] + away * lines[i, 3]
            if not (k < lines[i, 4] and 0.0 <= u < width - 1 and 0.0 <= v < height - 1):
                continue
            col, row = int(u), int(v)
            p, q = u - np.float32(col), v - np.float32(row)
            plane[row, col] += (one - p) * (one - q)
            plane[row, col + 1] += p * (one - q)
            plane[row + 1, col] += (one - p) * q
            plane[row + 1, col + 1] += p * q


@jit
def median_of_marked(values, marked, radius, out):
    """Replace marked pixels by the median of the marked ones around them.

    Parameters
    ----------
    values : ndarray of float64, shape (height, width)
        The values.
    marked : ndarray of bool, shape (height, width)
        Which count.
    radius : int
        Half the side of the square [px], less a half.
    out : ndarray of float64, shape (height, width)
        Output, where marked.
    """
    height, width = values.shape
    near = np.empty((2 * radius + 1) ** 2)
    for y in range(height):
        for x in range(width):
            if not marked[y, x]:
                continue
            count = 0
            for v in range(max(y - radius, 0), min(y + radius + 1, height)):
                for u in range(max(x - radius, 0), min(x + radius + 1, width)):
                    if marked[v, u]:
                        near[count] = values[v, u]
                        count += 1
            out[y, x] = np.median(near[:count])
