# %% [markdown]
# # 2. Heading: from two images to the direction of motion
#
# **For whom.** You have corners (notebook 1) and want to know which way the camera went.
#
# **What you will learn.**
#
# 1. why points flow away from one place in the image, and how two of them reveal it,
# 2. why not to estimate a rotation that is not there: two points against five,
# 3. what a longer baseline gains, and what it costs,
# 4. why many pairs of images are better than one,
# 5. how sure a heading is, and when there is none.
#
# **Required knowledge.** The cross product, and that a camera turns pixels into directions
# (*bearings*). **Time.** 30 minutes.
#
# **Where we are.** This notebook ends with the first of the two streams that the calibration
# compares: the camera's heading over time.

# %%
import matplotlib.pyplot as plt
import numpy as np

from data_tools.matches import random_matches
from data_tools.samples import load_sample, slider_depth
from evcalib import estimate_headings
from evcalib.epipolar import five_point, turn_explains, two_point
from evcalib.geometry import angle_between, unit
from evcalib.plots import style
from evcalib.plots.heading import draw_epipolar, draw_focus, draw_matches, draw_offsets
from evcalib.two_views import Pairs, keypoints_at, matched

style.use()

# %% [markdown]
# ## The geometry
#
# A camera that does not turn moves by $\mathbf t$. A point seen at the bearing $\mathbf r_1$ before
# is seen at $\mathbf r_2$ after. The three lie in one plane, whatever the point's distance:
#
# $$\mathbf t \cdot (\mathbf r_1 \times \mathbf r_2) = 0. \tag{1}$$
#
# It is linear in $\mathbf t$, which has two unknowns if we do not ask for its length. So *two*
# points are enough: $\mathbf t$ is at a right angle to both normals. Three points at different
# depths, seen before and after a step of 0.1 m:

# %%
step = np.array([0.06, 0.0, 0.08])
points = np.array([[-1.0, 0.5, 3.0], [0.5, -0.4, 2.0], [1.5, 1.0, 6.0]])
before, after = unit(points), unit(points - step)
normals = np.cross(before, after)
print("t . (r1 x r2):", np.round(np.abs(normals @ step), 12))
direction = unit(np.cross(normals[0], normals[1]))
direction *= np.sign(direction[2])
print("direction from two points:", np.round(direction, 3))

assert np.allclose(direction, unit(step))

# %% [markdown]
# ## Two recordings
#
# A simulated camera of 240 x 180 pixels, at 0.6 m/s: once mostly *forward*, so that the place
# towards which it moves is inside the image, and once mostly *sideways*.

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
# At two times 0.2 s apart, the Arc* corners of the last 60 ms become keypoints. Each is described
# by BRIEF on the surface and matched to the most similar one of the other time, if the choice is
# mutual. Nothing is dropped in silence; the counts say what happened.

# %%
camera = drives["forward"].camera
first, second = keypoints_at(drives["forward"].events, [250_000, 450_000])
pairs = matched(camera, first, second, reach=60)
print(f"{len(first)} and {len(second)} keypoints, {len(pairs)} matches")
print(f"left out: {first.weak} with a single corner event, {first.surplus} too many")
print(f"{first.clipped} lie near the border and were described all the same")

# %% [markdown]
# **See:** most matches, drawn as strokes that end in a dot, fan out from a common place. A few
# cross the flow. They are wrong, and we cannot yet tell which.

# %%
figure, ax = plt.subplots(figsize=(5.2, 3.9))
draw_matches(ax, camera, pairs)
ax.legend(loc="lower right", frameon=True)
plt.show()

# %% [markdown]
# ## Two points, robustly
#
# `two_point` draws pairs of matches, solves (1) for each, and keeps the direction with the least
# sum of truncated squared residuals; then it refines on all matches that agree. A residual is the
# angle by which a match misses its plane (Sampson's approximation), and 1.5 px is the limit.

# %%
limit = 1.5 / camera.fx
two = two_point(pairs.r1, pairs.r2, threshold=limit, groups=pairs.groups)
off = np.degrees(angle_between(two.direction, drives["forward"].direction))
print(f"{two.inliers.sum()} of {len(pairs)} matches are inliers")
print(f"error {off:.1f} deg, standard deviation as stated {np.degrees(two.sd):.1f} deg per axis")

# %% [markdown]
# In the image, all planes of (1) meet in the direction of motion itself: the *focus of expansion*.
# **See:** green matches run along the grey epipolar lines, away from the orange cross; purple ones
# do not. The black cross is the truth.

# %%
figure, ax = plt.subplots(figsize=(5.2, 3.9))
some = np.flatnonzero(two.inliers)[::3]
draw_epipolar(ax, camera, two.direction, pairs.xy1[some])
draw_matches(ax, camera, pairs, two.inliers)
draw_focus(ax, camera, two.direction, name="found")
draw_focus(ax, camera, drives["forward"].direction, true=True, name="true")
plt.show()

# %% [markdown]
# ## The sign
#
# Equation (1) holds for $\mathbf t$ and for $-\mathbf t$. What tells them apart is that points are
# in *front* of the camera, so they flow away from where it goes (*cheirality*). Swap the images,
# which is to drive backwards, and the sign must flip:

# %%
back = two_point(pairs.r2, pairs.r1, threshold=limit, groups=pairs.groups)
between = np.degrees(angle_between(two.direction, back.direction))
print(f"the two differ by {between:.0f} deg")

assert between > 175

# %% [markdown]
# ## Five points
#
# The paper takes the essential matrix from five points. That finds a rotation too, and here is the
# price: when a camera turns a little to the left, the image shifts to the right, nearly as if the
# camera had moved sideways. With a small field of view and small motion, noise decides which of
# the two it was.
#
# One pair of images proves little. So we draw random points at 1.5 to 6 m, move a camera 0.1 m in
# some direction between forward (0 deg) and sideways (90 deg), add noise of 0.8 px, the scatter of
# real keypoints, and make every fifth match wrong.

# %%
ANGLES = (0, 15, 30, 45, 60, 75, 90)


def error_of(solver, angle, seed, count=200, outliers=0.2):
    """Return the error [deg] of one random trial, 90 if there is no result."""
    d = np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
    rng = np.random.default_rng(seed)
    pair = random_matches(camera, 0.1 * d, rng, count=count, outliers=outliers)
    found = solver(pair.before, pair.after, threshold=2 * limit)
    return 90.0 if found is None else float(np.degrees(angle_between(found.direction, d)))


# %% [markdown]
# The median of 15 trials each:

# %%
SOLVERS = {"two points": two_point, "five points": five_point}
medians = {
    name: [np.median([error_of(solver, angle, seed) for seed in range(15)]) for angle in ANGLES]
    for name, solver in SOLVERS.items()
}
for angle, median in zip(ANGLES, medians["two points"], strict=True):
    print(f"{angle:2d} deg: two points {median:.1f} deg")

assert all(np.array(medians["five points"]) > 3 * np.array(medians["two points"]))

# %% [markdown]
# And the whole chain, from events on, at full size (346 x 260, simulated), as stored by
# `python notebooks/_make_data.py tables DATA_FOLDER`; the last row is the real *slider_depth*:

# %%
rows = np.loadtxt("data/solvers.csv", delimiter=",", skiprows=1, dtype=str)
print("                        two points           five points")
for a, b in zip(rows[::2], rows[1::2], strict=True):
    cells = [f"{float(r[3]):6.2f} deg, {float(r[5]):4.0%} found" for r in (a, b)]
    print(f"{a[0]:12s} {a[1]:>3s} deg  " + "   ".join(cells))

# %% [markdown]
# **See:** in the random trials (left) two points are about ten times as exact, in every direction.
# In the whole chain (right) five points get one pair of images, as in the paper: mostly within a
# degree, but 7 deg off straight ahead, up to 20 deg in one case of ten in other directions, and
# with fewer headings. Mind the logarithmic scale.

# %%
figure, axes = plt.subplots(1, 2, figsize=(8.0, 2.9), sharey=True)
stored = {"two points": rows[:14:2], "five points": rows[1:14:2]}
looks = {"two points": ("o-", style.CAMERA), "five points": ("s--", style.MUTED)}
for name, (form, color) in looks.items():
    axes[0].plot(ANGLES, medians[name], form, color=color, label=name)
    axes[1].plot(ANGLES, [float(r[3]) for r in stored[name]], form, color=color)
axes[0].set_yscale("log")
style.label(axes[0], "direction from the axis [deg]", "median error [deg]", title="random points")
style.label(axes[1], "direction from the axis [deg]", "", title="events, whole chain")
figure.legend(loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# The two-point solver must pay somewhere: it assumes that the camera does not turn. Half a degree
# during the step is enough to spoil it. This is why the calibration drives without
# turning, and why rows of the wheel log with a large yaw rate are left out (notebook 3).

# %%
ahead = unit([0.3, 0.0, 1.0])
for degrees in (0.0, 0.5, 2.0):
    rng = np.random.default_rng(0)
    yaw = (0.0, np.radians(degrees), 0.0)
    pair = random_matches(camera, 0.1 * ahead, rng, turn=yaw, noise=0.3)
    found = two_point(pair.before, pair.after, threshold=4 * limit)
    error = np.degrees(angle_between(found.direction, ahead))
    print(f"turn by {degrees} deg: error {error:.0f} deg")

# %% [markdown]
# ## The baseline
#
# More time between the two images means more motion, so the same noise matters less. But corners
# change their looks, leave the image, and are matched less often. We move the two times apart
# around the middle of the sideways recording:

# %%
drive = drives["sideways"]
times = list(range(50_000, 750_000, 25_000))
keypoints = dict(zip(times, keypoints_at(drive.events, times), strict=True))


def pair_around(middle, baseline):
    """Return the matches of two keyframes; all times in ms."""
    ends = (keypoints[1000 * middle + side * 500 * baseline] for side in (-1, 1))
    return matched(drive.camera, *ends, reach=60)


# %% [markdown]
# The median over five middles. **See:** fewer and fewer matches, and yet the error falls. At 100 ms
# it is much larger than stated: the standard deviation knows how the matches scatter, but not what
# is wrong with all of them alike, and 8 deg of a motion of 3 px are only 0.4 px.

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
# the same middle. So put the matches of all of them into *one* fit. That is `Pairs.pooled`.
#
# Pairs share keyframes, and one corner is seen many times. `groups` tells the solver which matches
# see the same corner; otherwise it would believe itself far too sure.


# %%
def pooled_around(middle):
    """Return the matches of all pairs of 200 to 400 ms about one time."""
    return Pairs.pooled([pair_around(middle, b) for b in (200, 250, 300, 350, 400)])


one, many = pair_around(400, 300), pooled_around(400)
for name, some in {"one pair": one, "five pairs": many}.items():
    error, sd, inliers = solved(some)
    print(f"{name}: {inliers} inliers, stated {sd:.1f} deg")

# %% [markdown]
# **See:** each orange point is the heading of another middle, with bars of one stated standard
# deviation. On the left from single pairs of 200 ms, on the right pooled. The cross is the truth.

# %%
figure, axes = plt.subplots(1, 2, figsize=(7.4, 3.3))
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
# is which, and the displacement is measured between small images of events (notebook 6 tells why).

# %%
for name, drive in drives.items():
    estimate = estimate_headings(drive.events, drive.camera)
    off = np.degrees(angle_between(estimate.headings.v, drive.direction))
    print(
        f"{name}: {len(off)} headings, {len(estimate.gaps)} gaps, median {np.median(off):.1f} deg"
    )

# %% [markdown]
# Where there is no heading, the estimate says why. **See:** the headings of the sideways drive.
# Those at the ends of the recording, where only short baselines fit, are less exact. Their bars
# say so, if not quite enough for the first one.

# %%
headings = estimate.headings
figure, ax = plt.subplots(figsize=style.WIDE)
ax.errorbar(headings.t, off, np.degrees(headings.sd), fmt="o", ms=4, lw=0.8, color=style.CAMERA)
ax.set_ylim(bottom=0.0)
style.label(ax, "time [s]", "error, bars of one sd [deg]")
for gap in estimate.gaps:
    print(f"no heading at {gap.t:.2f} s: {gap.reason}")
plt.show()

# %% [markdown]
# ## How sure is a heading?
#
# Is the stated covariance honest? In random trials it can be checked. If it is, the truth lies
# outside of its 95 % ellipse in 5 % of the trials. **See:** over 0.3 m it nearly is. Over 0.1 m,
# where points move by only a few times their noise, the ellipse is too small: the covariance takes
# the geometry for linear, and for so short a motion it is not.


# %%
def outside(length, seed):
    """Tell whether the truth is outside of the 95 % ellipse."""
    truth = unit([1.0, 0.0, 1.0])
    pair = random_matches(camera, length * truth, np.random.default_rng(seed), outliers=0.2)
    found = two_point(pair.before, pair.after, threshold=2 * limit)
    off = found.direction - truth
    return off @ np.linalg.pinv(found.covariance, rcond=1e-6) @ off > 5.99


for length in (0.1, 0.3):
    print(f"{length} m: {np.mean([outside(length, seed) for seed in range(200)]):.0%} outside")

# %% [markdown]
# A stated error is only as good as the model. A camera that only *turns* has no direction of
# motion, and the solver will still find one that fits. So the chain asks whether a steady turn
# would explain the matches as well. Only if it does not is there parallax, and a heading:

# %%
for name, shift, yaw in (("moves", 0.1, 0.0), ("turns", 0.0, 0.04)):
    rng = np.random.default_rng(1)
    turn = (0.0, yaw, 0.0)
    pair = random_matches(camera, shift * ahead, rng, turn=turn, noise=0.3)
    found = two_point(pair.before, pair.after, threshold=2 * limit)
    turned = turn_explains(pair.before, pair.after, np.ones(200), found)
    print(f"a camera that {name}: {found.inliers.mean():.0%} inliers, a turn explains it: {turned}")

# %% [markdown]
# ## Try it
#
# 1. *forward*, two points: raise the baseline from 100 to 500 ms. When are there too few matches?
# 2. Now *five points*. Which baseline brings the orange cross nearest to the black one?
# 3. Tick *pool*. What does it do to either solver, in error and in what is stated?
# 4. *sideways*: the focus is outside the image. How do the epipolar lines tell where?
#
# If the environment variable `EVCALIB_DATA` names a folder with the real *slider_depth*, the panel
# offers it too. The true heading is (1, 0, 0) there, to about 1 deg.

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
# </details>
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
# </details>
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
# - `evcalib.epipolar`: `two_point`, `five_point` with one result type, `turn_explains`.
# - `evcalib.two_views`: keypoints and matches at chosen times, as used here.
# - `evcalib.estimate_headings` for a recording; `HeadingEstimator` for a stream in pieces.
# - `evcalib.plots.heading`, `evcalib.widgets.heading.HeadingPanel`: the pictures of this notebook.
# - `evcalib headings RECORDING --camera CALIB -o headings.csv` from the command line.
#
# **Next:** notebook 3 makes the other stream, the velocity of the body, from the wheels.
