# %% [markdown]
# # 4. Offset: two streams, two clocks
#
# **For whom.** You have two logs of the same drive, written by two computers whose clocks do not
# agree, and you have never aligned any.
#
# **What you will learn.**
#
# 1. how to find the time offset *before* knowing how the camera is mounted,
# 2. what the paper's trace correlation is, and the three mends that it needs,
# 3. why we search with a robust score instead, and how to read a peak between grid points,
# 4. how exact any method can be (the Cramér-Rao bound),
# 5. why a drive in a circle can never reveal the offset, and how the library says so.
#
# **Required knowledge.** Covariance and eigenvalues, as ideas. **Time.** 30 minutes.
#
# **Where we are.** Notebook 2 turned events into directions $\mathbf v_e(t)$ in the camera frame,
# notebook 3 wheels into velocities $\mathbf v_o(t)$ in the body frame. Equations are numbered here
# on their own; a departure from it is said where it occurs.

# %%
import matplotlib.pyplot as plt
import numpy as np

from data_tools.motion import Noise, arc, s_curve, simulate, straight, zigzag
from evcalib import align
from evcalib.geometry import random_rotation, rotation_angle
from evcalib.offset import candidate_offsets, find_offset
from evcalib.plots import style
from evcalib.plots.alignment import draw_curve
from evcalib.plots.offset import draw_streams
from evcalib.refinement import inliers_at, refine_offset
from evcalib.track import velocity_track

style.use()

# %% [markdown]
# ## The problem
#
# A time on the body clock is the camera's time plus an unknown offset, and a direction in the body
# frame is the camera's, turned by an unknown rotation. So at the true offset $t_d$
#
# $$\mathbf v_o(t + t_d) = R\,\mathbf v_e(t), \qquad t_\text{body} = t_\text{cam} + t_d. \tag{1}$$
#
# (Lengths do not count: a camera sees only the direction of its motion.) We simulate 20 s along an
# S-curve, the camera mounted at random, its clock 137 ms behind:


# %%
def drive_along(drive, seed, *, offset=0.137, **spoiled):
    noise = Noise(**{"sigma": 0.05, **spoiled})
    odometry = Noise(sigma=0.02 if noise.sigma else 0.0)
    return simulate(
        drive,
        np.random.default_rng(seed),
        offset=offset,
        heading_noise=noise,
        velocity_noise=odometry,
    )


streams = drive_along(s_curve(), seed=1)
print(len(streams.headings), "headings,", len(streams.velocities), "velocities")

# %% [markdown]
# **See:** both streams swing with the same period, and that is all they share at first sight. The
# camera's three numbers stand in its own axes, which nobody knows.

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=style.WIDE)
for axis, values in zip("xyz", streams.headings.v.T, strict=True):
    left.plot(streams.headings.t, values, ".", ms=2, label=axis)
left.set_ylim(-1.1, 1.6)
left.legend(loc="upper center", ncols=3, markerscale=5)
v = streams.velocities.v
right.plot(streams.velocities.t, np.degrees(np.arctan2(v[:, 1], v[:, 0])), color=style.BODY)
style.label(left, "camera time [s]", "heading, camera frame [-]")
style.label(right, "body time [s]", "azimuth, body frame [deg]")
plt.show()

# %% [markdown]
# ## A number that no rotation changes
#
# Shift the odometry by a candidate offset and pair it with the headings. Let $S_{oo}$, $S_{ee}$ and
# $S_{oe}$ be the covariances of the pairs. The paper's **trace correlation** is
#
# $$r = \sqrt{\tfrac1k\,\operatorname{tr}\bigl(S_{oo}^{+}\,S_{oe}\,S_{ee}^{+}\,S_{eo}\bigr)}.
# \tag{2}$$
#
# It measures how much of one stream is a *linear function* of the other: 1 if all of it, 0 if
# nothing. Turning the headings by $R$ makes $S_{oe}$ into $S_{oe}R^\top$ and $S_{ee}$ into
# $R S_{ee} R^\top$; in the product every $R$ meets its inverse. So (2) needs no rotation. Here
# $^{+}$ is the pseudo-inverse and $k$ the smaller rank:


# %%
def trace_correlation(o, e):
    o, e = o - o.mean(axis=0), e - e.mean(axis=0)
    oo, ee, oe = o.T @ o, e.T @ e, o.T @ e
    rank = min(np.linalg.matrix_rank(oo, tol=1e-9), np.linalg.matrix_rank(ee, tol=1e-9))
    inverse_o, inverse_e = (np.linalg.pinv(s, rcond=1e-9, hermitian=True) for s in (oo, ee))
    return np.sqrt(np.trace(inverse_o @ oe @ inverse_e @ oe.T) / rank)


# %% [markdown]
# Three cases that you can check in your head: a stream with its own turned copy; the same with
# noise, and turned once more; and two streams that have nothing to do with each other.

# %%
rng = np.random.default_rng(0)
o = s_curve().velocity(np.arange(0, 20, 0.05))
e = o @ random_rotation(rng)
noisy, unrelated = (0.2 * rng.standard_normal(o.shape), rng.standard_normal(o.shape))
print(f"turned copy {trace_correlation(o, e):.3f}, unrelated {trace_correlation(o, unrelated):.2f}")

assert np.isclose(trace_correlation(o, e), 1.0)
here, turned = e + noisy, (e + noisy) @ random_rotation(rng)
assert np.isclose(trace_correlation(o, here), trace_correlation(o, turned))

# %% [markdown]
# ### Three mends
#
# **Rank.** A ground vehicle has $v_z = 0$, so $S_{oo}$ has a zero eigenvalue and the inverse that
# the paper writes does not exist; hence the pseudo-inverse. **Factor.** The paper divides by 3, the
# number of axes. With only two that vary, even perfect agreement would then stop at
# $\sqrt{2/3}$; hence $1/k$.

# %%
print("eigenvalues of S_oo:", np.round(np.linalg.eigvalsh(np.cov(o.T)), 3))
print(f"perfect agreement with 1/3: {np.sqrt(2 / 3) * trace_correlation(o, e):.4f}")

# %% [markdown]
# **Lag.** The paper also writes the lag into the covariances of a stream with *itself*. But once
# the odometry has been looked up at $t + t_d$, the pairs are simultaneous, and all three
# covariances are plain ones, as above.
#
# Now the search (the paper's Alg. 1): for each candidate, look up the body's direction at
# $t + t_d$. A `VelocityTrack` does that; it never bridges gaps, so a heading without odometry gives
# zeros and is left out. To compare like with like, we keep the headings that all candidates cover.

# %%
track, offsets = velocity_track(streams.velocities), candidate_offsets(1.0)
t = streams.headings.t
inner = (t - 1 >= track.t[0]) & (t + 1 <= track.t[-1])
e, t = streams.headings.v[inner], t[inner]
by_hand = np.array([trace_correlation(track.directions(t, t, td), e) for td in offsets])
print(f"best candidate: {offsets[by_hand.argmax()]:.2f} s, true {streams.offset} s")

# %% [markdown]
# `find_offset` runs the same arithmetic in a compiled loop:

# %%
trace = find_offset(streams.headings, track, method="trace")
assert np.allclose(trace.score, by_hand)

# %% [markdown]
# ## The rigid profile
#
# Equation (2) allows *any* linear map between the streams, where (1) says that it is a rotation.
# And squares, of which covariances are made, let a few wild headings spoil everything. Our default
# uses both: at each candidate, the best rotation under a robust loss,
#
# $$s(t_d) = \max_{R}\; \frac{1}{\sum w_i} \sum_i w_i
# \Bigl[1 - \frac{u_i}{c}\Bigr]_+^3, \qquad
# u_i = 1 - \mathbf v_o(t_i + t_d)^\top R\,\mathbf v_e(t_i). \tag{3}$$
#
# The misfit $u$ is 0 for parallel directions and 2 for opposite ones; from $c$ on a heading counts
# nothing (Tukey's loss). $R$ comes from a few re-weighted fits (notebook 5), with $c$ narrowing
# from 180 to 60 degrees, so that each candidate finds its own rotation.

# %%
profile = find_offset(streams.headings, track, method="profile")
print(f"trace {trace.offset:.3f} s, profile {profile.offset:.3f} s, true {streams.offset} s")

# %% [markdown]
# Now the sign of 40 % of the headings is turned, as happens to a camera that cannot tell what is in
# front of it from what is behind. **See:** the trace correlation (left) hardly rises above what
# chance gives, and its peak has wandered off. The profile (right) is lower, but stands where it
# stood.

# %%
flipped = drive_along(s_curve(), seed=5, flips=0.4)
flipped_track = velocity_track(flipped.velocities)
figure, axes = plt.subplots(1, 2, figsize=style.WIDE)
for ax, method in zip(axes, ("trace", "profile"), strict=True):
    curve = find_offset(flipped.headings, flipped_track, method=method)
    draw_curve(ax, curve, found=curve.offset, true=flipped.offset)
    ax.set_xticks([-1, -0.5, 0, 0.5, 1])
plt.show()

# %% [markdown]
# One drive proves little. Twenty drives each, three kinds of trouble, median and worst error:

# %%
troubles = {"clean": {}, "40 % flipped": {"flips": 0.4}, "60 % random": {"outliers": 0.6}}
for name, trouble in troubles.items():
    errors = {"trace": [], "profile": []}
    for seed in range(20):
        s = drive_along(s_curve(), seed, **trouble)
        on = velocity_track(s.velocities)
        for method, found in errors.items():
            found.append(1000 * abs(find_offset(s.headings, on, method=method).offset - s.offset))
    words = [f"{m} {np.median(x):.1f} (worst {max(x):.0f})" for m, x in errors.items()]
    print(f"{name:12s} [ms]: {', '.join(words)}")

# %% [markdown]
# ## Between the grid points
#
# The grid has 10 ms. A finer one does not help: noise of the odometry makes the curve rough at that
# scale, and a fine grid climbs the roughness. Instead we fit a parabola to the points around the
# peak and take its vertex. `refine_offset` then repeats that under a loss as narrow as the noise.

# %%
near = np.abs(profile.offsets - profile.offsets[profile.peak]) < 0.055
a, b, c = np.polyfit(profile.offsets[near], profile.score[near], 2)
refined = refine_offset(streams.headings, track, profile.offset)
print(f"grid    {profile.offsets[profile.peak]:.3f} s")
print(f"vertex  {-b / (2 * a):.4f} s, in the library {profile.offset:.4f} s")
print(f"refined {refined.offset:.4f} s, true {streams.offset} s")

# %% [markdown]
# ## How exact can it be?
#
# Move the offset by a little $\delta$: the body's azimuth at heading $i$ moves by $\omega_i\delta$,
# where $\omega_i$ is the rate at which the direction of travel turns. The rotation may answer with
# a turn $\varphi$ about the vertical. So the data see only
#
# $$r_i = \omega_i\,\delta + \varphi + \text{noise}, \qquad \text{sd } \sigma. \tag{4}$$
#
# That is a straight line through points $(\omega_i, r_i)$ with slope $\delta$ and intercept
# $\varphi$. The variance of a slope is in every textbook, and no unbiased method does better
# (Cramér-Rao):
#
# $$\operatorname{Var}(t_d) \;\ge\; \frac{\sigma^2}{\sum_i (\omega_i - \bar\omega)^2}. \tag{5}$$


# %%
def bound(drive, t, sigma):
    rate = (drive.angle(t + 1e-4) - drive.angle(t - 1e-4)) / 2e-4
    return sigma / np.sqrt(np.sum((rate - rate.mean()) ** 2))


errors = []
for seed in range(40):
    s = drive_along(s_curve(), seed, sigma=0.1)
    on = velocity_track(s.velocities)
    start = find_offset(s.headings, on).offset
    errors.append(refine_offset(s.headings, on, start).offset - s.offset)
best = bound(s_curve(), s.headings.t + s.offset, 0.1)
print(f"error {1000 * np.std(errors):.0f} ms (rms of 40 drives), bound {1000 * best:.0f} ms")

# %% [markdown]
# With a heading every 33 ms that are each 6 degrees wrong, the offset is known to some ten
# milliseconds, and there is little left to gain.
#
# ## The arc
#
# Look at (5) again: what if the direction turns at a *constant* rate? Then all
# $\omega_i = \bar\omega$, the sum is zero and the bound infinite. This is not a matter of noise. On
# such an arc, a later direction is an earlier one, turned:
#
# $$\mathbf v_o(t + t_d) = R_z(\omega t_d)\,\mathbf v_o(t). \tag{6}$$
#
# So any wrong offset is made good by another rotation. Let us check it on the exact drive:

# %%
omega = 0.25  # an arc of 4 m at 1 m/s [rad/s]
t, td = np.arange(0.0, 15.0, 0.1), 0.7
cos, sin = np.cos(omega * td), np.sin(omega * td)
R_z = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
assert np.allclose(arc(radius=4.0).velocity(t + td), arc(radius=4.0).velocity(t) @ R_z.T)

# %% [markdown]
# Now both scores, without any noise, on an arc and on an S-curve:

# %%
clean = {"arc": drive_along(arc(), 2, sigma=0.0), "S-curve": drive_along(s_curve(), 2, sigma=0.0)}
tracks = {name: velocity_track(s.velocities) for name, s in clean.items()}
for name, s in clean.items():
    for method in ("trace", "profile"):
        score = find_offset(s.headings, tracks[name], method=method).score
        print(f"{name:8s} {method:8s} from {np.nanmin(score):.3f} to {np.nanmax(score):.3f}")

# %% [markdown]
# **See, left:** on the arc the score is 1 for *every* offset; there is no peak to find. **Right:**
# where did the offset go? Into the rotation. The rotation that belongs to each offset is wrong by
# $\omega\,|t_d - t_d^\text{true}|$, exactly as (6) says. A method that reports the "best" offset
# here reports rounding errors, and ruins the rotation with them.

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=style.WIDE)
looks = {"arc": (style.OUTLIER, "-"), "S-curve": (style.BODY, "--")}
for name, s in clean.items():
    color, dash = looks[name]
    score = find_offset(s.headings, tracks[name]).score
    left.plot(offsets, score, dash, color=color, label=name)
    fits = [inliers_at(s.headings, tracks[name], td).R_body_cam for td in offsets[::5]]
    error = [np.degrees(rotation_angle(R, s.R_body_cam)) for R in fits]
    right.plot(offsets[::5], error, dash, color=color, label=name)
for ax, name in ((left, "robust score [-]"), (right, "error of the best rotation [deg]")):
    ax.axvline(0.137, color=style.TRUE, ls=":", label="true")
    style.label(ax, "offset [s]", name)
left.legend()
plt.show()

# %% [markdown]
# The paper has an experiment on arcs, too. With a constant rate of turning it cannot have worked as
# described: the offset found there is a matter of chance, the rotation inherits its error by (6),
# and the wider the search, the worse.
#
# On the S-curve a wrong offset cannot be hidden, neither in the score nor in the rotation:
# left and right swings are symmetric, so the best rotation stays right even at wrong offsets.
#
# ## What the library says
#
# `align` tests what the motion can tell before it believes a peak: does the heading rate vary by
# more than its noise, do the headings follow that, and is the best offset the only plausible one?

# %%
drives = {
    "S-curve": s_curve(),
    "arc": arc(),
    "straight": straight(),
    "slow zigzag": zigzag(side=3.0),
    "fast zigzag": zigzag(side=0.73),
}
results = {}
for name, drive in drives.items():
    s = drive_along(drive, 3)
    results[name] = align(s.headings, s.velocities)
    print(f"{name}: {results[name].verdict.summary}")

# %% [markdown]
# The S-curve and the slow zigzag are answered, the arc and the straight line are refused. Where the
# offset is not observable, `align` uses the one that you give it (0 if you give none), and says
# whether the rotation depends on it.

# %%
for name in ("S-curve", "slow zigzag"):
    result = results[name]
    print(f"{name}: {1000 * result.offset:.0f} ms, sd {1000 * result.offset_sd:.0f} ms")
    assert abs(result.offset - 0.137) < 4 * result.offset_sd
for name in ("arc", "straight", "fast zigzag"):
    assert not results[name].offset_observable

# %% [markdown]
# ### Repeating motions
#
# Why is the fast zigzag refused? Its direction alternates every 0.73 s, so it repeats itself after
# 1.46 s. But **see:** the curve has a second and a third peak after only *half* of that. Shifted by
# half a period, left and right are exchanged, and turning the camera by 180 degrees about the
# forward axis exchanges them back. So a periodic drive is ambiguous as soon as the search is wider
# than half a period.

# %%
s = drive_along(drives["fast zigzag"], 3)
on = velocity_track(s.velocities)
curve = find_offset(s.headings, on)
figure, (left, right) = plt.subplots(1, 2, figsize=style.WIDE)
draw_curve(left, curve, true=s.offset)
left.set_xticks([-1, -0.5, 0, 0.5, 1])
shifted = s.offset - 0.73
R = inliers_at(s.headings, on, shifted).R_body_cam
draw_streams(right, s.headings.select(s.headings.t < 8), on, shifted, R)
figure.legend(loc="outside upper right", ncols=3, markerscale=3)
left.get_legend().remove()
plt.show()

# %% [markdown]
# On the right, the two streams 730 ms from the truth: no eye could tell. The remedy is knowledge
# from outside. Who knows that the clocks agree to 0.3 s searches only that far:

# %%
narrow = align(s.headings, s.velocities, max_offset=0.3)
half_turn = np.degrees(rotation_angle(R, s.R_body_cam))
print(f"rotation half a period off: wrong by {half_turn:.0f} deg")
print(f"{narrow.verdict.summary} {1000 * narrow.offset:.0f} ms")

assert narrow.offset_observable

# %% [markdown]
# ## Find it by hand
#
# Shift the body's stream until it lies under the camera's; each place that you try leaves a dot in
# the right panel. Then tick *compare*: it shows the whole curve, the truth, and the verdict of
# `align`. The true offset is another one here. Try this:
#
# 1. The S-curve: how near do you come? And with a noise of 0.30 rad?
# 2. The arc: which offset looks best? What happens to the dots?
# 3. The fast zigzag: find all three places that fit.

# %%
from evcalib.widgets.offset import OffsetPanel

OffsetPanel(lambda kind, noise: drive_along(drives[kind], 5, offset=-0.26, sigma=noise), drives)

# %% [markdown]
# ## Exercises
#
# **1.** The bound of the S-curve above was 9 ms. You may drive for four times as long, or
# swing twice as fast (half the period, same amplitude). Which helps more?
#
# <details><summary>Solution</summary>
#
# By (5), four times the headings quadruple the sum: half the bound. Twice as fast
# doubles every $\omega_i$ and quadruples the sum as well: also half, in a quarter of the time. But
# mind the aliases: the search must stay within half a (now shorter) period. Check:
# `bound(s_curve(80.0), np.arange(0, 80, 1 / 30), 0.1)` against
# `bound(s_curve(period=4.0), np.arange(0, 20, 1 / 30), 0.1)`.
#
# </details>
#
# **2.** A vehicle drives an arc to the left for 10 s and then one to the right, of equal radius. Is
# the offset observable?
#
# <details><summary>Solution</summary>
#
# Yes. $\omega_i$ is $+\omega$ in one half and $-\omega$ in the other, so $\bar\omega = 0$ and the
# sum in (5) is $n\,\omega^2$. Within each half (6) still holds, but the two halves ask for
# *opposite* rotations, and one rotation cannot serve both.
#
# </details>
#
# **3.** The vehicle stops and starts on a straight line, so its *speed* has a clear pattern. Could
# that give the offset?
#
# <details><summary>Solution</summary>
#
# Not from directions: they are the same all the time. A monocular camera does not know its speed
# (it sees speed over depth). Only moments of standing still can be recognised in both streams; we
# do not use them.
#
# </details>
#
# ## In the library
#
# - `evcalib.offset`: `find_offset` with `method="profile"`, `"trace"`, `"canonical"` or `"scalar"`
#   returns an `OffsetCurve`; `refine_offset`; `plausible_offsets`.
# - `evcalib.track.velocity_track`: the odometry at any time, without bridging gaps.
# - `evcalib.observability`: `heading_rate_test` and `steady_turning`, the tests behind the verdict.
# - `evcalib.plots.alignment.draw_curve`, `evcalib.plots.offset`, `evcalib.widgets.offset`.
# - From the command line: `evcalib align headings.csv velocities.csv --max-offset 1.0`
#
# **Next:** the streams are aligned in time. Notebook 5 finds the rotation between them, and what to
# do about headings that are simply wrong.
