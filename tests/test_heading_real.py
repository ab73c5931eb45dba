"""Headings of real events: none where nothing translates, and the right ones where something does.

Figures over all recordings, lenses and transforms: ``python tests/heading_figures.py``.
"""

from dataclasses import replace

import numpy as np
import pytest
from heading_figures import FOCAL_GARFIELD, TRANSFORMS, events_of, lens_of, spread, still_cases

from evcalib.geometry import angle_between
from evcalib.heading import estimate_headings


def confident(events, camera, **options):
    """Return the number of windows with a heading, and the reasons of the others."""
    estimate = estimate_headings(events, camera, **options)
    assert len(estimate.headings) + len(estimate.gaps) > 5
    return len(estimate.headings), {gap.reason for gap in estimate.gaps}


@pytest.mark.parametrize("case", still_cases(), ids=lambda case: case.name)
def test_without_translation_there_is_no_heading(data, case):
    found, reasons = confident(events_of(data, case.recording), lens_of(data, case))
    assert found == 0
    assert reasons & set(case.reasons)


@pytest.mark.parametrize("name", ["seq_0001", "seq_0003"])
@pytest.mark.parametrize("factor", [0.93, 1.07])
def test_a_pan_behind_a_wrong_focal_length_has_no_heading(data, name, factor):
    case = next(c for c in still_cases() if name in c.recording and "plain" in c.name)
    lens = lens_of(data, case)
    lens = replace(lens, fx=factor * lens.fx, fy=factor * lens.fy)
    assert confident(events_of(data, case.recording), lens, rate=40)[0] == 0


def test_garfield_moves_sideways(data):
    """By block matching it does, but for a vibration of about 3 degrees; its lens is not known."""
    events = events_of(data, "motion/garfield.txt.gz")
    for focal in FOCAL_GARFIELD:
        headings = estimate_headings(events, lens_of(data, focal)).headings
        assert len(headings) >= 1
        assert np.degrees(angle_between(headings.v, (1, 0, 0))).max() < 3.5


@pytest.mark.parametrize("how", TRANSFORMS)
def test_headings_of_the_slider_agree(data, how):
    off, sd, lost = spread(data, how)
    assert np.median(off) <= 0.6
    assert np.percentile(off, 90) <= 1.5
    assert lost <= 2
    # About their own mean, and they overlap: a little below one.
    assert 0.7 < np.sqrt(0.5 * np.mean((off / sd) ** 2)) < 1.25
