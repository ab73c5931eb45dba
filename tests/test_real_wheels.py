"""Encoder ticks of real robots against motion capture, each kind read with one column map.

Run with ``-s`` for the table: bias and sd of speed, direction and yaw rate of each run.
"""

import numpy as np
import pytest

from data_tools.logs.velocity_sources import read_body_velocities
from evcalib.kinematics import Mecanum, Omni, OmniWheel

AROUND = {"a": -60.0, "b": 60.0, "c": 180.0}
OMNI = Omni(
    tuple(
        OmniWheel(n, 0.195 * np.cos(np.radians(a)), 0.195 * np.sin(np.radians(a)),
                  np.radians(a + 90))
        for n, a in AROUND.items()
    )
)  # fmt: skip
TICKS = {"wheel_diameter": 0.102, "ticks_per_turn": 1024, "gear": 12, "t": 1} | {
    f"speed_{name}": {"column": 5 + k, "unit": "ticks/row", "scale": -1}
    for k, name in enumerate(AROUND)
}
TURNS = {"wheel_diameter": 0.06, "t": 1} | {
    f"speed_{name}": {"column": 5 + k, "unit": "turns/row", "scale": -1 if name[1] == "r" else 1}
    for k, name in enumerate(("fl", "fr", "rl", "rr"))
}
RUNS = {
    "omni3/circular/221220201716": (OMNI, TICKS),
    "omni3/joystick/211220201842": (OMNI, TICKS),
    "omni3/square/221220201934": (OMNI, TICKS),
    "mecanum/circular/231220200502": (Mecanum(0.1, 0.1), TURNS),
    "mecanum/square/080920201205": (Mecanum(0.1, 0.1), TURNS),
}
HALF = 0.2
"""Both are compared as means over twice this time [s]."""


@pytest.mark.parametrize("run", list(RUNS))
def test_ticks_give_the_velocity_that_motion_capture_saw(data, run):
    folder = data / "wheels" / "optiodom" / run
    path = folder / f"{folder.name}_run-01.csv"
    vehicle, columns = RUNS[run]
    source = read_body_velocities(path, vehicle=vehicle, columns=columns)
    assert source.wheels.slip_share < 0.01
    t, x, y, yaw = np.loadtxt(path, delimiter=",", usecols=range(4), unpack=True)
    at = source.velocities.t
    np.testing.assert_allclose(at, (t[1:] + t[:-1]) / 2, atol=1e-9)

    def slope(values):
        return (np.interp(at + HALF, t, values) - np.interp(at - HALF, t, values)) / (2 * HALF)

    yaw = np.unwrap(yaw)
    seen = (slope(x) + 1j * slope(y)) * np.exp(-1j * np.interp(at, t, yaw))
    count = round(2 * HALF / float(np.median(np.diff(t))))
    box = np.ones(count) / count
    told = np.convolve(source.velocities.v[:, 0] + 1j * source.velocities.v[:, 1], box, "same")
    rate = np.convolve(source.velocities.yaw_rate, box, "same")
    use = (np.abs(seen) > 0.05) & (at > at[0] + 1) & (at < at[-1] - 1)
    speed = 100 * (np.abs(told) - np.abs(seen))[use]
    angle = np.degrees(np.angle(told * np.conj(seen)))[use]
    turn = np.degrees(rate - slope(yaw))[use]
    print(f"\n{run}: {np.abs(seen[use]).mean():.3f} m/s;"
          f" speed {speed.mean():+.1f} +- {speed.std():.1f} cm/s,"
          f" direction {angle.mean():+.1f} +- {angle.std():.1f} deg,"
          f" yaw rate {turn.mean():+.2f} +- {turn.std():.2f} deg/s")  # fmt: skip
    assert abs(speed.mean()) < 1.5
    assert speed.std() < 2.5
    assert abs(angle.mean()) < 4
    assert angle.std() < 12
    assert abs(turn.mean()) < 1
    assert turn.std() < 4
