"""Calibrations as files: our YAML, and what other tools read."""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from data_tools.files.text import LARGEST_YAML, read_text, read_yaml
from evcalib.alignment import Calibration
from evcalib.alignment.verdict import PIXEL_DELAY
from evcalib.arrays import Floats
from evcalib.errors import InputError
from evcalib.geometry import camera_looks, matrix_to_quaternion, matrix_to_rpy, quaternion_to_matrix
from evcalib.geometry import rpy_to_matrix as rpy_matrix
from evcalib.pipeline import CalibrationRun, RefinedCalibration, position_text

CONVENTION = (
    "v_body = R_body_cam v_cam, camera X right Y down Z forward, body X forward Y left Z up;"
    " t_body = t_cam + offset_s"
)

_NEEDED = ("R_body_cam", "offset_s", "offset_observable", "rotation_observable")

FORMATS = ("kalibr", "ros-tf", "urdf")


@dataclass(frozen=True, eq=False)
class StoredCalibration:
    """What other tools need of a calibration.

    Attributes
    ----------
    R_body_cam : ndarray, shape (3, 3)
        ``v_body = R_body_cam @ v_cam``.
    offset : float
        ``t_body = t_cam + offset`` [s].
    offset_observable, rotation_observable : bool
        Whether the motion determined them.
    position : tuple of float
        Where the camera sits in the body frame [m]; NaN where that is not known.
    position_sd : tuple of float
        Standard deviations of x and y [m]; inf where they were given or are not known.
    """

    R_body_cam: Floats
    offset: float
    offset_observable: bool = True
    rotation_observable: bool = True
    position: tuple[float, ...] = (math.nan, math.nan, math.nan)
    position_sd: tuple[float, ...] = (math.inf, math.inf)

    @property
    def translation(self) -> list[float]:
        """The position [m], with 0 for what is not known."""
        return [value if math.isfinite(value) else 0.0 for value in self.position]

    @property
    def about_position(self) -> str:
        """Where each coordinate comes from, in words."""
        words = []
        for name, value, sd in zip(
            "xyz", self.position, (*self.position_sd, math.inf), strict=True
        ):
            if not math.isfinite(value):
                words.append(f"{name} is not observed and written as zero")
            elif math.isfinite(sd):
                words.append(f"{name} is found to {1e3 * sd:.1f} mm (sd)")
            else:
                words.append(f"{name} is as given")
        return ", ".join(words)


def summary_dict(calibration: Calibration) -> dict[str, Any]:
    """Return the content of ``calibration.yaml``, of plain Python values."""
    diagnostics = calibration.diagnostics
    unknown = calibration.unknown_axis
    joint = getattr(calibration, "joint", None)
    return {
        "R_body_cam": [[float(x) for x in row] for row in calibration.R_body_cam],
        "offset_s": float(calibration.offset),
        "offset_sd_s": float(calibration.offset_sd),
        "offset_interval_s": [float(x) for x in calibration.offset_interval],
        "offset_observable": bool(calibration.offset_observable),
        "rotation_sd_deg": math.degrees(calibration.rotation_sd),
        "rotation_sd_xyz_deg": [
            min(math.degrees(math.sqrt(x)), 180.0) for x in np.diag(calibration.rotation_covariance)
        ],
        "rotation_covariance_deg2": [
            [float(x) for x in row]
            for row in np.degrees(np.degrees(calibration.rotation_covariance))
        ],
        "independent_stretches": float(calibration.samples),
        "rotation_radius_deg": math.degrees(calibration.rotation_radius),
        "rotation_radius_of_data_deg": math.degrees(calibration.data_radius),
        "rotation_radius_of_odometry_deg": math.degrees(calibration.odometry_radius),
        "rotation_observable": bool(calibration.rotation_observable),
        "unknown_axis": None if unknown is None else [float(x) for x in unknown],
        **_position_dict(calibration),
        "verdict": str(calibration.verdict),
        "doubts": list(calibration.verdict.doubts),
        "converged": joint is None or bool(joint.converged),
        "pixel_delay": PIXEL_DELAY,
        "inlier_share": float(calibration.inlier_share),
        "headings_used": len(calibration.residuals.t),
        "diagnostics": {
            "heading_noise_deg": math.degrees(diagnostics.mixture.sigma),
            "flipped_share": float(diagnostics.mixture.flipped),
            "outlier_share": float(diagnostics.mixture.outliers),
            "independent_headings": float(diagnostics.independent_headings),
            "noise_correlated_share": float(diagnostics.noise.share),
            "noise_memory_s": float(diagnostics.noise.memory),
            "heading_rate_z": float(diagnostics.heading_rate_z),
            "follows_z": float(diagnostics.follows_z),
            "agrees": bool(diagnostics.agrees),
            "direction_spread_deg": math.degrees(diagnostics.spread.spread),
            "direction_axes": int(diagnostics.spread.axes),
            "second_peak_ratio": float(diagnostics.second_peak_ratio),
            "rotation_change_over_plausible_offsets_deg": math.degrees(diagnostics.offset_matters),
        },
        "settings": dict(calibration.settings),
        "convention": CONVENTION,
    }


def _position_dict(calibration: Calibration) -> dict[str, Any]:
    """Return the camera's position, null where nothing is known, and each unknown's verdict."""
    if not isinstance(calibration, RefinedCalibration):
        return {}
    seen = [bool(x) for x in (*calibration.position_observable, False)]
    sds = zip(calibration.position_sd, seen, strict=True)
    return {
        "position_m": [_or_none(x) for x in calibration.position],
        "position_sd_m": [_or_none(sd) if known else None for sd, known in sds],
        "position_observable": seen,
        "unknowns": [asdict(one) | {"sd": _or_none(one.sd)} for one in calibration.unknowns],
    }


def _or_none(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def noise_dict(run: CalibrationRun) -> dict[str, Any]:
    """Return what was left out of the events as noise; null where all were taken."""
    noise = run.estimate.noise
    return {"noise": None if noise is None else asdict(noise)}


def run_dict(run: CalibrationRun) -> dict[str, Any]:
    """Return the content of a run's ``calibration.yaml``: what comparing runs needs, too."""
    systematic, rate = run.settings.get("systematic", {}), run.estimate.event_rate
    refined = getattr(run.calibration, "joint", None) is not None
    recording: dict[str, Any] = {"file": str(run.files.get("recording", ""))}
    if rate is not None and rate.t.size:
        recording["span_s"] = [float(rate.t[0]), float(rate.t[-1] + rate.width)]
    # It begins with the number: "... us, subtracted from all times".
    recording["origin_us"] = int(run.recording.get("origin", "0").split()[0])
    vehicle = run.files.get("vehicle")
    return {
        **summary_dict(run.calibration),
        **noise_dict(run),
        # Of the error bars above, what all runs of a rig have in common.
        "shared": {
            "rotation_sd_deg": math.degrees(systematic["rotation_sd"]) if refined else 0.0,
            "offset_sd_s": float(systematic["time_sd"]) if refined else 0.0,
        },
        "recording": recording,
        "rig": {
            "camera": "" if run.camera is None else str(run.camera),
            "vehicle": "" if vehicle is None else vehicle.sha256,
        },
    }


def write_calibration(
    path: str | Path, calibration: Calibration, run: CalibrationRun | None = None
) -> None:
    """Write ``calibration.yaml``, of a whole run with what comparing runs needs."""
    content = summary_dict(calibration) if run is None else run_dict(run)
    text = yaml.safe_dump(content, sort_keys=False, width=100, default_flow_style=None)
    Path(path).write_text(text, encoding="utf-8")


def read_calibration(path: str | Path) -> StoredCalibration:
    """Read rotation, offset and position from a ``calibration.yaml``.

    Raises
    ------
    InputError
        If the file cannot be read, lacks a key, or its matrix is no rotation.
    """
    return calibration_of(read_yaml(path), path)


def calibration_of(content: Any, path: str | Path) -> StoredCalibration:
    """Return rotation and offset out of what a ``calibration.yaml`` holds."""
    if not isinstance(content, dict) or not content.keys() >= set(_NEEDED):
        raise InputError(f"{path} is no whole calibration: it needs the keys {', '.join(_NEEDED)}")
    flags = [content[name] for name in ("offset_observable", "rotation_observable")]
    if not all(isinstance(flag, bool) for flag in flags):
        raise InputError(f"{path}: offset_observable and rotation_observable must be true or false")
    return replace(
        _stored(content["R_body_cam"], content["offset_s"], path),
        offset_observable=flags[0],
        rotation_observable=flags[1],
        position=_numbers(content.get("position_m"), math.nan, path),
        position_sd=_numbers(content.get("position_sd_m"), math.inf, path)[:2],
    )


def _numbers(values: Any, missing: float, path: str | Path) -> tuple[float, ...]:
    """Return three numbers, `missing` for null; files of earlier versions have none."""
    values = [None] * 3 if values is None else values
    try:
        numbers = tuple(missing if value is None else float(value) for value in values)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != 3:
        raise InputError(f"{path}: position_m and position_sd_m must be three numbers or null")
    return numbers


def export(calibration: StoredCalibration, form: str) -> str:
    """Return a calibration as text in the form of another tool.

    Parameters
    ----------
    calibration : StoredCalibration
        Rotation and offset.
    form : {"kalibr", "ros-tf", "urdf"}
        Kalibr's camchain with the body in place of the IMU; a ``static_transform_publisher``
        launch argument list as YAML; or a URDF joint.  What is not known of the camera's position
        is written as zero, and each file says what that is.
    """
    if form not in FORMATS:
        raise InputError(f"the export format must be one of {', '.join(FORMATS)}, not {form!r}")
    text = {"kalibr": _to_kalibr, "ros-tf": _to_ros_tf, "urdf": _to_urdf}[form](calibration)
    unsure = []
    if not calibration.rotation_observable:
        unsure.append("THE ROTATION IS NOT DETERMINED by the drive that this comes from.")
    if not calibration.offset_observable:
        unsure.append("The time offset was not observable: it is the one that was assumed.")
    mark = "<!-- {} -->\n" if form == "urdf" else "# {}\n"
    return "".join(mark.format(line) for line in unsure) + text


def read_export(path: str | Path, form: str) -> StoredCalibration:
    """Read back what :func:`export` wrote; what was not known of the position is 0 then."""
    if form == "urdf":
        return _from_urdf(path)
    content = read_yaml(path)
    try:
        if form == "kalibr":
            camera = content["cam0"]
            T_cam_body = np.array(camera["T_cam_imu"], dtype=np.float64)
            stored = _stored(T_cam_body[:3, :3].T, camera["timeshift_cam_imu"], path)
            return replace(stored, position=tuple(-stored.R_body_cam @ T_cam_body[:3, 3]))
        turn = content["rotation_xyzw"]
        wxyz = [turn[3], *turn[:3]]
        stored = _stored(quaternion_to_matrix(wxyz), content["time_offset_s"], path)
        return replace(stored, position=_numbers(content["translation"], math.nan, path))
    except (KeyError, TypeError, IndexError, ValueError) as error:
        raise InputError(f"{path} is no {form} file of ours: {error!r}") from None


def _to_kalibr(calibration: StoredCalibration) -> str:
    T_cam_body = np.eye(4)
    T_cam_body[:3, :3] = calibration.R_body_cam.T
    T_cam_body[:3, 3] = -calibration.R_body_cam.T @ calibration.translation
    rows = "\n".join(f"  - [{', '.join(_number(x) for x in row)}]" for row in T_cam_body)
    return (
        "# T_cam_imu maps points from the body frame (in place of Kalibr's IMU) to the camera:\n"
        "#   p_cam = T_cam_imu p_body.  Of the camera's position in the body frame,\n"
        f"#   {calibration.about_position}.\n"
        "# timeshift_cam_imu: t_body = t_cam + shift [s].\n"
        f"cam0:\n  T_cam_imu:\n{rows}\n  timeshift_cam_imu: {_number(calibration.offset)}\n"
    )


def _to_ros_tf(calibration: StoredCalibration) -> str:
    w, x, y, z = matrix_to_quaternion(calibration.R_body_cam)
    numbers = ", ".join(_number(q) for q in (x, y, z, w))
    place = [_number(value) for value in calibration.translation]
    options = " ".join(f"--{name} {value}" for name, value in zip("xyz", place, strict=True))
    return (
        "# Transform of the camera's optical frame in the body frame: p_body = R p_cam.\n"
        f"# Of the translation, {calibration.about_position}.\n"
        "# As a command:\n"
        f"#   ros2 run tf2_ros static_transform_publisher {options}"
        f" --qx {_number(x)} --qy {_number(y)} --qz {_number(z)} --qw {_number(w)}"
        " --frame-id base_link --child-frame-id camera_optical_frame\n"
        "# time_offset_s: t_body = t_cam + offset; tf has no place for it.\n"
        "frame_id: base_link\nchild_frame_id: camera_optical_frame\n"
        f"translation: [{', '.join(place)}]\nrotation_xyzw: [{numbers}]\n"
        f"time_offset_s: {_number(calibration.offset)}\n"
    )


def _to_urdf(calibration: StoredCalibration) -> str:
    rpy = " ".join(_number(a) for a in matrix_to_rpy(calibration.R_body_cam))
    xyz = " ".join(map(_number, calibration.translation))
    return (
        "<!-- Pose of the camera's optical frame in the body frame: p_body = R p_cam, with\n"
        "     R = Rz(yaw) Ry(pitch) Rx(roll).  Of the translation,\n"
        f"     {calibration.about_position}.\n"
        f"     Time offset: t_body = t_cam + {_number(calibration.offset)} s. -->\n"
        '<joint name="camera_optical_joint" type="fixed">\n'
        '  <parent link="base_link"/>\n'
        '  <child link="camera_optical_frame"/>\n'
        f'  <origin xyz="{xyz}" rpy="{rpy}"/>\n'
        "</joint>\n"
    )


def _from_urdf(path: str | Path) -> StoredCalibration:

    text = read_text(path, LARGEST_YAML)
    found = re.search(r'rpy="([^"]+)"', text)
    offset = re.search(r"t_body = t_cam \+ (\S+) s", text)
    place = re.search(r'xyz="([^"]+)"', text)
    if found is None or offset is None or place is None:
        raise InputError(f"{path} is no urdf file of ours")
    angles = [float(x) for x in found.group(1).split()]
    stored = _stored(rpy_matrix(angles), offset.group(1), path)
    return replace(stored, position=_numbers(place.group(1).split(), math.nan, path))


def _number(value: float) -> str:
    """Return the shortest text that reads back as the same number, always with a point."""
    return repr(float(value))


def _stored(matrix: Any, offset: Any, path: str | Path) -> StoredCalibration:
    try:
        R = np.array(matrix, dtype=np.float64)
        shift = float("nan") if isinstance(offset, bool) else float(offset)
    except (TypeError, ValueError):
        raise InputError(f"{path}: rotation and offset must be numbers") from None
    square = R.shape == (3, 3) and bool(np.all(np.abs(R) <= 2))
    off = np.abs(R.T @ R - np.eye(3)).max() if square else np.inf
    if not (off < 1e-6 and np.linalg.det(R) > 0 and np.isfinite(shift)):
        raise InputError(f"{path}: R_body_cam must be a 3 x 3 rotation and the offset finite")
    return StoredCalibration(R, shift)


def _position_rows(calibration: Calibration) -> list[str]:
    if not isinstance(calibration, RefinedCalibration):
        return []
    return [f"Position   of the camera in the body frame: {position_text(calibration)}"]


def summary_text(calibration: Calibration) -> str:
    """Return a calibration for people to read."""
    sd = [math.degrees(math.sqrt(x)) for x in np.diag(calibration.rotation_covariance)]
    low, high = calibration.offset_interval
    used, mixture = len(calibration.residuals.t), calibration.diagnostics.mixture
    offset = f"Offset     {calibration.offset:+.4f} s"
    if calibration.offset_observable:
        offset += f"   sd {calibration.offset_sd:.4f} s, 95 % from {low:+.4f} to {high:+.4f} s"
    else:
        origin = "assumed" if calibration.settings.get("offset") is None else "as given"
        offset += f"   {origin}; not observable (plausible: {low:+.2f} to {high:+.2f} s)"
    rows = [
        "Rotation   R_body_cam, v_body = R_body_cam v_cam",
        *("           " + " ".join(f"{x:+9.5f}" for x in row) for row in calibration.R_body_cam),
        "           sd about body x, y, z: "
        + ", ".join(f"{min(x, 180.0):.2f}" for x in sd)
        + " deg;"
        f" error within {math.degrees(calibration.rotation_radius):.2f} deg (95 %)",
        *([f"           of this {parts} deg"] if (parts := calibration.radius_parts) else []),
        f"           the camera looks {camera_looks(calibration.R_body_cam)}"
        + ("" if calibration.rotation_observable else ", if the rotation were known"),
        offset,
        "           t_body = t_cam + offset",
        *_position_rows(calibration),
        f"Headings   {used} used, {100 * mixture.inliers:.0f} % inliers,"
        f" noise {math.degrees(mixture.sigma):.2f} deg per axis",
        "",
        f"Verdict    {calibration.verdict.summary}",
        *(f"  - {reason}" for reason in calibration.verdict.reasons),
    ]
    if calibration.verdict.advice:
        rows += ["What would tell", *(f"  - {advice}" for advice in calibration.verdict.advice)]
    return "\n".join(rows)
