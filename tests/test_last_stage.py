"""What the last stage makes of a refinement: nothing that it learned against the answer is lost."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.runs.export import summary_dict
from data_tools.simulation.drives import straight
from data_tools.studies.sighting_drives import sight
from data_tools.studies.sightings import Corners
from evcalib.alignment import align
from evcalib.camera import Camera
from evcalib.errors import InputError, NoAnswerError
from evcalib.heading import Gap
from evcalib.pipeline import calibrate_estimate
from evcalib.pipeline._assessment import keep
from evcalib.uncertainty import rotation_radius


@pytest.fixture(scope="module")
def unobservable():
    """A straight drive: the offset stays unknown, the refinement gives the rotation."""
    camera = Camera(240, 180, 200.0, 200.0, 120.0, 90.0)
    R = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    corners = Corners(count=8, noise=0.25, false=0.15)
    rng = np.random.default_rng(8)
    made = sight(straight(9.0), rng, camera=camera, R_body_cam=R, offset=0.12, corners=corners)
    return made, made.estimate(), made.calibrate(max_offset=0.5)


def test_the_radius_is_that_of_the_covariance(unobservable):
    made, estimate, found = unobservable
    aligned = align(estimate.headings, made.velocities, max_offset=0.5)
    sure = replace(aligned, rotation_covariance=1e-4 * np.eye(3), rotation_radius=0.03)
    unsure = replace(found.joint, covariance=1e-2 * np.eye(4))
    kept = keep(sure, unsure, estimate.headings)
    assert kept.rotation_radius == rotation_radius(1e-2 * np.eye(3), samples=unsure.samples)
    assert kept.rotation_radius > 0.2


def test_doubts_are_kept_where_the_offset_is_not(unobservable):
    made, estimate, found = unobservable
    assert found.verdict.doubts == ()
    aligned = align(estimate.headings, made.velocities, max_offset=0.5)
    turning = replace(found.joint, turning=0.1)
    verdict = keep(aligned, turning, estimate.headings).verdict
    assert [doubt[:26] for doubt in verdict.doubts] == ["The body turns by 5.7 deg/"]
    assert verdict.summary.endswith("But the data contradict the model.")


def test_the_file_tells_doubts_and_whether_the_refinement_settled(unobservable):
    *_, found = unobservable
    told = summary_dict(found)
    assert (told["doubts"], told["converged"]) == ([], found.joint.converged)
    assert "9 ms at 50 Hz" in told["pixel_delay"]
    verdict = replace(found.verdict, doubts=("The clocks drift.",))
    torn = replace(found, verdict=verdict, joint=replace(found.joint, converged=False))
    told = summary_dict(torn)
    assert (told["doubts"], told["converged"]) == (["The clocks drift."], False)


def test_too_few_headings_are_no_bad_input_and_the_reasons_are_said(unobservable):
    made, estimate, _ = unobservable
    first = estimate.headings.select(np.arange(len(estimate.headings)) < 3)
    gaps = [*(Gap(t, "too dark") for t in range(5)), Gap(5.0, "the camera does not move")]
    few = replace(estimate, headings=first, gaps=gaps)
    with pytest.raises(NoAnswerError, match=r"3 usable row.*too dark \(5 windows\); the camera"):
        calibrate_estimate(few, made.velocities, focal=made.camera.focal)
    assert issubclass(NoAnswerError, InputError)


def test_the_command_line_ends_with_3_where_there_is_no_answer(run, monkeypatch):
    def none(*args, **options):
        raise NoAnswerError("no heading at all")

    monkeypatch.setattr("data_tools.runs.calibrate.run_files", none)
    words = ("calibrate", "e.h5", "--camera", "c.txt", "--velocities", "v.csv", "-o", "o")
    assert run(*words) == (3, "", "evcalib: no heading at all\n")
