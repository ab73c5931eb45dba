"""Figures of a report: what the artists hold, against the data."""

from dataclasses import replace

import numpy as np
import pytest
from made_runs import bare_run, made_run
from matplotlib.collections import PathCollection
from scipy.spatial.transform import Rotation

from evcalib.geometry import LOOKS_FORWARD
from evcalib.heading import EventRate
from evcalib.plots import alignment, recording, style
from evcalib.report import report_figures


@pytest.fixture
def ax():
    return style.new_figure().subplots()


@pytest.fixture
def axes():
    return style.new_figure(style.TALL).subplots(2, 1)


def lines(ax, color):
    return [line for line in ax.lines if line.get_color() == color]


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_the_event_rate_is_drawn_with_zeros_in_silences_and_without_half_bins(ax):
    rate = EventRate(np.array([0.0, 0.1, 0.2, 0.6, 0.7]), np.array([1, 5, 7, 900, 2]), 0.1)
    recording.draw_event_rate(ax, rate)
    (line,) = lines(ax, style.CAMERA)
    t, level = line.get_data()
    np.testing.assert_allclose(t, [0.1, 0.2, 0.3, 0.5, 0.6, 0.7], atol=1e-12)
    np.testing.assert_allclose(level, [0.05, 0.07, 0.0, 0.0, 9.0, 9.0])
    assert ax.get_ylabel() == "event rate [thousand/s]"


def test_a_single_bin_and_a_high_rate_are_drawn_too(ax):
    recording.draw_event_rate(ax, EventRate(np.array([3.0]), np.array([10**6]), 0.1))
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [10.0, 10.0])
    assert ax.get_ylabel() == "event rate [million/s]"


def test_inlier_shares_are_drawn_in_percent_with_their_median(ax):
    t, share = np.arange(5.0), np.array([0.2, 0.9, 0.8, 0.7, 1.0])
    recording.draw_inlier_share(ax, t, share)
    np.testing.assert_allclose(ax.lines[0].get_xydata(), np.column_stack((t, 100 * share)))
    assert ax.lines[0].get_color() == style.INLIER
    assert legend(ax) == ["median, 80 %"]


def test_each_reason_has_its_row_and_each_window_its_stroke(ax):
    estimate = made_run().estimate
    recording.draw_gaps(ax, estimate)
    found, odd, few = ax.lines
    np.testing.assert_array_equal(found.get_xdata(), estimate.headings.t)
    np.testing.assert_array_equal(odd.get_xydata(), [[9.0, 1]])
    np.testing.assert_array_equal(few.get_xydata(), [[0.1, 2], [0.2, 2]])
    names = [text.get_text() for text in ax.texts]
    assert names == [f"heading found ({len(estimate.headings)})", "odd (1)", "too few corners (2)"]
    assert [line.get_color() for line in ax.lines] == [style.INLIER, style.OUTLIER, style.OUTLIER]


def test_the_snapshot_shows_corners_and_where_matches_came_to():
    shot = made_run().estimate.snapshot
    axes = style.new_figure(style.WIDE).subplots(1, 2)
    recording.draw_snapshot(axes, shot)
    for ax, image in zip(axes, (shot.image1, shot.image2), strict=True):
        assert np.corrcoef(ax.images[0].get_array().ravel(), image.ravel())[0, 1] > 0.999
    np.testing.assert_array_equal(axes[0].lines[0].get_xydata(), shot.corners1)
    dots = {line.get_label(): line.get_xydata() for line in axes[1].lines if line.get_marker()}
    np.testing.assert_array_equal(dots["inlier"], shot.xy2[shot.inlier])
    np.testing.assert_array_equal(dots["outlier"], shot.xy2[~shot.inlier])
    assert axes[1].get_xlabel() == "9 of 12 matches agree with one direction"


def test_unaligned_directions_are_those_of_a_camera_that_looks_ahead(axes):
    run = made_run()
    alignment.draw_unaligned(axes, run.estimate.headings, run.velocities)
    azimuth, elevation = (lines(ax, style.CAMERA)[0].get_ydata() for ax in axes)
    x, y, z = run.estimate.headings.v.T
    np.testing.assert_allclose(azimuth, np.degrees(np.arctan2(-x, z)))
    np.testing.assert_allclose(elevation, np.degrees(np.arcsin(-y)), atol=1e-9)
    t, body = lines(axes[0], style.BODY)[0].get_data()
    fast = np.isin(run.velocities.t, t[np.isfinite(t)])
    v = run.velocities.v[fast]
    np.testing.assert_allclose(body[np.isfinite(t)], np.degrees(np.arctan2(v[:, 1], v[:, 0])))
    assert fast.mean() > 0.9


def test_standing_still_has_no_direction(axes):
    run = made_run()
    v = run.velocities.v.copy()
    v[40:60] *= 1e-3
    alignment.draw_unaligned(axes, run.estimate.headings, replace(run.velocities, v=v))
    t = lines(axes[0], style.BODY)[0].get_xdata()
    assert not np.isin(run.velocities.t[40:60], t).any()
    assert np.isnan(t).sum() >= 1


def test_aligned_directions_lie_over_each_other(axes):
    calibration = made_run().calibration
    alignment.draw_directions(axes, calibration)
    (camera,) = lines(axes[0], style.CAMERA)
    (body,) = lines(axes[0], style.BODY)
    at = np.interp(camera.get_xdata(), calibration.residuals.t, calibration.residuals.angle)
    off = np.abs(camera.get_ydata() - np.interp(camera.get_xdata(), *body.get_data()))
    assert np.median(off) <= np.degrees(np.median(at)) + 0.1
    assert camera.get_zorder() >= body.get_zorder()
    shown = sum(line.get_xdata().size for line in axes[0].lines if line.get_marker() == ".")
    assert shown == len(calibration.residuals.t)


def test_the_map_of_residuals_keeps_angles_and_knows_left_and_up(ax):
    """Against scipy: the rotation that takes forward into the body direction turned back."""
    calibration = made_run().calibration
    alignment.draw_residual_map(ax, calibration)
    residuals = calibration.residuals
    reach = ax.get_ylim()[1]
    drawn = np.concatenate([line.get_xydata() for line in ax.lines[:2]])
    inner = np.abs(drawn).max(axis=1) < reach
    angle = np.hypot(*drawn[inner].T)
    all_angles = np.degrees(residuals.angle)
    nearest = np.abs(angle[:, None] - all_angles).min(axis=1)
    assert nearest.max() < 1e-9
    azimuth = np.arctan2(residuals.direction[:, 1], residuals.direction[:, 0])
    elevation = np.arcsin(residuals.direction[:, 2])
    back = Rotation.from_euler("ZY", np.column_stack((azimuth, -elevation))).inv()
    _, left, up = back.apply(residuals.turned).T
    signs = {tuple(s) for s in np.sign(np.column_stack((left, up))).astype(int)}
    assert len(signs) == 4
    off = alignment._tangent(residuals.turned, residuals.direction)
    flat = np.column_stack((left, up)) / np.hypot(left, up)[:, None]
    np.testing.assert_allclose(off, flat, atol=1e-6)
    assert ax.get_xlim()[0] > ax.get_xlim()[1], "left must be on the left"


def test_outliers_stay_on_the_map(ax):
    calibration = made_run().calibration
    alignment.draw_residual_map(ax, calibration)
    drawn = np.concatenate([line.get_xydata() for line in ax.lines[:2]])
    assert len(drawn) == len(calibration.residuals.t)
    assert np.abs(drawn).max() == pytest.approx(ax.get_ylim()[1])


def test_the_sphere_holds_every_direction():
    calibration = made_run().calibration
    ax = style.new_figure(style.SQUARE).add_subplot(projection="3d", computed_zorder=False)
    alignment.draw_sphere(ax, calibration)
    clouds = [c for c in ax.collections if isinstance(c, PathCollection)]
    body, inliers, outliers = (np.column_stack(c._offsets3d) for c in clouds)
    np.testing.assert_allclose(body, calibration.residuals.direction)
    assert len(inliers) + len(outliers) == len(calibration.residuals.t)
    np.testing.assert_allclose(np.linalg.norm(np.concatenate((inliers, outliers)), axis=1), 1.0)
    assert legend(ax) == ["body", "camera, turned", "outliers"]


def test_the_peak_shows_the_whole_interval_and_the_truth(ax):
    calibration = made_run().calibration
    low, high = calibration.offset_interval
    alignment.draw_peak(
        ax, calibration.curve, found=calibration.offset, interval=(low, high), true=0.25
    )
    left, right = ax.get_xlim()
    assert left < low < high < right
    assert left < 0.25 < right
    near = np.abs(calibration.curve.offsets - calibration.offset) <= right - calibration.offset
    assert ax.get_ylim()[0] <= calibration.curve.score[near].min()
    assert ax.get_ylim()[1] >= calibration.curve.score[near].max()


def test_noise_does_not_fill_the_axis_of_a_flat_curve(ax):
    calibration = made_run("straight").calibration
    alignment.draw_curve(ax, calibration.curve, interval=calibration.offset_interval)
    assert np.ptp(ax.get_ylim()) >= 0.099
    assert legend(ax) == ["plausible"]


def test_a_report_has_all_figures_and_leaves_out_what_it_has_no_data_for():
    names = ["unaligned", "directions", "correlation", "residuals", "sphere"]
    more = ["headings", "snapshot", "event_rate"]
    assert list(report_figures(made_run())) == names + more
    assert list(report_figures(bare_run(made_run()))) == names + more[:1]


def test_quantities_keep_their_colours_throughout():
    figures = report_figures(made_run())
    of = lambda name: {  # noqa: E731
        line.get_label(): line.get_color() for ax in figures[name].axes for line in ax.lines
    }
    assert of("residuals")["inliers"] == of("snapshot")["inlier"] == style.INLIER
    assert of("residuals")["outliers"] == of("snapshot")["outlier"] == style.OUTLIER
    for name in ("unaligned", "directions"):
        looks = of(name)
        assert {c for n, c in looks.items() if n.startswith("camera")} == {style.CAMERA}
        assert {c for n, c in looks.items() if n.startswith("body")} == {style.BODY}
    assert style.TRUE in of("correlation").values()


def test_every_axis_names_its_quantity_and_unit():
    for name, figure in report_figures(made_run()).items():
        for ax in figure.axes:
            if name == "sphere" and ax.name == "3d":
                continue
            named = [ax.get_xlabel(), ax.get_ylabel()]
            assert any(named), name
            for label in filter(None, named):
                assert label.endswith("]") or name == "snapshot", (name, label)


def test_looking_forward_means_what_it_says():
    np.testing.assert_array_equal(LOOKS_FORWARD @ [0, 0, 1], [1, 0, 0])
    np.testing.assert_array_equal(LOOKS_FORWARD @ [0, 1, 0], [0, 0, -1])
    assert np.linalg.det(LOOKS_FORWARD) == pytest.approx(1.0)
