"""The measure of lags against lags put in by hand, and the chain's own lag against the truth."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from data_tools.files.csv_table import read_columns
from data_tools.simulation.trajectory import Trajectory
from data_tools.studies import lag
from data_tools.studies.lag import CAMERA, Drive, correspondence_lag, heading_lag, summary
from evcalib.errors import InputError
from evcalib.geometry import unit
from evcalib.heading import Correspondences, estimate_headings
from evcalib.series import HeadingSeries

SHORT = Drive(60, "tilted", duration=7.0)


@pytest.fixture(scope="module")
def simulator():
    return SHORT.simulator()


def lagging(simulator, px, n=4000):
    """Points that look as if they were where they were px / flow ago."""
    rng = np.random.default_rng(0)
    t1 = rng.uniform(0.5, 5.5, n)
    t2 = t1 + rng.uniform(0.15, 0.6, n)
    xy = rng.uniform((0, 0), (239, 179), (n, 2))
    depth = rng.uniform(1.5, 6.0, n)
    points = CAMERA.bearings(xy) * depth[:, None]
    start = simulator.truth(t1)
    R = start.R_world_cam[0]

    def seen(t):
        moved = (simulator.truth(t).position - start.position) @ R
        return unit(points - moved)

    flow = CAMERA.fx * np.linalg.norm(np.cross(seen(t1), seen(t2)), axis=1) / (t2 - t1)
    late = np.minimum(px / np.maximum(flow, 1e-9), 0.2)
    rows = np.arange(n)
    r1, r2 = seen(t1 - late), seen(t2 - late)
    return Correspondences(r1, r2, t1, t2, rows >= 0, rows, rows)


@pytest.mark.parametrize("px", [0.0, 0.3, -0.5])
def test_a_lag_put_in_is_found(simulator, px):
    lag = correspondence_lag(lagging(simulator, px), simulator)
    assert lag.px == pytest.approx(px, abs=0.02 + 0.03 * abs(px))
    slow = correspondence_lag(lagging(simulator, px), simulator, flows=(10.0, 25.0))
    assert slow.px == pytest.approx(px, abs=0.03 + 0.05 * abs(px))
    assert 10.0 < slow.flow < 25.0


def test_late_stamps_are_found(simulator):
    t = np.arange(0.5, 6.0, 0.05)
    v = unit(simulator.truth(t).v_cam)
    assert heading_lag(HeadingSeries(t + 0.012, v), simulator) == pytest.approx(0.012, abs=2e-4)


def test_a_straight_drive_tells_no_lag(simulator):
    straight = lagging(simulator, 0.0)
    path = Trajectory([0.0, 7.0], [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    still = replace(simulator, trajectory=path)
    with pytest.raises(InputError, match="direction of motion changes"):
        correspondence_lag(straight, still)


def test_the_chain_hardly_lags(simulator):
    """Bounds far wider than what notebook 6 measures, on a short drive of one scene."""
    seed = np.random.SeedSequence(0, spawn_key=(0, 0))
    rows = {row["localisation"]: row for row in lag.trial(asdict(SHORT), seed)}
    assert tuple(rows) == lag.LOCALISATIONS
    assert abs(rows["symmetric"]["lag_px"]) < 0.1
    assert abs(rows["symmetric"]["heading_ms"]) < 5
    assert rows["symmetric"]["scatter_px"] < 0.2
    assert rows["corners"]["scatter_px"] > 2 * rows["symmetric"]["scatter_px"]
    assert rows["symmetric"]["median_deg"] < rows["corners"]["median_deg"]
    without = estimate_headings(simulator.run().events.between(0, 1_000_000), CAMERA)
    with pytest.raises(InputError, match="keep_correspondences"):
        summary(without, simulator, "symmetric")


def test_trial_0_has_the_scenes_of_the_stored_table_and_others_have_new_ones(monkeypatch):
    stored = read_columns(Path(__file__).parents[1] / "notebooks" / "data" / "lag.csv")
    cells = lag.study().cells
    for name in asdict(SHORT):
        told = [cell.parameters[name] for cell in cells for _ in lag.LOCALISATIONS]
        assert stored[name].tolist() == told

    def tell_seed(drive):
        raise InputError(f"seed {drive.seed}")

    monkeypatch.setattr(Drive, "simulator", tell_seed)
    for trial, seed in ((0, 60), (2, 2060)):
        with pytest.raises(InputError, match=f"seed {seed}$"):
            lag.trial(asdict(SHORT), np.random.SeedSequence(9, spawn_key=(4, trial)))
