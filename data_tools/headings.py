"""From a recording's files to its headings: what ``evcalib headings`` runs."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm.auto import tqdm

from data_tools.camera_files import read_camera
from data_tools.events_text import read_events_text
from evcalib.errors import InputError
from evcalib.events import Events
from evcalib.heading import HeadingEstimate, estimate_headings


@dataclass(frozen=True, eq=False)
class RecordingHeadings:
    """Headings of a recording, and what sums them up: counts, and why windows have none."""

    estimate: HeadingEstimate
    summary: str


def parse_size(size: str) -> tuple[int, int]:
    """Return (width, height) [px] of a text like ``240x180``."""
    found = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", size.strip())
    if found is None:
        raise InputError(f"the size must be WIDTHxHEIGHT in pixels, like 240x180, not {size!r}")
    return int(found.group(1)), int(found.group(2))


def headings_from_files(
    recording: str | Path,
    camera: str | Path,
    *,
    size: str | None = None,
    surface: str = "tos_ts",
    solver: str = "two_point",
    rate: float = 20.0,
    seed: int = 0,
    time_unit: str | None = None,
) -> RecordingHeadings:
    """Read a recording in pieces and estimate its headings.

    Parameters
    ----------
    recording : path
        Events as text, plain, gzip or in the data set's zip.
    camera : path
        The Event Camera Dataset's calib.txt or Kalibr's camchain.
    size : str, optional
        ``WIDTHxHEIGHT`` [px], needed where the camera file does not tell it.
    time_unit : {"s", "ms", "us", "ns"}, optional
        Unit of the recording's times; seconds, where they have a decimal point.
    surface, solver, rate, seed
        As in :func:`evcalib.heading.estimate_headings`.
    """
    width, height = (None, None) if size is None else parse_size(size)
    lens = read_camera(camera, width, height)
    started = time.perf_counter()
    stream = _with_progress(
        read_events_text(recording, lens.width, lens.height, time_unit=time_unit)
    )
    estimate = estimate_headings(stream, lens, surface=surface, solver=solver, rate=rate, seed=seed)
    seconds = time.perf_counter() - started
    events, found = estimate.counts.events, len(estimate.headings)
    inliers = estimate.headings.inliers
    median = int(np.median(inliers)) if inliers is not None and found else 0
    summary = (
        f"{events} events in {seconds:.1f} s ({events / seconds / 1e6:.2f} million/s);"
        f" {found} headings of {found + len(estimate.gaps)} windows, {median} inliers (median)"
    )
    reasons = Counter(gap.reason for gap in estimate.gaps)
    if reasons:
        summary += "\nno heading: " + ", ".join(
            f"{count} x {reason}" for reason, count in reasons.most_common()
        )
    return RecordingHeadings(estimate, summary)


def _with_progress(stream: Iterator[Events]) -> Iterator[Events]:
    """Pass pieces on, counting events on a terminal or in Jupyter only."""
    with tqdm(unit=" events", unit_scale=True, disable=None, leave=False) as bar:
        for piece in stream:
            yield piece
            bar.update(len(piece))
