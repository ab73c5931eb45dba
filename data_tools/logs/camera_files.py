"""Readers of camera calibrations: the Event Camera Dataset's calib.txt and Kalibr's camchain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from data_tools.files.text import read_text, read_yaml
from evcalib.camera import Camera
from evcalib.errors import InputError

LARGEST_CALIB_TXT = 1 << 16

_MODELS = {"radtan": "radtan", "equidistant": "fisheye", "none": "radtan"}


def read_camera(
    path: str | Path, width: int | None = None, height: int | None = None, *, name: str = "cam0"
) -> Camera:
    """Read a camera file of either kind, told apart by the ending ``.yaml`` or ``.yml``.

    Parameters
    ----------
    path : path
        The file.
    width, height : int, optional
        Sensor size [px].  A calib.txt does not tell it; a camchain that tells another is refused.
    name : str
        Which camera of a camchain.

    Raises
    ------
    InputError
        If the file cannot be read, misses something, or is for another resolution.
    """
    path = Path(path)
    if path.suffix.lower() in (".yaml", ".yml"):
        camera = read_camchain(path, name)
        if width is not None and height is not None:
            try:
                camera.require_size(width, height)
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
        return camera
    if width is None or height is None:
        raise InputError(f"{path} does not tell the sensor size; give width and height (--size)")
    return read_calib_txt(path, width, height)


def read_calib_txt(path: str | Path, width: int, height: int) -> Camera:
    """Read ``fx fy cx cy k1 k2 p1 p2 [k3]`` on one line (Mueggler et al. 2017)."""
    words = read_text(path, LARGEST_CALIB_TXT).split()
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        raise InputError(
            f"{path} is not a line of numbers fx fy cx cy k1 k2 p1 p2 k3: {error}"
        ) from None
    if len(numbers) not in (4, 8, 9):
        raise InputError(
            f"{path} holds {len(numbers)} numbers; fx fy cx cy k1 k2 p1 p2 k3 are nine (k3, or"
            " all distortion, may be missing)"
        )
    return _camera(path, width, height, numbers[:4], numbers[4:], "radtan")


def read_camchain(path: str | Path, name: str = "cam0") -> Camera:
    """Read one pinhole camera of a Kalibr camchain YAML."""
    chain = read_yaml(path)
    if not isinstance(chain, dict) or not isinstance(chain.get(name), dict):
        found = ", ".join(map(str, chain)) if isinstance(chain, dict) else "no mapping"
        raise InputError(f"{path} has no camera {name}, but {found}")
    entry = chain[name]
    kind = _entry(entry, "camera_model", path)
    if kind != "pinhole":
        raise InputError(f"{path}: camera_model {kind!r} is not supported, only pinhole")
    model = str(entry.get("distortion_model", "none"))
    if model not in _MODELS:
        choices = ", ".join(_MODELS)
        raise InputError(f"{path}: distortion_model must be one of {choices}, not {model!r}")
    focal = _numbers(entry, "intrinsics", path, 4)
    distortion = [] if model == "none" else _numbers(entry, "distortion_coeffs", path, 4)
    width, height = _numbers(entry, "resolution", path, 2)
    return _camera(path, width, height, focal, distortion, _MODELS[model])


def _entry(entry: dict[str, Any], key: str, path: str | Path) -> Any:
    if key not in entry:
        raise InputError(f"{path} misses {key}")
    return entry[key]


def _numbers(entry: dict[str, Any], key: str, path: str | Path, count: int) -> list[float]:
    values = _entry(entry, key, path)
    if not isinstance(values, list) or len(values) != count:
        raise InputError(f"{path}: {key} must be a list of {count} numbers, not {values!r}")
    try:
        return [float(value) for value in values]
    except (TypeError, ValueError):
        raise InputError(f"{path}: {key} must be numbers, not {values!r}") from None


def _camera(
    path: str | Path,
    width: float,
    height: float,
    focal: list[float],
    distortion: list[float],
    model: str,
) -> Camera:
    fx, fy, cx, cy = focal
    try:
        camera = Camera(width, height, fx, fy, cx, cy, tuple(distortion), model)  # type: ignore[arg-type]
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if not (0 <= camera.cx < camera.width and 0 <= camera.cy < camera.height):
        raise InputError(
            f"{path}: the principal point ({camera.cx:g}, {camera.cy:g}) is outside"
            f" {camera.width}x{camera.height} pixels; is it the calibration of another resolution?"
        )
    return camera
