# %% [markdown]
# # 0. Quickstart: a calibration in five minutes
#
# **For whom.** You have a vehicle that can drive in any direction, an event camera mounted on it,
# and a recording of both. You want to know how the camera is mounted, and by how much its clock
# differs from the vehicle's.
#
# **What you will be able to do.**
#
# 1. calibrate a recording with one call, or with one command,
# 2. read the pictures of the report, and tell a good calibration from a bad one,
# 3. hand the result on to ROS, Kalibr or a URDF,
# 4. plan a drive, and know how exact the calibration will be before you drive it.
#
# **Required knowledge.** None. Notebooks 1 to 6 tell how it works.
#
# **Time.** 20 minutes: 10 of reading, 10 of playing with the drive designer.
#
# The question: how do the camera's clock and axes relate to those of the vehicle? The answer has
# two parts, the *offset* between the clocks and the *rotation* between the axes:
#
# $$t_\text{body} = t_\text{cam} + \text{offset}, \qquad
# \mathbf v_\text{body} = R_\text{body,cam}\, \mathbf v_\text{cam}. \tag{1}$$
#
# The rotation is what the paper calls $R_{oe}$; the sign of the offset is that of its Algorithm 1.
# The camera's axes are X to the right, Y down and Z along the optical axis. The body's axes are X
# forward, Y to the left and Z up.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Image

import evcalib
from data_tools.logs.velocity_sources import read_body_velocities
from data_tools.runs.export import export, read_calibration, write_calibration
from data_tools.runs.headings import open_with_camera
from evcalib.plots import style

style.use()

# %% [markdown]
# ## A recording
#
# A drive leaves four files: the events, the camera's intrinsics, the log of the wheels, and a
# description of the vehicle. Those used here are simulated: for 12 s a vehicle sweeps left and
# right through a furnished room, and a small camera of 120 x 90 pixels looks on. Nothing else is
# given. There is no calibration target, no map and no known trajectory.

# %%
home = Path("data/sweep")
events, camera = open_with_camera(home / "events.h5", home / "calib.txt")
wheels = read_body_velocities(home / "wheels.csv", vehicle=home / "vehicle.yaml").wheels
print(f"{sum(map(len, events))} events of {events.width} x {events.height} pixels")
print(f"{wheels.rows} rows of wheel states, {wheels.velocities.t[-1]:.1f} s")

# %% [markdown]
# `events` hands out the recording piece by piece, so hours of it need little memory. Other formats
# (AEDAT4, EVT2 and EVT3, ROS bags, text) are opened in the same way.
#
# ## One call
#
# It takes a few seconds. The first thing to look at is not a number but the *verdict*: did this
# drive contain the answer at all?

# %%
run = evcalib.calibrate(events, camera, wheels)
found = run.calibration
print(found.verdict.summary)

assert found.offset_observable
assert found.rotation_observable

# %% [markdown]
# It did. The recording is simulated, so we know the true offset and rotation, and can see what the
# numbers and their stated errors are worth:

# %%
from evcalib.geometry import rotation_angle

truth = read_calibration(home / "truth.yaml")
late = found.offset - truth.offset
turned = rotation_angle(found.R_body_cam, truth.R_body_cam)
sd, radius = 1e3 * found.offset_sd, np.degrees(found.rotation_radius)
print(f"offset {found.offset:.3f} s, true {truth.offset:.3f} s")
print(f"    off by {1e3 * late:.1f} ms; stated standard deviation {sd:.1f} ms")
print(f"rotation off by {np.degrees(turned):.2f} deg; stated 95 % radius {radius:.2f} deg")

low, high = found.offset_interval
assert low < truth.offset < high
assert turned < found.rotation_radius

# %% [markdown]
# That was the calibration. The asserts check what matters most: the truth lies within the stated
# 95 % intervals. One drive proves little, of course. Three more drives of this kind were 1 to 9 ms
# off, which is what 12 s from a tiny camera allow; notebook 6 shows many drives, seen by cameras of
# the usual size.
#
# ## The pictures of the report
#
# The command line writes a page `report.html` with eight pictures. Three of them tell nearly
# everything, and the same function draws them here. The first shows both streams before the
# calibration: the camera's *headings* (its directions of motion), as if the camera looked straight
# ahead, and the vehicle's direction of travel, each on its own clock.
#
# **See:** the upper panel shows one shape twice. The camera's copy is moved sideways by the offset,
# and bent and moved up and down by the mounting.

# %%
from evcalib.report import report_figures

figures = report_figures(run)
Image(style.png(figures["unaligned"], dpi=110))

# %% [markdown]
# The second shows the same streams after the calibration, on the camera's clock and in the axes of
# the body.
#
# **See:** the dots now lie *on* the line in the upper panel. In the lower one they scatter about it
# by a degree or two, but for a bump of 7 degrees near 4 s: headings that do not agree are purple,
# and count little. In a recording of your own, look for a slow wave in the lower panel: it would
# mean that the vehicle pitches, or that the camera's intrinsics are wrong.

# %%
Image(style.png(figures["directions"], dpi=110))

# %% [markdown]
# The third shows how well each offset explains the recording. *Sightings met* is the share of all
# sightings of corners that an offset explains, 1 being all of them. Left is the whole search, and
# right the top of the peak. Offsets were tried every 20 ms and are joined by straight lines, so the
# top looks like a tent; the offset found (green) comes from a fit between them.
#
# **See:** there is a single peak. Several peaks of the same height would mean that the drive
# repeats itself. The green band is the 95 % interval.

# %%
Image(style.png(figures["correlation"], dpi=110))

# %% [markdown]
# ## What to do with the result
#
# `write_calibration` stores the calibration with its verdict and its uncertainty. `export` turns it
# into what other tools read: Kalibr's camchain, a ROS transform, or a URDF joint.

# %%
import tempfile

folder = Path(tempfile.mkdtemp())
write_calibration(folder / "calibration.yaml", found)
stored = read_calibration(folder / "calibration.yaml")
for line in export(stored, "ros-tf").splitlines():
    if line.startswith(("frame", "child", "translation")):
        print(line)

# %% [markdown]
# The translation is zero, and a comment in the file says why: directions of motion do not show
# where on the vehicle the camera sits.
#
# **On the command line** the same is
#
# ```sh
# evcalib calibrate data/sweep/events.h5 --camera data/sweep/calib.txt \
#         --wheels data/sweep/wheels.csv --vehicle data/sweep/vehicle.yaml -o result
# evcalib export result/calibration.yaml --to ros-tf
# ```
#
# The folder `result` then holds `calibration.yaml`, the headings and velocities as tables, and
# `report.html`. The exit code is 0 if the drive told both parts, 2 for bad input, 3 if the motion
# cannot answer, and 4 if there is an answer but the data speak against it.
#
# ## How to drive
#
# A calibration is as good as its drive. Two questions decide.
#
# **Does the drive look like itself some time later?** Then no method can find the offset. On a
# straight line at constant speed every moment is like every other. An arc is no better: half a
# second later it is the same arc, turned, and since the rotation of the camera is unknown too, it
# takes the blame. A fast zigzag looks like itself half a period later.
#
# **Does the drive go in different directions?** If the vehicle only drives forward, the camera may
# be rolled about the forward axis by any angle, and it will see the same headings.
#
# The first question has a number. Write the velocities as complex numbers,
# $v(t) = v_x + i\,v_y$. Then the *likeness* of the drive to itself after a shift $s$ is
#
# $$L(s) = \frac{\max\bigl(\lvert\sum \bar v(t)\,v(t+s)\rvert,\;
# \lvert\sum v(t)\,v(t+s)\rvert\bigr)}{\sqrt{\sum\lvert v(t)\rvert^2 \sum\lvert v(t+s)\rvert^2}}.
# \tag{2}$$
#
# The absolute value allows for any turn about the vertical. The second sum allows for a camera that
# is turned over, which exchanges left and right. $L = 1$ means that the two cannot be told apart.
# (This measure is ours; the paper has none.)
#
# The function below plans a drive from four numbers: how far the direction swings, how fast, at
# what speed, for how long.

# %%
from data_tools.simulation.drives import PLANS
from evcalib.design import predict
from evcalib.series import VelocitySeries


def plan(motion, swing=45.0, period=6.0, speed=0.5, duration=16.0):
    """Return a planned drive, as if its wheels had been logged at 50 Hz."""
    drive = PLANS[motion](swing, period, speed, duration)
    t = np.arange(0.0, duration, 0.02)
    return VelocitySeries(t, drive.velocity(t))


# %% [markdown]
# Four drives, seen from above (the dot is the start), and below each its likeness to itself.
#
# **See:** straight line and arc stay at 1 for every shift: they cannot show the offset. The S-curve
# falls off on both sides, because its direction changes. So do the fingers, which go out and back
# in three directions, as in the paper's experiments. Above the grey dotted line a second peak would
# be taken for the first.

# %%
from evcalib.plots.design import draw_plans

motions = ("straight", "arc", "fingers", "S-curve")
drives = {motion: plan(motion) for motion in motions}
forecasts = {motion: predict(drive) for motion, drive in drives.items()}
figure = plt.figure(figsize=(9.4, 4.8))
draw_plans(figure, {motion: (drives[motion], forecasts[motion]) for motion in motions})
plt.show()

# %% [markdown]
# ### How exact will it be?
#
# There is a smallest error that no method can beat, the *Cramér-Rao bound*; notebook 4 derives it.
# `predict` computes it for any drive, for two kinds of measurement. *Directions alone* is what
# headings tell. *With speeds* adds what the camera sees when it watches the same corner again and
# again: whether it moves faster or slower than before (notebook 6).

# %%
for motion, both in forecasts.items():
    alone = predict(drives[motion], speed=False)
    print(
        f"{motion:8s} offset {1e3 * both.offset_sd:6.1f} ms, directions alone"
        f" {1e3 * alone.offset_sd:6.1f} ms; rotation {np.degrees(both.worst_axis_sd):6.2f} deg"
    )

# %% [markdown]
# These are standard deviations, for the rotation about its worst axis. A thousand milliseconds and
# 180 degrees are what was known before the drive, that is, nothing.
#
# The fingers are the interesting line. Along each finger the direction is constant. It changes only
# while the vehicle stands still, and then the camera sees nothing. So directions alone cannot
# measure the offset. (They bound it: shifted by more than a pause, one finger meets the next. The
# dashed likeness falls sooner, as the fingers then overlap less, but moments without a heading
# tell nothing.) But the vehicle speeds up and slows down at known times, and that brings the error
# down to a few milliseconds.
#
# The same in words, with advice where it is needed:

# %%
import textwrap

for motion, forecast in forecasts.items():
    print(f"{motion}: {forecast.summary}")
print(textwrap.fill("Advice for the arc: " + forecasts["arc"].advice[0], 90))

assert forecasts["S-curve"].offset_determined
assert not forecasts["arc"].offset_determined

# %% [markdown]
# A drive that has already been driven can be judged in the same way, from its wheel log alone,
# before anyone looks at an event. Here is ours (notebook 6 compares promise, error bar and error):

# %%
forecast = predict(wheels.velocities)
print(forecast.summary)
print(f"at best {1e3 * forecast.offset_sd:.1f} ms for 20 corners at 2.5 m, 200 pixels per radian")

# %% [markdown]
# ## Design a drive
#
# Now plan one yourself. First as a static picture, what the panel below shows: the course from
# above, direction and speed over time, and the likeness (2).
#
# **See:** this fast zigzag has three peaks, as high as each other. Shifted by 0.75 s, half its
# period, left and right are exchanged, and a camera that is turned over would see just the same.

# %%
from evcalib.design import self_likeness
from evcalib.plots.design import design_axes, draw_design

drive = plan("zigzag", period=1.5)
forecast = predict(drive)
figure = plt.figure(figsize=(9.4, 3.2))
draw_design(
    design_axes(figure), drive, forecast, self_likeness(drive, forecast.shifts, speed=False)
)
print(forecast.summary, "It repeats itself." if forecast.repeats else "")
plt.show()

# %% [markdown]
# **Your turn.**
#
# 1. *S-curve*: lower the swing until the offset is worse than 5 ms. How small is it then?
# 2. *zigzag*: lower the period until the table says *repeats*. Then make the drive work again with
#    the slider *search*, without touching the drive.
# 3. *fingers*: compare the two rows of the table. Then raise the period: what do slow fingers cost?
# 4. *way points*: draw a drive of less than 10 s that shows the offset to 2 ms, from directions
#    alone. The play button drives it for you.

# %%
from evcalib.widgets.designer import DriveDesigner

DriveDesigner(PLANS)

# %% [markdown]
# **Rules of thumb.** Keep the heading of the body, and let the direction of travel swing by 30
# degrees or more every few seconds. Vary the speed. Drive for 15 s or more, with some texture
# within a few metres. And know the offset roughly, so that the search stays below half a period of
# the motion.
#
# ## Exercises
#
# **1.** You drive the S-curve for four times as long. By how much does the offset improve? And if
# you drive it twice as fast along the same path?
#
# <details><summary>Solution</summary>
#
# Four times the time is four times the information, which would halve the standard deviation. But
# `predict` goes only from 3.4 to 2.1 ms. It adds an error of 1.5 ms that all sightings of a drive
# share and that does not average out. What is left when its square is taken away does halve, from
# 3.0 to 1.5 ms.
#
# Twice as fast along the same path means half the period and twice the speed, for half the time.
# Rates of turning double, which is four times the information; displacements double, which is
# another four times; the time halves. In all that is $\sqrt 8 = 2.8$ times better. The bound says
# 1.05 ms, 2.9 times better, beside the 1.5 ms that stay. Check with
# `predict(plan("S-curve", duration=64.0))` and
# `predict(plan("S-curve", period=3.0, speed=1.0, duration=8.0))`.
#
# </details><br>
#
# **2.** A vehicle stops and goes along a straight line. Which of the two unknowns can it show?
#
# <details><summary>Solution</summary>
#
# The offset, by its speeds: they make $L(s)$ in (2) fall off, though all directions are equal. Of
# the rotation it shows all but the roll about the line itself.
#
# </details><br>
#
# **3.** Why can a longer search make a calibration fail that worked before?
#
# <details><summary>Solution</summary>
#
# If the motion repeats itself with period $P$, there is one answer only as long as the search stays
# within $\pm P/2$ (or $\pm P/4$ if left and right are alike, as in a zigzag). Beyond, there is a
# second offset that fits as well, and an honest tool has to say so.
#
# </details>
#
# ## In the library
#
# - [`evcalib.calibrate`](../evcalib/pipeline/_calibrate.py): the whole chain in one call; what it
#   returns is a [`CalibrationRun`](../evcalib/pipeline/_run.py).
# - [`evcalib.design.predict`](../evcalib/design/_prediction.py) and `self_likeness`: what a drive
#   will tell.
# - [`evcalib.design.waypoints.drive_through`](../evcalib/design/waypoints.py): a drive along your
#   own way points.
# - [`evcalib.report.report_figures`](../evcalib/report/_figures.py) and
#   [`evcalib.report.report_html`](../evcalib/report/_page.py): the pictures, and the page that
#   holds them.
# - [`evcalib.widgets.designer.DriveDesigner`](../evcalib/widgets/designer.py): the panel above.
# - [`data_tools.recordings`](../data_tools/recordings/__init__.py),
#   [`data_tools.logs.velocity_sources`](../data_tools/logs/velocity_sources.py) and
#   [`data_tools.runs.export`](../data_tools/runs/export.py): what can be read and written.
# - On the command line: `evcalib calibrate --help`, `evcalib export --help`, `evcalib info --help`.
#
# **Next:** [notebook 1](01_representations.ipynb) starts the chain at its beginning, with what an
# event is. ([Notebook 6](06_full_calibration.ipynb) opens up the call that you have just made.)
