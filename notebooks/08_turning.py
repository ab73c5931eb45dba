# %% [markdown]
# # 8. Turning: what it adds, and what it hides
#
# **For whom.** Your vehicle cannot help turning while it drives (a differential drive, a car), or
# you want to know where on the vehicle the camera sits.
#
# **What you will be able to do.**
#
# 1. say what a turning body does to the motion of a camera on it, in one equation,
# 2. see from sightings of corners where on the body the camera sits, to a centimetre,
# 3. calibrate such a vehicle from nothing: no heading, no rotation, no offset, no position,
# 4. tell which unknowns a circle, a turn on the spot or a straight line hides, and why,
# 5. choose a motion by the error bar that it leaves to each unknown.
#
# **Required knowledge.** Notebooks 3 (kinematics) and 6 (tracks, joint refinement). **Time.** 30
# minutes: 20 to read, 10 to play.
#
# The paper asks for a vehicle that keeps its heading, and so did notebooks 0 to 7. Most vehicles
# cannot do that. If the body turns at the rate $\omega$ about its vertical axis $\mathbf e_z$, a
# camera at the place $\mathbf p$ in the body frame moves with
#
# $$\mathbf v_e(t) = R^\top \bigl(\mathbf v_o(t + t_d) + \omega(t + t_d)\,
# \mathbf e_z \times \mathbf p\bigr) \tag{1}$$
#
# in its own frame. (The paper has the first term only; everything in this notebook goes beyond it.)
# So there are two more unknowns, $p_x$ and $p_y$. The height $p_z$ is none of them, for
# $\mathbf e_z \times \mathbf e_z = 0$: a camera on a mast moves just as one at its foot.

#
# How much is the second term? A camera sits 25 cm before the middle of the axle and 18 cm to its
# right, and the vehicle drives ahead at 0.5 m/s. By (1), the camera moves:

# %%
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from evcalib.geometry import LOOKS_FORWARD, rotation_angle, rotation_vector_to_matrix
from evcalib.plots import style

style.use()
UP, PLACE = np.array([0.0, 0.0, 1.0]), np.array([0.25, -0.18, 0.30])
for rate in (0, 5, 20, 60):
    v = np.array([0.5, 0.0, 0.0]) + np.radians(rate) * np.cross(UP, PLACE)
    print(f"at {rate:2d} deg/s: {np.degrees(np.arctan2(v[1], v[0])):5.1f} deg to the left")

# %% [markdown]
# So a gentle curve turns the camera's heading by degrees. That is bad news, if $\mathbf p$ is not
# known, and good news for finding it.
#
# ## Four motions
#
# A figure-eight; a circle; turning on the spot, to and fro; and a straight line. Each planned
# motion is a function of a swing [deg], a period [s], a speed [m/s] and a duration [s]. The course
# has most of them (`data_tools.simulation.drives.PLANS`); the others are a few lines:

# %%
from data_tools.simulation.drives import FASTEST, PLANS


def straight(swing, period, speed, duration):
    return PLANS["straight"](0.0, period, speed, duration)


def circle(swing, period, speed, duration):
    rate = min(np.radians(swing) / (0.25 * period), FASTEST)
    ahead = straight(swing, period, speed, duration)
    return replace(ahead, kind="circle", yaw_rate=lambda t: np.full_like(t, rate))


# %% [markdown]
# To simulate events takes minutes, so we begin a level above: corners in space, projected into the
# camera as it moves by, with a noise of 0.3 px, one match in ten wrong, and wheels with noise. From
# there on everything is as after real events. (`evcalib study turning` starts from raw events.)

# %%
from data_tools.simulation.recorded_drive import CAMERA
from data_tools.studies.sighting_drives import Fault, sight
from data_tools.studies.sightings import Corners
from evcalib.joint.tracks import tracks_of

R_TRUE = rotation_vector_to_matrix([0.15, 0.25, -0.35]) @ LOOKS_FORWARD
OFFSET = 0.21
PLANNED = {"figure-eight": PLANS["figure-eight"], "circle": circle}
PLANNED |= {"on the spot": PLANS["turning in place"], "straight": straight}
truth = {"camera": CAMERA, "R_body_cam": R_TRUE, "offset": OFFSET}
truth |= {"corners": Corners(noise=0.3, false=0.1), "fault": Fault(lever=tuple(PLACE))}

# %% [markdown]
# The camera is turned by 26 degrees (to the right, down, and about its axis), and its clock is
# 0.21 s behind that of the wheels.

# %%
drives, estimates, tracks = {}, {}, {}
for name, plan in PLANNED.items():
    drives[name] = sight(plan(45.0, 6.0, 0.5, 12.0), np.random.default_rng(8), **truth)
    estimates[name] = drives[name].estimate()
    tracks[name] = tracks_of(estimates[name].correspondences)
    fastest = np.degrees(np.abs(drives[name].velocities.yaw_rate).max())
    print(f"{name:13s}{len(tracks[name]):5d} corners, turns by up to {fastest:.0f} deg/s")

# %% [markdown]
# **See:** the ways of the body (blue) and of the camera (vermilion) from above; the dots are the
# start. On the figure-eight and on the circle, the two go different ways. On the spot only the
# camera moves at all. On the straight line both go the same way, wherever the camera sits.

# %%
from scipy.integrate import cumulative_trapezoid

from evcalib.plots.turning import draw_paths
from evcalib.series import dead_reckon

figure, axes = plt.subplots(1, 4, figsize=(9.4, 2.9))
for ax, (name, drive) in zip(axes, drives.items(), strict=True):
    draw_paths(ax, drive.velocities, PLACE[:2])
    ax.set_title(name)
for ax in axes[1:]:
    ax.set_ylabel("")
plt.show()

# %% [markdown]
# ## Where does the camera sit?
#
# Take a corner that is seen twice, along the bearings $\mathbf r_1$ and $\mathbf r_2$. In between
# the body came along by $\mathbf d$, in its frame at the first time, and turned by the angle
# $\psi$; the wheels tell both. With $Z_\psi$ for a turn by $\psi$ about the vertical, the camera
# moved by
#
# $$\mathbf D = \mathbf d + (Z_\psi - 1)\,\mathbf p, \qquad
# \mathbf D \cdot \bigl(R\,\mathbf r_1 \times Z_\psi R\,\mathbf r_2\bigr) = 0. \tag{2}$$
#
# The second part is the epipolar equation of notebook 2, with the turn taken out: both rays and the
# way between them lie in one plane. It holds without any heading. And it is *linear* in
# $\mathbf p$: if we knew $R$ and $t_d$, we could solve for $\mathbf p$. Let us first look, and
# compute what (2) needs:


# %%
def turned(v, angle):
    c, s, (x, y, z) = np.cos(angle), np.sin(angle), np.transpose(v)
    return np.stack([c * x - s * y, s * x + c * y, z + 0 * c], axis=1)


def between(v, tracks):
    """Return the way d and the turn of the body between the two sightings of each pair."""
    yaw, a, b = cumulative_trapezoid(v.yaw_rate, v.t, initial=0.0), tracks.t1, tracks.t2
    ends = [[np.interp(t + OFFSET, v.t, x) for x in (yaw, *dead_reckon(v).T)] for t in (a, b)]
    turn, *way = np.subtract(ends[1], ends[0])
    return turned(np.stack(way, axis=1), -np.array(ends[0][0])), turn


# %% [markdown]
# For each place of the camera on a grid: which share of all sightings meets (2) to within a pixel?


# %%
def met(drive, tracks, side):
    way, turn = between(drive.velocities, tracks)
    ray = tracks.r1 @ R_TRUE.T
    normal = np.cross(ray, turned(tracks.r2 @ R_TRUE.T, turn))
    shares = np.zeros((side.size, side.size))
    for (i, j), _ in np.ndenumerate(shares):
        p = np.tile([side[i], side[j], 0.0], (turn.size, 1))
        D = way + turned(p, turn) - p
        across = np.linalg.norm(np.cross(D, ray), axis=1)
        off = CAMERA.focal * np.abs((normal * D).sum(axis=1)) / np.maximum(across, 1e-9)
        shares[i, j] = np.mean(off < 1.0)
    return shares


# %% [markdown]
# **See:** the body from above, darker where more sightings agree; the cross is the truth. *The
# figure-eight* has one dark spot, and the camera is there. *The circle* has a line of them, and so
# has *turning on the spot*: the places on it explain what is seen equally well. *The straight
# line* knows nothing: all places are alike.

# %%
from evcalib.plots.turning import draw_places

side = np.round(np.linspace(-0.6, 0.6, 31), 2)
maps = {name: met(drives[name], tracks[name], side) for name in drives}
i, j = np.unravel_index(maps["figure-eight"].argmax(), maps["figure-eight"].shape)
print(f"figure-eight: best at x = {side[i]:.2f} m, y = {side[j]:.2f} m, true 0.25 and -0.18")
figure, axes = plt.subplots(1, 4, figsize=(9.4, 2.9), sharey=True)
for ax, (name, shares) in zip(axes, maps.items(), strict=True):
    draw_places(ax, side, side, shares, true=PLACE[:2], scale=(0.2, 0.9))
    ax.set_title(name)
for ax in axes[1:]:
    ax.set_ylabel("")
plt.show()

# %% [markdown]
# ## A start from nothing
#
# The map takes $R$ and $t_d$ for granted. But it shows how to find them. For *any* rotation and
# offset, (2) gives the best $\mathbf p$ at once. Turns about the body's vertical may change their
# order, so one more angle, the camera's yaw, comes along in closed form, too. What is left to try
# is where the body's vertical lies in the camera, 400 directions all over the sphere, and the
# offset, in steps of 0.1 s. The best candidates are polished. Nothing has to be known beforehand:

# %%
from evcalib.joint import global_start
from evcalib.kinematics.velocity_track import velocity_track

eight = drives["figure-eight"]
track = velocity_track(eight.velocities)
start = global_start(tracks["figure-eight"], eight.velocities, track, focal=CAMERA.focal)
print(f"rotation off by {np.degrees(rotation_angle(start.R_body_cam, R_TRUE)):.1f} deg")
print(f"offset off by {1e3 * abs(start.offset - OFFSET):.1f} ms")
print(f"position off by {100 * np.linalg.norm((start.position - PLACE)[:2]):.1f} cm")

# %% [markdown]
# The joint refinement of notebook 6 takes over from there, with $p_x$ and $p_y$ beside rotation and
# offset, all in one solve. What would it cost to leave them out? We start it at the truth, once
# with the camera at the body's origin, and once where it is:

# %%
from evcalib.joint import refine_jointly

given = tracks["figure-eight"], eight.velocities, track, R_TRUE, OFFSET
for words, lever in (("at the origin", 0.0 * PLACE), ("where it is", PLACE)):
    options = {"focal": CAMERA.focal, "estimate_offset": False, "lever": tuple(lever)}
    joint = refine_jointly(*given, **options)
    turn = np.degrees(rotation_angle(joint.R_body_cam, R_TRUE))
    print(f"{words}: rotation off by {turn:.1f} deg, {100 * joint.inlier_share:.0f} % followed")

# %% [markdown]
# ## The call
#
# All of this is in `evcalib.calibrate` (and `evcalib calibrate`). Nobody has to say that the
# vehicle turns: the wheels do. Here we enter after the sightings:

# %%
from evcalib.pipeline import calibrate_estimate

found = {
    name: calibrate_estimate(estimates[name], drives[name].velocities, focal=CAMERA.focal)
    for name in ("figure-eight", "circle", "on the spot")
}
best = found["figure-eight"]
for one in best.unknowns:
    bar = f"sd {one.sd:.1g} {one.unit}" if np.isfinite(one.sd) else "nothing known"
    print(f"{one.name:9s}{'determined' if one.determined else 'not determined':16s}{bar}")

# %% [markdown]
# Each unknown has a verdict of its own. Against the truth:

# %%
from evcalib.uncertainty import t_quantile

half = t_quantile(best.samples) * best.position_sd
for k, axis in enumerate("xy"):
    off = abs(best.position[k] - PLACE[k])
    print(f"{axis} off by {100 * off:.1f} cm, 95 % within {100 * half[k]:.1f} cm")
    assert off < half[k]
print(f"rotation off by {np.degrees(rotation_angle(best.R_body_cam, R_TRUE)):.1f} deg")
low, high = best.offset_interval
assert rotation_angle(best.R_body_cam, R_TRUE) < best.rotation_radius
assert low < OFFSET < high

# %% [markdown]
# **See:** the body as a grey plate with two wheels, its axes in blue, and the camera as it was
# found, a pyramid that opens to where it looks. Below it on the floor lies the ellipse that holds
# 95 % of the errors of its position, *ten times* as large as it is; the cross is the truth. The
# dotted line stands for the height: no motion in a plane shows it, so it is drawn as one would
# measure it (and tell it, with `--camera-height`).

# %%
from evcalib.plots.turning import draw_mounting

figure = plt.figure(figsize=style.SQUARE)
ax = figure.add_subplot(projection="3d", computed_zorder=False)
place = np.append(best.position[:2], PLACE[2])
draw_mounting(ax, best.R_body_cam, place, best.covariance[4:, 4:], times=10, true=PLACE)
plt.show()

# %% [markdown]
# ## What turning hides
#
# The same call on the other two motions that turn:

# %%
for name in ("circle", "on the spot"):
    print(f"{name}: {found[name].verdict.summary}")
    told = {one.name: one.determined for one in found[name].unknowns}
    print("   ", ", ".join(f"{key} {'yes' if yes else 'no'}" for key, yes in told.items()))
    assert not told["rotation"] | told["x"] | told["y"]
axis = found["circle"].unknown_axis
print(f"circle: unknown about the body axis ({', '.join(f'{abs(a):.0f}' for a in axis)})")

# %% [markdown]
# Why? Both motions turn about *one point* $\mathbf c$ all the time (the middle of the circle, or
# the body's origin). Then (1) is
#
# $$\mathbf v_e = \omega\,R^\top \bigl(\mathbf e_z \times (\mathbf p - \mathbf c)\bigr). \tag{3}$$
#
# Turn the camera by any angle about $\mathbf c$, place and looks together: nothing changes. Set it
# twice as far from $\mathbf c$: it moves twice as fast, and everything it sees may be twice as far
# away. So yaw, $p_x$ and $p_y$ are tied to each other, but none of them is known. Roll and pitch
# are, since the turning shows the vertical.
#
# Let us hold (3) against numbers. A camera, and another that is turned by 50 degrees about
# $\mathbf c$ and 1.4 times as far from it; the angle between where each looks and where it goes:


# %%
def looks_and_goes(twist, place, yaw):
    """Return the angle from where a camera looks to where it goes [deg]."""
    v = np.array([twist[0], 0.0, 0.0]) + twist[1] * np.cross(UP, place)
    return np.degrees((np.arctan2(v[1], v[0]) - yaw + np.pi) % (2 * np.pi) - np.pi)


centre, angle, times = np.array([0.0, 0.5 / np.radians(30), 0.0]), np.radians(50), 1.4
other = centre + times * rotation_vector_to_matrix(angle * UP) @ (PLACE - centre)
for twist in ((0.5, np.radians(30)), (0.25, np.radians(15)), (0.5, np.radians(-30))):
    one, two = looks_and_goes(twist, PLACE, -0.3), looks_and_goes(twist, other, angle - 0.3)
    print(f"{twist[0]:.2f} m/s, {np.degrees(twist[1]):3.0f} deg/s: {one:6.1f} and {two:6.1f} deg")

# %% [markdown]
# On the circle to the left the two are one, at whatever speed. A circle to the *right* tells them
# apart at once.
#
# **See:** the body from above in grey, the point it turns about as a blue cross, the camera in
# vermilion. All grey cameras see what it sees: the angle between where they look and where they go
# (arrow) is the same. One of them is the second camera of the cell above.

# %%
from evcalib.plots.turning import draw_trade

figure, ax = plt.subplots(figsize=(5.4, 3.6))
ways = [(angle, times), (np.radians(-25), 1.2), (np.radians(30), 0.6)]
draw_trade(ax, centre[:2], PLACE[:2], -0.3, ways)
plt.show()

# %% [markdown]
# The offset is a matter of its own. On a constant circle every moment is like every other, so it
# is hidden, as on the arcs of notebook 4. Turning on the spot at a *changing* rate shows it: the
# moment at which the scene stands still is the moment at which the wheels do.
#
# ## Before anyone drives
#
# `predict` (notebook 0) knows all of this. Here is what it says of some motions, as standard
# deviations:

# %%
from evcalib.design import Viewing, predict
from evcalib.widgets.designer import planned

MOTIONS = {name: PLANS[name] for name in ("figure-eight", "slalom", "parking")}
MOTIONS |= PLANNED
viewing = Viewing(position=(0.25, -0.2))
print(f"{'':13s}{'roll':>8s}{'pitch':>8s}{'yaw [deg]':>11s}{'offset [ms]':>13s}{'x, y [cm]':>13s}")
for name, plan in MOTIONS.items():
    p = predict(planned(plan(45.0, 9.0, 0.5, 16.0)), viewing=viewing)
    roll, pitch, yaw = np.degrees(p.rotation_sd)
    x, y = 100 * p.position_sd
    angles = f"{roll:8.2f}{pitch:8.2f}{yaw:11.2f}"
    print(f"{name:13s}{angles}{1e3 * p.offset_sd:13.1f}{x:7.1f}{y:6.1f}")

# %% [markdown]
# (A metre, a second and some hundred degrees are what was known before.) *Parking* is to and fro,
# with the wheel locked to one side, then to the other: nearly two circles. It shows $x$ well, but
# hardly $y$; exercise 2 says why.
#
# How much must a vehicle turn? We let the heading of a slalom swing by more and more.
#
# **See:** the error bars of $x$ and $y$ fall. The one of $x$ is small even for a gentle slalom: a
# shift of the camera to the front moves it *sideways* in every curve. A shift to the side only
# changes its *speed*, by $\omega\,p_y$, and of speeds a camera sees only how they change while it
# watches a corner. So $y$ wants more turning than $x$.

# %%
swings = [3, 6, 12, 24, 48]
slaloms = [planned(PLANS["slalom"](swing, 9.0, 0.5, 16.0)) for swing in swings]
sd = 100 * np.array([predict(slalom, viewing=viewing).position_sd for slalom in slaloms])
figure, ax = plt.subplots(figsize=style.SMALL)
for values, axis, look in zip(sd.T, "xy", ("o-", "s--"), strict=True):
    ax.loglog(swings, values, look, color=style.BODY, label=axis)
    print(axis, *(f"{value:6.1f}" for value in values), "cm")
ax.set_xticks(swings, swings)
ax.set_yticks([0.1, 1, 10], ["0.1", "1", "10"])
ax.minorticks_off()
style.label(ax, "swing of the heading [deg]", "standard deviation [cm]")
ax.legend()
plt.show()

# %% [markdown]
# ## Error bars against the truth
#
# One drive proves little. Twelve figure-eights, twelve slaloms of a car and twelve drives that
# strafe and turn, with mountings up to 30 degrees per axis and 40 cm off, were calibrated from
# nothing, from sightings as above, 12 s each (`python notebooks/_make_drives.py turning`):

# %%
from data_tools.files.csv_table import read_columns

table = read_columns("data/turning.csv")
known = np.isfinite(table["x_error_cm"])
print(f"{known.sum()} of {known.size} drives answered")
for name, unit in {"offset": "ms", "rotation": "deg", "x": "cm", "y": "cm"}.items():
    error, bar = (table[f"{name}_{what}_{unit}"][known] for what in ("error", "95"))
    held = int((np.abs(error) <= bar).sum())
    print(
        f"{name}: median {np.median(np.abs(error)):.2f} {unit}, held by its interval {held} times"
    )

# %% [markdown]
# (The other two, figure-eights, said that they do not know their offset.) Of 34 such intervals 32
# should hold, and 30 to 34 by chance.
#
# **See:** errors of $x$ (left) and $y$ (right), each with its 95 % interval; green ones keep the
# promise.

# %%
from evcalib.plots.full import draw_calibrations

figure, axes = plt.subplots(1, 2, figsize=(9.2, 3.2))
groups = table["motion"][known].tolist()
for ax, axis in zip(axes, "xy", strict=True):
    error, bar = (table[f"{axis}_{what}_cm"][known] for what in ("error", "95"))
    draw_calibrations(ax, groups, error, bar)
    style.label(ax, "", f"error of {axis} [cm]")
plt.show()

# %% [markdown]
# ## Choose the motion
#
# Now you. First as a static picture, what the panel below shows: the ways of body and camera; the
# body in space, with the ellipse of the position's error *five* times as large as it is; and the
# error bar of each unknown, over the limit below which it counts as shown (5 degrees, a quarter of
# the search for the offset, 5 cm).
#
# **See:** *parking*. The ellipse is a band across the body: $x$ is known, $y$ hardly. The rings
# mark the bars of the figure-eight.

# %%
from evcalib.plots.turning import draw_turning, relative_errors, turning_axes

place = np.array([0.25, -0.2, 0.3])
plans = {name: planned(MOTIONS[name](45.0, 9.0, 0.5, 16.0)) for name in ("figure-eight", "parking")}
told = {name: predict(plan, viewing=viewing) for name, plan in plans.items()}
figure = plt.figure(figsize=(9.4, 3.2))
rings = relative_errors(told["figure-eight"])
axes, parking = turning_axes(figure), told["parking"]
draw_turning(axes, plans["parking"], parking, LOOKS_FORWARD, place, times=5, before=rings)
print(parking.summary)
plt.show()

# %% [markdown]
# **Your turn.** The rings mark the bars that you began with; *hold* moves them to the bars of now.
#
# 1. *figure-eight*: lower the swing until $y$ is no longer shown. Which bar hardly minds?
# 2. *circle*: try to save the yaw with speed, duration and swing. What would you have to change?
# 3. *parking*: which slider brings $y$ nearest to its limit, and what does that do to the yaw?
# 4. *figure-eight*: move the camera onto the axle (*camera x* to 0). Which bar grows, and why?

# %%
from evcalib.widgets.turning import TurningPanel

TurningPanel(MOTIONS)

# %% [markdown]
# ## Exercises
#
# **1.** A vehicle drives a circle, always the same, but at a changing speed. What does it show?
#
# <details><summary>Solution</summary>
#
# The offset, by its changes. Yaw and position stay hidden: it still turns about one point, and (3)
# does not ask how fast.
#
# </details><br>
#
# **2.** And one that drives a circle to the left, then one to the right?
#
# <details><summary>Solution</summary>
#
# Everything but the height, if it does not stop in between. There are two turning points now, and
# directions of motion leave one freedom: the camera may go along the circle through both of these
# points and its own place, while its yaw turns along (from every place on that circle the two
# points are seen under the same angle). Near the camera of this notebook, that circle runs along
# $y$.
#
# Corners that are watched during the change put an end to it: they compare how fast the camera goes
# on either circle. For the *circle* of the table above, half of the time to each side, `predict`
# gives 2.6 cm for $y$ if the wheel is thrown over at full speed, and 47 cm if the vehicle slows
# down to a stop for it within a second. That is also what ails *parking*.
#
# </details><br>
#
# **3.** The velocities that a vehicle tells are those of its front axle's middle, but its log calls
# them those of the rear axle. Does the calibration notice?
#
# <details><summary>Solution</summary>
#
# Not by itself. In (1), $\mathbf p$ is the place of the camera *as seen from the point whose
# velocity is told*. If that point is half a metre further ahead, $p_x$ comes out half a metre
# shorter, and everything fits. It is noticed if you give the position that you measured
# (`--camera-position`): the two contradict each other, and the verdict says by how much.
#
# </details><br>
#
# **4.** All steering angles are off by one degree, so all velocities are told turned by one degree.
# While the body keeps its heading, that looks like a camera that is turned. Does turning show the
# difference?
#
# <details><summary>Solution</summary>
#
# No, as long as the position is unknown. With $Z$ for the turn of all velocities,
# $Z\mathbf v_o + \omega\,\mathbf e_z \times \mathbf p = Z(\mathbf v_o + \omega\,\mathbf e_z \times
# Z^\top\mathbf p)$, for turns about the vertical go with the cross product. So it is a turn of the
# body frame as a whole, and takes the position along. A position that was *measured* would show
# it, by one degree of its distance from the origin: 5 mm at 0.3 m, hardly more than a tape measure
# is good for.
#
# </details>
#
# ## In the library
#
# - [`evcalib.calibrate`](../evcalib/pipeline/_calibrate.py): turning included; `unknowns` of what
#   it returns has a verdict for each
#   ([`evcalib.pipeline.Unknown`](../evcalib/pipeline/_position.py)).
# - [`evcalib.joint.global_start`](../evcalib/joint/_global_start.py) and
#   [`evcalib.kernels.joint.global_start`](../evcalib/kernels/joint/global_start.py): equation (2)
#   in closed form.
# - [`evcalib.joint.refine_jointly`](../evcalib/joint/_refine.py) with `estimate_position`.
# - [`evcalib.design.predict`](../evcalib/design/_prediction.py): what a motion will tell.
# - [`data_tools.studies.turning`](../data_tools/studies/turning.py): `evcalib study turning`, from
#   raw events;
#   [`data_tools.studies.sighting_drives`](../data_tools/studies/sighting_drives.py): the drives of
#   this notebook.
# - [`evcalib.plots.turning`](../evcalib/plots/turning.py),
#   [`evcalib.widgets.turning`](../evcalib/widgets/turning.py): the pictures and the panel.
# - On the command line: `evcalib calibrate --help` has `--camera-position` and `--camera-height`.
#
# **Next:** your own vehicle. [0. Quickstart](00_quickstart.ipynb) has the call, and a designer of
# drives with way points.
