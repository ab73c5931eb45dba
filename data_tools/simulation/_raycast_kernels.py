"""Jitted ray casting: what a ray sees in a room with boxes, area-sampled textures included."""

# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from evcalib.kernels.jit import jit

BOX = 8
"""Columns of a box: centre (3) and half sizes (3) [m], cosine and sine of its yaw."""


class SceneArrays(NamedTuple):
    """A scene as arrays.

    Faces are numbered 6 * body + 2 * axis + side; body 0 is the room, body k + 1 is box k; side 1
    is the one at the larger coordinate.
    """

    room: np.ndarray  # (2, 3) lower and upper corner [m]
    boxes: np.ndarray  # (n, 8), see BOX
    faces: np.ndarray  # (6 * (n + 1), 4): texture, shift along u and v [texels], gain
    texels: np.ndarray  # float32: each texture with all its levels of halved side, down to one
    side: int  # texels along the side of level 0, a power of two
    per_metre: float  # texels per metre at level 0


class Hit(NamedTuple):
    """Where a ray ends: distance [m], face, texture coordinates [m], cosine of incidence."""

    distance: float
    face: int
    u: float
    v: float
    cosine: float


@jit
def inverse(value):
    """Return 1 / value, finite and huge instead of infinite."""
    return 1.0 / value if abs(value) > 1e-290 else 1e290


@jit
def exit_room(origin, ray, room):
    """Return (distance, axis) at which a ray from inside leaves the room."""
    ox, oy, oz = origin
    ix, iy, iz = inverse(ray[0]), inverse(ray[1]), inverse(ray[2])
    x = max((room[0, 0] - ox) * ix, (room[1, 0] - ox) * ix)
    y = max((room[0, 1] - oy) * iy, (room[1, 1] - oy) * iy)
    z = max((room[0, 2] - oz) * iz, (room[1, 2] - oz) * iz)
    if x < y:
        return (x, 0) if x < z else (z, 2)
    return (y, 1) if y < z else (z, 2)


@jit
def enter_box(origin, ray, half):
    """Return (distance, axis) where a ray enters a box around 0, infinite for a miss.

    The slab method; an origin inside the box counts as a miss.
    """
    ix, iy, iz = inverse(ray[0]), inverse(ray[1]), inverse(ray[2])
    mx, my, mz = -origin[0] * ix, -origin[1] * iy, -origin[2] * iz
    rx, ry, rz = half[0] * abs(ix), half[1] * abs(iy), half[2] * abs(iz)
    x, y, z = mx - rx, my - ry, mz - rz
    near, far = max(x, y, z), min(mx + rx, my + ry, mz + rz)
    if near > far or near <= 0.0:
        return math.inf, 0
    return near, 0 if near == x else (1 if near == y else 2)


@jit
def to_box(vector, cosine, sine):
    """Return a world vector in the axes of a box with this cosine and sine of its yaw."""
    x, y, z = vector
    return cosine * x + sine * y, cosine * y - sine * x, z


@jit
def meet_box(ray, near, row, boxes):
    """Return (distance, axis) of a ray's entry into the box of a row of `near` (see `place`).

    Also the ray's origin and direction in the axes of the box.
    """
    b = int(near[row, 4])
    direction = to_box(ray, boxes[b, 6], boxes[b, 7])
    start = (near[row, 0], near[row, 1], near[row, 2])
    entry, axis = enter_box(start, direction, (boxes[b, 3], boxes[b, 4], boxes[b, 5]))
    return entry, axis, start, direction


@jit
def hit_at(distance, axis, body, start, direction):
    """Return the hit of a ray that meets a body at right angles to an axis."""
    x = start[0] + distance * direction[0]
    y = start[1] + distance * direction[1]
    z = start[2] + distance * direction[2]
    across = direction[0] if axis == 0 else (direction[1] if axis == 1 else direction[2])
    side = (across > 0.0) == (body == 0)
    u, v = y if axis == 0 else x, y if axis == 2 else z
    return Hit(distance, 6 * body + 2 * axis + side, u, v, abs(across))


@jit
def bilinear(texels, start, side, x, y):
    """Return a periodic texture between the centres of its texels; coordinates in texels."""
    x0, y0 = math.floor(x - 0.5), math.floor(y - 0.5)
    fx, fy = x - 0.5 - x0, y - 0.5 - y0
    mask = side - 1
    left, top = int(x0) & mask, int(y0) & mask
    right, bottom = (left + 1) & mask, (top + 1) & mask
    row, below = start + top * side, start + bottom * side
    upper = texels[row + left] + fx * (texels[row + right] - texels[row + left])
    lower = texels[below + left] + fx * (texels[below + right] - texels[below + left])
    return upper + fy * (lower - upper)


class Detail(NamedTuple):
    """Where the texels of a level begin, its side, that side against level 0, and how far to blend.

    The next level, half as wide, follows it.
    """

    first: int
    size: int
    scale: float
    blend: float


@jit
def detail_of(texture, side, footprint):
    """Return the level for samples that are `footprint` texels wide.

    4 (side^2 - size^2) / 3 texels of finer levels come before that of width `size`.
    """
    level = math.log2(min(max(footprint, 1.0), float(side)))
    fine = int(level)
    size = side >> fine
    first = (texture * (4 * side * side - 1) + 4 * (side * side - size * size)) // 3
    return Detail(first, size, size / side, level - fine)


@jit
def reflectance(texels, detail, u, v):
    """Return a texture's value between two levels; coordinates in texels of level 0."""
    x, y = u * detail.scale, v * detail.scale
    value = bilinear(texels, detail.first, detail.size, x, y)
    if detail.blend == 0.0:
        return value
    first, half = detail.first + detail.size * detail.size, detail.size >> 1
    return value + detail.blend * (bilinear(texels, first, half, 0.5 * x, 0.5 * y) - value)


@jit
def turn(pose, x, y, z):
    """Return a camera bearing in the world; a pose is position (3), R_world_cam (9), ..."""
    return (
        pose[3] * x + pose[4] * y + pose[5] * z,
        pose[6] * x + pose[7] * y + pose[8] * z,
        pose[9] * x + pose[10] * y + pose[11] * z,
    )


@jit
def box_distance(x, y, z, b, boxes):
    """Return a point's distance [m] to box `b`, and the point in the box's axes."""
    local = to_box((x - boxes[b, 0], y - boxes[b, 1], z - boxes[b, 2]), boxes[b, 6], boxes[b, 7])
    dx = max(abs(local[0]) - boxes[b, 3], 0.0)
    dy = max(abs(local[1]) - boxes[b, 4], 0.0)
    dz = max(abs(local[2]) - boxes[b, 5], 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz), local


@jit
def place(pose, near, boxes):
    """Fill the rows of `near` for a pose: the boxes to test, nearest first.

    Columns: origin of the rays in the axes of the box (3), distance below which the box cannot be
    hit, index of the box.  Only the index is given.
    """
    for k in range(near.shape[0]):
        b = near[k, 4]
        gap, local = box_distance(pose[0], pose[1], pose[2], int(b), boxes)
        j = k
        while j > 0 and near[j - 1, 3] > gap:
            for c in range(5):
                near[j, c] = near[j - 1, c]
            j -= 1
        near[j, 0], near[j, 1], near[j, 2] = local
        near[j, 3], near[j, 4] = gap, b


@jit
def boxes_in_cone(pose, axis, half_angle, slack, near, boxes):
    """Write the boxes that a cone of rays may meet into column 4 of `near`; return their number.

    `slack` [m] is how far the camera may move meanwhile; `half_angle` [rad] includes how far it
    may turn.  A box counts if the sphere around it, grown by the slack, meets the cone.
    """
    count = 0
    for b in range(boxes.shape[0]):
        dx, dy, dz = boxes[b, 0] - pose[0], boxes[b, 1] - pose[1], boxes[b, 2] - pose[2]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        radius = math.sqrt(boxes[b, 3] ** 2 + boxes[b, 4] ** 2 + boxes[b, 5] ** 2) + slack
        if distance > radius:
            along = (dx * axis[0] + dy * axis[1] + dz * axis[2]) / distance
            reach = half_angle + math.asin(radius / distance)
            if reach < math.pi and along < math.cos(reach):
                continue
        near[count, 4] = b
        count += 1
    return count


@jit
def render_pixels(pixels, pose, bearings, sample_angle, near, scene, light, depth):
    """Write what a rectangle of pixels gathers, the mean over its rays, and how far the last goes.

    `pixels` are first and past-last column and row, and the pixels per row of `light`.  Each ray
    stands for `sample_angle` [rad]; its longer footprint on the surface picks the level of detail,
    so that nothing aliases.  Rays on one face share the level of the first.

    The loops are here, and the arrays taken out of the scene once, because numba counts
    references atomically around calls to functions that loop: that costs more than a ray.
    """
    room, boxes, faces, texels = scene.room, scene.boxes, scene.faces, scene.texels
    origin = (pose[0], pose[1], pose[2])
    per_metre, side = scene.per_metre, scene.side
    left, right, top, bottom, width = pixels
    detail = detail_of(0, side, 1.0)
    for y in range(top, bottom):
        for i in range(y * width + left, y * width + right):
            total, face = 0.0, -1
            for k in range(bearings.shape[1]):
                ray = turn(pose, bearings[i, k, 0], bearings[i, k, 1], bearings[i, k, 2])
                distance, axis = exit_room(origin, ray, room)
                body, start, direction = 0, origin, ray
                for row in range(near.shape[0]):
                    if near[row, 3] >= distance:
                        break
                    entry, a, from_box, in_box = meet_box(ray, near, row, boxes)
                    if entry < distance:
                        distance, axis, body = entry, a, int(near[row, 4]) + 1
                        start, direction = from_box, in_box
                hit = hit_at(distance, axis, body, start, direction)
                if hit.face != face:
                    face = hit.face
                    footprint = distance * sample_angle * per_metre / max(hit.cosine, 1e-6)
                    detail = detail_of(int(faces[face, 0]), side, footprint)
                u = hit.u * per_metre + faces[face, 1]
                v = hit.v * per_metre + faces[face, 2]
                total += faces[face, 3] * reflectance(texels, detail, u, v)
                depth[i] = distance
            light[i] = total / bearings.shape[1]
