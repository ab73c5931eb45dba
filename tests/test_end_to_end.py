"""From simulated events and velocities to the calibration, through every stage."""

import numpy as np
import pytest

from data_tools.simulation.drives import s_curve
from data_tools.simulation.scenes import furnished_room
from data_tools.simulation.simulator import FORWARD, Simulator
from data_tools.simulation.trajectory import Trajectory
from evcalib.alignment import align
from evcalib.camera import Camera
from evcalib.geometry import rotation_angle, rotation_vector_to_matrix
from evcalib.heading import estimate_headings
from evcalib.series import VelocitySeries


@pytest.fixture(scope="module")
def calibration():
    camera = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
    drive = s_curve(7.0, amplitude=np.radians(50), period=4.0, speed=0.5)
    R_body_cam = rotation_vector_to_matrix([0.1, -0.2, 0.15]) @ FORWARD
    trajectory = Trajectory.of_drive(drive, offset=0.2)
    room = furnished_room(trajectory.position, 5)
    events = Simulator(trajectory, camera, room, R_body_cam, seed=5).run().events
    t = np.arange(0, 7, 0.02)
    found = align(estimate_headings(events, camera).headings, VelocitySeries(t, drive.velocity(t)))
    return found, R_body_cam


def test_events_and_velocities_give_rotation_and_offset(calibration):
    """Bounds of a short drive with a small sensor; longer and larger ones do better."""
    found, R_body_cam = calibration
    assert found.rotation_observable
    assert found.offset_observable
    assert rotation_angle(found.R_body_cam, R_body_cam) < np.radians(2.0)
    assert abs(found.offset - 0.2) < 0.05


def test_the_stated_uncertainty_fits_the_error(calibration):
    found, R_body_cam = calibration
    assert rotation_angle(found.R_body_cam, R_body_cam) < 2 * found.rotation_radius
    assert abs(found.offset - 0.2) < 4 * found.offset_sd
