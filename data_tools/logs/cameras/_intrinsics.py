"""What a file says of one camera: focal lengths, distortion, sensor size, checked alike."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from evcalib.errors import InputError

Node = dict[str, Any]
"""A mapping whose keys are letters and digits in lower case: ``camera_matrix`` is cameramatrix."""

PLAIN = ("", "none", "nodistortion", "pinhole", "perspective")
"""Words for no distortion, or for none said."""
_RADTAN = (
    *("radtan", "radialtangential", "plumbbob", "brown", "pinholebrownt2"),
    *("rationalpolynomial", "pinholeradtan8", *PLAIN),
)
_FISHEYE = ("equidistant", "fisheye", "kannalabrandt", "kannalabrandt8", "kb4", "pinholefisheye")
_SIZES = (
    ("imagewidth", "imageheight"),
    ("imgwidth", "imgheight"),
    ("camwidth", "camheight"),
    ("camerawidth", "cameraheight"),
    ("width", "height"),
)
_PAIRS = ("resolution", "imagesize", "imgsize")


@dataclass(frozen=True)
class Intrinsics:
    """What a file says of one camera.

    Attributes
    ----------
    focal : tuple of float
        fx, fy, cx, cy [px].
    distortion : tuple of float
        As :class:`evcalib.camera.Camera` takes it.
    model : {"radtan", "fisheye"}
        Kind of distortion.
    size : (int, int) or None
        Sensor width and height [px], if the file tells them.
    note : str
        What was taken for granted, or nothing.
    """

    focal: tuple[float, float, float, float]
    distortion: tuple[float, ...]
    model: str
    size: tuple[int, int] | None
    note: str = ""


def intrinsics(
    focal: Sequence[float],
    distortion: Sequence[float],
    model: str,
    size: tuple[int, int] | None,
    note: str = "",
) -> Intrinsics:
    """Return a camera under the two models that are known; coefficients of 0 say nothing.

    Raises
    ------
    InputError
        If its distortion is neither radial-tangential (k1 k2 p1 p2 k3) nor equidistant.
    """
    given = [float(k) for k in distortion]
    most = {**dict.fromkeys(_RADTAN, 5), **dict.fromkeys(_FISHEYE, 4)}.get(model)
    if most is None:
        raise InputError(
            f"its distortion is of the model {model!r}; radial-tangential (radtan, plumb_bob) and"
            " equidistant (fisheye) are supported"
        )
    if any(given[most:]):
        raise InputError(
            f"its {len(given)} coefficients of distortion are those of a rational or thin-prism"
            f" model; of {model or 'radtan'} the first {most} are supported, if the others are 0"
        )
    if given and len(given) < 4:
        raise InputError(f"it has {len(given)} coefficients of distortion; 4 or 5 are needed")
    kind = "radtan" if model in _RADTAN else "fisheye"
    fx, fy, cx, cy = focal
    return Intrinsics((fx, fy, cx, cy), tuple(given[:most]), kind, size, note)


def plain_key(key: Any) -> str:
    """Return a key in small letters, without what separates its words."""
    return "".join(c for c in str(key).lower() if c.isalnum())


def plain_keys(value: Any) -> Node:
    """Return a mapping with plain keys, also those of the mappings in it; else an empty one."""
    return {plain_key(key): v for key, v in value.items()} if isinstance(value, Mapping) else {}


def word(node: Node, key: str) -> str:
    """Return a word of a node in small letters, without what separates its parts."""
    value = node.get(key)
    return "" if value is None else plain_key(value)


def flat(value: Any) -> list[Any]:
    """Return the values of a matrix in whatever form: a list, lists in a list, rows/cols/data."""
    if isinstance(value, Mapping):
        return flat(value.get("data"))
    if not isinstance(value, list):
        return []
    return [one for part in value for one in (part if isinstance(part, list) else [part])]


def numbers(node: Node, key: str, label: str, count: int | None = None) -> list[float]:
    """Return the numbers of a list or matrix.

    Raises
    ------
    InputError
        If they are missing, no numbers, or not as many as must be.
    """
    if key not in node or (isinstance(node[key], Mapping) and "data" not in node[key]):
        raise InputError(f"it misses {label}")
    value = node[key]
    values = flat(value)
    if (count is not None and len(values) != count) or not isinstance(value, list | Mapping):
        what = "numbers" if count is None else f"{count} numbers"
        raise InputError(f"{label} must be a list of {what}, not {_short(value)}")
    return [number(one, label) for one in values]


def named(node: Node, *keys: str) -> list[float]:
    """Return numbers that stand under their own names; InputError if one is missing."""
    missing = [key for key in keys if key not in node]
    if missing:
        raise InputError(f"it misses {', '.join(missing)}")
    return [number(node[key], key) for key in keys]


def number(value: Any, label: str) -> float:
    """Return a finite number; texts will do, as DV writes them."""
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found):
        raise InputError(f"{label} must be numbers, not {_short(value)}")
    return found


def matrix(values: Sequence[float]) -> list[float]:
    """Return fx, fy, cx, cy of a 3 x 3 matrix, row by row."""
    if len(values) != 9:
        raise InputError(f"the camera matrix has {len(values)} numbers, not 9")
    fx, skew, cx, down, fy, cy, *last = values
    if down or any(last[:2]) or last[2] != 1:
        raise InputError(f"the camera matrix is no [fx 0 cx; 0 fy cy; 0 0 1]: {list(values)}")
    if abs(skew) > 1e-9 * abs(fx):
        raise InputError(f"the camera matrix has a skew of {skew:g}, which is not supported")
    return [fx, fy, cx, cy]


def size_of(node: Node) -> tuple[int, int] | None:
    """Return the sensor size (width, height) [px] that a node tells, or None."""
    for width, height in _SIZES:
        if node.get(width) is not None and node.get(height) is not None:
            return whole_size([number(node[key], "the size") for key in (width, height)])
    for key in _PAIRS:
        if node.get(key) is not None:
            return whole_size(numbers(node, key, key, 2))
    return None


def whole_size(pair: Sequence[float]) -> tuple[int, int] | None:
    """Return width and height; None where they are 0, which stands for unknown."""
    if any(side != int(side) or side < 0 for side in pair):
        raise InputError(f"the sensor size must be two whole numbers, not {list(pair)}")
    width, height = (int(side) for side in pair)
    return (width, height) if width and height else None


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 100 else f"{text[:100]}..."
