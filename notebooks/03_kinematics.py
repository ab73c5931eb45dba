# %% [markdown]
# # 3. Kinematics: from wheel states to the velocity of the body
#
# **For whom.** You have a vehicle that can drive in any direction, a log of its wheels, and no
# background in robotics.
#
# **What you will be able to do.**
#
# 1. say what one wheel tells about the motion of the whole body,
# 2. combine all wheels, and say what it means when they disagree (*slip*),
# 3. say when the short formula of the paper is right, and how wrong it is otherwise,
# 4. treat swerve, mecanum and omni wheels as one problem with three matrices,
# 5. turn a log of wheels into the velocities that the calibration needs.
#
# **Required knowledge.** Vectors in the plane, and least squares as an idea.
#
# **Time.** 30 minutes: 20 of reading, 10 of playing with the panel.
#
# The question: how does the body move, given what its wheels do? The body's axes are X forward, Y
# to the left and Z up. A rigid body in the plane moves with three numbers, its *twist*: the
# velocity $(v_x, v_y)$ of the point where the axes meet, and the yaw rate $\omega$, positive
# counter-clockwise. A point of the body at $(x, y)$ then moves with the velocity
#
# $$\mathbf u = \begin{pmatrix} v_x - \omega\,y \\ v_y + \omega\,x \end{pmatrix}. \tag{1}$$
#
# The calibration compares two streams of directions. Notebook 2 made the camera's; this notebook
# makes the other one, the velocity of the body $\mathbf v_o(t)$, from the wheels.

# %%
import math
import tempfile
import textwrap
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from data_tools.logs import vehicle_files, wheel_logs
from evcalib.errors import InputError
from evcalib.kinematics import Mecanum, Omni, OmniWheel, Swerve, Wheel, WheelLog, WheelStates
from evcalib.plots import draw_motion, draw_velocity_log, explain_motion, style

style.use()

# %% [markdown]
# ## What one wheel tells
#
# A wheel that rolls without slipping must point along $\mathbf u$ at the place where it touches the
# ground, and run at the speed $\lVert\mathbf u\rVert$. So a wheel that both steers and drives
# *measures* $\mathbf u$ there. A vehicle with four such wheels is called a *swerve* drive:

# %%
places = {"fl": (0.30, 0.25), "fr": (0.30, -0.25), "rl": (-0.30, 0.25), "rr": (-0.30, -0.25)}
swerve = Swerve(tuple(Wheel(name, x, y) for name, (x, y) in places.items()))

# %% [markdown]
# Let it spin on the spot at 1 rad/s. By (1) the front left wheel moves with $(-0.25, 0.30)$ m/s:
# backwards and to the left, at a right angle to its radius. `wheel_states` says the same as a
# speed and an angle.

# %%
spin = swerve.wheel_states(v=[[0.0, 0.0]], yaw_rate=[1.0])
speed, angle = spin.speed[0, 0], spin.steer[0, 0]
print(f"front left: {speed:.4f} m/s at {math.degrees(angle):.2f} deg")

assert math.isclose(speed, math.hypot(0.25, 0.30))
assert math.isclose(angle, math.atan2(0.30, -0.25))

# %% [markdown]
# Four motions of the same vehicle, seen from above. Orange arrows are what the wheels measure,
# drawn as the way they go in 0.3 s. The thick blue arrow is the velocity of the body, and the blue
# cross is the point about which it turns.
#
# **See:** only if nothing turns are all orange arrows equal. In a curve, each wheel stands at a
# right angle to the line from it to the cross.

# %%
from evcalib.plots.kinematics import draw_motions

cases = {"forward": (1, 0, 0), "crab": (0.7, 0.7, 0), "spin": (0, 0, 2), "curve": (0.8, 0, 1.4)}
states = {name: swerve.wheel_states([[vx, vy]], [w]) for name, (vx, vy, w) in cases.items()}
figure, axes = plt.subplots(1, 4, figsize=(9.4, 2.9), sharey=True)
draw_motions(axes, {name: (swerve, s) for name, s in states.items()})
explain_motion(figure)
plt.show()

# %% [markdown]
# ## All wheels together
#
# Now the other way round: given what all wheels measure, $\mathbf u_1$ to $\mathbf u_k$, which
# twist explains them? Four wheels give eight numbers for three unknowns. Stack (1) for all wheels
# into one matrix,
#
# $$\begin{pmatrix} \mathbf u_1 \\ \vdots \\ \mathbf u_k \end{pmatrix} \approx
# H \begin{pmatrix} v_x \\ v_y \\ \omega \end{pmatrix}, \qquad
# H_i = \begin{pmatrix} 1 & 0 & -y_i \\ 0 & 1 & x_i \end{pmatrix}, \tag{2}$$
#
# and take the least-squares solution. (This is ours; the paper has the average of (4) below.) These
# are the rows of the two front wheels, the left one first:

# %%
print(swerve.matrix[:4])

# %% [markdown]
# `twist` solves (2) for each row of a log. From twist to wheels and back again must give what went
# in:

# %%
curve = swerve.wheel_states([[0.8, 0.0]], [1.4])
twist = swerve.twist(curve)
print(f"forward {twist.v[0, 0]:.3f} m/s, turning {twist.yaw_rate[0]:.3f} rad/s")

assert np.allclose(twist.v, [[0.8, 0.0]])
assert np.allclose(twist.yaw_rate, 1.4)

# %% [markdown]
# A wheel may also stand the other way round and run backwards: speed $-s$ at angle
# $\theta + \pi$ is the same contact velocity as $s$ at $\theta$. Real swerve drives do this all the
# time to save steering. Equation (2) sees only $\mathbf u$, so it does not care.

# %%
flipped = WheelStates(-curve.speed, curve.steer + np.pi)
assert np.allclose(swerve.twist(flipped).v, twist.v)
assert np.allclose(swerve.twist(flipped).yaw_rate, twist.yaw_rate)

# %% [markdown]
# ## When wheels disagree: slip
#
# What least squares cannot explain is called *slip* here. It is the root mean square, over the
# wheels, of what each of them measures minus what the best twist implies, in metres per second:
#
# $$\text{slip} = \sqrt{\tfrac1k \textstyle\sum_i
# \lVert \mathbf u_i - H_i\,(v_x, v_y, \omega)^\top \rVert^2}. \tag{3}$$
#
# Let the front left wheel come onto ice, and spin at 1.6 m/s while the vehicle drives 0.8 m/s:

# %%
ice = WheelStates(np.array([[1.6, 0.8, 0.8, 0.8]]), np.zeros((1, 4)))
on_ice = swerve.twist(ice)
print(f"v_x = {on_ice.v[0, 0]:.3f} m/s instead of 0.8")
print(f"yaw rate {on_ice.yaw_rate[0]:.3f} rad/s, slip {on_ice.slip[0]:.3f} m/s")

# %% [markdown]
# **See:** the purple bars of slip lie at all four wheels, not only at the guilty one. Least squares
# shares the error out, and the vehicle seems to turn right. So slip does not say *which* wheel is
# wrong, but it does say that this row is not to be trusted.

# %%
figure, ax = plt.subplots(figsize=(4.6, 5.2))
draw_motion(ax, swerve, ice)
explain_motion(figure)
plt.show()

# %% [markdown]
# ## The paper's average
#
# The paper steers and drives all wheels alike, and uses their mean speed $\bar v$ and their mean
# angle $\bar\theta$:
#
# $$\mathbf v_o = \bar v \, (\cos\bar\theta,\; \sin\bar\theta,\; 0)^\top. \tag{4}$$
#
# Two remarks. The paper prints this as a rotation matrix times a vector in a way that gives
# $-\sin\bar\theta$ if it is read with row vectors. That is an erratum: wheels that steer to the
# left take the body to the left. And angles must be averaged on the circle, as directions, not as
# numbers:

# %%
average = Swerve(swerve.wheels, method="average")
angles = np.radians([[179.0, -179.0, 178.0, -178.0]])
backwards = average.twist(WheelStates(np.ones((1, 4)), angles))
print(f"mean of the numbers: {np.degrees(angles.mean()):.0f} deg, which is forward")
print(f"mean on the circle: v_x = {backwards.v[0, 0]:.3f} m/s, which is backwards")

assert np.allclose(backwards.v, [[-1.0, 0.0]])

# %% [markdown]
# The average is right as long as the body does not turn. If it turns, each wheel has its own
# velocity, and the mean of their *lengths* is more than the length of their mean. Drive forward at
# 1 m/s, and turn ever faster:

# %%
rates = np.linspace(0.0, 2.0, 41)
turning = swerve.wheel_states(np.tile([1.0, 0.0], (rates.size, 1)), rates)
error = {vehicle.method: vehicle.twist(turning).v[:, 0] - 1.0 for vehicle in (average, swerve)}
for rate in (0.2, 1.0, 2.0):
    row = int(np.argmin(np.abs(rates - rate)))
    print(f"{rate:.1f} rad/s: the average is {1000 * error['average'][row]:.1f} mm/s too fast")

assert np.allclose(error["least_squares"], 0.0)

# %% [markdown]
# **See:** the error grows with the square of the yaw rate, and at 0.2 rad/s it is still tiny. This
# is why the paper may use the average on a vehicle that only translates, and why we use least
# squares.

# %%
from evcalib.plots.kinematics import draw_speed_error

figure, ax = plt.subplots(figsize=(5.6, 3.2))
shown = {"paper's average": error["average"], "least squares": error["least_squares"]}
draw_speed_error(ax, rates, shown)
plt.show()

# %% [markdown]
# ## Other wheels, same idea
#
# A wheel with rollers on its rim slides freely in one direction. So it measures only *one
# component* of its contact velocity, which is one row of $H$ instead of two. For an **omni wheel**
# that rolls towards the angle $\beta$, the speed of the rim is
#
# $$s = v_x \cos\beta + v_y \sin\beta + \omega\,(x \sin\beta - y \cos\beta), \tag{5}$$
#
# and for a **mecanum wheel**, whose rollers stand at 45 degrees,
#
# $$s = u_x \mp u_y, \tag{6}$$
#
# with minus for front left and rear right. Both are in Lynch and Park, *Modern Robotics*, section
# 13.2; the speed of the rim is the rotation rate times the wheel's radius. Here are the matrix of a
# mecanum vehicle, and a *kiwi* drive of three omni wheels:

# %%
mecanum = Mecanum(half_length=0.30, half_width=0.25)
around = {"a": 0.0, "b": 2 * math.pi / 3, "c": 4 * math.pi / 3}
kiwi = Omni(
    tuple(
        OmniWheel(name, 0.30 * math.cos(a), 0.30 * math.sin(a), drive=a + math.pi / 2)
        for name, a in around.items()
    )
)
print(mecanum.matrix)

# %% [markdown]
# All three drive the same twist, but the first wheel of each reports 0.4 m/s too much.
#
# **See:** swerve and mecanum notice, by their purple bars. The three wheels of the kiwi drive
# cannot: three numbers for three unknowns always fit. Its blue arrow is simply wrong, with no sign
# of it.

# %%
cases = {}
for vehicle in (swerve, mecanum, kiwi):
    states = vehicle.wheel_states([[0.6, 0.4]], [0.8])
    states.speed[0, 0] += 0.4
    slip = abs(vehicle.twist(states).slip[0])
    cases[f"{type(vehicle).__name__}: slip {slip:.2f} m/s"] = vehicle, states
figure, axes = plt.subplots(1, 3, figsize=(9.4, 3.7), sharey=True)
draw_motions(axes, cases)
explain_motion(figure)
plt.show()

# %% [markdown]
# Not every placement of wheels can answer. If the rolling directions of all wheels point through
# one common point, turning about that point moves none of them. The library refuses such a vehicle
# and names the motion that it cannot see:

# %%
radial = [OmniWheel(w.name, w.x, w.y, drive=around[w.name]) for w in kiwi.wheels]
try:
    Omni(tuple(radial))
except InputError as refusal:
    print(textwrap.fill(str(refusal), 90))

# %% [markdown]
# ## A whole log
#
# Now the real work. We simulate a drive of 20 s along an S-curve, and log the wheels at 50 Hz with
# a little noise. Then we spoil the log twice: from 8 to 9 s the vehicle turns, and from 14 to 15 s
# the front right wheel slips.

# %%
from data_tools.simulation.drives import s_curve

rng = np.random.default_rng(3)
t = np.arange(0.0, 20.0, 0.02)
v = s_curve(20.0).velocity(t)[:, :2]
yaw_rate = np.where((t >= 8) & (t < 9), 0.8, 0.0)
clean = swerve.wheel_states(v, yaw_rate)
states = WheelStates(
    clean.speed + rng.normal(0, 0.01, clean.speed.shape),
    clean.steer + rng.normal(0, 0.01, clean.speed.shape),
)
states.speed[(t >= 14) & (t < 15), 1] += 0.3

# %% [markdown]
# On disk, a vehicle is a few lines of YAML. A log is a CSV file with a column `t` [s], and for each
# wheel `speed_NAME` [m/s] and `steer_NAME` [rad].

# %%
folder = Path(tempfile.mkdtemp())
vehicle_files.write_vehicle(folder / "vehicle.yaml", swerve)
wheel_logs.write_wheel_log(folder / "wheels.csv", WheelLog(t, states), swerve)
print((folder / "vehicle.yaml").read_text())
print((folder / "wheels.csv").read_text().splitlines()[0])

# %% [markdown]
# One call reads both files and returns the velocities.
#
# **See:** in the lowest panel, the second from 14 s on stands out from the noise. That is what slip
# is for. The turn at 8 s shows in the yaw rate (middle), but it is *not* slip, because the model
# explains it.

# %%
everything = wheel_logs.velocities_from_files(folder / "wheels.csv", folder / "vehicle.yaml")
figure, axes = plt.subplots(3, 1, figsize=style.TALL, sharex=True)
draw_velocity_log(axes, everything)
print(everything.summary())
plt.show()

# %% [markdown]
# The calibration wants rows that can be trusted: without slip, and with little rotation, because
# when the body turns, the camera moves with another velocity than the origin of the body, by (1).
# Two limits take out the other rows, and tell how many they were:

# %%
gated = wheel_logs.velocities_from_files(
    folder / "wheels.csv", folder / "vehicle.yaml", max_slip=0.05, max_yaw_rate=0.3
)
print(gated.summary())

assert gated.removed == gated.over_slip + gated.over_yaw_rate == 100

# %% [markdown]
# Did it help? The worst error against the truth, with and without the limits:

# %%
worst = {}
for name, result in {"all rows": everything, "gated": gated}.items():
    truth = v[np.isin(t, result.velocities.t)]
    worst[name] = np.abs(result.velocities.v[:, :2] - truth).max()
    print(f"{name}: worst error {worst[name]:.3f} m/s")

assert worst["gated"] < 0.4 * worst["all rows"]

# %% [markdown]
# A good log is worth little if it is read in the wrong unit. So the reader refuses what looks like
# another unit, and says where. Here somebody logged degrees:

# %%
degrees = WheelStates(states.speed, np.degrees(states.steer))
wheel_logs.write_wheel_log(folder / "degrees.csv", WheelLog(t, degrees), swerve)
try:
    wheel_logs.read_wheel_log(folder / "degrees.csv", swerve)
except InputError as refusal:
    print(textwrap.fill(str(refusal).replace(str(folder), "..."), 90))

# %% [markdown]
# ## Drive it yourself
#
# In the panel below you steer and drive each wheel by hand. First as a static picture, for a curve
# to the left with the front left wheel too fast.
#
# **See:** left, the picture as above. Right, the way that the vehicle goes in 3 s if its wheels
# stay as they are, and where it is after 1 s; the blue line on it points to its front.

# %%
from evcalib.plots.kinematics import draw_travel

states = swerve.wheel_states([[0.8, 0.0]], [1.0])
states.speed[0, 0] += 0.4
figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.6))
draw_motion(left, swerve, states)
draw_travel(right, swerve, states, seconds=3.0, now=1.0)
explain_motion(figure)
plt.show()

# %% [markdown]
# **Your turn.** The table below the picture has the twist, by least squares and by the paper's
# average.
#
# 1. *forward*: raise only the speed of `fl` by 0.4 m/s. How much of it does the body take over?
# 2. *sideways*: turn one wheel by 180 degrees, and make its speed negative. The slip is zero again.
# 3. *spin on the spot*: the paper's average shows no velocity. Turn a single wheel by one step, and
#    it shows one of 0.6 m/s, while least squares stays below 0.02. (What does the mean angle in (4)
#    mean when all directions cancel?)
# 4. From any start, make the vehicle turn about its own front left wheel. (The blue cross must lie
#    on the wheel, with a slip below 0.02 m/s.) Then press play.

# %%
from evcalib.widgets.kinematics import SwervePanel

SwervePanel(swerve)

# %% [markdown]
# ## Exercises
#
# **1.** The vehicle shall turn about the point 1 m to its left, $(0, 1)$, at 0.5 rad/s. What is its
# twist, and what are the speed and the angle of the front left wheel?
#
# <details><summary>Solution</summary>
#
# By (1) the point itself stands still: $v_x - 0.5 \cdot 1 = 0$ and $v_y + 0.5 \cdot 0 = 0$, so
# $v = (0.5, 0)$ m/s. The wheel moves with $(0.5 - 0.5 \cdot 0.25,\; 0.5 \cdot 0.30) =
# (0.375, 0.15)$ m/s: 0.404 m/s at 21.8 degrees. Check:
# `swerve.wheel_states([[0.5, 0.0]], [0.5])`.
#
# </details><br>
#
# **2.** Two steered wheels give four numbers for three unknowns. Which single disagreement can they
# show?
#
# <details><summary>Solution</summary>
#
# A rigid body keeps the distance between its wheels, so the components *along the line that joins
# them* must be equal. Only their difference is slip; everything else is explained by some twist.
# Try `Swerve((Wheel("f", 0.3, 0), Wheel("r", -0.3, 0)))` with speeds (1, 1) and angles
# (0.2, -0.1): the difference is $\cos 0.2 - \cos 0.1 = -0.0149$ m/s and each wheel is off by half
# of it, so the slip is 0.0075 m/s.
#
# </details><br>
#
# **3.** How many omni wheels does a kiwi drive need to notice slip?
#
# <details><summary>Solution</summary>
#
# Four: one more equation than unknowns. `Omni` takes any number from three on. With four, errors
# that happen to look like a motion still go unseen; every further wheel leaves fewer of those.
#
# </details>
#
# ## In the library
#
# - [`evcalib.kinematics`](../evcalib/kinematics/__init__.py): `Swerve`, `Mecanum` and `Omni`
#   with `twist` and `wheel_states`; `body_velocities` for a whole log, with limits on slip and yaw
#   rate.
# - [`data_tools.logs.vehicle_files`](../data_tools/logs/vehicle_files.py) and
#   [`data_tools.logs.wheel_logs`](../data_tools/logs/wheel_logs.py): the two files, read and
#   written.
# - [`evcalib.plots.kinematics`](../evcalib/plots/kinematics.py) and
#   [`evcalib.widgets.SwervePanel`](../evcalib/widgets/kinematics.py): the pictures of this
#   notebook.
# - On the command line:
#   `evcalib velocities wheels.csv --vehicle vehicle.yaml -o velocities.csv --max-slip 0.05`.
#
# **Next:** the wheels' clock and the camera's clock do not agree. [Notebook 4](04_offset.ipynb)
# finds the offset between them.
