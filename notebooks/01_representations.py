# %% [markdown]
# # 1. Representations: from events to images
#
# **For whom.** You know images, and you have heard that an event camera does not make any.
#
# **What you will be able to do.**
#
# 1. say what an event is, and why the speed of the camera matters so much,
# 2. make an image of events (a *surface*) in five ways, and say what each of them forgets,
# 3. find corners without an image, from times alone,
# 4. measure whether a surface is clean, and whether it looks the same at another speed,
# 5. choose a surface for finding the direction of motion. The answer may surprise you.
#
# **Required knowledge.** Arrays, and the exponential function.
#
# **Time.** 30 minutes: 20 of reading, 10 of playing with the panel.
#
# The question: which image of events looks the same whether the camera moves slowly or fast? The
# calibration needs the direction in which the camera moves (notebook 2), and for that it must find
# the same corners again in two images. The oldest answer lets the last time $T(x, y)$ of each pixel
# fade, with a time constant $\tau$:
#
# $$\mathrm{TS}(x, y) = e^{-(t - T(x, y)) / \tau}. \tag{1}$$
#
# This *time surface* is equation 2 of Lagorce et al. (2017). As you will see, it does depend on
# speed.

# %%
import matplotlib.pyplot as plt
import numpy as np

from data_tools.course.samples import load_sample, slider_depth
from evcalib.events import Events
from evcalib.features.corners import arc_star
from evcalib.features.repeatability import score_surface
from evcalib.plots import style
from evcalib.plots.events import NAMES, draw_over_speed, draw_rows_of_time, draw_surfaces
from evcalib.surfaces import time_surface, tos, tos_ts
from evcalib.surfaces.quality import edges, grey, likeness, surface_images

style.use()

# %% [markdown]
# ## Events
#
# A pixel of an event camera sends a report whenever the logarithm of its brightness has changed by
# a fixed amount since its last report. The report is the event: column, row, time, and whether the
# pixel became brighter (*ON*) or darker (*OFF*). Where nothing changes, nothing is sent.
#
# The recordings used here are simulated (by `notebooks/_make_data.py`). A camera slides 0.4 m
# through a furnished room, to the right and a little forward. It does so four times, at four
# speeds.

# %%
SPEEDS = (0.2, 0.4, 0.8, 1.6)  # m/s
samples = {v: load_sample(f"data/speed_{round(100 * v):03d}.npz") for v in SPEEDS}
for speed, sample in samples.items():
    ev = sample.events
    print(f"{speed:.1f} m/s: {len(ev)} events in {ev.duration:.2f} s, {ev.p.mean():.1%} ON")

# %% [markdown]
# The number of events is nearly the same at all speeds, because an edge that crosses a pixel makes
# as many events however long it takes. The slow recording has a few more: noise has more time.
#
# Here is half a row of pixels over time, at the lowest and at the highest speed.
#
# **See:** moving edges draw lines, and the steeper the line, the slower the edge. But for the scale
# of the time axis, the two panels are the same picture.

# %%
figure, axes = plt.subplots(1, 2, figsize=(9.4, 3.2))
draw_rows_of_time(axes, {f"{v} m/s": samples[v].events for v in (0.2, 1.6)}, row=60)
axes[1].set_ylabel("")
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# So there are two kinds of time: that of the clock, and that of the *scene*, which counts how far
# the edges have moved. A surface that goes by the clock looks different at another speed. A corner
# on it is hard to recognise when the vehicle brakes.
#
# ## The time surface
#
# Equation (1) goes by the clock. Take three events on a toy sensor of 5 x 3 pixels, one every 30
# ms, and draw the surface 30 ms after the last, with $\tau = 30$ ms. Each event is $1/e$ as bright
# as the next younger one, and a pixel without events is exactly 0:

# %%
three = Events.from_arrays([1, 2, 3], [1, 1, 1], [10_000, 40_000, 70_000], [1, 1, 1], 5, 3)
fading = time_surface(three, 100_000, tau=0.03)
print(np.round(fading[1], 3))

assert np.allclose(fading[1], [0, np.exp(-3), np.exp(-2), np.exp(-1), 0])

# %% [markdown]
# ## The threshold-ordinal surface
#
# The threshold-ordinal surface, TOS for short (Glover et al. 2021), has no clock. Each event sets
# its own pixel to 255 and takes 1 from all others in a patch of $k \times k$ pixels around it. What
# falls below $255 - 2k$ becomes 0. So a pixel fades not because time passes, but because its
# neighbours have had events since.
#
# Here are the same three events, and the same again ten times as fast. Nothing changes in TOS,
# while the time surface is a different one:

# %%
faster = Events(three.x, three.y, three.t // 10, three.p, 5, 3)
print(tos(three, k=3))

assert np.array_equal(tos(three, k=3), tos(faster, k=3))
assert not np.allclose(fading, time_surface(faster, 10_000, tau=0.03))

# %% [markdown]
# ## Two more without a clock
#
# - **SILC**, the speed-invariant surface for learned corners (Manderscheid et al. 2019): each
#   event takes 1 from those pixels of its patch that are at least as bright as its own, and then
#   sets its own pixel to the area of the patch. A moving edge so leaves a ramp behind it whose
#   length in pixels is always the same.
# - **DiST**, the discounted and sorted timestamps (Kim et al. 2021): sort all pixels by their last
#   time, counting those as older that lie in a busy patch, and keep only the *rank*. An order has
#   no unit, so no clock is left.
#
# ## TOS AND TS
#
# TOS has a weakness: where nothing else happens it never forgets. A noise event in an empty region
# stays white for ever. The paper therefore lets through only the pixels that are young by the time
# surface:
#
# $$\mathrm{TOS\,AND\,TS} = \begin{cases} \mathrm{TOS} & \text{if } \mathrm{TS} > \theta, \\
# 0 & \text{otherwise.} \end{cases} \tag{2}$$
#
# The paper gives no number for $\theta$. By (1) it stands for an age: a pixel lives for
# $\tau \ln(1/\theta)$. With our 30 ms and $\theta = 0.1$ that is 69 ms, as a single event shows.
# Note that (2) brings the clock back in.

# %%
lone = Events.from_arrays([2], [1], [0], [1], 5, 3)
for age_ms in (68, 69, 70):
    print(f"after {age_ms} ms: TOS {tos(lone)[1, 2]}, AND TS {tos_ts(lone, 1000 * age_ms)[1, 2]}")

# %% [markdown]
# ## Corners without an image
#
# Arc* ("arc star", Alzugaray and Chli 2018) finds corners by the *order of times* on two circles
# around an event. When a corner moves, the newest pixels on each circle form one arc of limited
# length. Nothing has to be drawn for that, and each event is tested when it comes:

# %%
corners = {speed: sample.events[arc_star(sample.events)] for speed, sample in samples.items()}
for speed, found in corners.items():
    print(f"{speed:.1f} m/s: {len(found) / len(samples[speed].events):.1%} of events are corners")

# %% [markdown]
# Arc* is not quite without a clock either. It leaves out an event that follows another of the same
# pixel and polarity within 50 ms. At high speed edges come a longer way in that time, so fewer
# corners are left.
#
# ## The paper's figure
#
# Fig. 2 of the paper shows all surfaces side by side. We do the same. The simulator also took nine
# ordinary pictures, at 10, 20, ..., 90 % of the path, so we know for each speed when the camera was
# at these places. ON and OFF events are treated alike.

# %%
PLACES = np.arange(1, 10)


def rendered(speed, name, **options):
    """Return the surface at the nine places."""
    t_us = [round(1e5 * place * 0.4 / speed) for place in PLACES]
    return surface_images(name, samples[speed].events, t_us, **options)


# %% [markdown]
# A function draws them, so that two speeds can be compared. Orange circles are Arc* corners of the
# last 2 % of the path. To make pixels visible, only a part of 84 x 60 of them is shown.

# %%
PART = (12, 40, 84, 60)  # first column, first row, width, height


def draw_all(speed, place, part=PART, size=(8.6, 4.7)):
    """Draw the picture and the five surfaces at one of the places."""
    length = 0.4e6 / speed
    t = round(0.1 * place * length)
    recent = corners[speed].between(round(t - 0.02 * length), t)
    shown = {"picture": samples[0.2].frames[place - 1]}
    shown |= {NAMES[name]: rendered(speed, name)[place - 1] for name in NAMES}
    figure = plt.figure(figsize=size)
    draw_surfaces(figure, shown, np.column_stack((recent.x, recent.y)), part=part)
    plt.show()


# %% [markdown]
# First slowly, at 0.2 m/s.
#
# **See:** DiST and SILC show broad ramps behind the edges. TOS shows thin lines, and between them
# the litter of noise. TS is nearly black, because at this speed most edges are older than $\tau$.
# TOS AND TS is clean, and sparse for the same reason.

# %%
draw_all(0.2, place=7)

# %% [markdown]
# Now the very same place, passed at 1.6 m/s.
#
# **See:** DiST, SILC and TOS have hardly changed. TS is full of long tails. TOS AND TS has nearly
# become TOS, since most of what TOS shows is now younger than 69 ms.

# %%
draw_all(1.6, place=7)

# %% [markdown]
# ## Which surfaces do not depend on speed?
#
# Put a number on it. How *like* are two images? We take their correlation: 1 if they agree but for
# brightness and contrast, 0 if they have nothing in common. Each surface is compared with the same
# surface at 0.2 m/s, at the same place; the mean is over the seven places from 30 % on.

# %%
images = {name: {v: rendered(v, name) for v in SPEEDS} for name in NAMES}


def likeness_to_slow(name, speed):
    """Return the mean correlation with the slowest recording."""
    pairs = zip(images[name][speed][2:], images[name][0.2][2:], strict=True)
    return float(np.mean([likeness(grey(a), grey(b)) for a, b in pairs]))


# %% [markdown]
# One row for each surface:

# %%
like = {name: [likeness_to_slow(name, v) for v in SPEEDS] for name in NAMES}
print("speed [m/s]" + "".join(f"{v:8.1f}" for v in SPEEDS))
for name, values in like.items():
    print(f"{NAMES[name]:11s}" + "".join(f"{value:8.2f}" for value in values))

assert min(like["dist"]) > 0.9 > 0.7 > like["tos_ts"][-1]

# %% [markdown]
# DiST stays at 0.94 and SILC at 0.91, while the speed grows eightfold. TOS follows with 0.83. What
# it lacks is the noise, which differs from recording to recording, and which TOS shows as bright as
# anything else. The two surfaces with a clock fall to 0.6. By this measure *the paper's surface is
# not independent of speed*.
#
# ## How clean are they, and are corners found again?
#
# The simulator knows the distance of what each pixel sees, so it can say where a corner must be in
# the next picture. That gives three more numbers:
#
# - *on edges*: the share of a surface's brightness that lies on an edge of the picture, or next to
#   one. (48 % of all pixels do, so that is what an image of pure noise would score.)
# - *repeatability*: take the 80 strongest Harris corners **of the surface itself**. Which share of
#   them is found again in the next image, within 2 px of where the motion takes them? (By chance 6
#   % would be.)
# - *right* matches: describe the Arc* corners by BRIEF, a pattern of brighter-or-darker comparisons
#   **on the surface**, and match them with those of the next image. How many land where they
#   should, and how many do not?

# %%
table = {}
for speed in SPEEDS:
    step = round(1e5 * 0.4 / speed)
    for name in NAMES:
        at = images[name][speed]
        known = samples[0.2], at, corners[speed], [step * int(place) for place in PLACES], step
        table[speed, name] = score_surface(*known)

# %% [markdown]
# `score_surface` did the work. Here are its numbers at the lowest and at the highest speed:

# %%
for speed in (0.2, 1.6):
    print(f"at {speed} m/s   on edges  repeatability  right  wrong")
    for name in NAMES:
        s = table[speed, name]
        shares = f"{s.on_edges:8.0%} {s.repeatability:14.0%}"
        print(f"  {NAMES[name]:10s} {shares} {s.right:6.0f} {s.wrong:6.0f}")

# %% [markdown]
# And over all speeds.
#
# **See:** left, the surfaces with a clock are the cleanest while the camera is slow, and lose that
# when it is fast. Middle, corners *on* the surface come back best on SILC and DiST: their ramps
# have slopes that a corner detector can use, thin white lines do not. Right, the same two give the
# most right matches, at 0.2 m/s more than twice as many as TOS.

# %%
figure, axes = plt.subplots(1, 3, figsize=(9.4, 3.2))
fields = {
    "on_edges": "brightness on edges [-]",
    "repeatability": "corners found again [-]",
    "right": "right matches per pair [-]",
}
for ax, (field, title) in zip(axes, fields.items(), strict=True):
    values = {n: [getattr(table[v, n], field) for v in SPEEDS] for n in NAMES}
    draw_over_speed(ax, SPEEDS, values, title)
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
plt.show()

# %% [markdown]
# What counted as an edge there? A step of 45 of 255 between neighbouring pixels. Whoever sets such
# a number should show what it selects.
#
# **See:** outlines of furniture and of its patterns are in, faint shading is out.

# %%
from evcalib.plots.events import draw_surface

frame = samples[0.2].frames[6]
figure, axes = plt.subplots(1, 2, figsize=(6.2, 2.5))
draw_surface(axes[0], frame, title="picture", part=PART)
draw_surface(axes[1], edges(frame), title=f"edges: {edges(frame).mean():.0%} of all", part=PART)
plt.show()

# %% [markdown]
# ## Which is best for the direction of motion?
#
# All this is only a means. What we want is the direction of motion, the *heading*. Its error has
# been measured with the whole chain of notebook 2: on simulated recordings of 346 x 260 pixels
# (sideways, oblique and forward motion), and on the real *slider_depth* of the Event Camera Dataset
# (240 x 180). The real recording exists at one speed only, but dividing all its times by a factor
# gives exactly the events of a faster camera. The table was stored by
# `python notebooks/_make_data.py tables DATA_FOLDER`.

# %%
errors = {}
stored = np.loadtxt("data/surfaces.csv", delimiter=",", skiprows=1, dtype=str)
for recording, speed, name, median, p90, found in stored:
    errors.setdefault((recording, speed), {})[name] = (float(median), float(p90), float(found))
print("median error / 90th percentile of the heading [deg]")
print(" " * 22 + "".join(f"{NAMES[name]:>14s}" for name in NAMES))
for (recording, speed), row in errors.items():
    cells = "".join(f"{row[n][0]:7.2f} /{row[n][1]:5.2f}" for n in NAMES)
    print(f"{recording:13s}{speed:>9s}{cells}")

# %% [markdown]
# The mean of the medians over all speeds:

# %%
for recording in ("simulated", "slider_depth"):
    rows = [row for (kind, _), row in errors.items() if kind == recording]
    means = {name: np.mean([row[name][0] for row in rows]) for name in NAMES}
    print(recording, ", ".join(f"{NAMES[n]} {mean:.2f}" for n, mean in means.items()))

# %% [markdown]
# **The answer: for headings, none of them is best.** The means of the five lie within a few
# hundredths of a degree on simulated data and within two tenths on real data, and no order holds
# from one speed to the next. How can that be, after such differences above?
#
# - How far a corner *moved* is measured between images of events (notebook 6), not on the surface.
#   The surface only describes corners. It decides how many matches there are, not how exact they
#   are.
# - One heading pools hundreds of matches and throws out those that disagree. Forty right ones or
#   seventy: both are plenty.
#
# The package keeps the paper's TOS AND TS as its default. It costs far less than DiST, and the
# choice does not matter here. It would matter to somebody who detects corners *on* the surface.
#
# If the environment variable `EVCALIB_DATA` names a folder with *slider_depth*, the next cell draws
# its surfaces half a second after the start, and you will see the same characters as above: ramps,
# thin lines, litter. Otherwise it draws nothing; the recording may not be passed on with this
# notebook.

# %% tags=["nbval-ignore-output"]
real = slider_depth()
if real:
    surfaces = {NAMES[n]: surface_images(n, real.events, [500_000])[0] for n in NAMES}
    draw_surfaces(plt.figure(figsize=(9.0, 4.7)), surfaces)
    plt.show()

# %% [markdown]
# ## Play with the surfaces
#
# The panel below shows these six images for any time and speed, with the settings of the surfaces
# in your hands. First as a static picture: the whole image, at 70 % of the slowest path.
#
# **See:** the orange circles of Arc* sit on the corners of bright and dark patches. They are the
# same in all images, since Arc* looks at times, not at a surface.

# %%
draw_all(0.2, place=7, part=None, size=(6.0, 3.3))

# %% [markdown]
# **Your turn.** The table below the picture has the numbers.
#
# 1. Press play. Then, at 70 %, move only *speed*. Which surfaces keep a likeness above 0.85 up to
#    1.6 m/s?
# 2. At 0.2 m/s, TOS AND TS has 12 % of its pixels lit. Go to 0.4 m/s and lower *tau* until it has
#    about 12 % again. Which tau is it? Which would you need at 1.6 m/s?
# 3. At 1.6 m/s, raise *threshold* until less than 10 % are lit. What age does it stand for?
# 4. Move *patch* from 3 to 15 px. What happens to SILC's ramps and to TOS's lines, and what share
#    of TOS is lit at either end?

# %%
from evcalib.widgets.surfaces import SurfacePanel

SurfacePanel({f"{speed} m/s": sample for speed, sample in samples.items()})

# %% [markdown]
# ## Exercises
#
# **1.** Events come at pixel A at 0 ms, and at its right neighbour B at 10, 20 and 30 ms. What is
# TOS ($k = 7$) at A and at B after that? And at A after 15 events at B?
#
# <details><summary>Solution</summary>
#
# A: each event at B takes 1 from it, $255 - 3 = 252$. B: 255, set anew each time. The threshold is
# $255 - 14 = 241$, so after 14 events A has 241 and lives; the 15th takes it to 240, hence to 0.
#
# </details><br>
#
# **2.** Which $\tau$ makes TOS AND TS keep the events of the last 10 px of motion, if edges move at
# 20 px/s, and $\theta = 0.1$?
#
# <details><summary>Solution</summary>
#
# 10 px take 0.5 s, and $\tau \ln 10 = 0.5$ s gives $\tau = 0.217$ s. At 200 px/s it would be 22 ms.
# A fixed $\tau$ fits one speed only.
#
# </details><br>
#
# **3.** Divide all times of a recording by two. Which of the five surfaces change, if each is
# rendered at the time of its last event?
#
# <details><summary>Solution</summary>
#
# TS and TOS AND TS, which contain $\tau$. TOS and SILC only know the order of events, which is the
# same. DiST knows times, but ranks are the same when all times are scaled (up to rounding to whole
# microseconds). Check with `surface_images` on `Events(ev.x, ev.y, ev.t // 2, ev.p, 160, 120)`.
#
# </details>
#
# ## In the library
#
# - [`evcalib.surfaces`](../evcalib/surfaces/__init__.py): each surface as a function, and as a
#   class with `update` and `render` for long recordings.
# - [`evcalib.features.corners`](../evcalib/features/corners.py): `arc_star` and `ArcStar` likewise,
#   and `TosHarris`, which looks for corners on the TOS.
# - [`evcalib.surfaces.quality`](../evcalib/surfaces/quality.py): `likeness`, `score_surface` and
#   what they are made of.
# - [`evcalib.plots.events`](../evcalib/plots/events.py) and
#   [`evcalib.widgets.surfaces.SurfacePanel`](../evcalib/widgets/surfaces.py): the pictures of this
#   notebook.
# - [`evcalib.estimate_headings`](../evcalib/heading/_estimator.py) takes `surface="dist"` and so on
#   for the whole chain; on the command line it is `evcalib headings RECORDING --surface dist`.
#
# **Next:** [notebook 2](02_heading.ipynb) takes two such images and finds the direction of motion.
