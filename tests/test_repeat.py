"""Several runs of one rig: the test of their agreement, the page, and the command."""

import json

import numpy as np
import pytest
import yaml
from scipy import stats

from data_tools.runs.repeat import repeat_runs
from evcalib.errors import InputError
from evcalib.geometry import random_rotation, rotation_angle, rotation_vector_to_matrix
from evcalib.pipeline import RunAnswer, compare_runs
from evcalib.plots.repeats import repeats_figure
from evcalib.report import repeats_html
from evcalib.uncertainty import agreement

SAMPLES, SD = 6.4, 0.0015
COVARIANCE = np.radians(0.15) ** 2 * np.diag([1.0, 2.0, 0.5])


def made(rng, R, name, *, shift=0.0, turn=(0.0, 0.0, 0.0), **more):
    """Return a run whose error bars are estimated from as many samples as it claims."""
    dof = 2 * SAMPLES - 4
    draws = rng.multivariate_normal(np.zeros(3), COVARIANCE, round(dof))
    vector = rng.multivariate_normal(np.zeros(3), COVARIANCE) + np.array(turn)
    return RunAnswer(
        name,
        rotation_vector_to_matrix(vector) @ R,
        draws.T @ draws / len(draws),
        0.1 + shift + SD * rng.standard_normal(),
        SD * np.sqrt(rng.chisquare(dof) / dof),
        SAMPLES,
        **more,
    )


def group(rng, R, off=(), **change):
    return [made(rng, R, f"run {k}", **(change if k in off else {})) for k in range(5)]


def test_one_number_known_exactly_is_the_chi_square_test():
    rng = np.random.default_rng(0)
    x, var = rng.standard_normal((6, 1)), rng.uniform(0.5, 2.0, 6)
    found = agreement(x, var[:, None, None], np.full(6, np.inf))
    mean = np.average(x[:, 0], weights=1 / var)
    assert found.pooled[0] == pytest.approx(mean)
    assert found.covariance[0, 0] == pytest.approx(1 / np.sum(1 / var))
    square = np.sum((x[:, 0] - mean) ** 2 / var)
    assert found.p_value == pytest.approx(stats.chi2.sf(square, 5), rel=1e-6)


def test_two_samples_give_welch_test():
    rng = np.random.default_rng(1)
    a, b = rng.normal(0, 1, 7), rng.normal(1, 3, 12)
    means = np.array([[a.mean()], [b.mean()]])
    variances = np.array([a.var(ddof=1) / a.size, b.var(ddof=1) / b.size])
    found = agreement(means, variances[:, None, None], np.array([6.0, 11.0]))
    # His statistic and degrees of freedom, written out.
    square = (a.mean() - b.mean()) ** 2 / variances.sum()
    dof = variances.sum() ** 2 / (variances[0] ** 2 / 6 + variances[1] ** 2 / 11)
    assert found.p_value == pytest.approx(stats.f.sf(square, 1, dof), rel=1e-6)


def test_false_alarms_are_as_rare_as_stated_and_the_pooled_answer_is_covered():
    rng = np.random.default_rng(2)
    R = random_rotation(rng)
    found = [compare_runs(group(rng, R)) for _ in range(300)]
    # Within 3.3 standard errors of a share of 300.
    assert 0.01 <= np.mean([one.contradict for one in found]) <= 0.095
    covered = [abs(one.offset - 0.1) < 2.02 * one.offset_sd for one in found]
    assert 0.89 <= np.mean(covered) <= 0.98
    inside = [rotation_angle(one.R_body_cam, R) < one.rotation_radius for one in found]
    assert 0.89 <= np.mean(inside) <= 0.99


def test_a_run_that_is_off_is_found_and_named():
    rng = np.random.default_rng(3)
    R = random_rotation(rng)
    for change, unknown in (({"shift": 0.02}, "offset"), ({"turn": (0, 0.06, 0)}, "rotation")):
        found = [compare_runs(group(rng, R, (2,), **change)).unknowns[unknown] for _ in range(20)]
        assert np.mean([one.contradict for one in found]) >= 0.9
        assert np.mean([one.odd == "run 2" for one in found]) >= 0.8


def test_two_that_contradict_blame_neither():
    rng = np.random.default_rng(4)
    R = random_rotation(rng)
    found = compare_runs([made(rng, R, "a"), made(rng, R, "b", shift=0.05)])
    assert found.unknowns["offset"].contradict
    assert found.unknowns["offset"].odd is None
    assert "not because of one" in " ".join(found.lines())


def test_a_drift_is_told_per_hour():
    rng = np.random.default_rng(5)
    R = random_rotation(rng)
    runs = [made(rng, R, f"{k}", shift=0.01 * k, start=1e9 + 1800.0 * k) for k in range(6)]
    one = compare_runs(runs).unknowns["offset"]
    assert one.trend == pytest.approx(0.02, rel=0.2)
    assert one.trend_p < 1e-3
    assert "ms per hour" in " ".join(compare_runs(runs).lines())


def test_a_run_keeps_a_part_of_its_error_bars_whatever_all_share():
    shared = {"shared_rotation_sd": np.radians(0.06), "shared_offset_sd": 0.0015}
    small = np.diag(np.radians([0.05, 0.1, 0.2]) ** 2)
    one = RunAnswer.split("small", np.eye(3), small, 0.1, 0.001, samples=5.0, **shared)
    own = np.degrees(np.sqrt(np.diag(one.rotation_covariance)))
    assert own == pytest.approx([0.05 * np.sqrt(0.1), 0.08, np.sqrt(0.2**2 - 0.06**2)])
    assert one.offset_sd == pytest.approx(0.001 * np.sqrt(0.1))
    wide = RunAnswer.split("wide", np.eye(3), small, 0.1, 0.0025, samples=5.0, **shared)
    assert wide.offset_sd == pytest.approx(0.002)


def test_what_a_run_does_not_determine_is_left_out_and_told():
    rng = np.random.default_rng(6)
    R = random_rotation(rng)
    runs = [*group(rng, R)[:3], made(rng, R, "arc", shift=0.4, offset_determined=False)]
    found = compare_runs(runs)
    assert found.unknowns["offset"].runs == ("run 0", "run 1", "run 2")
    assert any("arc" in line for line in found.lines())
    nothing = {"offset_determined": False, "rotation_determined": False}
    with pytest.raises(InputError, match="no two of the runs"):
        compare_runs([made(rng, R, name, **nothing) for name in "ab"])
    with pytest.raises(InputError, match="two runs or more"):
        compare_runs(runs[:1])


def stored(folder, one, **more):
    """Write the calibration.yaml of a run as `evcalib calibrate` does, of what is compared."""
    folder.mkdir()
    content = {
        "R_body_cam": one.R_body_cam.tolist(),
        "offset_s": one.offset,
        "offset_sd_s": float(one.offset_sd),
        "offset_observable": True,
        "rotation_observable": True,
        "rotation_covariance_deg2": np.degrees(np.degrees(one.rotation_covariance)).tolist(),
        "independent_stretches": one.samples,
        "shared": {"rotation_sd_deg": 0.0, "offset_sd_s": 0.0},
        "recording": {"file": folder.name, "span_s": [0.0, 16.0], "origin_us": 0},
        "rig": {"camera": "A", "vehicle": "B"},
        **more,
    }
    (folder / "calibration.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_folders_are_read_and_compared(tmp_path):
    rng = np.random.default_rng(7)
    runs = group(rng, random_rotation(rng))
    folders = [stored(tmp_path / f"{k}", one) for k, one in enumerate(runs)]
    found, direct = repeat_runs(folders), compare_runs(runs)
    assert found.offset == pytest.approx(direct.offset)
    p_values = [one.unknowns["rotation"].agreement.p_value for one in (found, direct)]
    assert p_values[0] == pytest.approx(p_values[1])
    assert "agree" in repeats_html(found)
    assert len(repeats_figure(found).axes) == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rig": {"camera": "C", "vehicle": "B"}}, "different rigs: their camera"),
        ({"recording": {"file": "0", "span_s": [8.0, 20.0], "origin_us": 0}}, "overlap in time"),
        ({"shared": None}, "lacks what a comparison needs"),
        ({"offset_sd_s": float("nan")}, "offset_sd of 1 must be"),
        ({"rotation_covariance_deg2": np.zeros((3, 3)).tolist()}, "must be positive"),
        ({"R_body_cam": [[2.0, 0, 0], [0, 1, 0], [0, 0, 1]]}, "must be a 3 x 3 rotation"),
    ],
)
def test_runs_that_cannot_be_compared_are_refused(tmp_path, change, message):
    rng = np.random.default_rng(8)
    R = random_rotation(rng)
    folders = [
        stored(tmp_path / "0", made(rng, R, "0")),
        stored(tmp_path / "1", made(rng, R, "1"), **change),
    ]
    with pytest.raises(InputError, match=message):
        repeat_runs(folders)
    (tmp_path / "0" / "INCOMPLETE").touch()
    with pytest.raises(InputError, match="is not finished"):
        repeat_runs(folders)


def test_the_command_exits_with_4_on_a_contradiction(tmp_path, run):
    rng = np.random.default_rng(9)
    R = random_rotation(rng)
    runs = group(rng, R, (2,), shift=0.05)
    folders = [str(stored(tmp_path / f"{k}", one)) for k, one in enumerate(runs)]
    code, out, _ = run("repeat", *folders, "-o", str(tmp_path / "page.html"), "--json")
    told = json.loads(out)
    assert code == 4
    assert told["contradict"]
    assert told["unknowns"]["offset"]["odd"] == "2"
    assert (tmp_path / "page.html").read_text().startswith("<!DOCTYPE html>")
    kept = [f for k, f in enumerate(folders) if k != 2]
    assert run("repeat", *kept)[0] == 0
