# %% [markdown]
# # 1. Representations: from events to images
#
# **For whom.** You know images, and you have heard that an event camera does not make any.
#
# **What you will learn.**
#
# 1. what an event is, and why the speed of the camera matters so much,
# 2. five ways to make an image of events (*surfaces*), and what each of them forgets,
# 3. how corners are found without an image, from times alone,
# 4. how to measure whether a surface is clean and independent of speed,
# 5. which surface is best for the direction of motion. The answer may surprise you.
#
# **Required knowledge.** Arrays, and the exponential function. **Time.** 30 minutes.
#
# **Where we are.** The calibration needs the direction in which the camera moves. This notebook
# makes images and corners from events; notebook 2 makes directions from them.

# %%
import matplotlib.pyplot as plt
import numpy as np

from data_tools.samples import load_sample, slider_depth
from evcalib.corners import arc_star
from evcalib.events import Events
from evcalib.plots import style
from evcalib.plots.events import NAMES, draw_over_speed, draw_row_of_time, draw_surface
from evcalib.surface_quality import edges, grey, likeness, score_surface, surface_images
from evcalib.surfaces import time_surface, tos, tos_ts

style.use()

# %% [markdown]
# ## Events
#
# A pixel of an event camera reports when the logarithm of its brightness has changed by a fixed
# amount since its last report: column, row, time, and whether it became brighter (*ON*) or darker
# (*OFF*). Nothing moves, nothing is reported.
#
# The recordings here are simulated (`notebooks/_make_data.py`): a camera slides 0.4 m through a
# furnished room, to the right and a little forward. It does so four times, at four speeds.

# %%
SPEEDS = (0.2, 0.4, 0.8, 1.6)  # m/s
samples = {v: load_sample(f"data/speed_{round(100 * v):03d}.npz") for v in SPEEDS}
for speed, sample in samples.items():
    ev = sample.events
    print(f"{speed:.1f} m/s: {len(ev)} events in {ev.duration:.2f} s, {ev.p.mean():.1%} ON")

# %% [markdown]
# The number of events is nearly the same at all speeds: an edge that crosses a pixel makes as many
# events however long it takes. The slow recording has a few more, since noise has more time.
#
# Here is half a row of pixels over time. **See:** edges draw lines; the steeper the line, the
# slower the edge. Left and right are the same picture but for the scale of time.

# %%
figure, axes = plt.subplots(1, 2, figsize=(7.0, 2.7))
for ax, speed in zip(axes, (0.2, 1.6), strict=True):
    draw_row_of_time(ax, samples[speed].events, row=60)
    ax.set_title(f"{speed} m/s")
    ax.set_xlim(10, 90)
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# So two times matter, and they are not the same thing: the clock's, and the *scene's*, which
# counts how far edges have moved. A surface that depends on the clock looks different at another
# speed, and a corner on it is hard to recognise when the vehicle brakes.
#
# ## The time surface
#
# The simplest surface remembers the last time $T(x, y)$ of each pixel and lets it fade:
#
# $$\mathrm{TS}(x, y) = e^{-(t - T(x, y)) / \tau}. \tag{1}$$
#
# Three events of a toy sensor, rendered 30 ms after the last, with $\tau = 30$ ms:

# %%
three = Events.from_arrays([1, 2, 3], [1, 1, 1], [10_000, 40_000, 70_000], [1, 1, 1], 5, 3)
fading = time_surface(three, 100_000, tau=0.03)
print(np.round(fading[1], 3))

assert np.allclose(fading[1], [0, np.exp(-3), np.exp(-2), np.exp(-1), 0])

# %% [markdown]
# ## The threshold-ordinal surface
#
# TOS (Glover et al. 2021) has no clock. Every event makes its own pixel 255 and takes 1 from all
# others in a patch of $k \times k$; what falls below $255 - 2k$ becomes 0. So a pixel is dark not
# when it is *old*, but when its neighbours have had events since.
#
# The same three events, then the same ten times as fast. **See:** nothing changes.

# %%
faster = Events(three.x, three.y, three.t // 10, three.p, 5, 3)
print(tos(three, k=3))

assert np.array_equal(tos(three, k=3), tos(faster, k=3))
assert not np.allclose(fading, time_surface(faster, 10_000, tau=0.03))

# %% [markdown]
# ## SILC and DiST
#
# - **SILC** (Manderscheid et al. 2019): an event takes 1 from all pixels of its patch that are
#   not darker than its own, and sets its own to the patch's area. Behind an edge this leaves a
#   ramp of fixed length, whatever the speed.
# - **DiST** (Kim et al. 2021): sort all pixels by their last time, discounted where the patch is
#   busy, and keep only the *rank*. Order has no unit, so no clock remains.
#
# ## TOS AND TS
#
# TOS never forgets where nothing happens: a noise event in an empty region stays white for ever.
# The paper therefore lets through only what is young:
#
# $$\mathrm{TOS\,AND\,TS} = \begin{cases} \mathrm{TOS} & \text{if } \mathrm{TS} > \theta \\
# 0 & \text{otherwise.} \end{cases} \tag{2}$$
#
# The paper gives no $\theta$. By (1) it stands for an age: values live for $\tau \ln(1/\theta)$,
# with our 30 ms and 0.1 for 69 ms. Mind that (2) brings the clock back in.

# %%
lone = Events.from_arrays([2], [1], [0], [1], 5, 3)
for age_ms in (68, 69, 70):
    print(f"after {age_ms} ms: TOS {tos(lone)[1, 2]}, AND TS {tos_ts(lone, 1000 * age_ms)[1, 2]}")

# %% [markdown]
# ## Corners without an image
#
# Arc* (Alzugaray & Chli 2018) looks only at the *order of times* on two circles around an event.
# When a corner moves, the newest pixels on each circle form one arc of limited length. There is
# nothing to render, and the test runs for every event:

# %%
corners = {speed: sample.events[arc_star(sample.events)] for speed, sample in samples.items()}
for speed, found in corners.items():
    print(f"{speed:.1f} m/s: {len(found) / len(samples[speed].events):.1%} of events are corners")

# %% [markdown]
# Not quite without a clock either: Arc* ignores an event that follows another of the same polarity
# within 50 ms. At high speed this is a longer way, so fewer corners are left.
#
# ## The paper's figure
#
# Fig. 2 of the paper shows all of them side by side. The nine pictures of a recording were taken
# at 10, 20, ..., 90 % of the path, so at every speed we know when the camera was at these places.
# Polarities are merged.

# %%
PLACES = np.arange(1, 10)


def rendered(speed, name, **options):
    """Return the surface at the nine places."""
    t_us = [round(1e5 * place * 0.4 / speed) for place in PLACES]
    return surface_images(name, samples[speed].events, t_us, **options)


# %% [markdown]
# A function draws them, so that two speeds can be compared. Circles are Arc* corners of the last
# 2 % of the path. To see pixels, only a part of 84 x 60 of them is shown.


# %%
def draw_all(speed, place):
    """Draw the picture and the five surfaces at one of the places."""
    length = 0.4e6 / speed
    t = round(0.1 * place * length)
    recent = corners[speed].between(round(t - 0.02 * length), t)
    spots = np.column_stack((recent.x, recent.y))
    figure, axes = plt.subplots(2, 3, figsize=(7.8, 4.3))
    shown = {"picture": samples[0.2].frames[place - 1]}
    shown |= {NAMES[name]: rendered(speed, name)[place - 1] for name in NAMES}
    for ax, (name, image) in zip(axes.flat, shown.items(), strict=True):
        draw_surface(ax, image, spots, title=name, part=(12, 40, 84, 60))
    plt.show()


# %% [markdown]
# First slowly, at 0.2 m/s. **See:** DiST and SILC show broad ramps behind the edges. TOS shows
# thin lines and also the litter of noise between them. TS is nearly black, because at this speed
# most edges are older than $\tau$; TOS AND TS is clean, and thin for the same reason.

# %%
draw_all(0.2, place=7)

# %% [markdown]
# Now the very same place, passed at 1.6 m/s. **See:** DiST, SILC and TOS hardly changed. TS is
# full of long tails. TOS AND TS has nearly become TOS, since most of what TOS shows is now younger
# than 69 ms.

# %%
draw_all(1.6, place=7)

# %% [markdown]
# ## Which surfaces do not depend on speed?
#
# Put a number on it: the correlation between the surface at some speed and at 0.2 m/s, at the same
# place, averaged over the seven places from 30 % on.

# %%
images = {name: {v: rendered(v, name) for v in SPEEDS} for name in NAMES}


def likeness_to_slow(name, speed):
    """Return the mean correlation with the slowest recording."""
    pairs = zip(images[name][speed][2:], images[name][0.2][2:], strict=True)
    return float(np.mean([likeness(grey(a), grey(b)) for a, b in pairs]))


# %% [markdown]
# **See:** DiST 0.94 and SILC 0.91 over a range of eight in speed. TOS follows; what it lacks is
# noise, which differs between recordings and which TOS shows as bright as anything. The two with
# a clock fall to 0.6. By this measure *the paper's surface is not independent of speed*.

# %%
like = {name: [likeness_to_slow(name, v) for v in SPEEDS] for name in NAMES}
print("speed [m/s]" + "".join(f"{v:8.1f}" for v in SPEEDS))
for name, values in like.items():
    print(f"{NAMES[name]:11s}" + "".join(f"{value:8.2f}" for value in values))

assert min(like["dist"]) > 0.9 > 0.7 > like["tos_ts"][-1]

# %% [markdown]
# ## How clean are they, and are corners found again?
#
# The simulator knows the distance of every pixel, so it can say where a corner must be in the next
# picture. That gives three more numbers:
#
# - *on edges*: the share of a surface's brightness that lies on an edge of the picture (48 % of the
#   image does, so that is what pure chance would score);
# - *repeatability*: the 80 strongest Harris corners **of the surface itself** in one picture; which
#   share is found again in the next within 2 px of where the motion takes it (chance: 6 %);
# - *right matches*: Arc* corners, described by BRIEF **on the surface**, matched with the next
#   picture; how many land where they should.

# %%
table = {}
for speed in SPEEDS:
    step = round(1e5 * 0.4 / speed)
    for name in NAMES:
        at = images[name][speed]
        known = samples[0.2], at, corners[speed], [step * int(place) for place in PLACES], step
        table[speed, name] = score_surface(*known)

# %% [markdown]
# `score_surface` did the work. At the lowest and the highest speed:

# %%
for speed in (0.2, 1.6):
    print(f"at {speed} m/s   on edges  repeatability  right  wrong")
    for name in NAMES:
        s = table[speed, name]
        shares = f"{s.on_edges:8.0%} {s.repeatability:14.0%}"
        print(f"  {NAMES[name]:10s} {shares} {s.right:6.0f} {s.wrong:6.0f}")

# %% [markdown]
# The same over all speeds. **See:** the surfaces with a clock are the cleanest where the camera is
# slow, and lose it when it is fast. Corners *on* the surface come back best on SILC and DiST: ramps
# have gradients that a detector can use, thin white lines do not. And DiST and SILC give up to
# twice as many right matches as TOS. Wrong ones are few on all.

# %%
figure, axes = plt.subplots(1, 3, figsize=(8.6, 2.9))
fields = {
    "on_edges": "brightness on edges [-]",
    "repeatability": "corners found again [-]",
    "right": "right matches per pair [-]",
}
for ax, (field, title) in zip(axes, fields.items(), strict=True):
    draw_over_speed(
        ax, SPEEDS, {n: [getattr(table[v, n], field) for v in SPEEDS] for n in NAMES}, title
    )
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
plt.show()

# %% [markdown]
# What counts as an edge? A step of 45 of 255 between neighbouring pixels. Whoever writes such a
# number should show what it selects:

# %%
frame = samples[0.2].frames[6]
figure, axes = plt.subplots(1, 2, figsize=(5.4, 2.2))
part = (12, 40, 84, 60)
draw_surface(axes[0], frame, title="picture", part=part)
draw_surface(axes[1], edges(frame), title=f"edges: {edges(frame).mean():.0%} of all", part=part)
plt.show()

# %% [markdown]
# ## Which is best for the direction of motion?
#
# All this is only a means. What we want is the heading, and that has been measured with the whole
# chain of notebook 2 on full-size recordings: simulated ones (346 x 260; sideways, oblique and
# forward motion) and the real *slider_depth* of the Event Camera Dataset (240 x 180). The real
# recording exists at one speed only; dividing all its times by a factor gives exactly the events
# of a faster camera. The table was stored by
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
# - The *displacement* of a corner is measured between images of events (notebook 6), not on the
#   surface. The surface only describes corners, so it decides how many matches there are, not how
#   exact they are.
# - One heading pools hundreds of matches and throws out those that disagree. Forty right ones or
#   seventy: both are plenty.
#
# The package keeps the paper's TOS AND TS as the default. It costs far less than DiST, and the
# choice does not matter here. It would matter to somebody who detects corners *on* the surface.
#
# If the environment variable `EVCALIB_DATA` names a folder with *slider_depth*, here it is, half a
# second after its start. (Otherwise nothing is shown; the recording may not be passed on with this
# notebook.)

# %% tags=["nbval-ignore-output"]
real = slider_depth()
if real:
    figure, axes = plt.subplots(1, 5, figsize=(12.0, 2.2))
    for ax, name in zip(axes, NAMES, strict=True):
        image = surface_images(name, real.events, [500_000])[0]
        draw_surface(ax, image, title=NAMES[name])
    plt.show()

# %% [markdown]
# ## Try it
#
# The panel shows the same six images. Try this:
#
# 1. Set the time to 70 % and move only *speed*. Which images stay as they are?
# 2. At 0.2 m/s, raise *tau* until TOS AND TS equals TOS. At which age does that happen? What tau
#    would the fastest recording need to look like the slowest with 30 ms?
# 3. Raise *threshold* at 1.6 m/s. Can you make the litter go away without losing the edges?
# 4. Change *patch*: what do SILC's ramps do, and what TOS's lines?

# %%
from evcalib.widgets.surfaces import SurfacePanel

SurfacePanel({f"{speed} m/s": sample for speed, sample in samples.items()})

# %% [markdown]
# ## Exercises
#
# **1.** Events come at pixel A at 0 ms, and at its right neighbour B at 10, 20 and 30 ms. What is
# TOS ($k = 7$) at A and B after that? And at A after 15 events at B?
#
# <details><summary>Solution</summary>
#
# A: each event at B takes 1 from it, $255 - 3 = 252$. B: 255, set anew each time. The threshold is
# $255 - 14 = 241$, so after 14 events A has 241 and lives; the 15th takes it to 240, hence to 0.
#
# </details>
#
# **2.** Which $\tau$ makes TOS AND TS keep events of the last 10 px of motion, if edges move at 20
# px/s, and $\theta = 0.1$?
#
# <details><summary>Solution</summary>
#
# 10 px take 0.5 s, and $\tau \ln 10 = 0.5$ s gives $\tau = 0.217$ s. At 200 px/s it would be 22 ms.
# A fixed $\tau$ fits one speed only.
#
# </details>
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
# - `evcalib.surfaces`: each surface as a function, and as a class with `update` and `render` for
#   long recordings. `evcalib.corners.arc_star` and `ArcStar` likewise, and `TosHarris`, which
#   looks for corners on the TOS.
# - `evcalib.surface_quality`: `likeness`, `score_surface` and what they are made of.
# - `evcalib.plots.events`, `evcalib.widgets.surfaces.SurfacePanel`: the pictures of this notebook.
# - `estimate_headings(events, camera, surface="dist")` and
#   `evcalib headings RECORDING --surface dist` use another surface for the whole chain.
#
# **Next:** two such images, a few seconds of geometry, and out comes the direction of motion.
