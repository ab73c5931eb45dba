"""Camera calibrations of whatever tool wrote them, found by their content.

Known are the Event Camera Dataset's calib.txt and other lines of numbers, ROS camera_info, Kalibr's
and OpenVINS's camchains, DSEC's cam_to_cam, OpenCV's YAML and XML, DV's XML and JSON, Metavision's
and Basalt's (TUM-VIE's) JSON, and the YAML of VINS, ORB-SLAM, SVO and iKalibr.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from data_tools.logs.cameras import Intrinsics, find_cameras, read_content
from evcalib.camera import Camera
from evcalib.errors import InputError

FOCAL = (0.1, 100.0)
"""Focal lengths as shares of the side of the sensor.  A choice: below, a pinhole sees 157 deg, and
the widest fisheye has 0.2; above, 0.6 deg, and a lens of 50 mm before a DVS128 has 10."""
OFF_CENTRE = 0.2
"""A principal point farther from the centre than this share of width or height is told.

Between real calibrations, which are off by up to 0.16, mostly below 0.06
(`test_real_principal_points_are_not_called_far`), and those of another resolution: one of
346x260 px is off by 0.22 on 240x180 px, one of half or twice the resolution by 0.25 or more.
"""

_CUT = "the last line is not ended: if its number is cut off, the camera is wrong; look at it"


@dataclass(frozen=True)
class CameraFile:
    """The cameras of a file, by name; to be used with sensors of their size.

    Attributes
    ----------
    path : Path
        The file.
    cameras : dict of str to Intrinsics or InputError
        What it says of each, or why it cannot be used.
    """

    path: Path
    cameras: dict[str, Intrinsics | InputError]

    def choose(
        self, width: int | None = None, height: int | None = None, name: str | None = None
    ) -> tuple[Camera, tuple[str, ...]]:
        """Return the camera of a name or of a sensor size, and what the user should know of it.

        Parameters
        ----------
        width, height : int, optional
            Sensor size [px] of the events; where the file tells another, it is refused.
        name : str, optional
            Which camera; needed where several are of that size.

        Returns
        -------
        (Camera, tuple of str)
            The camera, and notes.

        Raises
        ------
        InputError
            If there is no such camera, or more than one, or it cannot be used.
        """
        size = None if width is None or height is None else (width, height)
        chosen = self._named(name, size)
        found = self.cameras[chosen]
        if isinstance(found, InputError):
            raise InputError(f"{self._where(chosen)}: {found}")
        told = found.size or size
        if told is None:
            raise InputError(
                f"{self.path} does not tell the sensor size; give width and height (--size)"
            )
        try:
            camera = Camera(told[0], told[1], *found.focal, found.distortion, found.model)
            if size is not None:
                camera.require_size(*size)
        except InputError as error:
            raise InputError(f"{self._where(chosen)}: {error}") from None
        return camera, self._notes(chosen, camera, found)

    def size(self, name: str | None = None) -> tuple[int, int] | None:
        """Return the sensor size [px] that all cameras (or the one of a name) tell, or None."""
        cameras = [self.cameras.get(name)] if name is not None else self.cameras.values()
        sizes = {one.size for one in cameras if isinstance(one, Intrinsics)}
        return sizes.pop() if len(sizes) == 1 else None

    def _named(self, name: str | None, size: tuple[int, int] | None) -> str:
        names = list(self.cameras)
        if name is not None:
            if name not in self.cameras:
                raise InputError(f"{self.path} has no camera {name}, but {', '.join(names)}")
            return name
        if len(names) == 1:
            return names[0]
        fitting = [
            name
            for name, one in self.cameras.items()
            if isinstance(one, Intrinsics) and (size is None or one.size in (None, size))
        ]
        if len(fitting) == 1:
            return fitting[0]
        what = "several cameras" if size is None else f"cameras for {size[0]}x{size[1]} px"
        if not fitting:
            what = what.replace("cameras", "no camera" if size else "cameras, none of use")
        way_out = "say which with --camera-name" if fitting or not size else "is it the right file?"
        raise InputError(f"{self.path} has {what}: {self._list()}; {way_out}")

    def _list(self) -> str:
        return ", ".join(
            f"{name} ({one})"
            if isinstance(one, InputError)
            else name + ("" if one.size is None else f" ({one.size[0]}x{one.size[1]})")
            for name, one in self.cameras.items()
        )

    def _where(self, name: str) -> str:
        return str(self.path) if len(self.cameras) == 1 else f"{self.path}, {name}"

    def _notes(self, name: str, camera: Camera, found: Intrinsics) -> tuple[str, ...]:
        notes = [f"{self._where(name)}: {found.note}"] if found.note else []
        for focal, side in ((camera.fx, camera.width), (camera.fy, camera.height)):
            if not FOCAL[0] < focal / side < FOCAL[1]:
                raise InputError(
                    f"{self._where(name)}: a focal length of {focal:g} pixels does not go with"
                    f" {side} pixels; is it in pixels (not in mm, or as a share of the width)?"
                )
        point = f"{self._where(name)}: the principal point ({camera.cx:g}, {camera.cy:g})"
        centre = (camera.cx, (camera.width - 1) / 2, camera.width)
        middle = (camera.cy, (camera.height - 1) / 2, camera.height)
        if not (0 <= camera.cx < camera.width and 0 <= camera.cy < camera.height):
            raise InputError(
                f"{point} is outside {camera.width}x{camera.height} pixels; is it the calibration"
                " of another resolution?"
            )
        if any(abs(at - half) > OFF_CENTRE * side for at, half, side in (centre, middle)):
            notes.append(
                f"{point} is far from the centre of {camera.width}x{camera.height} pixels: is it"
                " the calibration of another resolution, or of a cut-out?"
            )
        return tuple(notes)


def read_camera_file(path: str | Path) -> CameraFile:
    """Read all cameras of a file.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    CameraFile
        Its cameras, at least one.

    Raises
    ------
    InputError
        If it cannot be read, or holds no camera.
    """
    content, longer = read_content(path)
    cameras = find_cameras(content)
    if longer is not content:
        for (name, one), other in zip(cameras.items(), find_cameras(longer).values(), strict=True):
            if isinstance(one, Intrinsics) and one != other:
                cameras[name] = replace(one, note=_CUT)
    if not cameras:
        there = ", ".join(map(str, content)) if isinstance(content, dict) else "no mapping"
        raise InputError(
            f"{path} holds no camera in a form that is known (ROS camera_info, Kalibr, OpenCV, DV,"
            f" a line of numbers, ...), but {there[:300]}"
        )
    return CameraFile(Path(path), cameras)


def read_camera(
    path: str | Path,
    width: int | None = None,
    height: int | None = None,
    *,
    name: str | None = None,
) -> Camera:
    """Read one camera of a file.

    Parameters
    ----------
    path : path
        The file.
    width, height : int, optional
        Sensor size [px], where the file does not tell it; one that tells another is refused.
    name : str, optional
        Which camera, where the file has several of that size: ``cam1``.

    Returns
    -------
    Camera
        The camera.

    Raises
    ------
    InputError
        If the file cannot be read, misses something, is for another resolution, or holds several
        cameras that fit.
    """
    return read_camera_file(path).choose(width, height, name)[0]


def read_calib_txt(path: str | Path, width: int, height: int) -> Camera:
    """Read ``fx fy cx cy k1 k2 p1 p2 [k3]`` on one line (Mueggler et al. 2017)."""
    return read_camera(path, width, height)


def read_camchain(path: str | Path, name: str = "cam0") -> Camera:
    """Read one pinhole camera of a Kalibr camchain YAML."""
    return read_camera(path, name=name)
