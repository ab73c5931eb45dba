# %% [markdown]
# # 0. Quickstart: a calibration in five minutes
#
# **For whom.** You have a vehicle that can drive in any direction, an event camera on it, and a
# recording of both. You want to know how the camera sits and how far its clock is off.
#
# **What you will be able to do.**
#
# 1. calibrate a recording with one call, or one command,
# 2. read the pictures of the report, and tell a good calibration from a bad one,
# 3. hand the result on to ROS, Kalibr or a URDF,
# 4. plan a drive that makes the calibration work, and know its precision before you drive it.
#
# **Required knowledge.** None; how it works is told in notebooks 1 to 6. **Time.** 5 minutes for
# the calibration, 15 for the planning.
#
# Two things are sought, the *offset* between the two clocks and the *rotation* of the camera:
#
# $$t_\text{body} = t_\text{cam} + \text{offset}, \qquad
# \mathbf v_\text{body} = R_\text{body,cam}\, \mathbf v_\text{cam}. \tag{1}$$
#
# The camera frame has X to the right, Y down, Z along the optical axis; the body frame X forward, Y
# to the left, Z up.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from IPython.display import Image

import evcalib
from data_tools.export import read_calibration
from data_tools.headings import open_with_camera
from data_tools.velocity_sources import read_body_velocities
from evcalib.geometry import rotation_angle
from evcalib.plots import style

style.use()

# %% [markdown]
# ## A recording
#
# A drive leaves four files: the events, the camera's intrinsics, the log of the wheels, and a
# description of the vehicle. These are simulated, 12 s of a vehicle that sweeps left and right
# through a furnished room, seen by a small camera (120 x 90 pixels). Nothing else is known: no
# target, no map, no trajectory.

# %%
home = Path("data/sweep")
events, camera = open_with_camera(home / "events.h5", home / "calib.txt")
wheels = read_body_velocities(home / "wheels.csv", vehicle=home / "vehicle.yaml").wheels
print(f"{sum(map(len, events))} events of {events.width} x {events.height} pixels")
print(f"{wheels.rows} rows of {wheels.velocities.t[-1]:.1f} s of wheel states")

# %% [markdown]
# `events` yields pieces of the recording, so that hours of it fit into memory. Other formats
# (AEDAT4, EVT2 and EVT3, ROS bags, text) are opened in the same way.
#
# ## One call

# %%
run = evcalib.calibrate(events, camera, wheels)
found = run.calibration
print(found.verdict.summary)

assert found.offset_observable
assert found.rotation_observable

# %% [markdown]
# Before any number comes the verdict: did this drive contain the answer? Here it did. Since the
# recording is simulated, the truth is known, and we can see what the numbers and their stated
# errors are worth:

# %%
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
# That is it. The asserts hold what matters most: the truth lies within the stated 95 % intervals.
# One drive proves little, of course: three more of this kind were 1 to 9 ms off, as 12 s from a
# tiny camera allow. Notebook 6 shows many, from a camera of usual size.
#
# ## The report's pictures
#
# The same pictures are in `report.html`, which the command line writes. Three of them tell nearly
# everything (the others show residuals, lost headings, matches and the event rate). First, the two
# streams as they came: the camera's headings as if it looked straight ahead, and the vehicle's
# direction of travel. **See:** one shape, twice. It is moved sideways by the offset, and up or down
# by the mounting.

# %%
from evcalib.plots.report import report_figures

figures = report_figures(run)
Image(style.png(figures["unaligned"], dpi=110))

# %% [markdown]
# After the calibration the dots must lie *on* the line. **See:** they do, in both panels; a few
# outliers are marked. A slow wave in the lower panel would mean that the vehicle pitches, or that
# the camera's own intrinsics are off.

# %%
Image(style.png(figures["directions"], dpi=110))

# %% [markdown]
# And every offset was tried. **See:** there is one peak within the search, not several of the same
# height, and its tip (right) is sharp enough for the green interval.

# %%
Image(style.png(figures["correlation"], dpi=110))

# %% [markdown]
# ## What to do with the result
#
# `write_calibration` stores everything, the verdict and the uncertainty included. `export` turns it
# into what other tools read: Kalibr's camchain, a ROS transform, a URDF joint.

# %%
import tempfile

from data_tools.export import export, write_calibration

folder = Path(tempfile.mkdtemp())
write_calibration(folder / "calibration.yaml", found)
stored = read_calibration(folder / "calibration.yaml")
for line in export(stored, "ros-tf").splitlines():
    if line.startswith(("frame", "child", "translation")):
        print(line)

# %% [markdown]
# The translation is zero, and a comment in the file says why: directions do not show the lever arm.
#
# **On the command line** the same is
#
# ```sh
# evcalib calibrate data/sweep/events.h5 --camera data/sweep/calib.txt \
#         --wheels data/sweep/wheels.csv --vehicle data/sweep/vehicle.yaml -o result
# evcalib export result/calibration.yaml --to ros-tf
# ```
#
# and `result/` holds `calibration.yaml`, the headings and velocities as tables, and `report.html`.
# The exit code is 0 if the drive told both, 2 for bad input, and 3 if the motion cannot answer.
#
# ## How to drive
#
# A calibration is as good as its drive. Two questions decide:
#
# - **Could the drive be taken for itself, some time later?** Then no method can find the offset. On
#   a straight line at constant speed every moment is like every other. On an arc, too: half a
#   second later is the same, turned, and the unknown rotation takes the turn. A fast zigzag is like
#   itself half a period on.
# - **Does it go in different directions?** The camera's roll about a line of travel does not show
#   on that line.
#
# The first question has a number. With the velocities as complex numbers $v(t) = v_x + i\,v_y$, let
# the *likeness* of the drive and itself at a shift $s$ be
#
# $$L(s) = \frac{\max\bigl(\lvert\sum \bar v(t)\,v(t+s)\rvert,\;
# \lvert\sum v(t)\,v(t+s)\rvert\bigr)}{\sqrt{\sum\lvert v(t)\rvert^2 \sum\lvert v(t+s)\rvert^2}}.
# \tag{2}$$
#
# Taking the modulus allows for any turn about the vertical, and the second sum for a camera that is
# turned over, which exchanges left and right. $L = 1$ means: cannot be told apart.

# %%
from data_tools.plans import PLANS
from evcalib.design import predict, self_likeness
from evcalib.plots.design import draw_course, draw_likeness
from evcalib.series import VelocitySeries


def plan(motion, swing=45.0, period=6.0, speed=0.5, duration=16.0):
    drive = PLANS[motion](swing, period, speed, duration)
    t = np.arange(0.0, duration, 0.02)
    return VelocitySeries(t, drive.velocity(t))


# %% [markdown]
# **See:** above, four drives from above; below, their likeness to themselves. Straight line and arc
# stay at 1 for every shift. The S-curve falls off by its changing direction. The fingers (out and
# back in three directions, as in the paper) fall off whether or not speeds are looked at; but see
# the prediction further down.

# %%
motions = ("straight", "arc", "fingers", "S-curve")
figure, axes = plt.subplots(2, 4, figsize=(9.4, 4.6))
for (top, bottom), motion in zip(axes.T, motions, strict=True):
    drive = plan(motion)
    forecast = predict(drive)
    draw_course(top, drive)
    draw_likeness(bottom, forecast, self_likeness(drive, forecast.shifts, speed=False))
    top.set_title(motion)
    if motion != "straight":
        bottom.get_legend().remove()
        style.label(top, "to the left [m]", "", title=motion)
        bottom.set_ylabel("")
plt.show()

# %% [markdown]
# ### How exact will it be?
#
# Notebook 4 derives a bound that no method can beat (Cramér and Rao's): the more the rate of
# turning changes, the better. `predict` computes it for any drive, for two kinds of measurement.
# *Directions alone* is what headings tell. *With speeds* adds what corners tell that are seen again
# and again: by how much further they move each time (notebook 6).

# %%
for motion in motions:
    both, alone = predict(plan(motion)), predict(plan(motion), speed=False)
    print(
        f"{motion:8s} offset {1e3 * both.offset_sd:6.1f} ms, directions alone"
        f" {1e3 * alone.offset_sd:6.1f} ms; rotation {np.degrees(both.worst_axis_sd):6.2f} deg"
    )

# %% [markdown]
# (The rotation is that about its worst axis. A second, or 180 degrees, is what was known before the
# drive: nothing.) The fingers are the interesting line. Along each finger the direction is
# constant, and it changes while the vehicle stands and the camera sees nothing: locally, directions
# know nothing of the offset. Speeds rise and fall at known times, and bring it to a few
# milliseconds.
#
# The verdict in words:

# %%
for motion in motions:
    print(f"{motion}: {predict(plan(motion)).summary}")
print(predict(plan("arc")).advice[0])

assert predict(plan("S-curve")).offset_determined
assert not predict(plan("arc")).offset_determined

# %% [markdown]
# Nothing forces you to guess: a drive that *was* driven can be judged from its wheel log alone,
# before anyone looks at an event. Ours:

# %%
forecast = predict(wheels.velocities)
print(forecast.summary)
print(f"at best {1e3 * forecast.offset_sd:.1f} ms for 20 corners at 2.5 m, 200 pixels per radian")

# %% [markdown]
# ## Design a drive
#
# **See** in the static picture what the panel below shows: the course from above, direction and
# speed over time, and the likeness (2).

# %%
from evcalib.plots.design import draw_design

figure = style.new_figure((9.4, 3.2))
drive = plan("zigzag", period=1.5)
forecast = predict(drive)
draw_design(figure, drive, forecast, self_likeness(drive, forecast.shifts, speed=False))
print(forecast.summary, "It repeats itself." if forecast.repeats else "")
Image(style.png(figure, dpi=110))

# %% [markdown]
# Your turn:
#
# 1. *S-curve*: how small may the swing be until the offset is worse than 5 ms?
# 2. *fingers*: compare the two rows of the table. Then raise the period: what do slow fingers cost?
# 3. *zigzag*: lower the period until the verdict changes. Mend it with the *search* slider, without
#    touching the drive.
# 4. *arc*: is there any setting that works?

# %%
from evcalib.widgets.designer import DriveDesigner

DriveDesigner(PLANS)

# %% [markdown]
# **Rules of thumb.** Keep the body's heading, and let the direction of travel swing by 30 degrees
# or more every few seconds; vary the speed; 15 s or more; some texture within a few metres; and a
# rough idea of the offset, so that the search stays below half a period of the motion.
#
# ## Exercises
#
# **1.** You drive the S-curve for four times as long. By how much does the offset improve? And if
# you drive it twice as fast along the same path?
#
# <details><summary>Solution</summary>
#
# Four times the information, half the standard deviation, until the floor of about a millisecond
# that all sightings share. Twice as fast along the same path is half the period *and* twice the
# speed, for half the time: rates of turning double (four times the information), displacements
# double (another four), the time halves. In all about $\sqrt 8$ times better. Check:
# `predict(plan("S-curve", duration=64.0))` and `predict(plan("S-curve", period=3.0, speed=1.0,
# duration=8.0))`.
#
# </details>
#
# **2.** A vehicle stops and goes along a straight line. Which of the two unknowns can it show?
#
# <details><summary>Solution</summary>
#
# The offset, by the speeds; and of the rotation all but the part about the line itself. In (2) the
# speeds make $L(s)$ fall off, though all directions are equal.
#
# </details>
#
# **3.** Why can a longer search make a calibration *fail* that worked before?
#
# <details><summary>Solution</summary>
#
# If the motion repeats itself with period $P$, the search holds only one answer as long as it stays
# within $\pm P/2$ (or $\pm P/4$ if left and right are alike, as in a zigzag). Beyond, there is a
# second offset that fits as well, and an honest tool has to say so.
#
# </details>
#
# ## In the library
#
# - `evcalib.calibrate`, `evcalib.pipeline`: the whole chain; `CalibrationRun` is all it returns.
# - `evcalib.design`: `predict`, `self_likeness`, `Viewing`; `evcalib.widgets.designer`.
# - `evcalib.plots.report.report_figures`, `evcalib.report.report_html`: pictures and page.
# - `data_tools.recordings.open_recording`, `data_tools.velocity_sources`: what can be read.
# - `evcalib calibrate --help`, `evcalib export --help`, `evcalib info RECORDING`.
#
# **Next:** notebooks 1 to 5 build the chain from the events up. Notebook 6 opens up the call that
# you have just made.
