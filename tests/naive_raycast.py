"""What a ray sees, face by face: the plain twin of the simulator's ray casting."""

import numpy as np


def faces_of(lower, upper):
    """Yield (axis, coordinate) of the six faces of a box."""
    for axis in range(3):
        yield axis, lower[axis]
        yield axis, upper[axis]


def first_hit(origin, ray, room, boxes):
    """Return the distance to the nearest face that the ray meets from its front."""
    best = np.inf
    for b in range(-1, len(boxes)):
        start, direction, lower, upper = origin, ray, room[0], room[1]
        if b >= 0:
            centre, half, yaw = boxes[b, :3], boxes[b, 3:6], boxes[b, 6]
            c, s = np.cos(yaw), np.sin(yaw)
            to_box = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
            start, direction = to_box @ (origin - centre), to_box @ ray
            lower, upper = -half, half
        for axis, coordinate in faces_of(lower, upper):
            if direction[axis] == 0:
                continue
            distance = (coordinate - start[axis]) / direction[axis]
            point = start + distance * direction
            others = [a for a in range(3) if a != axis]
            inside = all(lower[a] - 1e-9 <= point[a] <= upper[a] + 1e-9 for a in others)
            if distance > 0 and inside:
                best = min(best, distance)
    return best
