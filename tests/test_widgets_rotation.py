"""The rotation panel without a browser: every corner of its ranges, and what it shows there."""

import itertools
import re
from types import SimpleNamespace

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest

from data_tools.simulation.drives import s_curve
from data_tools.simulation.streams import Noise, simulate
from evcalib.alignment.rotation import METHODS, RotationEstimate, estimate_rotation
from evcalib.errors import InputError
from evcalib.geometry import unit
from evcalib.plots.rotation import TOP, draw_map, draw_weights
from evcalib.widgets.rotation import MAX_SHARE, RotationPanel

KINDS = ("uniform", "one cluster", "flipped")
CURVE = s_curve(12.0, amplitude=1.0, period=6.0)


def pairs(kind, share, sigma=0.1):
    if kind == "flipped":
        noise = Noise(sigma=sigma, flips=share)
    else:
        noise = Noise(sigma=sigma, outliers=share, cluster=kind == "one cluster")
    streams = simulate(CURVE, np.random.default_rng(5), heading_rate=15.0, heading_noise=noise)
    d = unit(CURVE.velocity(streams.headings.t))
    return SimpleNamespace(e=streams.headings.v, d=d, R_body_cam=streams.R_body_cam)


@pytest.fixture
def panel():
    return RotationPanel(pairs, KINDS)


def shown(panel):
    """Return the errors of the table, by loss."""
    found = re.findall(r"(\w+) ([\d.]+)(?:</b>)?</td>", panel.numbers.value)
    return {name: float(value) for name, value in found}


def test_the_table_holds_the_errors_of_all_losses(panel):
    assert list(shown(panel)) == list(METHODS)
    R = estimate_rotation(panel.pairs.e, panel.pairs.d, method="l1").R_body_cam
    # the angle between two rotations, from the chord |A - B| = 2 sqrt(2) sin(angle / 2)
    chord = np.linalg.norm(R - panel.pairs.R_body_cam)
    angle = 2 * np.degrees(np.arcsin(chord / np.sqrt(8)))
    assert shown(panel)["l1"] == pytest.approx(angle, abs=0.006)


def test_robust_losses_shrug_off_what_breaks_least_squares(panel):
    panel.share.value = 60
    errors = panel.errors()
    assert max(errors["tukey"], errors["l1"], errors["gnc"]) < 4.0
    assert errors["kabsch"] > 5.0
    panel.kind.value, panel.share.value = "one cluster", 40
    errors = panel.errors()
    assert errors["tukey"] < errors["l1"] < errors["kabsch"]


def test_more_flips_than_not_turn_every_loss_over(panel):
    panel.kind.value, panel.share.value = "flipped", MAX_SHARE
    assert min(panel.errors().values()) > 150.0


def test_clean_pairs_need_no_robust_loss(panel):
    panel.share.value = 0
    errors = panel.errors()
    assert max(errors[loss] for loss in ("kabsch", "l1", "tukey", "gnc")) < 2.0


def test_every_corner_shows_finite_numbers_and_a_picture(panel, tmp_path):
    path = tmp_path / "picture.png"
    for kind, share in itertools.product(KINDS, (0, MAX_SHARE)):
        panel.kind.value, panel.share.value = kind, share
        values = np.array(list(shown(panel).values()))
        assert values.size == len(METHODS)
        assert np.all((values >= 0.0) & (values <= 180.0))
    for loss in METHODS:
        panel.loss.value = loss
        assert f"<b>{loss} " in panel.numbers.value
        path.write_bytes(panel.picture.value)
        assert matplotlib.image.imread(path).std() > 0.05


def test_the_same_place_gives_the_same_bytes_and_reset_goes_back_there(panel):
    first, table = bytes(panel.picture.value), panel.numbers.value
    panel.kind.value, panel.share.value, panel.loss.value = "flipped", 70, "gnc"
    assert panel.picture.value != first
    panel.reset.click()
    assert (panel.kind.value, panel.share.value, panel.loss.value) == ("uniform", 30, "kabsch")
    assert panel.picture.value == first
    assert panel.numbers.value == table


def test_nothing_to_choose_from_is_refused():
    with pytest.raises(InputError, match="at least one kind"):
        RotationPanel(pairs, [])


def test_exact_pairs_are_drawn_too():
    exact = RotationPanel(lambda kind, share: pairs(kind, share, sigma=0.0), KINDS)
    for share in (0, MAX_SHARE):
        exact.share.value = share
        for loss in METHODS:
            exact.loss.value = loss
            assert bytes(exact.picture.value).startswith(b"\x89PNG")
    exact.share.value = 0
    assert max(exact.errors().values()) < 1e-6


def test_left_is_drawn_on_the_left_and_up_above():
    d = np.array([[0.0, 1.0, 0.0], [0.0, 0.6, 0.8]])
    figure = plt.figure()
    ax = figure.add_subplot(projection="hammer")
    draw_map(ax, d, d, RotationEstimate(np.eye(3), np.ones(2), 0.1, True, 1))
    x, y = ax.lines[-1].get_xdata(), ax.lines[-1].get_ydata()
    np.testing.assert_allclose(x, -np.pi / 2)
    np.testing.assert_allclose(y, [0.0, np.arcsin(0.8)], atol=1e-12)
    plt.close(figure)


def test_weights_are_drawn_relative_to_the_median_inlier():
    angle = np.radians([0.0, 1.0, 2.0, 60.0])
    e = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    d = np.tile([1.0, 0.0, 0.0], (4, 1))
    weight = np.array([80.0, 4.0, 2.0, 1.0])
    figure, ax = plt.subplots()
    draw_weights(ax, e, d, RotationEstimate(np.eye(3), weight, np.radians(1.0), True, 1))
    inliers, outliers = ax.lines
    np.testing.assert_allclose(inliers.get_xdata(), [0.0, 1.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(inliers.get_ydata(), [TOP, 1.0, 0.5])
    np.testing.assert_allclose(outliers.get_xdata(), [60.0])
    np.testing.assert_allclose(outliers.get_ydata(), [0.25])
    plt.close(figure)
