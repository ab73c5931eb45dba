"""The pinhole camera with lens distortion: pixels to unit bearings and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evcalib import checks
from evcalib.arrays import Floats
from evcalib.errors import InputError

_COEFFICIENTS = {"radtan": (0, 4, 5), "fisheye": (0, 4)}
_STEPS = 30
"""Most steps of Newton's method: usual lenses need 4 or 5, one that turns back in its image 9
(`tests/test_camera.py` finds the same answers with half as many)."""

_TOLERANCE = 1e-13
"""Steps below this are rounding of numbers near 1."""


@dataclass(frozen=True)
class Camera:
    """Pinhole camera with radial-tangential or fisheye distortion.

    Integer pixel coordinates are pixel centres.  Both models are those of OpenCV.

    Attributes
    ----------
    width, height : int
        Sensor size [px].
    fx, fy, cx, cy : float
        Focal lengths and principal point [px].
    distortion : tuple of float
        ``radtan``: (k1, k2, p1, p2[, k3]); ``fisheye``: (k1, k2, k3, k4); empty for none.
    model : {"radtan", "fisheye"}
        Radial-tangential (Brown 1966) or equidistant (Kannala & Brandt 2006).

    Raises
    ------
    InputError
        If a number is not finite, a length is not positive, or a count is wrong.

    Examples
    --------
    >>> camera = Camera(240, 180, fx=200.0, fy=200.0, cx=120.0, cy=90.0)
    >>> camera.bearings([[120, 90], [320, 90]]).round(3)
    array([[0.   , 0.   , 1.   ],
           [0.707, 0.   , 0.707]])
    >>> camera.project([[1, 0, 2]])
    array([[220.,  90.]])
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    model: str = "radtan"

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = checks.positive(getattr(self, name), f"camera {name}", "pixels")
            if value != int(value):
                raise InputError(f"camera {name} must be a whole number of pixels, not {value}")
            object.__setattr__(self, name, int(value))
        for name in ("fx", "fy"):
            value = checks.positive(getattr(self, name), f"camera {name}", "pixels")
            object.__setattr__(self, name, value)
        cx, cy = checks.floats((self.cx, self.cy), "camera cx, cy", (2,))
        model = checks.one_of(self.model, "camera model", tuple(_COEFFICIENTS))
        given = checks.floats(self.distortion, "camera distortion", (None,))
        if given.size not in _COEFFICIENTS[model]:
            counts = ", ".join(str(n) for n in _COEFFICIENTS[model])
            raise InputError(f"a {model} camera has {counts} coefficients, not {given.size}")
        object.__setattr__(self, "cx", float(cx))
        object.__setattr__(self, "cy", float(cy))
        object.__setattr__(self, "distortion", tuple(float(k) for k in given))

    @property
    def matrix(self) -> Floats:
        """The 3 x 3 matrix K [px]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def focal(self) -> float:
        """Geometric mean of the two focal lengths [px]."""
        return float(np.sqrt(self.fx * self.fy))

    def require_size(self, width: int, height: int) -> None:
        """Raise InputError unless the camera has this sensor size [px]."""
        if (width, height) != (self.width, self.height):
            raise InputError(
                f"the camera is calibrated for {self.width}x{self.height} pixels, the events have"
                f" {width}x{height}; use the calibration of this resolution"
            )

    def bearings(self, pixels: ArrayLike) -> Floats:
        """Return unit bearings in the camera frame.

        Parameters
        ----------
        pixels : array_like, shape (n, 2)
            Columns x, y [px]; fractions are welcome.

        Returns
        -------
        ndarray, shape (n, 3)
            Unit vectors.  Rows of NaN where no direction maps to the pixel, because the
            distortion turns back before it.
        """
        xy = checks.floats(pixels, "pixels", (None, 2))
        distorted = (xy - (self.cx, self.cy)) / (self.fx, self.fy)
        if self.model == "fisheye":
            return self._fisheye_bearings(distorted)
        plane = self._undistort(distorted)
        rays = np.column_stack((plane, np.ones(len(plane))))
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def project(self, bearings: ArrayLike) -> Floats:
        """Return the pixels of bearings.

        Parameters
        ----------
        bearings : array_like, shape (n, 3)
            Directions in the camera frame, of any length.

        Returns
        -------
        ndarray, shape (n, 2)
            Columns x, y [px], also outside the image.  Rows of NaN for the zero vector, for
            directions behind a ``radtan`` camera, and for those beyond the angle where the
            distortion turns back.
        """
        rays = checks.floats(bearings, "bearings", (None, 3))
        if self.model == "fisheye":
            distorted = self._fisheye_plane(rays)
        else:
            front = rays[:, 2] > 0
            depth = np.where(front, rays[:, 2], np.nan)
            plane = rays[:, :2] / depth[:, None]
            plane[~(np.hypot(plane[:, 0], plane[:, 1]) <= self._radial_limit())] = np.nan
            distorted = self._distort(plane)[0]
        return distorted * (self.fx, self.fy) + (self.cx, self.cy)

    def _radial_limit(self) -> float:
        """Largest undistorted radius up to which the radial polynomial increases."""
        if self.model == "fisheye":
            k = self.distortion or (0.0,) * 4
            return min(_first_turn(k), np.pi)
        k1, k2, _, _, k3 = (*self.distortion, *(0.0,) * 5)[:5]
        return _first_turn((k1, k2, k3))

    def _distort(self, plane: NDArray) -> tuple[NDArray, NDArray]:
        """Apply the radial-tangential model; return points and their Jacobians (n, 2, 2)."""
        k1, k2, p1, p2, k3 = (*self.distortion, *(0.0,) * 5)[:5]
        x, y = plane[:, 0], plane[:, 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
        points = np.column_stack(
            (
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            )
        )
        jacobian = np.empty((len(plane), 2, 2))
        jacobian[:, 0, 0] = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        jacobian[:, 1, 1] = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        jacobian[:, 0, 1] = slope * x * y + 2 * p1 * x + 2 * p2 * y
        jacobian[:, 1, 0] = jacobian[:, 0, 1]
        return points, jacobian

    def _undistort(self, distorted: NDArray) -> NDArray:
        """Invert `_distort` by Newton's method; NaN where it finds no answer."""
        limit = self._radial_limit()
        plane = distorted.copy()
        with np.errstate(all="ignore"):
            # A start beyond the turning point would converge to the wrong branch.
            radius = np.hypot(plane[:, 0], plane[:, 1])
            plane *= np.minimum(1.0, 0.9 * limit / np.maximum(radius, 1e-300))[:, None]
            for _ in range(_STEPS):
                points, jacobian = self._distort(plane)
                step = _solve(jacobian, distorted - points)
                plane += step
                if not (np.abs(step) > _TOLERANCE).any():
                    break
            points, _ = self._distort(plane)
            found = np.abs(points - distorted).max(axis=1, initial=0) < 1e-10
            found &= np.hypot(plane[:, 0], plane[:, 1]) <= limit
        plane[~found] = np.nan
        return plane

    def _fisheye_plane(self, rays: NDArray) -> NDArray:
        rho = np.hypot(rays[:, 0], rays[:, 1])
        theta = np.arctan2(rho, rays[:, 2])
        lost = (theta > self._radial_limit()) | ((rho == 0) & (rays[:, 2] <= 0))
        radius = np.where(lost, np.nan, _odd(theta, self.distortion)[0])
        # On the axis both factors vanish and any direction serves.
        return rays[:, :2] * (radius / np.where(rho > 0, rho, 1.0))[:, None]

    def _fisheye_bearings(self, distorted: NDArray) -> NDArray:
        radius = np.hypot(distorted[:, 0], distorted[:, 1])
        limit = self._radial_limit()
        theta = np.minimum(radius, 0.9 * limit)
        with np.errstate(all="ignore"):
            for _ in range(_STEPS):
                value, slope = _odd(theta, self.distortion)
                step = (radius - value) / slope
                theta = theta + step
                if not (np.abs(step) > _TOLERANCE).any():
                    break
            found = np.abs(_odd(theta, self.distortion)[0] - radius) < 1e-10
            found &= (theta >= 0) & (theta <= limit)
        theta = np.where(found, theta, np.nan)
        across = distorted * (np.sin(theta) / np.where(radius > 0, radius, 1.0))[:, None]
        return np.column_stack((across, np.cos(theta)))


def _odd(r: NDArray, k: tuple[float, ...]) -> tuple[NDArray, NDArray]:
    """Return r (1 + k1 r^2 + k2 r^4 + ...) and its derivative."""
    value, slope = np.ones_like(r), np.ones_like(r)
    for n, coefficient in enumerate(k, start=1):
        power = r ** (2 * n)
        value = value + coefficient * power
        slope = slope + (2 * n + 1) * coefficient * power
    return r * value, slope


def _first_turn(k: tuple[float, ...]) -> float:
    """Return the smallest r > 0 at which r (1 + k1 r^2 + ...) stops increasing."""
    # The derivative as a polynomial in u = 1 / r^2, whose leading coefficient is 1.
    slope = [1.0] + [(2 * n + 1) * coefficient for n, coefficient in enumerate(k, start=1)]
    roots = np.roots(slope)
    turns = roots[(np.abs(roots.imag) < 1e-12) & (roots.real > 1e-12)].real
    return float(1 / np.sqrt(turns.max())) if turns.size else np.inf


def _solve(matrix: NDArray, right: NDArray) -> NDArray:
    """Solve n systems of 2 x 2."""
    (a, b), (c, d) = matrix[:, 0].T, matrix[:, 1].T
    det = a * d - b * c
    return (
        np.column_stack((d * right[:, 0] - b * right[:, 1], a * right[:, 1] - c * right[:, 0]))
        / det[:, None]
    )
