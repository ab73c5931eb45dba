# %% [markdown]
# # 5. Rotation: how the camera is mounted
#
# **For whom.** You have pairs of directions, each seen once by the camera and once by the vehicle,
# and want the rotation between the two frames, although some pairs are simply wrong.
#
# **What you will be able to do.**
#
# 1. derive the least-squares rotation in closed form (Kabsch) and compute it in three lines,
# 2. see why the formula in the paper's text gives a mirror image for a ground vehicle,
# 3. choose a robust loss, and say how many outliers it stands,
# 4. state how sure the result is, also when errors come in spells,
# 5. tell which motions leave an axis of the rotation open.
#
# **Required knowledge.** Matrices and the singular value decomposition (SVD). **Time.** 30 minutes:
# 20 to read, 10 to play.
#
# Notebook 4 aligned the two clocks. So headings $\mathbf e_i$ (in the camera frame) and body
# directions $\mathbf d_i$ now come in pairs. *Which rotation turns all headings into their body
# directions, as nearly as the noise allows?* In the plainest sense of "nearly", that is
#
# $$R = \arg\min_R \sum_i w_i\,\lVert\mathbf d_i - R\,\mathbf e_i\rVert^2, \tag{1}$$
#
# with weights $w_i$ that say how much each pair is trusted. The paper sums the lengths instead of
# their squares (L1); we shall come to that.

# %%
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np

from data_tools.simulation.drives import s_curve
from data_tools.simulation.streams import Noise, SyntheticStreams, simulate
from evcalib import align
from evcalib.alignment.rotation import METHODS, RotationEstimate, estimate_rotation, kabsch
from evcalib.geometry import random_rotation, rotation_angle
from evcalib.plots import style
from evcalib.plots.rotation import draw_breakdown, draw_losses, draw_map, draw_weights

style.use()

# %% [markdown]
# ## Pairs of directions
#
# The vehicle swings its direction of travel by 57 degrees to either side, for 20 s. The camera is
# mounted at random and gives 10 headings per second, each wrong by 0.1 rad (5.7 degrees) per axis.
# The clocks agree here, so the odometry is looked up at the headings' own times. This is what a
# drive gives us:


# %%
@dataclass
class Pairs:
    e: np.ndarray
    d: np.ndarray
    R_body_cam: np.ndarray
    streams: SyntheticStreams


# %% [markdown]
# And this makes one. `spoiled` says what else goes wrong with the headings: outliers, flipped
# signs, errors that last.


# %%
from evcalib.kinematics.velocity_track import velocity_track


def make_pairs(seed, *, swing=1.0, **spoiled):
    drive, rng = s_curve(amplitude=swing), np.random.default_rng(seed)
    noise, odometry = Noise(sigma=0.1, **spoiled), Noise(sigma=0.02)
    s = simulate(drive, rng, heading_rate=10.0, heading_noise=noise, velocity_noise=odometry)
    d = velocity_track(s.velocities).directions(s.headings.t, s.headings.t)
    known = np.any(d != 0, axis=1)
    return Pairs(s.headings.v[known], d[known], s.R_body_cam, s)


# %% [markdown]
# Before anything is estimated, the best guess is "no rotation" ($R = I$). Then we let the library
# find the one that minimises (1):

# %%
pairs = make_pairs(0)
before = RotationEstimate(np.eye(3), np.ones(len(pairs.e)), 0.1, True, 0)
after = estimate_rotation(pairs.e, pairs.d, method="kabsch")
for name, estimate in {"before": before, "after": after}.items():
    error = np.degrees(rotation_angle(estimate.R_body_cam, pairs.R_body_cam))
    print(f"{name}: {error:.1f} deg from the true rotation")

# %% [markdown]
# **See:** two maps of all directions as one sees them from the vehicle, forward in the middle. Grey
# lines join each heading to its body direction. Left, the headings as the camera gives them; right,
# turned by the rotation found. To minimise (1) is to make the grey lines short.

# %%
figure, axes = plt.subplots(1, 2, figsize=(8.2, 2.6), subplot_kw={"projection": "hammer"})
for ax, estimate in zip(axes, (before, after), strict=True):
    draw_map(ax, pairs.e, pairs.d, estimate)
figure.legend(
    *axes[1].get_legend_handles_labels(), loc="outside upper center", ncols=3, markerscale=2.5
)
plt.show()

# %% [markdown]
# ## Least squares in closed form
#
# **Step 1: one matrix says it all.** For unit vectors
# $\lVert\mathbf d - R\mathbf e\rVert^2 = 2 - 2\,\mathbf d^\top R\,\mathbf e$. So (1) is smallest
# where the summed agreement $\mathbf d_i^\top R\,\mathbf e_i$ is largest, and that depends on the
# pairs only through a $3 \times 3$ matrix:
#
# $$\sum_i w_i\,\mathbf d_i^\top R\,\mathbf e_i = \operatorname{tr}(R^\top H), \qquad
# H = \sum_i w_i\,\mathbf d_i \mathbf e_i^\top. \tag{2}$$
#
# Let us check that for some rotation, with all weights 1:

# %%
H = pairs.d.T @ pairs.e
R = random_rotation(np.random.default_rng(1))
assert np.isclose(np.sum(pairs.d * (pairs.e @ R.T)), np.trace(R.T @ H))

# %% [markdown]
# **Step 2: the SVD.** Write $H = U S V^\top$ with $s_1 \ge s_2 \ge s_3 \ge 0$. Then
#
# $$\operatorname{tr}(R^\top U S V^\top) = \operatorname{tr}(S M) = s_1 M_{11} + s_2 M_{22} +
# s_3 M_{33}, \qquad M = V^\top R^\top U. \tag{3}$$
#
# $M$ is orthogonal, so none of its entries exceeds 1, and the sum is largest for $M = I$, that is
# for $R = U V^\top$.
#
# **Step 3: but $R$ must be a rotation.** The determinant of $R$ has to be $+1$, so that of $M$ is
# fixed to $\det(U V^\top)$. If this is $-1$, then $M = I$ is not allowed. The cheapest way out is
# to give up the *smallest* singular value, $M = \operatorname{diag}(1, 1, -1)$. In one formula
# (Kabsch 1976, Umeyama 1991):
#
# $$R = U \operatorname{diag}\bigl(1,\, 1,\, \det(U V^\top)\bigr)\, V^\top. \tag{4}$$


# %%
def best_rotation(e, d, weight):
    U, _, Vt = np.linalg.svd((d * weight[:, None]).T @ e)
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt


ones = np.ones(len(pairs.e))
R = best_rotation(pairs.e, pairs.d, ones)
error = np.degrees(rotation_angle(R, pairs.R_body_cam))
print(f"error {error:.2f} deg, determinant {np.linalg.det(R):.2f}")

assert np.allclose(R, kabsch(pairs.e, pairs.d, ones))

# %% [markdown]
# Each pair is off by 6 degrees, but 200 of them together by far less than one.
#
# ## The mirror in the paper's text
#
# The paper's text has (4) without the determinant: its rotation is the product of the two
# orthogonal matrices alone. For directions all over the sphere that goes well: it takes enormous
# noise to make $\det H$ negative. But a ground vehicle has $d_z = 0$. The last row of $H$ is then
# exactly zero, and so is $s_3$:

# %%
U, S, Vt = np.linalg.svd(H)
print("last row of H: ", np.abs(H[2]).max())
print("singular values:", np.round(S, 1))

# %% [markdown]
# With $s_3 = 0$ the third column of $U$ may be $+z$ or $-z$: both are correct decompositions of the
# same $H$. One of them makes $U V^\top$ a rotation, the other a *mirror image*, and which one comes
# out is up to the SVD routine. Let us count over 200 drives:

# %%
mirrored = 0
for seed in range(200):
    p = make_pairs(seed)
    U, S, Vt = np.linalg.svd(p.d.T @ p.e)
    mirrored += np.linalg.det(U @ Vt) < 0
    assert np.allclose((U * [1, 1, -1]) @ np.diag(S) @ Vt, p.d.T @ p.e)  # as good a decomposition
print(f"share of mirror images without the determinant: {mirrored / 200:.1f}")

# %% [markdown]
# It is the toss of a coin. With other mountings, or another SVD routine, it may fall the same way
# every time, which only hides the trouble. And the data cannot warn us. Rotation and mirror image
# have the *same* residuals, since in (3) the sign of $M_{33}$ is multiplied by $s_3 = 0$. They
# differ in what they say about directions that the vehicle never took:

# %%
best = kabsch(pairs.e, pairs.d, ones)
mirror = np.diag([1.0, 1.0, -1.0]) @ best
for name, R in {"rotation": best, "mirror": mirror}.items():
    residual = np.sqrt(np.mean(np.sum((pairs.d - pairs.e @ R.T) ** 2, axis=1)))
    up = (R @ pairs.R_body_cam.T)[2, 2]
    print(
        f"{name:8s} det {np.linalg.det(R):+.0f}, rms residual {residual:.3f}, up becomes {up:+.2f}"
    )

assert np.isclose(np.trace(mirror.T @ H), np.trace(best.T @ H))

# %% [markdown]
# With the mirror the camera's up is the vehicle's down, while left stays left. No camera can be
# mounted like that. So the determinant in (4) is not a refinement: it is what makes planar data
# determine a rotation at all.
#
# ## Headings that are wrong
#
# Least squares believes every pair. Let 60 % of the headings be random directions, and see what
# each of the library's methods makes of it (error against the truth):

# %%
wild = make_pairs(3, outliers=0.6)
fits = {method: estimate_rotation(wild.e, wild.d, method=method) for method in METHODS}
for method, fit in fits.items():
    error = np.degrees(rotation_angle(fit.R_body_cam, wild.R_body_cam))
    print(f"{method:7s}{error:5.1f} deg")

# %% [markdown]
# How do `l1` and `tukey` stay unmoved? **L1**, the paper's choice, minimises the sum of the
# residuals' lengths instead of their squares. It needs no new solver: fit by (4), weigh each pair
# by
#
# $$w_i = \frac{1}{\max(\delta,\, \lVert\mathbf d_i - R\,\mathbf e_i\rVert)}, \tag{5}$$
#
# and fit again, until nothing moves: *iteratively re-weighted least squares* (IRLS). A square
# divided by the length is the length, so the weighted squares add up to the lengths. In the code
# $\delta$ is 0.001; exercise 2 asks what it is for.

# %%
R, steps = kabsch(wild.e, wild.d, np.ones(len(wild.e))), 0
moved = 1.0
while moved > 1e-10:
    length = np.linalg.norm(wild.d - wild.e @ R.T, axis=1)
    update = kabsch(wild.e, wild.d, 1 / np.maximum(1e-3, length))
    moved, R, steps = np.linalg.norm(update - R), update, steps + 1

assert steps > 3
assert np.allclose(R, fits["l1"].R_body_cam, atol=1e-6)

# %% [markdown]
# The weights apply to the data as given, anew in each step. (The authors' released script
# multiplies the weights of all steps together, which leads back to nearly the unweighted result;
# our frozen copy of it, `evcalib.baselines.authors`, keeps that.) The other methods:
#
# - **Tukey**, our default, goes on from L1 with $w_i = (1 - u_i/c)_+^2$, where $u_i$ is 1 minus the
#   cosine of the angle between $\mathbf d_i$ and $R\,\mathbf e_i$. Beyond $c$, about five standard
#   deviations of the good pairs, a pair counts *nothing*.
# - **GNC** (graduated non-convexity, Yang 2020) ends at weights of 0 and 1 only. It starts from a
#   loss so wide that there is one minimum, and narrows it step by step.
# - **CCA** is not robust: the closed form $S_{oo}^{+} S_{oe}$ of the canonical correlation of
#   notebook 4, turned into the nearest rotation (Qiu 2020). (The paper's $S_{ee}^{-1} S_{eo}$ is
#   far worse.)
#
# **See:** each dot is a pair, green if it is within three of the fit's own standard deviations.
# Least squares gives all the same weight, and finds nearly all of them good, since its own standard
# deviation is so large. L1 turns the wild ones down, but never off. Tukey turns them off.

# %%
figure, axes = plt.subplots(1, 3, figsize=(9.2, 2.9), sharey=True)
for ax, method in zip(axes, ("kabsch", "l1", "tukey"), strict=True):
    draw_weights(ax, wild.e, wild.d, fits[method])
    ax.set_title(method)
    ax.set_ylabel(ax.get_ylabel() if ax is axes[0] else "")
plt.show()

# %% [markdown]
# The same on the sphere, least squares left and Tukey right. **See:** the good headings form a band
# around the body directions. On the left this band is tilted, and hardly any of the wild headings
# counts as an outlier; on the right it lies where it should.

# %%
figure, axes = plt.subplots(1, 2, figsize=(8.2, 2.6), subplot_kw={"projection": "hammer"})
for ax, method in zip(axes, ("kabsch", "tukey"), strict=True):
    draw_map(ax, wild.e, wild.d, fits[method])
figure.legend(
    *axes[1].get_legend_handles_labels(), loc="outside upper center", ncols=3, markerscale=2.5
)
plt.show()

# %% [markdown]
# ## How many outliers does each stand?
#
# We take the median error over twenty drives, for several shares of random headings, and for 40 %
# that all point in *one* wrong direction, as something does that moves along with the vehicle:


# %%
def median_errors(**spoiled):
    errors = {method: [] for method in METHODS}
    for seed in range(20):
        p = make_pairs(seed, **spoiled)
        for method, found in errors.items():
            R = estimate_rotation(p.e, p.d, method=method).R_body_cam
            found.append(np.degrees(rotation_angle(R, p.R_body_cam)))
    return {method: float(np.median(found)) for method, found in errors.items()}


# %% [markdown]
# The study takes a few seconds. All numbers are in degrees.

# %%
shares = (0.0, 0.2, 0.4, 0.6, 0.8)
study = {f"{share:.0%}": median_errors(outliers=share) for share in shares}
study["40% one way"] = median_errors(outliers=0.4, cluster=True)
print(" " * 12 + "".join(f"{method:>8s}" for method in METHODS))
for name, errors in study.items():
    print(f"{name:12s}" + "".join(f"{error:8.1f}" for error in errors.values()))

# %% [markdown]
# **See:** without outliers least squares (`kabsch`) is the best, and robustness costs almost
# nothing. From 20 % on it costs a lot *not* to have it. (The table's last line, the cluster, is not
# drawn: L1 holds against random outliers, which pull in all directions and cancel, but bends under
# a cluster; Tukey and GNC do not.)

# %%
figure, ax = plt.subplots(figsize=(6.0, 3.4))
by_loss = {m: [study[f"{share:.0%}"][m] for share in shares] for m in METHODS}
draw_breakdown(ax, shares, by_loss)
plt.show()

# %% [markdown]
# One kind of error beats every loss. If a camera takes forward for backward more often than not,
# the *opposites* of the headings are the majority, and a majority is all that a loss can go by:

# %%
for share in (0.3, 0.7):
    errors = median_errors(flips=share)
    print(f"{share:.0%} flipped: tukey {errors['tukey']:.0f} deg, l1 {errors['l1']:.0f} deg")

# %% [markdown]
# ## How sure is it?
#
# A pair tells two of the three angles: a turn *about* its own direction leaves it where it is. With
# noise $\sigma$ per axis, a pair brings the information $(I - \mathbf d\mathbf d^\top)/\sigma^2$,
# and the sum of these is the inverse of the covariance of the rotation vector (the paper gives no
# uncertainty; this is the usual one of least squares):
#
# $$C = \sigma^2 \Bigl(\sum_i (I - \mathbf d_i \mathbf d_i^\top)\Bigr)^{-1}. \tag{6}$$

# %%
covariance = 0.1**2 * np.linalg.inv(np.sum(np.eye(3) - pairs.d[:, :, None] * pairs.d[:, None], 0))
stated = np.degrees(np.sqrt(np.trace(covariance)))
print("stated per axis [deg]:", np.round(np.degrees(np.sqrt(np.diag(covariance))), 2))

# %% [markdown]
# The first number is the roll about the forward axis: most of the travel is forward, so it is known
# least. Now the test that any stated uncertainty has to pass: is it as large as the errors are?
# With independent errors it is. But real headings go wrong in *spells*: neighbours see the same
# corners, and so share their errors. We try both, without and with a correlation of 0.8 from one
# heading to the next, twenty drives each:

# %%
for rho in (0.0, 0.8):
    errors, own = [], []
    for seed in range(20):
        p = make_pairs(seed, rho=rho)
        result = align(p.streams.headings, p.streams.velocities)
        errors.append(np.degrees(rotation_angle(result.R_body_cam, p.R_body_cam)))
        own.append(np.degrees(result.rotation_sd))
    rms = np.sqrt(np.mean(np.square(errors)))
    print(f"rho {rho}: error {rms:.1f} deg, by (6) {stated:.1f}, align says {np.mean(own):.1f}")

# %% [markdown]
# Formula (6) does not notice the spells and is too small by a factor of about
# $\sqrt{(1 + \rho)/(1 - \rho)} = 3$. `align` estimates the correlation from the residuals and
# carries it through, so what it states is what one gets.
#
# ## What the motion leaves open
#
# By (6), directions that are all parallel leave the turn about them open: nothing in a straight
# drive tells how the camera is rolled. And nearly parallel ones leave it *nearly* open. Here the
# direction of travel swings by 1 to 45 degrees, and `align` says about which axis it knows nothing:

# %%
for swing in (1.0, 4.0, 15.0, 45.0):
    p = make_pairs(1, swing=np.radians(swing))
    result = align(p.streams.headings, p.streams.velocities)
    axis = result.unknown_axis
    words = "-" if axis is None else "about (" + ", ".join(f"{abs(x):.1f}" for x in axis) + ")"
    print(f"swing {swing:4.0f} deg: unknown {words}")

# %% [markdown]
# The axis is $(1, 0, 0)$, forward. No loss helps here. More data would average out the *noise*, but
# not the small systematic errors that all real headings share; `align` allows for those too. An
# omni-directional vehicle has an easy way out: it drives sideways for a while.
#
# ## Try the losses
#
# In the panel below you choose how many headings are wrong, in which way, and which loss has to
# cope with it. Three kinds of wrong headings:

# %%
kinds = {
    "random": lambda share: {"outliers": share},
    "one cluster": lambda share: {"outliers": share, "cluster": True},
    "flipped": lambda share: {"flips": share},
}


def spoiled_pairs(kind, share):
    return make_pairs(7, **kinds[kind](share))


# %% [markdown]
# **See:** the panel as a static picture, L1 under a cluster of 40 %. The cluster is the knot of
# purple dots; on the right its pairs have little weight, but all of it pulls to the same side.

# %%
some = spoiled_pairs("one cluster", 0.4)
figure = plt.figure(figsize=(9.2, 3.2))
axes = figure.add_subplot(1, 2, 1, projection="hammer"), figure.add_subplot(1, 2, 2)
l1 = estimate_rotation(some.e, some.d, method="l1")
draw_losses(axes, some.e, some.d, l1, title="l1")
plt.show()

# %% [markdown]
# **Your turn.** The table below the picture has the errors of all losses; *reset* goes back to the
# start.
#
# 1. *random*, `kabsch`: raise the share to 60 %. Which way does the band tilt? Now choose `tukey`,
#    and raise the share to 90 %: it should still be right to 3 degrees.
# 2. *one cluster*: raise the share until `l1` is wrong by more than 5 degrees, then until `tukey`
#    is. Why just there?
# 3. *flipped*: go from 40 to 60 %. The green dots fit as well as before; what does the table say?

# %%
from evcalib.widgets.rotation import RotationPanel

RotationPanel(spoiled_pairs, list(kinds))

# %% [markdown]
# ## Exercises
#
# **1.** A real vehicle nods a little, so $d_z$ is not exactly zero. Does the toss of the coin go
# away?
#
# <details><summary>Solution</summary>
#
# $s_3$ is then small instead of zero, and its side is decided by what the nods and the noise of the
# headings happen to have in common. Mirror images remain until the nodding rises well above that
# chance: with 100 pairs of noise 0.05 we counted 4 in 10 for nods of 0.001 rad, and a few per cent
# for 0.01 rad. The determinant costs nothing: keep it.
#
# </details><br>
#
# **2.** Why is $\delta$ in (5) needed, and what happens if it is large?
#
# <details><summary>Solution</summary>
#
# A pair that fits exactly would get an infinite weight and hold the rotation for ever. Residuals
# below $\delta$ all get the same weight, so there the loss is quadratic: with $\delta \ge 2$, the
# longest residual there is, L1 becomes Kabsch.
#
# </details><br>
#
# **3.** Use (6): by what factor does the uncertainty about the forward axis shrink if the vehicle
# drives half of the time sideways, instead of swinging by $\pm 15$ degrees?
#
# <details><summary>Solution</summary>
#
# About the forward axis a pair brings $1 - d_x^2 = \sin^2(\text{azimuth})$. Half of the time
# sideways gives a mean of 0.5. A sine of amplitude 15 degrees (0.262 rad) gives about
# $0.262^2/2 = 0.034$. So $\sqrt{0.5/0.034}$, nearly a factor of 4.
#
# </details>
#
# ## In the library
#
# - [`evcalib.alignment.rotation.estimate_rotation`](../evcalib/alignment/rotation.py) with
#   `method="tukey"`, `"l1"`, `"kabsch"`, `"gnc"` or `"cca"`: rotation, weights, scale, and whether
#   it converged.
# - [`evcalib.uncertainty.joint_covariance`](../evcalib/uncertainty/_covariance.py): (6) with
#   correlated noise and the offset's share.
# - [`evcalib.alignment.observability.direction_spread`](../evcalib/alignment/observability.py):
#   which axis the motion leaves open.
# - [`evcalib.plots.rotation`](../evcalib/plots/rotation.py),
#   [`evcalib.widgets.rotation`](../evcalib/widgets/rotation.py): the pictures and the panel.
# - [`evcalib.align`](../evcalib/alignment/_align.py) does notebooks 4 and 5 in one call.
# - From the command line: `evcalib align headings.csv velocities.csv --max-offset 1.0`
#
# **Next:** [6. Full calibration](06_full_calibration.ipynb) puts all the parts together, from raw
# events to a result with error bars.
