"""The named studies: what each runs, against the library called by hand; their tables and plots."""

import json

import numpy as np
import pytest
from matplotlib.colors import to_hex

from data_tools.simulation import random_drives
from data_tools.simulation.streams import Noise
from data_tools.studies import (
    STUDIES,
    Cell,
    Study,
    ablations,
    coverage,
    describe,
    measure_cost,
    paper,
    real,
    run_study,
    study,
    write_summary,
)
from evcalib.alignment import align
from evcalib.baselines import METHODS
from evcalib.errors import InputError
from evcalib.geometry import rotation_angle
from evcalib.plots.studies import COLOURS, cost_figure, study_figure
from evcalib.series import VelocitySeries


def seeded(k=0):
    return np.random.SeedSequence(1, spawn_key=(0, k))


@pytest.mark.parametrize("name", [name for name in STUDIES if name != "real"])
def test_every_study_can_be_named_and_written_down(name):
    made = study(name)
    groups = [cell.group for cell in made.cells]
    assert made.name == name
    assert len(set(groups)) == len(groups)
    assert json.loads(made.cells_json()) == [[c.group, c.parameters] for c in made.cells]


def test_the_papers_study_has_six_arcs_and_six_polylines_and_all_methods():
    cells = study("paper").cells
    assert [c.parameters["motion"] for c in cells] == 6 * ["arc"] + 6 * ["polyline"]
    assert all(c.parameters["methods"] == list(METHODS) for c in cells)
    assert {c.parameters["motion"] for c in study("drives").cells} == {
        "zigzag",
        "s-curve",
        "fingers",
    }
    with pytest.raises(InputError, match="study must be one of paper"):
        study("newspaper")


def test_a_trial_of_the_paper_is_each_method_called_on_the_same_streams():
    parameters = study("drives", motions=["s-curve"]).cells[2].parameters
    rows = {row["method"]: row for row in paper.trial(parameters, seeded())}
    assert list(rows) == list(METHODS)
    made = random_drives.streams(parameters, np.random.default_rng(seeded()))
    assert abs(made.offset) <= 0.5
    ours = align(made.headings, made.velocities)
    assert rows["ours"]["offset_error_s"] == ours.offset - made.offset
    error = np.degrees(rotation_angle(ours.R_body_cam, made.R_body_cam))
    assert rows["ours"]["rotation_deg"] == error
    assert rows["ours"]["offset_observable"]
    unaligned = ["vc_wota", "hand_eye"]
    if "pip install" not in rows["cgoc"].get("failure", ""):
        unaligned.append("cgoc")
    for name in unaligned:
        assert rows[name]["offset_error_s"] == pytest.approx(-made.offset)


def test_a_method_that_gives_up_leaves_its_reason_and_the_others_their_rows():
    noise = {"sigma": 0.1, "dropout": 0.995}
    cell = study("drives", motions=["s-curve"], heading_noise=noise).cells[0]
    rows = paper.trial(cell.parameters, seeded())
    assert [row["method"] for row in rows] == list(METHODS)
    assert all("row" in row["failure"] for row in rows if row["method"] in ("ours", "vc"))
    assert all(row["failure"] for row in rows)


def test_alignment_in_time_pays_on_polylines_and_is_flagged_as_impossible_on_arcs(tmp_path):
    few = study("paper", methods=["ours", "vc", "vc_wota"])
    groups = {"arc 4 m", "polyline 90 deg"}
    few = Study("few", tuple(c for c in few.cells if c.group in groups), few.trial)
    found = run_study(few, trials=7, seed=1, folder=tmp_path)

    def median(group, method):
        return np.median(found.values("rotation_deg", group=group, method=method))

    assert median("polyline 90 deg", "vc") < 0.5 * median("polyline 90 deg", "vc_wota")
    assert median("polyline 90 deg", "ours") < 0.5 * median("polyline 90 deg", "vc_wota")
    assert found.values("offset_observable", group="polyline 90 deg", method="ours").all()
    assert not found.values("offset_observable", group="arc 4 m", method="ours").any()
    assert median("arc 4 m", "ours") == pytest.approx(median("arc 4 m", "vc_wota"), rel=0.1)


def test_real_trials_give_the_same_file_in_two_processes(tmp_path):
    few = study("paper", methods=["ours", "vc", "hand_eye"])
    few = Study("few", few.cells[8:9], few.trial)
    one, two = (
        run_study(few, trials=3, seed=1, folder=tmp_path / str(workers), workers=workers)
        for workers in (1, 2)
    )
    assert one.path.read_bytes() == two.path.read_bytes()
    assert not one.failures


@pytest.mark.parametrize(
    ("parameters", "kind"),
    [
        ({"motion": "straight"}, "straight"),
        ({"motion": "arc", "radius_m": 4.0}, "arc"),
        ({"motion": "polyline", "turn_deg": 30.0}, "polyline"),
        ({"motion": "zigzag"}, "zigzag"),
        ({"motion": "s-curve", "swing_deg": 20.0}, "s-curve"),
        ({"motion": "fingers", "count": 2}, "fingers"),
    ],
)
def test_drives_come_from_plain_parameters(parameters, kind):
    assert random_drives.drive(parameters, np.random.default_rng(0)).kind == kind


def test_drives_turn_as_they_are_told():
    def angles(parameters, t):
        drive = random_drives.drive(parameters, np.random.default_rng(3))
        angle = drive.angle(np.array(t, dtype=float))
        return np.degrees(np.unwrap(angle))

    rate = np.diff(angles({"motion": "arc", "radius_m": 4.0}, [0, 1]))[0]
    assert abs(rate) == pytest.approx(np.degrees(1 / 4))
    assert np.ptp(angles({"motion": "polyline", "turn_deg": 30.0}, [1, 4])) == pytest.approx(30)
    swing = angles({"motion": "s-curve", "swing_deg": 20.0}, np.linspace(0, 8, 4000))
    assert np.ptp(swing) == pytest.approx(40, abs=1e-3)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"motion": "walk"}, "motion must be one of straight"),
        ({}, "motion must be one of straight"),
        ({"motion": "arc"}, "an arc needs radius_m"),
        ({"motion": "arc", "radius_m": [1.0, 2.0, 3.0]}, "an arc needs radius_m"),
        ({"motion": "arc", "radius_m": -1.0}, "an arc needs radius_m"),
        ({"motion": "arc", "radius_m": "far"}, "radius_m must be numbers"),
        ({"motion": "zigzag", "side_s": "long"}, "side_s must be numbers"),
        ({"motion": "s-curve", "swing_deg": np.nan}, "swing_deg holds"),
        ({"motion": "fingers", "count": 0}, "count must be a whole number"),
        ({"motion": "fingers", "count": 2.5}, "count must be a whole number"),
    ],
)
def test_a_wrong_parameter_of_a_drive_is_named(parameters, words):
    with pytest.raises(InputError, match=words):
        random_drives.drive(parameters, np.random.default_rng(0))


@pytest.mark.parametrize("noise", [None, {"sigm": 0.1}, 0.1])
def test_streams_without_usable_noise_are_refused(noise):
    parameters = {"motion": "straight", "heading_noise": {}, "velocity_noise": noise}
    with pytest.raises(InputError, match="velocity_noise must be a dictionary of sigma, rho"):
        random_drives.streams(parameters, np.random.default_rng(0))
    del parameters["velocity_noise"]
    with pytest.raises(InputError, match="velocity_noise must be a dictionary of sigma, rho"):
        random_drives.streams(parameters, np.random.default_rng(0))


def test_noise_is_written_down_as_what_differs_from_none():
    assert random_drives.noise(0.1) == {"sigma": 0.1}
    assert Noise(**random_drives.noise(0.1, rho=0.8)) == Noise(0.1, rho=0.8)


def test_the_default_of_the_ablations_is_the_default_of_align():
    parameters = study("ablations").cells[0].parameters
    made = random_drives.streams(parameters, np.random.default_rng(seeded(1)))
    found = align(made.headings, made.velocities)
    offset, R = ablations.estimate(made.headings, made.velocities, ablations.Choices())
    assert found.offset_observable
    assert offset == found.offset
    np.testing.assert_array_equal(R, found.R_body_cam)


def test_ablations_have_a_row_per_variant():
    rows = ablations.trial(study("ablations").cells[0].parameters, seeded())
    names = [(row["ablation"], row["variant"]) for row in rows]
    assert names == [(a, v) for a, variants in ablations.VARIANTS.items() for v in variants]
    assert all(np.isfinite(row["rotation_deg"]) for row in rows)
    by_name = {row["variant"]: row["offset_error_s"] for row in rows}
    assert by_name["held"] - by_name["default"] == pytest.approx(0.01, abs=0.004)


def test_each_interpolation_goes_through_the_samples_and_slerp_along_circles():
    t = np.linspace(0.0, 5.0, 26)
    v = np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=1)
    at = np.linspace(0.5, 4.5, 301)
    exact = np.stack([np.cos(at), np.sin(at), np.zeros_like(at)], axis=1)
    for curve in ablations._CURVES.values():
        np.testing.assert_allclose(curve(t, v, t[:-1]), v[:-1], atol=1e-12)
    np.testing.assert_allclose(ablations._slerp(t, v, at), exact, atol=1e-12)
    choices = ablations.Choices(interpolation="cubic", smooth=False)
    track = ablations.track_of(VelocitySeries(t, v), choices)
    np.testing.assert_allclose(track.directions(at, at), exact, atol=1e-4)


def test_a_trial_of_the_coverage_study_is_one_alignment():
    cell = next(c for c in study("coverage").cells if c.group == "white 0.1")
    (row,) = coverage.trial(cell.parameters, seeded())
    made = random_drives.streams(cell.parameters, np.random.default_rng(seeded()))
    found = align(made.headings, made.velocities)
    low, high = found.offset_interval
    assert row["offset_error_s"] == found.offset - made.offset
    assert row["offset_inside"] == (low <= made.offset <= high)
    assert row["bound_s"] == pytest.approx(found.offset_sd, rel=0.5)


def test_the_papers_real_sets_stand_beside_what_was_printed(data, tmp_path):
    found = run_study("real", trials=1, seed=1, folder=tmp_path, data=data / "evcalib")
    assert found.groups == ("3 fingers", "5 fingers")
    for group, plain, aligned in (("3 fingers", 2.03, 1.86), ("5 fingers", 1.82, 1.68)):
        for method, degrees in (("VC-woTA", plain), ("VC", aligned)):
            value = found.values("rotation_deg", group=group, method=f"{method}, released script")
            assert value == pytest.approx(degrees, abs=0.01)
        (ours,) = found.values("verdict", group=group, method="ours")
        assert "offset is not observable" in ours
    assert found.labels("method")[:2] == tuple(real.PRINTED)
    assert str(data).encode() not in found.path.read_bytes()


def test_without_any_real_set_nothing_is_run(tmp_path):
    with pytest.raises(InputError, match="holds none of calib_data_time_2traj"):
        study("real", data=tmp_path)


def draw(parameters, seed):
    rng = np.random.default_rng(seed)
    return [
        {"method": name, "rotation_deg": rng.gamma(2.0), "offset_error_s": rng.normal()}
        for name in ("ours", "vc", "another")
    ] + [{"method": "lazy", "failure": "too tired"}]


@pytest.fixture
def drawn(tmp_path):
    small = Study("small", (Cell("a", {}), Cell("b", {})), draw)
    return run_study(small, trials=9, seed=2, folder=tmp_path)


def test_boxes_are_the_quartiles_of_each_group_and_method(drawn):
    figure = study_figure(drawn.table)
    for ax, column, scale in zip(
        figure.axes, ("rotation_deg", "|offset_error_s|"), (1, 1e3), strict=True
    ):
        medians = [line for line in ax.lines if line.get_color() == "#000000"]
        found = sorted((line.get_xdata().mean(), line.get_ydata()[0]) for line in medians)
        expected = [
            scale * np.median(drawn.values(column, group=group, method=method))
            for group in "ab"
            for method in ("ours", "vc", "another")
        ]
        np.testing.assert_allclose([y for _, y in found], expected)
    boxes = [to_hex(p.get_facecolor()) for p in figure.axes[0].patches]
    assert boxes.count(COLOURS["ours"].lower()) == 2
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert legend == ["ours", "vc", "another"]
    assert figure.axes[0].get_ylabel() == "rotation error [deg]"


def test_figures_say_what_they_miss(drawn):
    with pytest.raises(InputError, match="lacks the column"):
        study_figure({"group": np.array(["a"])})
    with pytest.raises(InputError, match="nothing to draw"):
        study_figure(drawn.table, groups=["c"])
    with pytest.raises(InputError, match="scale must be one of"):
        study_figure(drawn.table, scale="square")
    with pytest.raises(InputError, match="same length"):
        cost_figure([1, 2], [1], [1.0, 2.0])


def test_a_summary_is_written_beside_the_table(drawn, tmp_path):
    paths = write_summary(drawn, tmp_path / "out")
    assert [path.name for path in paths] == ["small.csv", "small.txt", "small.png"]
    again = write_summary(drawn, tmp_path / "again")
    assert [p.read_bytes() for p in paths] == [p.read_bytes() for p in again]
    text = paths[1].read_text()
    assert text == describe(drawn) + "\n"
    assert "18 x too tired" in text
    lazy = next(line for line in text.splitlines() if "lazy" in line)
    assert lazy.split()[:4] == ["a", "lazy", "9", "9"]


def test_the_cost_of_a_study_is_measured_and_drawn():
    small = Study("small", (Cell("a", {}), Cell("b", {})), draw)
    costs = measure_cost(small, trials=[1, 3], workers=[1])
    assert [(c.trials, c.workers) for c in costs] == [(2, 1), (6, 1)]
    assert all(c.seconds > 0 for c in costs)
    figure = cost_figure([2, 6, 2, 6], [1, 1, 2, 2], [1.0, 3.0, 0.5, 1.0])
    left, right = figure.axes
    assert [line.get_ydata().tolist() for line in left.lines] == [[1.0, 3.0], [0.5, 1.0]]
    assert right.lines[0].get_ydata().tolist() == [2.0, 6.0]
    assert right.lines[1].get_ydata().tolist() == [2.0, 4.0]
