"""Simulated drives: what vehicles do and log, against closed forms and the simulator's truth."""

import numpy as np
import pytest

from data_tools.simulation.random_drives import CAR_WHEELBASE, RECORDED, TURNING
from data_tools.simulation.recorded_drive import LARGEST_REACH, record_drive
from evcalib.camera import Camera

SMALL = Camera(32, 24, 40.0, 40.0, 15.5, 11.5)


@pytest.mark.parametrize("motion", TURNING)
@pytest.mark.parametrize("seed", [1, 2])
def test_wheels_and_position_tell_the_velocity_of_the_camera(motion, seed):
    """v_cam = v_o + w x lever, from the wheel log alone, is what the simulated camera does."""
    made = record_drive(seed, motion=motion, duration=8.0, speed=0.7, camera=SMALL)
    told, (x, y, z) = made.velocities(), made.lever
    t = told.t - made.offset
    keep = (t > made.simulator.trajectory.t[0]) & (t < made.simulator.trajectory.t[-1])
    truth = made.simulator.truth(t[keep])
    v = told.v[keep] + np.outer(told.yaw_rate[keep], [0, 0, 1]) @ [[0, 0, 0], [0, 0, 0], [-y, x, 0]]
    np.testing.assert_allclose(v @ made.R_body_cam, truth.v_cam, atol=0.01)
    np.testing.assert_allclose(told.yaw_rate[keep], truth.rate_body[:, 2], atol=0.01)
    assert np.hypot(x, y) <= LARGEST_REACH
    assert 0.3 <= z <= 0.9


@pytest.mark.parametrize("seed", range(5))
def test_what_the_turning_vehicles_do(seed):
    """Bounds of speeds and rates, from the definitions of the motions."""
    t = np.linspace(1.0, 16.0, 4001)
    rng = np.random.default_rng(seed)
    made = {name: RECORDED[name](rng, 16.0, 0.7) for name in TURNING}
    rate = {name: np.degrees(drive.yaw_rate(t)) for name, drive in made.items()}
    speed = {name: drive.speed(t) for name, drive in made.items()}
    assert 38 < np.abs(rate["figure-eight"]).max() <= 60
    assert 0.29 < speed["figure-eight"].min() < 0.45 < 0.6 < speed["figure-eight"].max() <= 0.7
    steer = np.arctan(CAR_WHEELBASE * np.radians(rate["slalom"]) / speed["slalom"])
    assert 14.5 < np.degrees(np.abs(steer).max()) <= 30.0
    assert not speed["spin"].any()
    assert 10 < np.abs(rate["spin"]).max() <= 60
    assert np.ptp(rate["circle"]) == np.ptp(speed["circle"]) == 0.0
    assert not rate["stops"].any()
    assert speed["stops"].min() == 0.0
    for name in ("figure-eight", "slalom", "circle", "stops"):
        assert not made[name].velocity(t)[:, 1].any(), f"{name} does not go sideways"


def test_a_lobe_of_an_eight_turns_all_round():
    """The body turns by 200 to 250 degrees one way, then back."""
    t = np.linspace(0.0, 30.0, 30001)
    for seed in range(5):
        drive = RECORDED["figure-eight"](np.random.default_rng(seed), 30.0, 0.7)
        yaw = np.degrees(np.concatenate([[0], np.cumsum(drive.yaw_rate(t)[1:] * 1e-3)]))
        turns = np.flatnonzero(np.diff(np.sign(drive.yaw_rate(t))))
        lobe = np.abs(np.diff(yaw[turns[turns > 1000]]))
        assert ((lobe > 199) & (lobe < 251)).all()
