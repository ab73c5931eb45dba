# %% [markdown]
# # 6. Full calibration: the call, opened up
#
# **For whom.** You have made the call of notebook 0, and want to know what it did, stage by stage,
# and how far to trust it.
#
# **What you will be able to do.**
#
# 1. run each stage on its own, and judge it against the truth,
# 2. say what a *track* of a corner knows that a heading does not,
# 3. follow the joint refinement from its one equation to its error bars,
# 4. tell where a lag of milliseconds comes from when everything is measured by events, and what
#    takes it out,
# 5. calibrate by hand, and see why the computer is better at it.
#
# **Required knowledge.** Notebooks 2 (headings), 4 (offset) and 5 (rotation). **Time.** 45 minutes.
#
# The paper ends with the rotation of notebook 5. What is told here of tracks and lags goes beyond
# it; equations are numbered on their own.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from data_tools.export import read_calibration
from data_tools.headings import open_with_camera
from data_tools.velocity_sources import read_body_velocities
from evcalib import align, estimate_headings
from evcalib.geometry import angle_between, rotation_angle, unit
from evcalib.plots import style

style.use()

# %% [markdown]
# ## Two drives
#
# The sweep of notebook 0, whose direction of travel swings without end; and *fingers*, as in the
# paper: out and back along three directions, with pauses.


# %%
from evcalib.track import velocity_track


class Drive:
    def __init__(self, name):
        home = Path("data") / name
        self.events, self.camera = open_with_camera(home / "events.h5", home / "calib.txt")
        wheels, vehicle = home / "wheels.csv", home / "vehicle.yaml"
        self.velocities = read_body_velocities(wheels, vehicle=vehicle).velocities
        self.track = velocity_track(self.velocities)
        self.truth = read_calibration(home / "truth.yaml")


drives = {name: Drive(name) for name in ("sweep", "fingers")}

# %% [markdown]
# ## Stage 1: headings
#
# Notebook 2 in one call. This time we keep the correspondences behind the headings: they are what
# the last stage lives on.

# %%
estimates = {
    name: estimate_headings(drive.events, drive.camera, keep_correspondences=True)
    for name, drive in drives.items()
}
for name, estimate in estimates.items():
    drive, headings = drives[name], estimate.headings
    body = drive.track.directions(headings.t, headings.t, drive.truth.offset)
    seen = body.any(axis=1)
    off = angle_between(headings.v[seen] @ drive.truth.R_body_cam.T, unit(body[seen]))
    print(f"{name}: {len(headings)} headings, median error {np.degrees(np.median(off)):.2f} deg")

# %% [markdown]
# **See:** one row for each reason why a window has no heading. The fingers lose theirs in the
# pauses, as they must: nothing moves, nothing is seen.

# %%
from evcalib.plots.recording import draw_gaps

figure, ax = plt.subplots(figsize=style.WIDE)
draw_gaps(ax, estimates["fingers"])
plt.show()

# %% [markdown]
# ## Stage 2: alignment
#
# Notebooks 4 and 5 in one call: the offset by the robust profile, the rotation by L1 and Tukey, the
# tests of what is observable.

# %%
aligned = {name: align(estimates[name].headings, drives[name].velocities) for name in drives}
for name, result in aligned.items():
    turn = rotation_angle(result.R_body_cam, drives[name].truth.R_body_cam)
    print(f"{name}: {result.verdict.summary}")
    print(f"    rotation off by {np.degrees(turn):.2f} deg")

assert aligned["sweep"].offset_observable
assert not aligned["fingers"].offset_observable

# %% [markdown]
# The fingers are refused. Notebook 4 says why: along a finger the direction is constant, so a
# shifted finger is the same finger; and it changes in the pauses, when there are no headings to
# notice. The rotation does not mind.
#
# Is the offset really not in the data? Look at the *speed* of the vehicle: it rises and falls along
# every finger. A camera does not see speed, only speed over depth. But the depth of one corner does
# not change much while it is watched, so whether it moves *faster or slower than before* is plain
# to see.
#
# ## Stage 3: tracks
#
# A **track** is a corner at its first sighting (its *anchor*) and at all later ones: here up to 0.7
# s of it.

# %%
from evcalib.tracks import tracks_of

tracks = {name: tracks_of(estimate.correspondences) for name, estimate in estimates.items()}
for name, found in tracks.items():
    long = int((found.length >= 6).sum())
    print(f"{name}: {len(found)} tracks, {long} of them with six sightings or more after the first")

# %% [markdown]
# Take a long track of the finger drive from the moment in which the vehicle starts. Wheels say how
# far it came between two sightings, *if* the offset is known; one unknown factor, the corner's
# distance, turns metres into pixels. Let us try the true offset, and two wrong ones, each with the
# factor that suits it best:


# %%
def way(drive, t, offset):
    """Return how far the vehicle came until some camera times [m]."""
    speed = drive.velocities.speed
    steps = np.diff(drive.velocities.t) * (speed[1:] + speed[:-1]) / 2
    return np.interp(t + offset, drive.velocities.t, np.append(0.0, np.cumsum(steps)))


def sightings(tracks, k):
    """Return first time, later times, and how far the corner had moved by then [px]."""
    rows = slice(tracks.first[k], tracks.first[k + 1])
    moved = np.linalg.norm(np.cross(tracks.r1[rows], tracks.r2[rows]), axis=1)
    return tracks.start[k], tracks.t2[rows], 100 * moved


# %% [markdown]
# (100 px is the focal length, and small angles are their sines.) The model of a track is the way
# since its first sighting, times the factor that fits best:


# %%
from evcalib.plots.full import draw_growth


def model(drive, start, t, seen, offset):
    """Return how far the corner should have moved [px], at whatever distance fits best."""
    metres = way(drive, t, offset) - way(drive, start, offset)
    return metres * (metres @ seen) / max(metres @ metres, 1e-9)


# %% [markdown]
# **See:** dots, the corner's displacement at each sighting. While the vehicle speeds up (left) or
# slows down (right) the true offset (black) follows their bend. A clock that is 0.2 s early or late
# bends too much or too little, whatever the distance.

# %%
drive, found, true = drives["fingers"], tracks["fingers"], drives["fingers"].truth.offset
speeds = [
    np.interp(t + true, drive.track.t, drive.velocities.speed) for t in (found.start, found.end)
]
bend = found.length * (speeds[1] - speeds[0])
figure, axes = plt.subplots(1, 2, figsize=style.WIDE)
for ax, k in zip(axes, (bend.argmax(), bend.argmin()), strict=True):
    start, t, seen = sightings(found, k)
    tried = {"true offset": 0.0, "0.2 s later": 0.2, "0.2 s earlier": -0.2}
    curves = {name: model(drive, start, t, seen, true + d) for name, d in tried.items()}
    draw_growth(ax, t - start, seen, curves)
plt.show()

# %% [markdown]
# One track is a hint. Some hundred of them are an answer. We sum the squared misfits of all long
# tracks over candidate offsets, a method of a few lines:


# %%
def misfit(drive, tracks, offset):
    total = 0.0
    for k in np.flatnonzero(tracks.length >= 6):
        start, t, seen = sightings(tracks, k)
        total += min(np.mean((seen - model(drive, start, t, seen, offset)) ** 2), 0.5)
    return total


candidates = np.round(np.arange(-0.5, 0.51, 0.05), 2)
losses = np.array([misfit(drive, found, offset) for offset in candidates])
print(f"best of 21 candidates: {candidates[losses.argmin()]:.2f} s, true {true:.2f} s")

# %% [markdown]
# And there is the offset that headings could not know. **See:** no ambiguity at all; a single
# valley.

# %%
figure, ax = plt.subplots(figsize=style.SMALL)
ax.plot(candidates, losses / losses.max(), "o-", color=style.BODY, ms=4, label="long tracks")
ax.axvline(true, color=style.TRUE, ls="--", label="true")
style.label(ax, "offset [s]", "misfit, relative [-]")
ax.legend()
plt.show()

# %% [markdown]
# ## The joint refinement
#
# The sketch above looks at lengths only. The real thing predicts each sighting as a point. Let
# $\mathbf b$ be the bearing of the anchor, $\mathbf e_1, \mathbf e_2$ two axes across it, $\rho$
# the inverse of the corner's distance, and
#
# $$\mathbf d_i = R^\top \int_{t_1 + t_d}^{t_i + t_d} \mathbf v_o(t)\,dt, \qquad
# \mathbf a_i = (\mathbf e_1, \mathbf e_2)^\top \mathbf d_i, \qquad z_i = \mathbf b^\top \mathbf d_i
# \tag{1}$$
#
# the camera's displacement in its own frame, across and along the bearing. The corner sits at
# $\mathbf b / \rho$, so it is seen along $\mathbf b - \rho\,\mathbf d_i$. On the plane that touches
# the sphere at $\mathbf b$ that is the point
#
# $$\mathbf y_i = \frac{-\rho\,\mathbf a_i}{1 - \rho\,z_i}. \tag{2}$$
#
# Let us check it on a corner at 2 m:

# %%
b, rho, d = unit(np.array([0.2, -0.1, 1.0])), 0.5, np.array([0.08, 0.02, 0.15])
e1 = unit(np.cross(b, [0.0, 1.0, 0.0]))
e2 = np.cross(b, e1)
seen = unit(b / rho - d)
y = np.array([e1 @ seen, e2 @ seen]) / (b @ seen)
predicted = -rho * np.array([e1 @ d, e2 @ d]) / (1 - rho * (b @ d))
print("seen and predicted:", np.round(y, 4), np.round(predicted, 4))

assert np.allclose(y, predicted)

# %% [markdown]
# Everything enters (2) at once: the *direction* of $\mathbf y$ tells the rotation, as headings do;
# its *growth* from one sighting to the next tells the offset. Four unknowns are wanted (three of
# the rotation, one offset), and each corner brings nuisances of its own: its $\rho$, and the error
# of the anchor, which shifts all sightings of the track alike. For given $R$ and $t_d$ both are
# solved for track by track, and what is left depends on the four alone (*variable projection*,
# Golub and Pereyra 1973). Four more things make it work on real tracks:
#
# - **A robust loss.** Tukey's, narrowing from 2 px to five standard deviations of a sighting.
# - **A search first.** The loss is followed over the candidates, each with its best rotation, so
#   that the refinement starts in the right valley, and other valleys that are as deep are noticed.
# - **The body's turning.** Where the wheels report a yaw rate, the camera is turned along between
#   two sightings, and by how much that rate is off is estimated too, moment by moment: a body that
#   turns unnoticed by 0.1 degrees looks like one that drifts sideways.
# - **Honest sums.** Sightings of one corner share errors, and so do corners that are watched at the
#   same time. Scores are summed over 0.1 s and correlated over 2.5 s before they become a
#   covariance (Newey and West 1987); what all sightings of a drive share is added at the end
#   (`evcalib.joint.Systematic`).

# %%
from evcalib.joint import refine_jointly

refined = {}
for name, drive in drives.items():
    start = aligned[name]
    refined[name] = refine_jointly(
        tracks[name],
        drive.velocities,
        drive.track,
        start.R_body_cam,
        start.offset,
        focal=drive.camera.fx,
    )

# %% [markdown]
# **See:** the share of loss that each candidate avoids, for both drives. The finger drive, refused
# by the alignment, has one clear peak.

# %%
from evcalib.plots.alignment import draw_curve

figure, axes = plt.subplots(1, 2, figsize=style.WIDE)
for ax, (name, joint) in zip(axes, refined.items(), strict=True):
    draw_curve(ax, joint.curve, true=drives[name].truth.offset)
    ax.set_xticks([-1, -0.5, 0, 0.5, 1])
    ax.set_title(name)
plt.show()

# %% [markdown]
# And against the truth:

# %%
for name, joint in refined.items():
    truth, sd = drives[name].truth, np.sqrt(joint.covariance[3, 3])
    late = joint.offset - truth.offset
    turn = rotation_angle(joint.R_body_cam, truth.R_body_cam)
    print(f"{name}: offset off by {1e3 * late:.1f} ms, stated standard deviation {1e3 * sd:.1f} ms")
    print(f"    rotation off by {np.degrees(turn):.2f} deg")

    assert abs(late) < 3 * sd

# %% [markdown]
# ## Before and after
#
# Two drives of a tiny camera prove little. Twelve drives at 240 x 180 pixels, eight sweeps and four
# times fingers, were calibrated from raw events, and their errors stored after the alignment of
# headings and at the end (`python notebooks/_make_drives.py stages`):

# %%
import csv
import itertools


def read(name):
    with open(f"data/{name}.csv") as file:
        return list(csv.DictReader(file))


def errors(name, motion, stage):
    """Return the errors of all drives of a motion after a stage."""
    chosen = [r for r in read("stages") if (r["motion"], r["stage"]) == (motion, stage)]
    return np.array([float(r[name]) for r in chosen])


# %% [markdown]
# How many of the drives know their offset, the median of its error, and that of the rotation:

# %%
for motion, stage in itertools.product(("sweep", "fingers"), ("headings", "tracks")):
    late = np.abs(errors("offset_error_ms", motion, stage))
    known, turn = late[np.isfinite(late)], np.median(errors("rotation_deg", motion, stage))
    milliseconds = f"{np.median(known):.1f} ms" if known.size else "unknown"
    print(f"{motion}, {stage}: {known.size} of {late.size}, {milliseconds}, {turn:.2f} deg")

# %% [markdown]
# On these sweeps the headings alone are already good to a millisecond, and the tracks mend mostly
# the rotation. The finger drives are where they are needed: from no answer to a millisecond.
#
# **See:** errors of the rotation, one line for each drive. Lines that go down got better.

# %%
figure, axes = plt.subplots(1, 2, figsize=style.WIDE, sharey=True)
for ax, motion in zip(axes, ("sweep", "fingers"), strict=True):
    both = [errors("rotation_deg", motion, stage) for stage in ("headings", "tracks")]
    ax.plot([0, 1], both, "o-", color=style.BODY, ms=5, lw=1)
    ax.set_xticks([0, 1], ["headings", "tracks"])
    ax.set(xlim=(-0.3, 1.3), ylim=(0, None))
    style.label(ax, "stage", "error of the rotation [deg]", title=motion)
plt.show()

# %% [markdown]
# ## Error bars against the truth
#
# An error bar is a promise: that 95 % of them hold the truth. `evcalib study recorded --trials 10
# --seed 1` draws drives that nothing was tuned to (motion, mounting, offset, room), simulates
# events and wheel states, and calibrates. *Rough* means noisy pixels of unequal thresholds, wheels
# that slip by 5 %, and a body that wobbles by up to 5 degrees per second.

# %%
table = read("recorded")
answered = [row for row in table if float(row["offset_observable"])]
refused = {row["drive"] for row in table} - {row["drive"] for row in answered}
group = [row["drive"] for row in answered]
column = {k: np.array([float(row[k]) for row in answered]) for k in table[0] if k != "drive"}
holds = np.abs(column["offset_error_ms"]) <= column["offset_half_width_ms"]
covers = column["rotation_deg"] <= column["rotation_radius_deg"]
print(f"{len(answered)} of {len(table)} drives answered; refused: {', '.join(sorted(refused))}")
print(f"offset held by its interval: {holds.sum()}, rotation: {covers.sum()}")

# %% [markdown]
# **See:** the error of the offset (left) with its 95 % interval, and of the rotation (right) below
# its 95 % radius. Green ones keep the promise. Straight lines and arcs are missing: they were
# refused, as they should be.

# %%
from evcalib.plots.full import draw_calibrations

figure, (left, right) = plt.subplots(1, 2, figsize=style.WIDE)
draw_calibrations(left, group, column["offset_error_ms"], column["offset_half_width_ms"])
draw_calibrations(right, group, column["rotation_deg"], column["rotation_radius_deg"])
style.label(left, "", "error of the offset [ms]")
style.label(right, "", "error of the rotation [deg]")
plt.show()

# %% [markdown]
# ## The lag
#
# A prototype of this chain was 20 to 60 ms off, always to the same side. What looks like an offset
# of the clocks was a delay in the *measurement*: corners were not where they were said to be at
# that time. At a flow of 20 px/s, one pixel is 50 ms. We go through the sources, largest first.
#
# ### 1. The age of the surface
#
# A surface drawn at time $t$ shows events of the last 50 ms or more. Who stamps its corners with
# $t$ is late by the mean age of their events. Remedy: each keypoint carries the mean time of its
# own events. Easily said, but see the next one.
#
# ### 2. The disc that gathers corner events
#
# A keypoint is a cluster: corner events of a short window, within a disc around the newest. If a
# corner sweeps more than the disc's radius in that time, the oldest events fall out, save those
# that chanced to lie ahead. So the mean place of what is left is *ahead* of its mean time. Let us
# see it in one dimension: events scatter by a pixel about a corner at 30 px/s.


# %%
def lead(sweep, radius=3.0, scatter=1.0, count=200_000):
    """Return how far the mean of gathered events is ahead of their mean time [px]."""
    rng = np.random.default_rng(1)
    since = rng.uniform(-1.0, 0.0, count)
    place = sweep * since + rng.normal(0.0, scatter, count)
    kept = np.abs(place) < radius
    return place[kept].mean() - sweep * since[kept].mean()


for sweep in (0.5, 2.0, 4.0, 8.0):
    px = lead(sweep)
    print(
        f"{sweep:.1f} px of motion in the window: {px:+.2f} px, {1000 * px / 30:+.0f} ms at 30 px/s"
    )

# %% [markdown]
# As long as the corner stays well inside of the disc there is no bias. When it sweeps as far as the
# disc reaches, the keypoint leads by a third of a pixel: some 10 ms, more at slower flow. Finger
# drives were off by 10 to 20 ms for this reason. Gathering over a shorter time helps, but leaves
# few events for each keypoint.
#
# The cure is not to measure places by corner events at all. They are good for *finding and
# matching* corners. The displacement is then measured anew, by aligning patches of two **event
# images**: sums of all signed events over the time in which the scene moves by 1.5 px, stamped with
# the middle of that time (`evcalib._event_image`; the alignment is the inverse compositional one of
# Baker and Matthews, 2004). No disc, no choice of events, no lead; and, with all events of a patch,
# a scatter of a tenth of a pixel instead of half a pixel.
#
# ### 3. The generation of events
#
# One source is left, and it sits in the pixel. An event reports that the log intensity has
# *already* changed by a threshold $C$. An edge of contrast $A$ passes: events fire when the change
# reaches $C, 2C, \dots$; their mean time is later than the middle of the edge, by half a
# threshold's worth:


# %%
def late(threshold, last_weight):
    """Return how late an edge's events are on average [% of its own duration]."""
    found = []
    for edge in np.linspace(0.5, 2.5, 4001):
        steps = np.arange(1, int(edge / threshold) + 1)
        weight = np.where(steps == steps.size, last_weight, 1.0)
        found.append(np.average(steps * threshold / edge, weights=weight) - 0.5)
    return 100 * np.mean(found)


for threshold in (0.1, 0.2, 0.4):
    plain, halved = late(threshold, 1.0), late(threshold, 0.5)
    print(f"C = {threshold}: {plain:+.1f} %; last event halved: {halved:+.1f} %")

# %% [markdown]
# The second column is the remedy. Run backwards, the same edge would report each step one threshold
# earlier, but not its last one. The mean of forward and backward counts the **last event before a
# change of polarity half**: the lag is gone to first order, without knowing $C$ or $A$. (Of edges
# that make a single event nothing can be weighed; they are why a lag remains at $C = 0.4$.)
#
# ### Does it work?
#
# Thirteen simulated drives, each with the three ways to measure displacements, against the
# simulator's truth (`python -m data_tools.lag_study`). Speeds from 0.25 to 2 m/s, cameras that look
# ahead, sideways, down and tilted, thresholds from 0.1 to 0.4, and two with noisy pixels.


# %%
def of(name):
    ways = ("corners", "images", "symmetric")
    lags = read("lag")
    return {w: np.array([float(r[name]) for r in lags if r["localisation"] == w]) for w in ways}


flow, scatter = of("flow"), of("scatter_px")
error = {way: -late_by for way, late_by in of("heading_ms").items()}
for w, off in error.items():
    rms = np.sqrt(np.mean(off**2))
    print(
        f"{w:9s} mean {off.mean():+.1f}, rms {rms:.1f} ms; scatter {np.median(scatter[w]):.2f} px"
    )

# %% [markdown]
# **See:** the error of the offset that these headings would cause, over the flow. Keypoints
# (squares) mostly lead, by up to 16 ms. Aligned event images (triangles) are all late by some
# milliseconds: the generation of events. With the last events halved (dots) most lie within 2 ms of
# zero, at a fifth of the scatter.

# %%
from evcalib.plots.full import draw_lags

figure, ax = plt.subplots(figsize=style.WIDE)
draw_lags(ax, flow, error)
plt.show()

# %% [markdown]
# Two dots stay away from zero: the drives with noisy pixels. A noise event resets its pixel, which
# from then on reports every edge late; that cannot be read off the events. So the joint refinement
# carries the lag as a **fifth unknown**: a shift of each sighting along its flow, the same for all,
# with a prior of a tenth of a pixel. Where the direction of the flow changes it is told apart from
# the offset; where it is not, its uncertainty is passed on to the offset's. That is what it found
# here:

# %%
for name, joint in refined.items():
    print(f"{name}: lag {joint.lag:.2f} px (sd {joint.lag_sd:.2f}), noise {joint.noise:.2f} px")

# %% [markdown]
# ## The cockpit
#
# Enough of algorithms. The panel below gives you the four unknowns as sliders: offset, roll, pitch,
# yaw (all zero: a camera that looks straight ahead). First as a static picture, at the truth, but
# for 10 degrees of yaw:

# %%
from evcalib.geometry import rotation_vector_to_matrix
from evcalib.plots.full import draw_cockpit

figure = plt.figure(figsize=(9.0, 4.2))
sweep, headings = drives["sweep"], estimates["sweep"].headings
R = rotation_vector_to_matrix(np.radians([0.0, 0.0, 10.0])) @ sweep.truth.R_body_cam
draw_cockpit(figure, headings, sweep.track, sweep.truth.offset, R, aligned["sweep"].curve)
plt.show()

# %% [markdown]
# **See:** yaw moves the upper dots up and down, the offset moves the blue line sideways, roll and
# pitch bend the lower dots. Your task:
#
# 1. Bring the azimuths together with *yaw* and *offset*. Which of the two can you judge better?
# 2. Now the elevations, with *pitch* and *roll*. Watch the residuals at the lower right.
# 3. How small can you make the median residual? Press **solve** and compare.
# 4. From the solution, move the offset by 0.1 s and try to make up for it by yaw alone. Why does it
#    fail here, and on which drive would it not?

# %%
from evcalib.widgets.cockpit import Cockpit

Cockpit(headings, sweep.velocities, aligned["sweep"])

# %% [markdown]
# ## Exercises
#
# **1.** A vehicle drives straight at constant speed. What do tracks tell about the offset?
#
# <details><summary>Solution</summary>
#
# Nothing. In (1) the integral of a constant velocity depends on the length of the interval alone,
# not on when it starts: $t_d$ drops out. The same holds for an arc at constant rate, where a shift
# is a rotation. `predict` of notebook 0 says so before anyone drives.
#
# </details>
#
# **2.** Why must a track have at least three sightings (anchor and two more) to say anything about
# the offset by its length?
#
# <details><summary>Solution</summary>
#
# Its distance is unknown. One displacement fixes $\rho$ for any offset; only the second, compared
# with the first, can contradict.
#
# </details>
#
# **3.** A lag of 0.1 px acts like a delay of how many milliseconds at 20 px/s, and at 100 px/s? How
# would you drive to be safe from it?
#
# <details><summary>Solution</summary>
#
# 5 ms and 1 ms. Drive faster or nearer to things; and let the flow change its direction and size
# within the drive, so that a lag in pixels and a delay in time cannot be mistaken for one another.
#
# </details>
#
# **4.** In the toy of section 2, is there still a lead if the disc is centred on the *middle* of
# the window's events, not the newest?
#
# <details><summary>Solution</summary>
#
# No, by symmetry: what falls out at the old end on one side falls out at the young end on the
# other. (Replace `abs(place)` by `abs(place + sweep / 2)`.) But the middle is what one wants to
# find.
#
# </details>
#
# ## In the library
#
# - `evcalib.calibrate` runs all stages; `evcalib.estimate_headings`, `evcalib.align`,
#   `evcalib.tracks.tracks_of` and `evcalib.joint.refine_jointly` are the stages.
# - `evcalib.kernels.joint`: equation (2), its derivatives, and the elimination of the nuisances.
# - `data_tools.recorded_drive`, `evcalib study recorded`: the drives behind the error bars.
# - `data_tools.lag_study`: the lag against the truth.
# - `evcalib.plots.full`, `evcalib.widgets.cockpit`: the pictures of this notebook.
# - From the command line: `evcalib headings`, `evcalib velocities`, `evcalib align`, or all at once
#   with `evcalib calibrate`.
#
# **Next:** notebook 7 lets the rivals run on the same data, and repeats the paper's experiments.
