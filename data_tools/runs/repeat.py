"""Finished runs of one rig, compared: what ``evcalib repeat`` does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.files.text import read_yaml
from data_tools.runs.export import calibration_of
from data_tools.runs.folder import CALIBRATION, MARKER
from evcalib.errors import InputError
from evcalib.pipeline import Repeats, RunAnswer, compare_runs


@dataclass(frozen=True, eq=False)
class _StoredRun:
    answer: RunAnswer
    recording: dict[str, Any]
    rig: dict[str, str]

    @property
    def span(self) -> tuple[float, float]:
        """When it began and ended [s], on the clock of its recording."""
        start, end = self.recording.get("span_s", (0.0, 0.0))
        origin = 1e-6 * self.recording["origin_us"]
        return origin + start, origin + end


def repeat_runs(runs: Sequence[str | Path]) -> Repeats:
    """Read finished runs and compare their answers.

    Parameters
    ----------
    runs : sequence of path
        Folders of `evcalib calibrate`, or their calibration.yaml.

    Returns
    -------
    Repeats
        Whether they agree, and their pooled answer.

    Raises
    ------
    InputError
        If a run is not finished or cannot be compared, if runs are of different rigs, or if two are
        of the same stretch of one recording.
    """
    paths = [Path(run) for run in runs]
    names = [path.parent.name if path.name == CALIBRATION else path.name for path in paths]
    if len(set(names)) < len(names):
        names = [str(path) for path in paths]
    stored = [_read(path, name) for path, name in zip(paths, names, strict=True)]
    for one, other in combinations(stored, 2):
        _same_rig(one, other)
        _apart(one, other)
    return compare_runs([run.answer for run in stored])


def _read(path: Path, name: str) -> _StoredRun:
    if path.is_dir():
        if (path / MARKER).exists():
            raise InputError(f"{path} is not finished: see {path / MARKER}")
        path = path / CALIBRATION
    content: Any = read_yaml(path)
    known = calibration_of(content, path)
    try:
        shared, recording = content["shared"], content["recording"]
        covariance = np.array(content["rotation_covariance_deg2"], dtype=np.float64).reshape(3, 3)
        start = 1e-6 * int(recording["origin_us"])
        answer = RunAnswer.split(
            name,
            known.R_body_cam,
            np.radians(np.radians(covariance)),
            known.offset,
            float(content["offset_sd_s"]),
            samples=float(content["independent_stretches"]),
            rotation_determined=known.rotation_observable,
            offset_determined=known.offset_observable,
            shared_rotation_sd=math.radians(shared["rotation_sd_deg"]),
            shared_offset_sd=float(shared["offset_sd_s"]),
            # Times that do not count from a common epoch do not order the runs.
            start=start or None,
        )
        rig = dict(content["rig"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path} lacks what a comparison needs ({error}): it is of `evcalib align`, or of an"
            " earlier version; run `evcalib calibrate` again"
        ) from None
    return _StoredRun(answer, recording, rig)


def _same_rig(one: _StoredRun, other: _StoredRun) -> None:
    for part in ("camera", "vehicle"):
        a, b = one.rig.get(part, ""), other.rig.get(part, "")
        if a != b:
            raise InputError(
                f"{one.answer.name} and {other.answer.name} are of different rigs: their {part}"
                f" files differ ({a or 'none'}; {b or 'none'})"
            )


def _apart(one: _StoredRun, other: _StoredRun) -> None:
    """Refuse two runs of the same stretch: they agree whatever their error bars say."""
    same = one.recording["file"] == other.recording["file"]
    timed = one.answer.start is not None and other.answer.start is not None
    (a, b), (c, d) = one.span, other.span
    if (same or timed) and a < d and c < b:
        raise InputError(
            f"{one.answer.name} and {other.answer.name} overlap in time: runs must be independent"
            " of one another; leave one out"
        )


def repeats_text(repeats: Repeats) -> str:
    """Return what several runs say together, for people to read."""
    rows = [f"Runs       {len(repeats.runs)}: " + ", ".join(run.name for run in repeats.runs)]
    if "offset" in repeats.unknowns:
        rows.append(f"Offset     {repeats.offset:+.5f} s   sd {repeats.offset_sd:.5f} s, pooled")
    if repeats.R_body_cam is not None:
        rows.append("Rotation   R_body_cam, pooled")
        rows += ["           " + " ".join(f"{x:+9.5f}" for x in row) for row in repeats.R_body_cam]
        rows.append(
            f"           error within {math.degrees(repeats.rotation_radius):.2f} deg (95 %)"
        )
    summary = "contradict each other" if repeats.contradict else "agree"
    rows += ["", f"Verdict    The runs {summary}.", *(f"  - {line}" for line in repeats.lines())]
    return "\n".join(rows)


def repeats_dict(repeats: Repeats) -> dict[str, Any]:
    """Return the same, of plain Python values."""
    R, sd = repeats.R_body_cam, repeats.rotation_sd
    known = "offset" in repeats.unknowns
    return {
        "runs": [run.name for run in repeats.runs],
        "contradict": repeats.contradict,
        "offset_s": repeats.offset if known else None,
        "offset_sd_s": repeats.offset_sd if known else None,
        "R_body_cam": None if R is None else R.tolist(),
        "rotation_sd_xyz_deg": None if sd is None else np.degrees(sd).tolist(),
        "rotation_radius_deg": math.degrees(repeats.rotation_radius) if R is not None else None,
        "unknowns": {
            name: {
                "runs": list(one.runs),
                "p_value": one.agreement.p_value,
                "contradict": one.contradict,
                "odd": one.odd,
                "p_against_the_others": one.agreement.without.tolist(),
                "trend_p_value": one.trend_p,
            }
            for name, one in repeats.unknowns.items()
        },
        "said": repeats.lines(),
    }
