"""See a surface change with time, speed and its own settings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import cv2
import ipywidgets as widgets
import numpy as np
from numpy.typing import NDArray

from evcalib import checks
from evcalib._moved import renamed
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.features.corners import arc_star
from evcalib.plots import style
from evcalib.plots.events import NAMES
from evcalib.surfaces.quality import grey, likeness, surface_images
from evcalib.widgets._parts import Panel, bgr, choices, encode, player, slider, whole_slider

ROOM = 330
"""Width of a surface on the screen [px], if whole enlargements allow."""
RECENT = 0.02
"""Corners of this last part of the recording are shown."""
CAPTION = 20
"""Height of the line above each picture [px]."""


class EventsAndFrames(Protocol):
    """Events, and pictures of the same path (as of `data_tools.course.samples`)."""

    @property
    def events(self) -> Events: ...  # noqa: D102

    @property
    def frames(self) -> NDArray[np.uint8]: ...  # noqa: D102


def tile(
    image: NDArray[np.uint8], title: str, corners: NDArray, *, side: int = 2
) -> NDArray[np.uint8]:
    """Return an image enlarged, in BGR, with a caption and circles around corners.

    Parameters
    ----------
    image : ndarray of uint8, shape (height, width)
        What to show.
    title : str
        Its caption.
    corners : ndarray, shape (n, 2)
        Pixels.
    side : int
        Of a pixel of the sensor on the screen [px].
    """
    large = image.repeat(side, axis=0).repeat(side, axis=1)
    picture = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    for x, y in np.rint(side * (corners + 0.5)).astype(int).tolist():
        cv2.circle(picture, (x, y), 4, bgr(style.MEASURED), 1, cv2.LINE_AA)
    framed = cv2.copyMakeBorder(
        picture, CAPTION, 3, 3, 3, cv2.BORDER_CONSTANT, value=(255, 255, 255)
    )
    where, font = (4, CAPTION - 6), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(framed, title, where, font, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    return np.asarray(framed, dtype=np.uint8)


class SurfacePanel(Panel):
    """A picture and the five surfaces at the same place, at a time and speed of one's choice.

    Parameters
    ----------
    recordings : mapping of str to EventsAndFrames
        The same path at several speeds, by the name of the speed, the slowest first.  Pictures
        are those of the first one that has any, evenly spread over the path without its ends.
    """

    def __init__(self, recordings: Mapping[str, EventsAndFrames]) -> None:
        super().__init__()
        names = choices(recordings, "recording")
        self.streams = {name: recording.events for name, recording in recordings.items()}
        self._corners = {name: ev[arc_star(ev)] for name, ev in self.streams.items()}
        with_frames = [r.frames for r in recordings.values() if len(r.frames)]
        if not with_frames:
            raise InputError("none of the recordings holds pictures")
        self._frames = with_frames[0]
        self._side = max(1, ROOM // self._frames.shape[2])
        self._slow: tuple[tuple[float, ...], dict[str, NDArray]] | None = None
        self.speed = widgets.SelectionSlider(
            options=names,
            description="speed",
            style={"description_width": "95px"},
            layout={"width": "305px"},
        )
        self.time = whole_slider("time [%]", 2, 100, 1, 70)
        self.tau = slider("tau [ms]", 5.0, 200.0, 5.0, 30.0)
        self.threshold = slider("threshold", 0.02, 0.9, 0.02, 0.1, ".2f")
        self.patch = whole_slider("patch [px]", 3, 15, 2, 7)
        self.corners = widgets.Checkbox(value=True, description="Arc* corners", indent=False)
        self.picture = widgets.Image(format="png")
        self.numbers = widgets.HTML()
        self._settings = (self.time, self.tau, self.threshold, self.patch)
        rows = [
            widgets.HBox([self.speed, self.time, player(self.time, 100)]),
            widgets.HBox([self.tau, self.threshold, self.patch]),
            widgets.HBox([self.corners, self.reset]),
        ]
        controls = (self.speed, *self._settings, self.corners)
        self._start(controls, [*rows, self.picture, self.numbers])

    @property
    def t_us(self) -> int:
        """Time in the recording that the slider, a share of its length, stands for [us]."""
        return self._time_in(self.speed.value)

    def _time_in(self, name: str) -> int:
        return int(self.streams[name].t[-1]) * self.time.value // 100

    def images(self, name: str | None = None) -> dict[str, NDArray]:
        """Return the five surfaces at the settings of the sliders.

        Parameters
        ----------
        name : str, optional
            Of the recording; by default that of the slider.
        """
        name = checks.one_of(name or self.speed.value, "name", tuple(self.streams))
        patch, tau = int(self.patch.value), 1e-3 * self.tau.value
        options: dict[str, dict[str, float]] = {
            "ts": {"tau": tau},
            "dist": {"patch": patch},
            "silc": {"r": patch // 2},
            "tos": {"k": patch},
            "tos_ts": {"k": patch, "tau": tau, "ts_threshold": self.threshold.value},
        }
        t, events = self._time_in(name), self.streams[name]
        return {key: surface_images(key, events, [t], **options[key])[0] for key in NAMES}

    def recent_corners(self) -> NDArray[np.uint16]:
        """Return the pixels of the corner events shown, shape (n, 2)."""
        length = int(RECENT * self.streams[self.speed.value].t[-1])
        recent = self._corners[self.speed.value].between(self.t_us - length, self.t_us + 1)
        return np.column_stack((recent.x, recent.y))

    def draw(self, images: Mapping[str, NDArray]) -> bytes:
        """Return the picture of the scene and the surfaces as a PNG file."""
        corners = self.recent_corners() if self.corners.value else np.empty((0, 2))
        tiles = [
            tile(grey(image), NAMES[name], corners, side=self._side)
            for name, image in images.items()
        ]
        nearest = round(0.01 * self.time.value * (len(self._frames) + 1)) - 1
        frame = self._frames[min(max(nearest, 0), len(self._frames) - 1)]
        tiles.insert(0, tile(frame, "picture nearby", corners, side=self._side))
        return encode(np.vstack([np.hstack(tiles[:3]), np.hstack(tiles[3:])]))

    def table(self, images: Mapping[str, NDArray]) -> str:
        """Return how much of each surface is lit, and how like the slowest it is, as HTML."""
        first, slow = next(iter(self.streams)), self._slowest(images)
        lit = [f"{100 * np.count_nonzero(image) / image.size:.0f} %" for image in images.values()]
        like = [f"{likeness(grey(images[k]), grey(slow[k])):.2f}" for k in images]
        head = _row("th", ["", *(NAMES[name] for name in images)])
        body = _row("td", ["pixels that are not black", *lit])
        body += _row("td", [f"likeness to the same place at {first}", *like])
        age = 1e-3 * self.tau.value * float(np.log(1 / self.threshold.value))
        note = f"TOS AND TS keeps events of the last {1000 * age:.0f} ms"
        return f"{1e-3 * self.t_us:.0f} ms after the start. {note}.<table>{head}{body}</table>"

    def _slowest(self, images: Mapping[str, NDArray]) -> Mapping[str, NDArray]:
        """Return the surfaces of the first recording at the same settings."""
        first = next(iter(self.streams))
        if self.speed.value == first:
            return images
        now = tuple(float(control.value) for control in self._settings)
        if self._slow is None or self._slow[0] != now:
            self._slow = now, self.images(first)
        return self._slow[1]

    def _draw(self) -> None:
        images = self.images()
        self.picture.value = self.draw(images)
        self.numbers.value = self.table(images)


def _row(kind: str, cells: list[str]) -> str:
    look = "style='padding:2px 10px; text-align:right'"
    return "<tr>" + "".join(f"<{kind} {look}>{cell}</{kind}>" for cell in cells) + "</tr>"


__getattr__ = renamed(__name__)
