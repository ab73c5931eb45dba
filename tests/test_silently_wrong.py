"""Data that cannot answer, or answer another question: nothing confident may come out."""

import numpy as np
import pytest

from data_tools import cli
from data_tools.runs import export
from data_tools.simulation.drives import Drive, arc, s_curve, zigzag
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment import align
from evcalib.errors import InputError
from evcalib.geometry import rotation_angle
from evcalib.series import HeadingSeries

ODOMETRY = Noise(0.02)


def drive(seed, shape=None, **options):
    options = {"heading_noise": Noise(0.05), "velocity_noise": ODOMETRY, "offset": 0.1, **options}
    shape = shape or s_curve(period=6.0)
    return simulate(shape, np.random.default_rng(seed), **options)


@pytest.mark.parametrize("count", [8, 15, 200])
def test_random_headings_determine_nothing(count):
    for seed in range(5):
        streams, rng = drive(seed), np.random.default_rng(seed)
        v = rng.standard_normal((count, 3))
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        found = align(HeadingSeries(np.sort(rng.uniform(0, 20, count)), v), streams.velocities)
        assert not found.rotation_observable
        assert not found.offset_observable
        assert "no better than chance" in str(found.verdict)


def test_headings_of_another_drive_determine_nothing():
    other = drive(1, s_curve(period=4.3, amplitude=0.6), heading_rate=5)
    found = align(other.headings, drive(0).velocities)
    assert not found.rotation_observable


def test_weight_on_two_headings_is_no_evidence():
    streams = drive(0)
    weight = np.full(len(streams.headings), 1e-9)
    weight[[100, 400]] = 1.0
    headings = HeadingSeries(streams.headings.t, streams.headings.v, weight=weight)
    assert not align(headings, streams.velocities).rotation_observable


@pytest.mark.parametrize("offset", [1.1, 1.5])
def test_an_offset_outside_the_search_is_not_taken_for_zero(offset):
    def angle(t):
        return 0.4 * (np.sin(0.7 * t) + np.sin(1.13 * t + 1) + np.sin(0.37 * t + 2))

    wander = Drive("wander", 20.0, angle, np.ones_like)
    streams = drive(2, wander, offset=offset)
    assert not align(streams.headings, streams.velocities).rotation_observable
    assert align(streams.headings, streams.velocities, max_offset=2.0).offset_observable


def test_standing_most_of_the_time_spoils_nothing():
    shape = s_curve(period=6.0)
    stop = Drive("stop and go", 20.0, shape.angle, lambda t: (np.mod(t, 5) < 2).astype(float))
    streams = drive(3, stop)
    found = align(streams.headings, streams.velocities)
    assert found.rotation_observable
    assert abs(found.offset - 0.1) < 4 * found.offset_sd
    assert found.offset_sd < 0.03


@pytest.mark.parametrize("rate", [5, 10, 20])
def test_slow_odometry_shows_the_turns_all_the_same(rate):
    streams = drive(4, velocity_rate=rate)
    found = align(streams.headings, streams.velocities)
    assert found.offset_observable
    assert rotation_angle(found.R_body_cam, streams.R_body_cam) < np.radians(2)


def test_turns_in_step_with_the_clocks_leave_an_error_of_their_steps():
    """Steps of 20 and 33 ms, uniform: no standard deviation below 11 ms, however long the drive."""
    streams = drive(5, zigzag(60.0, side=3.0))
    found = align(streams.headings, streams.velocities)
    assert found.offset_sd >= np.hypot(1 / 30, 1 / 50) / np.sqrt(12) - 1e-9


def test_a_heading_must_lie_within_its_own_interval():
    t = np.array([0.0, 1.0])
    with pytest.raises(InputError, match=r"row 0: t .* not within t_start and t_end"):
        HeadingSeries(t, np.eye(3)[:2], t_start=t + 0.5, t_end=t + 0.6)


def test_a_turning_body_is_remarked():
    shape = s_curve(period=6.0)
    turning = Drive("turning", 20.0, shape.angle, shape.speed, lambda t: 0.3 * np.sin(t))
    streams = drive(6, turning)
    assert "The body turns" in str(align(streams.headings, streams.velocities).verdict)


def test_an_undetermined_rotation_is_exported_only_by_force(tmp_path, monkeypatch, capsys):
    streams = drive(7, arc())
    export.write_calibration(tmp_path / "c.yaml", align(streams.headings, streams.velocities))
    words = ["evcalib", "export", str(tmp_path / "c.yaml"), "--to", "kalibr"]
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as stop:
        cli.main()
    out, err = capsys.readouterr()
    assert stop.value.code == cli.NO_ANSWER
    assert (out, err.count("\n")) == ("", 1)
    monkeypatch.setattr("sys.argv", [*words, "--force"])
    with pytest.raises(SystemExit):
        cli.main()
    assert "# THE ROTATION IS NOT DETERMINED" in capsys.readouterr().out


def test_a_search_without_bounds_is_refused():
    streams = drive(8)
    with pytest.raises(InputError, match="more than 200,000 candidates"):
        align(streams.headings, streams.velocities, max_offset=1e7)
    with pytest.raises(InputError, match="at least two steps"):
        align(streams.headings, streams.velocities, max_offset=0.005)
    with pytest.raises(InputError, match="seed must not be negative"):
        align(streams.headings, streams.velocities, seed=-1)
