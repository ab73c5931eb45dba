"""A calibration together with all that a report says of how it came about."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from evcalib.arrays import Floats
from evcalib.camera import Camera
from evcalib.display import Shown
from evcalib.heading import HeadingEstimate
from evcalib.kinematics import BodyVelocities
from evcalib.pipeline._assessment import RefinedCalibration
from evcalib.pipeline._gyro import Gyro
from evcalib.series import VelocitySeries

PACKAGES = ("evcalib", "numpy", "scipy", "numba", "opencv-python-headless", "matplotlib")
"""Packages that have a say in the numbers and pictures."""


@dataclass(frozen=True)
class Gating:
    """Wheel rows, and how many were left out.

    Attributes
    ----------
    rows : int
        Rows of the wheel log.
    over_slip, over_yaw_rate : int
        Rows over each limit; a row can be over both.
    removed : int
        Rows that were left out.
    """

    rows: int
    over_slip: int
    over_yaw_rate: int
    removed: int

    @classmethod
    def of(cls, body: BodyVelocities) -> Gating:
        """Take the counts out of what the wheels gave."""
        return cls(body.rows, body.over_slip, body.over_yaw_rate, body.removed)


@dataclass(frozen=True)
class InputFile:
    """A file that a run read.

    Attributes
    ----------
    name : str
        Without its folder.
    size : int
        Bytes.
    sha256 : str
        Digest in hexadecimal, or nothing.
    """

    name: str
    size: int
    sha256: str = ""

    def __str__(self) -> str:
        digest = f", sha256 {self.sha256}" if self.sha256 else ""
        return f"{self.name}, {self.size:,} bytes{digest}"


@dataclass(frozen=True, eq=False)
class Truth(Shown):
    """What a simulation knows.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        True rotation.
    offset : float
        True offset [s].
    """

    R_body_cam: Floats
    offset: float


@dataclass(frozen=True, eq=False)
class CalibrationRun(Shown):
    """One run from a recording and a wheel log to a calibration.

    Attributes
    ----------
    calibration : RefinedCalibration
        The result.
    estimate : HeadingEstimate
        What the camera gave.
    velocities : VelocitySeries
        What the vehicle gave, gated rows left out.
    gating : Gating, optional
        Wheel rows and what was left out of them; None where velocities were given.
    recording : mapping of str to str
        Description of the recording: name to value with its unit.
    losses : mapping of str to int
        What of the recording could not be used: what to how many.
    settings : mapping
        Parameters of the run, the seed among them.
    versions : mapping of str to str
        Package to version; see `package_versions`.
    timings : mapping of str to float
        Stage to seconds.
    command : str
        Command line that repeats the run.
    files : mapping of str to InputFile
        Role to file, the recording first.
    truth : Truth, optional
        Where it is known.
    camera : Camera, optional
        The camera as it was given.
    gyro : Gyro, optional
        What the camera's IMU gave, where one was used.
    """

    calibration: RefinedCalibration
    estimate: HeadingEstimate
    velocities: VelocitySeries
    gating: Gating | None = None
    recording: Mapping[str, str] = field(default_factory=dict)
    losses: Mapping[str, int] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    timings: Mapping[str, float] = field(default_factory=dict)
    command: str = ""
    files: Mapping[str, InputFile] = field(default_factory=dict)
    truth: Truth | None = None
    camera: Camera | None = None
    gyro: Gyro | None = None

    @property
    def gap_reasons(self) -> list[tuple[str, int]]:
        """Why windows have no heading and how many, the most frequent first."""
        return Counter(gap.reason for gap in self.estimate.gaps).most_common()


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the packages behind the numbers."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed as a package"
    found["system"] = f"{platform.system()} {platform.machine()}"
    return found
