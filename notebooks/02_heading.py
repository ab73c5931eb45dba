# %% [markdown]
# # 2. Heading: from two images to the direction of motion
#
# **For whom.** You have corners (notebook 1), and want to know which way the camera went.
#
# **What you will be able to do.**
#
# 1. say why points flow away from one place in the image, and find it from two of them,
# 2. say why one should not estimate a rotation that is not there: two points against five,
# 3. choose a baseline, knowing what a longer one gains and what it costs,
# 4. pool many pairs of images into one exact heading,
# 5. judge how sure a heading is, and when there is none.
#
# **Required knowledge.** The cross product, and that a camera turns each pixel into a direction in
# space (its *bearing*).
#
# **Time.** 35 minutes: 25 of reading, 10 of playing with the panel.
#
# The question: where is the camera going, given what it sees at two times? Let a camera that does
# not turn move by $\mathbf t$. A point seen at the bearing $\mathbf r_1$ before is seen at
# $\mathbf r_2$ after. The three directions lie in one plane, whatever the distance of the point:
#
# $$\mathbf t \cdot (\mathbf r_1 \times \mathbf r_2) = 0. \tag{1}$$
#
# This is the epipolar constraint without a rotation. (The paper uses it with one; more on that
# below.) The notebook ends with the first of the two streams that the calibration compares, the
# camera's heading over time.

# %%
import matplotlib.pyplot as plt
import numpy as np

from data_tools.course.samples import load_sample, slider_depth
from data_tools.simulation.point_matches import random_matches
from evcalib.geometry import angle_between, unit
from evcalib.heading import Matches, estimate_headings
from evcalib.heading.epipolar import five_point, turn_explains, two_point
from evcalib.heading.two_views import keypoints_at, matched
from evcalib.plots import style
from evcalib.plots.heading import draw_backdrop, draw_heading, draw_matches, draw_offsets

style.use()

# %% [markdown]
# ## The geometry
#
# Equation (1) is linear in $\mathbf t$. We do not ask for the length of $\mathbf t$, so it has two
# unknowns, and *two* points are enough: $\mathbf t$ stands at a right angle to both normals
# $\mathbf r_1 \times \mathbf r_2$. Try it with three points at different distances, seen before and
# after a step of 0.1 m:

# %%
step = np.array([0.06, 0.0, 0.08])
points = np.array([[-1.0, 0.5, 3.0], [0.5, -0.4, 2.0], [1.5, 1.0, 6.0]])
before, after = unit(points), unit(points - step)
normals = np.cross(before, after)
print("t . (r1 x r2):", np.round(np.abs(normals @ step), 12))
direction = unit(np.cross(normals[0], normals[1]))
direction *= np.sign(direction[2])
print("direction from two points:", np.round(direction, 3) + 0.0)

assert np.allclose(direction, unit(step))

# %% [markdown]
# The third point, which was not used, agrees: its product is zero, too.
#
# ## Two recordings
#
# Here are two recordings of a simulated camera of 240 x 180 pixels at 0.6 m/s. In the first it goes
# mostly *forward*, so that the place towards which it moves is inside the image; in the second
# mostly *sideways*.

# %%
drives = {name: load_sample(f"data/{name}.npz") for name in ("forward", "sideways")}
for name, drive in drives.items():
    ev = drive.events
    print(
        f"{name}: {len(ev)} events in {ev.duration:.2f} s, heading {np.round(drive.direction, 2)}"
    )

# %% [markdown]
# ## Matches
#
# We choose two times, 0.2 s apart. The Arc* corners of the last 60 ms before each of them become
# *keypoints*. Each keypoint gets a description of the surface around it (BRIEF, notebook 1) and is
# matched to the most similar keypoint of the other time, if the choice is mutual. Nothing is left
# out in silence; the counts say what happened.

# %%
camera = drives["forward"].camera
first, second = keypoints_at(drives["forward"].events, [250_000, 450_000])
pairs = matched(camera, first, second, reach=60)
print(f"{len(first)} and {len(second)} keypoints, {len(pairs)} matches")
print(f"left out: {first.weak} with a single corner event, {first.surplus} too many")
print(f"{first.clipped} lie near the border and were described all the same")

# %% [markdown]
# In the picture, each match is a stroke that ends in a dot, over the surface of the later time in
# faint grey.
#
# **See:** most matches fan out from a common place on the right. A few cross the others. They are
# wrong, but so far nothing tells us which.

# %%
from evcalib.surfaces.quality import surface_images

surface = surface_images("tos_ts", drives["forward"].events, [450_000])[0]
figure, ax = plt.subplots(figsize=(6.0, 4.4))
draw_backdrop(ax, surface)
draw_matches(ax, camera, pairs)
plt.show()

# %% [markdown]
# ## Two points, robustly
#
# `two_point` draws pairs of matches at random and solves (1) for each pair. It keeps the direction
# from which the matches deviate least, where a deviation beyond 1.5 px counts no more than one of
# 1.5 px (that is what makes it robust). Then it fits the direction once more, to all matches that
# agree, the *inliers*. The deviation is the angle by which a match misses its plane, in Sampson's
# approximation.

# %%
limit = 1.5 / camera.fx
two = two_point(pairs.r1, pairs.r2, threshold=limit, groups=pairs.groups)
off = np.degrees(angle_between(two.direction, drives["forward"].direction))
print(f"{two.inliers.sum()} of {len(pairs)} matches are inliers")
print(f"error {off:.1f} deg, standard deviation as stated {np.degrees(two.sd):.1f} deg per axis")

# %% [markdown]
# In the image, all planes of (1) meet in the direction of motion itself. The place is called the
# *focus of expansion*.
#
# **See:** green matches run along the grey lines, away from the orange cross. Purple ones do not.
# The black cross is the true focus.

# %%
figure, ax = plt.subplots(figsize=(6.0, 4.7))
draw_heading(ax, camera, pairs, two, drives["forward"].direction)
figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=4)
plt.show()

# %% [markdown]
# ## The sign
#
# Equation (1) holds for $\mathbf t$ and for $-\mathbf t$. What tells them apart is that points are
# in *front* of the camera, so in the image they flow away from the place where it goes
# (*cheirality*). Exchange the two images, which is to drive backwards, and the sign must flip:

# %%
back = two_point(pairs.r2, pairs.r1, threshold=limit, groups=pairs.groups)
between = np.degrees(angle_between(two.direction, back.direction))
print(f"the two differ by {between:.0f} deg")

assert between > 175

# %% [markdown]
# ## Five points
#
# The paper takes the essential matrix from five points, and that finds a rotation between the two
# images, too. There is a price. When a camera turns a little to the left, the image shifts to the
# right, nearly as if the camera had moved sideways. If the field of view and the motion are small,
# it is the noise that decides which of the two it was.
#
# One pair of images proves little. So we draw random points at 1.5 to 6 m, and let a camera move
# 0.1 m in some direction between forward (0 deg) and sideways (90 deg). We add noise of 0.8 px,
# which is how real keypoints scatter, and make every fifth match wrong.

# %%
ANGLES = (0, 15, 30, 45, 60, 75, 90)


def error_of(solver, angle, seed, count=200, outliers=0.2):
    """Return the error [deg] of one random trial, 90 if there is no result."""
    d = np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
    rng = np.random.default_rng(seed)
    pair = random_matches(camera, 0.1 * d, rng, count=count, outliers=outliers)
    found = solver(pair.r1, pair.r2, threshold=2 * limit)
    return 90.0 if found is None else float(np.degrees(angle_between(found.direction, d)))


# %% [markdown]
# Here is the median error of 15 such trials for each direction and solver:

# %%
SOLVERS = {"two points": two_point, "five points": five_point}
medians = {
    name: [np.median([error_of(solver, angle, seed) for seed in range(15)]) for angle in ANGLES]
    for name, solver in SOLVERS.items()
}
print("two points:", ", ".join(f"{m:.1f}" for m in medians["two points"]), "deg")

assert all(np.array(medians["five points"]) > 3 * np.array(medians["two points"]))

# %% [markdown]
# The same comparison for the whole chain, from events on, was stored by
# `python notebooks/_make_data.py tables DATA_FOLDER`: simulated recordings of 346 x 260 pixels, and
# in the last row the real *slider_depth*. *Found* is the share of times that got a heading.

# %%
rows = np.loadtxt("data/solvers.csv", delimiter=",", skiprows=1, dtype=str)
print("                        two points           five points")
for a, b in zip(rows[::2], rows[1::2], strict=True):
    cells = [f"{float(r[3]):6.2f} deg, {float(r[5]):4.0%} found" for r in (a, b)]
    print(f"{a[0]:12s} {a[1]:>3s} deg  " + "   ".join(cells))

# %% [markdown]
# Both as pictures. Mind the logarithmic scale.
#
# **See:** in the random trials (left) two points are about ten times as exact, in every direction.
# In the whole chain (right) five points get one pair of images at a time, as in the paper. They are
# mostly within a degree, but 7 deg off straight ahead.

# %%
from evcalib.plots.heading import draw_solvers

chain = {"two points": rows[:14:2, 3].astype(float), "five points": rows[1:14:2, 3].astype(float)}
figure, axes = plt.subplots(1, 2, figsize=(9.4, 3.4), sharey=True)
draw_solvers(axes, ANGLES, {"random points": medians, "events, whole chain": chain})
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# The two-point solver pays elsewhere: it relies on a camera that does not turn. Half a degree
# during the step is enough to spoil its result. This is why one drives without turning for a
# calibration, and why rows of the wheel log with a large yaw rate are left out (notebook 3). Small
# turns that the wheels report are taken into account at the end, in notebook 6.

# %%
ahead = unit([0.3, 0.0, 1.0])
for degrees in (0.0, 0.5, 2.0):
    rng = np.random.default_rng(0)
    yaw = (0.0, np.radians(degrees), 0.0)
    pair = random_matches(camera, 0.1 * ahead, rng, turn=yaw, noise=0.3)
    found = two_point(pair.r1, pair.r2, threshold=4 * limit)
    error = np.degrees(angle_between(found.direction, ahead))
    print(f"turn by {degrees} deg: error {error:.0f} deg")

# %% [markdown]
# ## The baseline
#
# The time between the two images is called the *baseline* here. A longer one means more motion, so
# the same noise matters less. But corners change their looks, leave the image, and fewer are
# matched. We move the two times apart, around the middle of the sideways recording:

# %%
drive = drives["sideways"]
times = list(range(50_000, 750_000, 25_000))
keypoints = dict(zip(times, keypoints_at(drive.events, times), strict=True))


def pair_around(middle, baseline):
    """Return the matches of two keyframes; all times in ms."""
    ends = (keypoints[1000 * middle + side * 500 * baseline] for side in (-1, 1))
    return matched(drive.camera, *ends, reach=60)


# %% [markdown]
# The table has the median over five middles. There are fewer and fewer matches, and yet the error
# falls. At 100 ms it is much larger than stated. The stated standard deviation knows how much the
# matches scatter, but not what is wrong with all of them alike; and here 8 deg of a motion of 3 px
# are only 0.4 px.

# %%
MIDDLES = (325, 350, 375, 400, 425)


def solved(pairs):
    """Return error and stated standard deviation [deg], and the number of inliers."""
    found = two_point(pairs.r1, pairs.r2, threshold=limit, groups=pairs.groups)
    error = np.degrees(angle_between(found.direction, drive.direction))
    return float(error), float(np.degrees(found.sd)), int(found.inliers.sum())


for baseline in (100, 150, 200, 300, 400):
    trials = [solved(pair_around(middle, baseline)) for middle in MIDDLES]
    error, sd, inliers = np.median(trials, axis=0)
    print(f"{baseline} ms: {inliers:3.0f} inliers, error {error:.1f} deg, stated {sd:.1f} deg")

# %% [markdown]
# ## Pooling
#
# Why choose one baseline? While the motion is steady, the direction is the same for all pairs about
# the same middle. So put the matches of all of them into *one* fit. That is `Matches.pooled`.
#
# Pairs share keyframes (the times at which keypoints are taken), and one corner is seen many times.
# Its errors are then not independent. `groups` tells the solver which matches see the same corner;
# otherwise it would believe itself far too sure.


# %%
def pooled_around(middle):
    """Return the matches of all pairs of 200 to 400 ms about one time."""
    return Matches.pooled([pair_around(middle, b) for b in (200, 250, 300, 350, 400)])


one, many = pair_around(400, 300), pooled_around(400)
for name, some in {"one pair": one, "five pairs": many}.items():
    error, sd, inliers = solved(some)
    print(f"{name}: {inliers} inliers, stated {sd:.1f} deg")

# %% [markdown]
# Five headings, one for each middle, seen along the true direction. Left they are from single pairs
# of 200 ms, right from pooled ones; the bars are one stated standard deviation.
#
# **See:** pooling brings the headings together, and close to the black cross, the truth.

# %%
figure, axes = plt.subplots(1, 2, figsize=(8.4, 3.9))
makers = {"one pair": lambda m: pair_around(m, 200), "pooled": pooled_around}
for ax, (name, make) in zip(axes, makers.items(), strict=True):
    parts = [make(middle) for middle in MIDDLES]
    fits = [two_point(p.r1, p.r2, threshold=limit, groups=p.groups) for p in parts]
    draw_offsets(ax, [f.direction for f in fits], drive.direction, [f.sd for f in fits])
    ax.set_title(name)
plt.show()

# %% [markdown]
# ## The whole chain
#
# `estimate_headings` does all this for a recording: keyframes at 20 Hz, pairs over the longest
# baselines at which matches survive, one pooled fit per window. Each heading carries the mean start
# and end time of its own matches. One thing is better than above: keypoints only say which corner
# is which, and how far it moved is measured between small images of events (notebook 6 tells why).

# %%
for name, drive in drives.items():
    estimate = estimate_headings(drive.events, drive.camera)
    off = np.degrees(angle_between(estimate.headings.v, drive.direction))
    print(
        f"{name}: {len(off)} headings, {len(estimate.gaps)} gaps, median {np.median(off):.1f} deg"
    )

# %% [markdown]
# Where there is no heading, the estimate says why:

# %%
for gap in estimate.gaps:
    print(f"no heading at {gap.t:.2f} s: {gap.reason}")

# %% [markdown]
# The errors of the headings that there are, in the sideways recording.
#
# **See:** the first two and the last are less exact. At the ends of a recording only short
# baselines fit, and the bars say so, if not quite enough for the first one.

# %%
from evcalib.plots.heading import draw_errors_over_time

headings = estimate.headings
figure, ax = plt.subplots(figsize=style.WIDE)
draw_errors_over_time(ax, headings.t, off, np.degrees(headings.sd))
plt.show()

# %% [markdown]
# ## How sure is a heading?
#
# Is the stated covariance honest? In random trials it can be checked: if it is, the truth lies
# outside of its 95 % ellipse in 5 % of the trials.


# %%
def outside(length, seed):
    """Tell whether the truth is outside of the 95 % ellipse."""
    truth = unit([1.0, 0.0, 1.0])
    pair = random_matches(camera, length * truth, np.random.default_rng(seed), outliers=0.2)
    found = two_point(pair.r1, pair.r2, threshold=2 * limit)
    off = found.direction - truth
    return off @ np.linalg.pinv(found.covariance, rcond=1e-6) @ off > 5.99


for length in (0.1, 0.3):
    print(f"{length} m: {np.mean([outside(length, seed) for seed in range(200)]):.0%} outside")

# %% [markdown]
# Over 0.3 m the ellipse is nearly honest. Over 0.1 m points move by only a few times their noise,
# and the ellipse is too small: the covariance takes the geometry for linear, and for so short a
# motion it is not.
#
# A stated error is only as good as its model. A camera that only *turns* has no direction of
# motion, and yet the solver will find one that fits. So the chain asks whether a steady turn would
# explain the matches as well. Only if it does not, points at different distances moved differently
# (*parallax*), and there is a heading:

# %%
for name, shift, yaw in (("moves", 0.1, 0.0), ("turns", 0.0, 0.04)):
    rng = np.random.default_rng(1)
    turn = (0.0, yaw, 0.0)
    pair = random_matches(camera, shift * ahead, rng, turn=turn, noise=0.3)
    found = two_point(pair.r1, pair.r2, threshold=2 * limit)
    turned = turn_explains(pair.r1, pair.r2, np.ones(200), found)
    print(f"a camera that {name}: {found.inliers.mean():.0%} inliers, a turn explains it: {turned}")

# %% [markdown]
# ## Play with matches and headings
#
# The panel below shows matches and heading for any two times, with either solver. First as a static
# picture: the two times from above, 250 and 450 ms, and two points.
#
# **See:** right, the heading is 2.5 deg off, upwards and to the right, which is one and a half
# times the stated standard deviation. The focus (left) is off by as much.

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(9.4, 4.3), width_ratios=(3, 2))
draw_backdrop(left, surface)
draw_heading(left, camera, pairs, two, drives["forward"].direction)
draw_offsets(right, [two.direction], drives["forward"].direction, [two.sd], reach=10.0)
figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=4)
plt.show()

# %% [markdown]
# **Your turn.** The line below the picture has the numbers.
#
# 1. *forward*, two points: raise the baseline step by step. From which one on is there no
#    direction, and why?
# 2. *forward* at 200 ms, *five points*: the heading is 28 deg off. Bring it within 2 deg of the
#    truth, with *pool* and the baseline alone.
# 3. *sideways*, two points, at 100 ms: the error is three times what is stated. Find the shortest
#    baseline at which it is smaller than stated.
# 4. Press play. Which parts of the image give matches, and which never do?
#
# If the environment variable `EVCALIB_DATA` names a folder with the real *slider_depth*, the panel
# offers it too. The true heading there is (1, 0, 0), to about 1 deg.

# %% tags=["nbval-ignore-output"]
from evcalib.widgets.heading import HeadingPanel

real = slider_depth()
HeadingPanel(drives | ({"slider_depth": real} if real else {}))

# %% [markdown]
# ## Exercises
#
# **1.** A camera of focal length 173 px moves straight ahead. A point 2 m away, 40 px from the
# centre, and one 4 m away at the same pixel: how far does each move in the image over 0.1 m?
#
# <details><summary>Solution</summary>
#
# The offset from the focus grows as $1/Z$: $40 \cdot 2 / 1.9 = 42.1$, so 2.1 px, and
# $40 \cdot 4 / 3.9 = 41.03$, so 1.0 px. The distance changes how far a point moves, and never the
# line on which it does.
#
# </details><br>
#
# **2.** Do matches near the focus of expansion say less about it than others? Which say most?
#
# <details><summary>Solution</summary>
#
# Near the focus a match moves by $k d$ only, where $d$ is its distance from the focus and $k$ the
# travel over the depth. Noise $\sigma$ turns its line by $\sigma / (k d)$, and at the distance $d$
# the line misses the focus by $d$ times that: $\sigma / k$, whatever $d$. So no: what counts is
# depth, since near points have a large $k$. Besides, lines should cross at large angles: matches
# all around are worth more than many on one side.
#
# </details><br>
#
# **3.** In (1), what happens to a match whose point lies exactly in the direction of motion?
#
# <details><summary>Solution</summary>
#
# It does not move: $\mathbf r_1 = \mathbf r_2 = \mathbf t$, so the normal is zero and (1) holds for
# every $\mathbf t$. Such a match carries no information. Sampson's residual divides by how far both
# bearings are from $\mathbf t$, which is zero as well; the library takes care that 0 / 0 is 0.
#
# </details>
#
# ## In the library
#
# - [`evcalib.heading.epipolar`](../evcalib/heading/epipolar.py): `two_point` and `five_point`, with
#   one type of result, and `turn_explains`.
# - [`evcalib.heading.two_views`](../evcalib/heading/two_views.py): keypoints and matches at chosen
#   times, as here.
# - [`evcalib.estimate_headings`](../evcalib/heading/_estimator.py): the chain for a recording, and
#   `HeadingEstimator` for a stream that comes in pieces.
# - [`evcalib.plots.heading`](../evcalib/plots/heading.py) and
#   [`evcalib.widgets.heading.HeadingPanel`](../evcalib/widgets/heading.py): the pictures of this
#   notebook.
# - On the command line: `evcalib headings RECORDING --camera CALIB -o headings.csv`.
#
# **Next:** [notebook 3](03_kinematics.ipynb) makes the other stream, the velocity of the body, from
# the wheels.
