"""The unit sphere of the body frame, seen from outside."""

from __future__ import annotations

import numpy as np
from mpl_toolkits.mplot3d import Axes3D

from evcalib.arrays import Floats
from evcalib.plots import style


def draw_globe(ax: Axes3D, *, elevation: float, azimuth: float) -> None:
    """Draw meridians and parallels, fainter on the far side, and the axes of the body frame."""
    view = np.radians([elevation, azimuth])
    eye = np.array(
        [np.cos(view[0]) * np.cos(view[1]), np.cos(view[0]) * np.sin(view[1]), np.sin(view[0])]
    )
    turn, lift = np.radians(np.arange(0, 361, 5)), np.radians(np.arange(-90, 91, 5))
    level = np.zeros_like(turn)
    lines = [_on_sphere(turn, level + np.radians(e)) for e in range(-60, 61, 30)]
    lines += [_on_sphere(np.radians(a) + np.zeros_like(lift), lift) for a in range(0, 360, 30)]
    side = np.array([-np.sin(view[1]), np.cos(view[1]), 0.0])
    limb = np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(eye, side))
    ax.plot(*limb.T, color=style.MUTED, lw=0.8)
    for line in lines:
        far = (line @ eye < 0)[:, None]
        for hidden, alpha in ((far, 0.7), (~far, 0.2)):
            ax.plot(*np.where(hidden, np.nan, line).T, color=style.MUTED, lw=0.5, alpha=alpha)
    for end, name in zip(np.eye(3) * 1.2, ("x forward", "y left", "z up"), strict=True):
        ax.plot(*np.outer([0, 1], end).T, color=style.MUTED, lw=1, zorder=2)
        ax.text(*end * 1.1, name, color=style.MUTED, ha="center", va="center", zorder=10)
    ax.set_box_aspect((1, 1, 1), zoom=1.15)
    ax.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    ax.view_init(elev=elevation, azim=azimuth)


def _on_sphere(azimuth: Floats, elevation: Floats) -> Floats:
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)
