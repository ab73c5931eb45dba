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
# 3. follow the joint refinement from its two equations to its error bars,
# 4. tell where a lag of milliseconds comes from when everything is measured by events, and what
#    takes it out,
# 5. calibrate by hand, and see by how much the computer is better at it.
#
# **Required knowledge.** Notebooks 2 (headings), 4 (offset) and 5 (rotation). **Time.** 45 minutes:
# 30 to read, 15 to play.
#
# *What happens between raw events and a calibration, and what is the result worth?* The goal is the
# one of the paper, an offset $t_d$ and a rotation $R$ such that
#
# $$\mathbf v_o(t + t_d) = R\,\mathbf v_e(t), \tag{1}$$
#
# with the vehicle's velocity $\mathbf v_o$ in the body frame and the direction $\mathbf v_e$ in
# which the camera sees itself move. The paper ends with stage 2 below. Tracks, the joint refinement
# and the cure for the lag (stages 3 and 4) go beyond it; all equations but (1) are ours.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.runs.export import read_calibration
from data_tools.runs.headings import open_with_camera
from evcalib import align
from evcalib.geometry import angle_between, rotation_angle, unit
from evcalib.heading import estimate_headings
from evcalib.plots import style

style.use()

# %% [markdown]
# ## Two drives
#
# We use the *sweep* of notebook 0, whose direction of travel swings all the time, and *fingers*, as
# in the paper: out and back along three directions, with pauses. Both are simulated, so that the
# truth is known. A small class opens what a drive leaves:


# %%
from evcalib.kinematics.velocity_track import velocity_track


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
# Notebook 2 in one call: the direction of the camera's motion, some 20 times per second. This time
# we keep the correspondences behind the headings (which corner was seen where, and when): they are
# what the last stage lives on.

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
# **See:** the top row are headings, the rows below windows of time without one, by reason. The
# fingers lose theirs in the pauses, as they must: nothing moves, so nothing is seen.

# %%
from evcalib.plots.recording import draw_gaps

figure, ax = plt.subplots(figsize=style.WIDE)
draw_gaps(ax, estimates["fingers"])
plt.show()

# %% [markdown]
# ## Stage 2: alignment
#
# Notebooks 4 and 5 in one call: the offset by the robust score, the rotation by L1 and Tukey, and
# the tests of what this drive can tell.

# %%
aligned = {name: align(estimates[name].headings, drives[name].velocities) for name in drives}
for name, result in aligned.items():
    turn = rotation_angle(result.R_body_cam, drives[name].truth.R_body_cam)
    print(f"{name}: {result.verdict.summary}")
    print(f"    rotation off by {np.degrees(turn):.2f} deg")

assert aligned["sweep"].offset_observable
assert not aligned["fingers"].offset_observable

# %% [markdown]
# The offset of the fingers is refused. Notebook 4 says why: along a finger the direction is
# constant, so a shifted finger is the same finger; and it changes in the pauses, when there are no
# headings to notice. The rotation does not mind.
#
# Is the offset really not in the data? Look at the *speed* of the vehicle: it rises and falls along
# every finger. A camera does not see speed, only speed over distance. But the distance of one
# corner does not change much while it is watched, so whether it moves *faster or slower than
# before* is plain to see.
#
# ## Stage 3: tracks
#
# A **track** is a corner at its first sighting (its *anchor*) and at all later ones, here over up
# to 0.7 s.

# %%
from evcalib.joint.tracks import tracks_of

tracks = {name: tracks_of(estimate.correspondences) for name, estimate in estimates.items()}
for name, found in tracks.items():
    long = int((found.length >= 6).sum())
    print(f"{name}: {len(found)} tracks, {long} of them with six sightings or more after the first")

# %% [markdown]
# Take a long track of the finger drive while the vehicle speeds up. The wheels say how far it came
# between two sightings, *if* the offset is known. The track says how far the corner moved in the
# image. (100 px is the focal length; for small angles the sine is the angle.)


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
# One unknown factor, which stands for the corner's distance, turns metres into pixels. So the model
# of a track is the way since its first sighting, times the factor that fits best:


# %%
from evcalib.plots.full import draw_growth


def model(drive, start, t, seen, offset):
    """Return how far the corner should have moved [px], at whatever distance fits best."""
    metres = way(drive, t, offset) - way(drive, start, offset)
    return metres * (metres @ seen) / max(metres @ metres, 1e-9)


# %% [markdown]
# We pick the two tracks that are bent most: one while the vehicle speeds up, one while it slows
# down.

# %%
drive, found, true = drives["fingers"], tracks["fingers"], drives["fingers"].truth.offset
speeds = [
    np.interp(t + true, drive.track.t, drive.velocities.speed) for t in (found.start, found.end)
]
bend = found.length * (speeds[1] - speeds[0])
print(f"faster by {np.ptp([s[bend.argmax()] for s in speeds]):.2f} m/s,", end=" ")
print(f"slower by {np.ptp([s[bend.argmin()] for s in speeds]):.2f} m/s")

# %% [markdown]
# **See:** dots, the corner's displacement at each sighting. Whether the vehicle speeds up (left) or
# slows down (right), the true offset (black) follows their bend. A clock that is 0.2 s early or
# late bends too much or too little, whatever the distance of the corner.

# %%
figure, axes = plt.subplots(1, 2, figsize=style.WIDE)
for ax, k in zip(axes, (bend.argmax(), bend.argmin()), strict=True):
    start, t, seen = sightings(found, k)
    tried = {"true offset": 0.0, "0.2 s later": 0.2, "0.2 s earlier": -0.2}
    curves = {name: model(drive, start, t, seen, true + d) for name, d in tried.items()}
    draw_growth(
        ax, t - start, seen, curves, title="speeding up" if ax is axes[0] else "slowing down"
    )
plt.show()

# %% [markdown]
# One track is a hint. Some hundred of them are an answer. For each candidate offset we sum the
# squared misfits of all long tracks (none counts more than 0.5 px², so that wild ones do no harm).
# A method of a few lines:


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
# And there is the offset that headings could not know. **See:** one valley, and no other one nearly
# as deep.

# %%
figure, ax = plt.subplots(figsize=style.SMALL)
ax.plot(candidates, losses / losses.max(), "o-", color=style.BODY, ms=4, label="long tracks")
ax.axvline(true, color=style.TRUE, ls="--", label="true")
style.label(ax, "offset [s]", "misfit, relative [-]")
ax.legend()
plt.show()

# %% [markdown]
# ## Stage 4: the joint refinement
#
# The sketch above looks at lengths only. The real thing predicts each sighting as a point. Let
# $\mathbf b$ be the bearing of the anchor (the unit vector towards the corner), $\mathbf e_1,
# \mathbf e_2$ two axes across it, $\rho$ the inverse of the corner's distance, and
#
# $$\mathbf d_i = R^\top \int_{t_1 + t_d}^{t_i + t_d} \mathbf v_o(t)\,dt, \qquad
# \mathbf a_i = (\mathbf e_1, \mathbf e_2)^\top \mathbf d_i, \qquad z_i = \mathbf b^\top \mathbf d_i
# \tag{2}$$
#
# the camera's displacement in its own frame, across and along the bearing. The corner sits at
# $\mathbf b / \rho$, so it is seen along $\mathbf b - \rho\,\mathbf d_i$. On the plane that touches
# the sphere at $\mathbf b$ that is the point
#
# $$\mathbf y_i = \frac{-\rho\,\mathbf a_i}{1 - \rho\,z_i}. \tag{3}$$
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
# Both unknowns are in (3). The *direction* of $\mathbf y_i$ tells the rotation, as headings do; its
# *growth* from one sighting to the next tells the offset. Four numbers are wanted: three of the
# rotation, one offset. Each corner brings unknowns of its own, which nobody wants: its $\rho$, and
# the error of its anchor, which shifts all sightings of the track alike. For given $R$ and $t_d$
# these are found track by track in closed form, and what is left depends on the four alone
# (*variable projection*, Golub and Pereyra 1973). Four more things make it work on real tracks:
#
# - **A robust loss.** Tukey's, narrowing from 2 px to five standard deviations of a sighting.
# - **A search first.** The loss is computed for all candidate offsets, each with its best rotation.
#   So the refinement starts in the right valley, and another valley that is as deep is noticed.
# - **The body's turning.** Where the wheels report a yaw rate, the camera is turned along between
#   two sightings. By how much that rate is off is estimated too, moment by moment: a body that
#   turns by 0.1 degrees without telling looks like one that drifts sideways.
# - **Honest sums.** Sightings of one corner share errors, and so do corners that are watched at the
#   same time. So they do not count as independent: what they say is summed over 0.1 s, and
#   correlations over 2.5 s are allowed for (Newey and West 1987). What all sightings of a drive
#   share is added at the end (`evcalib.joint.Systematic`).
#
# In the library it is one call:

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
# **See:** how well the sightings are met at each candidate, for both drives. The finger drive,
# refused by the alignment, has one clear peak.

# %%
from evcalib.plots.alignment import draw_curve

figure, axes = plt.subplots(1, 2, figsize=style.WIDE)
for ax, (name, joint) in zip(axes, refined.items(), strict=True):
    draw_curve(ax, joint.curve, true=drives[name].truth.offset)
    ax.set_xticks([-1, -0.5, 0, 0.5, 1])
    ax.set_title(name)
plt.show()

# %% [markdown]
# `finish` puts the refinement in the place of the alignment, and judges anew what the drive can
# tell. This is what `evcalib.calibrate` returns. Against the truth:

# %%
from evcalib.pipeline import finish

final = {
    name: finish(aligned[name], refined[name], estimates[name].headings, drive.track, 1.0)
    for name, drive in drives.items()
}
for name, found in final.items():
    truth = drives[name].truth
    late, turn = found.offset - truth.offset, rotation_angle(found.R_body_cam, truth.R_body_cam)
    print(f"{name}: {found.verdict.summary}")
    print(f"    offset off by {1e3 * late:.1f} ms, stated sd {1e3 * found.offset_sd:.1f} ms")
    print(f"    rotation off by {np.degrees(turn):.2f} deg")
    assert abs(late) < 3 * found.offset_sd

# %% [markdown]
# And what was *promised*? Notebook 0 predicts the error bar of a drive from its wheel log, for 20
# corners that are seen to 0.3 px. Here the camera has a focal length of 100 px only:

# %%
from evcalib.design import Viewing, predict

for name, found in final.items():
    drive, found_tracks = drives[name], tracks[name]
    promised = predict(drive.velocities, viewing=Viewing(focal=drive.camera.fx)).offset_sd
    late = abs(found.offset - drive.truth.offset)
    print(f"{name}: promised {1e3 * promised:.1f} ms,", end=" ")
    print(f"stated {1e3 * found.offset_sd:.1f} ms, off by {1e3 * late:.1f} ms")
    at_once = (found_tracks.end - found_tracks.start).sum() / np.ptp(drive.track.t)
    print(f"    {at_once:.0f} corners at once, each seen to {refined[name].noise:.2f} px")

# %% [markdown]
# So a promise is right within a factor of two or so. It knows the motion, but neither the room nor
# how corners fare in it. The sweep sees many more corners than 20 and each of them finer, so its
# error bar is shorter than promised. That of the fingers is longer: it counts, too, by how much
# stretches of a drive contradict each other (the last point of the list above).
#
# ## Before and after
#
# Two drives of a tiny camera prove little. Twelve drives at 240 x 180 pixels, eight sweeps and four
# times fingers, were calibrated from raw events, and their errors stored after the alignment of
# headings and at the end (`python notebooks/_make_drives.py stages`):

# %%
from data_tools.files.csv_table import read_columns

stages = read_columns("data/stages.csv")


def errors(name, motion, stage):
    """Return the errors of all drives of a motion after a stage."""
    return stages[name][(stages["motion"] == motion) & (stages["stage"] == stage)]


# %% [markdown]
# For each motion and stage: how many of the drives know their offset, the median of its error, and
# the median error of the rotation.

# %%
pairs = [(m, s) for m in ("sweep", "fingers") for s in ("headings", "tracks")]
for motion, stage in pairs:
    late = np.abs(errors("offset_error_ms", motion, stage))
    known, turn = late[np.isfinite(late)], np.median(errors("rotation_deg", motion, stage))
    milliseconds = f"{np.median(known):.1f} ms" if known.size else "unknown"
    print(f"{motion}, {stage}: {known.size} of {late.size}, {milliseconds}, {turn:.2f} deg")

# %% [markdown]
# On these sweeps the headings alone are already good to a millisecond, and the tracks mend mostly
# the rotation. The finger drives are where they are needed: from no answer to a millisecond.
#
# **See:** errors of the rotation, one line for each drive. Most lines go down, not all.

# %%
from evcalib.plots.full import draw_stages

figure, axes = plt.subplots(1, 2, figsize=style.WIDE, sharey=True)
names = ("headings", "tracks")
for ax, motion in zip(axes, ("sweep", "fingers"), strict=True):
    draw_stages(ax, names, [errors("rotation_deg", motion, n) for n in names], title=motion)
axes[1].set_ylabel("")
plt.show()

# %% [markdown]
# ## Error bars against the truth
#
# An error bar is a promise: 95 of 100 hold the truth. `evcalib study recorded --trials 10 --seed 1`
# draws drives to which nothing was tuned (motion, mounting, offset, room), simulates events and
# wheel states, and calibrates; its table is stored. *Rough* means noisy pixels of unequal
# thresholds, wheels that slip by 5 %, and a body that wobbles by up to 5 degrees per second.

# %%
table = read_columns("data/recorded.csv")
known = table["offset_observable"] == 1
refused = sorted(set(table["drive"]) - set(table["drive"][known]))
answered = {name: column[known] for name, column in table.items()}
holds = np.abs(answered["offset_error_ms"]) <= answered["offset_half_width_ms"]
covers = answered["rotation_deg"] <= answered["rotation_radius_deg"]
print(f"{known.sum()} of {known.size} drives answered; refused: {', '.join(refused)}")
print(f"offset held by its interval: {holds.sum()}, rotation: {covers.sum()}")

# %% [markdown]
# Of 40 such intervals 38 should hold, and 35 to 40 by chance.
#
# **See:** the error of the offset (left) with its 95 % interval, and of the rotation (right) below
# its 95 % radius. Green ones keep the promise. Straight lines and arcs are missing: they were
# refused, as they should be.

# %%
from evcalib.plots.full import draw_calibrations

figure, (left, right) = plt.subplots(1, 2, figsize=(9.2, 3.4))
drawn = answered["drive"].tolist()
draw_calibrations(left, drawn, answered["offset_error_ms"], answered["offset_half_width_ms"])
draw_calibrations(right, drawn, answered["rotation_deg"], answered["rotation_radius_deg"])
style.label(left, "", "error of the offset [ms]")
style.label(right, "", "error of the rotation [deg]")
plt.show()

# %% [markdown]
# ## The lag
#
# An early version of this chain was 20 to 60 ms off, always to the same side. What looked like an
# offset of the clocks was a delay in the *measurement*: corners were not where they were said to be
# at that time. Where the image moves by 20 px/s (its *flow*), one pixel is 50 ms. We go through the
# sources of this lag, the largest first.
#
# ### 1. The age of the surface
#
# A surface (notebook 1) drawn at time $t$ shows events of the last 50 ms or more. If its corners
# are stamped with $t$, they are late by the mean age of their events. Remedy: each corner carries
# the mean time of its own events. That is easily said, but it brings up the next one.
#
# ### 2. The disc that gathers corner events
#
# A *keypoint* is a cluster: the corner events of a short window of time, within a disc around the
# newest. If the corner moves by more than the disc's radius in that time, the oldest events fall
# out, save those that happened to lie ahead. So the mean place of what is left is *ahead* of where
# the corner was at its mean time. Let us see it in one dimension: events scatter by a pixel about a
# corner that moves at 30 px/s.


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
    print(f"moves {sweep:.1f} px in the window: ahead by {px:+.2f} px, {1000 * px / 30:+.0f} ms")

# %% [markdown]
# As long as the corner stays well inside the disc there is no lead. When it moves as far as the
# disc reaches, the keypoint leads by a third of a pixel: some 10 ms, more at slower flow. Finger
# drives were off by 10 to 20 ms for this reason. Gathering over a shorter time helps, but leaves
# few events for each keypoint.
#
# The cure is not to measure places by corner events at all. They are good for *finding and
# matching* corners. Their displacement is then measured anew, with all events around them. An
# **event image** is the sum of all signed events (ON +1, OFF -1) over the time in which the scene
# moves by 1.5 px, and carries the middle of that time. A patch of one event image is shifted until
# it lies on the other (`evcalib.features.align_patches`, after Baker and Matthews, 2004).
# There is no disc, no choice of events, and so no lead; and the scatter is a tenth of a pixel
# instead of half a pixel.
#
# ### 3. The generation of events
#
# One source is left, and it sits in the pixel. An event reports that the logarithm of the
# brightness has *already* changed by a threshold $C$. When an edge of contrast $A$ passes, events
# come when the change has reached $C, 2C, \dots$; so their mean time is later than the middle of
# the edge, by the time that half a threshold takes:


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
# The second column is the remedy. Imagine time running backwards: the same edge would report each
# step one threshold earlier, but not its last one. The mean of the forward and the backward edge is
# an edge whose **last event before a change of polarity counts half**. With these weights the lag
# is gone to first order, without knowing $C$ or $A$. (An edge that makes a single event leaves
# nothing to weigh; such edges are why a lag remains at $C = 0.4$.)
#
# ### Does it work?
#
# Thirteen simulated drives, each with the three ways to measure displacements, against the
# simulator's truth (`evcalib study lag`). Speeds from 0.25 to 2 m/s, cameras that
# look ahead, sideways, down and tilted, thresholds from 0.1 to 0.4, and two with noisy pixels.

# %%
lags = read_columns("data/lag.csv")
ways = ("corners", "images", "symmetric")
flow = {w: lags["flow"][lags["localisation"] == w] for w in ways}
error = {w: -lags["heading_ms"][lags["localisation"] == w] for w in ways}
scatter = {w: lags["scatter_px"][lags["localisation"] == w] for w in ways}
for w, off in error.items():
    rms = np.sqrt(np.mean(off**2))
    px = np.median(scatter[w])
    print(f"{w:9s} mean {off.mean():+.1f}, rms {rms:.1f} ms; scatter {px:.2f} px")

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
# Enough of algorithms: now you calibrate. The panel below gives you the four unknowns as sliders:
# offset, roll, pitch and yaw (all zero for a camera that looks straight ahead). It needs, for each
# drive, the two streams, the solution, and the truth to compare with:

# %%
from evcalib.widgets.cockpit import Cockpit, Scorer, SolvedStreams

recordings = {
    name: SolvedStreams(estimates[name].headings, drive.velocities, final[name], drive.truth)
    for name, drive in drives.items()
}

# %% [markdown]
# Your place has a **score**: equation (3) of notebook 4 at *your* offset and *your* rotation. It
# cannot be higher than the curve on the upper right, which has at each offset the score of the best
# rotation. So you climb twice: up to the curve by the angles, and along the curve to its peak by
# the offset.
#
# **See:** the panel as a static picture, at the true offset but with a yaw that is wrong by 10
# degrees. The dots stand 10 degrees above the line (upper left), the residuals are 10 degrees
# (lower right), and the orange dot is below the curve. (The curve has a step at -0.8 s: the best
# angles are searched by climbing from a start, and further left the climb ends on a lower hill.)

# %%
from evcalib.geometry import rotation_vector_to_matrix
from evcalib.plots.full import cockpit_axes, draw_cockpit

sweep, headings = drives["sweep"], estimates["sweep"].headings
R = rotation_vector_to_matrix(np.radians([0.0, 0.0, 10.0])) @ sweep.truth.R_body_cam
place = sweep.truth.offset, Scorer(headings, sweep.track, 1.0)(sweep.truth.offset, R)
axes = cockpit_axes(plt.figure(figsize=(9.2, 4.4)))
draw_cockpit(axes, headings, sweep.track, R, aligned["sweep"].curve, [place])
plt.show()

# %% [markdown]
# **Your turn.** Yaw moves the upper dots up and down, the offset moves the blue line sideways, roll
# and pitch bend the lower dots. **solve** goes to the computed solution and says how far you were
# off; the play button then shows the way from your place to it; **reset** starts anew.
#
# 1. *sweep*: bring the azimuths together with *yaw* and *offset*, then the elevations with *pitch*
#    and *roll*. You have reached the goal when the bar of the score turns green.
# 2. Press **solve**. Which of the four could you judge best? Play the way from your hand to the
#    solution, and watch the directions fall together.
# 3. From the solution, move the offset by 0.1 s and try to make up for it by yaw alone. Why does it
#    fail here, and on which drive would it not?
# 4. *fingers*: find the angles, then the offset. Look at the curve: why can no hand do it? What
#    does **solve** know that the picture does not show?

# %%
Cockpit(recordings)

# %% [markdown]
# ## Exercises
#
# **1.** A vehicle drives straight at constant speed. What do tracks tell about the offset?
#
# <details><summary>Solution</summary>
#
# Nothing. In (2) the integral of a constant velocity depends on the length of the interval alone,
# not on when it starts: $t_d$ drops out. The same holds for an arc at constant rate, where a shift
# is a rotation. `predict` of notebook 0 says so before anyone drives.
#
# </details><br>
#
# **2.** Why must a track have at least three sightings (anchor and two more) to say anything about
# the offset by its length?
#
# <details><summary>Solution</summary>
#
# Its distance is unknown. One displacement fixes $\rho$ for any offset; only the second, compared
# with the first, can contradict.
#
# </details><br>
#
# **3.** A lag of 0.1 px acts like a delay of how many milliseconds at 20 px/s, and at 100 px/s? How
# would you drive to be safe from it?
#
# <details><summary>Solution</summary>
#
# 5 ms and 1 ms. Drive faster or nearer to things; and let the flow change its direction and size
# within the drive, so that a lag in pixels and a delay in time cannot be mistaken for one another.
#
# </details><br>
#
# **4.** In the toy of section 2, is there still a lead if the disc is centred on the *middle* of
# the window's events, not the newest?
#
# <details><summary>Solution</summary>
#
# No, by symmetry: what falls out at the old end on one side falls out at the young end on the
# other. (Replace `abs(place)` by `abs(place + sweep / 2)`: the lead is 0.00 px at each speed.) But
# where the middle is, is what one wants to find out.
#
# </details>
#
# ## In the library
#
# - [`evcalib.calibrate`](../evcalib/pipeline/_calibrate.py) runs all stages. The stages are
#   [`evcalib.estimate_headings`](../evcalib/heading/_estimator.py),
#   [`evcalib.align`](../evcalib/alignment/_align.py),
#   [`evcalib.joint.tracks.tracks_of`](../evcalib/joint/tracks.py),
#   [`evcalib.joint.refine_jointly`](../evcalib/joint/_refine.py) and
#   `finish` in [the pipeline's assessment](../evcalib/pipeline/_assessment.py).
# - [`evcalib.kernels.joint.observations`](../evcalib/kernels/joint/observations.py): equation (3),
#   its derivatives, and the elimination of each corner's own unknowns.
# - [`data_tools.simulation.recorded_drive`](../data_tools/simulation/recorded_drive.py) and
#   `evcalib study recorded`: the drives behind the error bars;
#   [`data_tools.studies.lag`](../data_tools/studies/lag.py): the lag
#   against the truth.
# - [`evcalib.plots.full`](../evcalib/plots/full.py),
#   [`evcalib.widgets.cockpit`](../evcalib/widgets/cockpit.py): the pictures and the cockpit.
# - From the command line: `evcalib headings`, `evcalib velocities`, `evcalib align`, or all at once
#   with `evcalib calibrate`.
#
# **Next:** [7. Experiments](07_experiments.ipynb) lets the rivals run on the same data, and repeats
# the paper's experiments.
