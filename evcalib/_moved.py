"""Import paths from before the folders: they work for one minor version and say what is new.

This file, its twin in `data_tools`, `tests/test_moved.py` and `tests/old_paths.txt` go together.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, TypeVar

T = TypeVar("T")

MOVED = {
    "evcalib.authors": "evcalib.baselines.authors",
    "evcalib.baselines.canonical": "evcalib.baselines._streams",
    "evcalib.baselines.cross_correlation": "evcalib.baselines._streams",
    "evcalib.baselines.motions": "evcalib.poses",
    "evcalib.baselines.released": "evcalib.baselines.authors",
    "evcalib.baselines.rival": "evcalib.baselines._interface",
    "evcalib.baselines.velocity_correlation": "evcalib.baselines._streams",
    "evcalib.bootstrap": "evcalib.alignment._bootstrap",
    "evcalib.calibration": "evcalib.alignment._align evcalib.alignment._evidence",
    "evcalib.cli": "data_tools.cli",
    "evcalib.corners": "evcalib.features.corners",
    "evcalib.epipolar": "evcalib.heading.epipolar",
    "evcalib.final_stage": "evcalib.pipeline._assessment",
    "evcalib.kernels.authors": "evcalib.kernels.baselines.authors",
    "evcalib.kernels.bearings": "evcalib.kernels.heading.bearings",
    "evcalib.kernels.corners": "evcalib.kernels.features.corners",
    "evcalib.kernels.dist": "evcalib.kernels.surfaces.dist",
    "evcalib.kernels.epipolar": (
        "evcalib.kernels.heading.epipolar evcalib.kernels.linalg evcalib.kernels.splitmix"
    ),
    "evcalib.kernels.event_image": "evcalib.kernels.features.event_image",
    "evcalib.kernels.hand_eye": "evcalib.kernels.baselines.hand_eye",
    "evcalib.kernels.mixture": "evcalib.kernels.alignment.mixture",
    "evcalib.kernels.noise": "evcalib.kernels.uncertainty.noise",
    "evcalib.kernels.offset": "evcalib.kernels.alignment.offset",
    "evcalib.kernels.rotation": "evcalib.kernels.alignment.rotation",
    "evcalib.kernels.sighting": "evcalib.kernels.joint.observation_model",
    "evcalib.kernels.silc": "evcalib.kernels.surfaces.silc",
    "evcalib.kernels.time_surface": "evcalib.kernels.surfaces.time_surface",
    "evcalib.kernels.tos": "evcalib.kernels.surfaces.tos",
    "evcalib.kernels.track": "evcalib.kernels.kinematics.velocity_track",
    "evcalib.kernels.turn": "evcalib.kernels.heading.turn",
    "evcalib.observability": "evcalib.alignment.observability evcalib.uncertainty._noise",
    "evcalib.offset": "evcalib.alignment._stream_pair evcalib.alignment.offset",
    "evcalib.plots.report": "evcalib.report._figures",
    "evcalib.refinement": "evcalib.alignment.offset_refinement",
    "evcalib.results": "evcalib.alignment._result evcalib.alignment.verdict",
    "evcalib.rotation": "evcalib.alignment.rotation",
    "evcalib.run": "evcalib.pipeline._run",
    "evcalib.solution": "evcalib.alignment.registration",
    "evcalib.surface_quality": "evcalib.features.repeatability evcalib.surfaces.quality",
    "evcalib.track": (
        "evcalib.alignment._stream_pair "
        "evcalib.kinematics.velocity_track "
        "evcalib.uncertainty._noise"
    ),
    "evcalib.tracks": "evcalib.joint.tracks",
    "evcalib.two_views": "evcalib.heading.two_views evcalib.heading._matches",
    "evcalib.verdict": "evcalib.alignment.verdict",
    "evcalib.waypoints": "evcalib.design.waypoints",
}
"""Old modules, and where their names are now; the first that has a name is taken."""

LEFT = {
    "evcalib.design": "evcalib.design._prediction evcalib.design._information",
    "evcalib.features": "evcalib.features._keypoints",
    "evcalib.heading": "evcalib.heading._options",
    "evcalib.joint": "evcalib.joint._refine evcalib.joint._result evcalib.joint._world_motion",
    "evcalib.pipeline": "evcalib.pipeline._calibrate",
    "evcalib.report": "evcalib.report._page",
    "evcalib.uncertainty": "evcalib.uncertainty._covariance evcalib.uncertainty._noise",
    "data_tools.bags": "data_tools.bags._bag",
}
"""Folders with the name of an old module, and where names are that are public no more."""

RENAMED = {
    "evcalib.widgets.cockpit.Recording": "SolvedStreams",
    "evcalib.widgets.heading.Recording": "KnownMotion",
    "evcalib.widgets.surfaces.Recording": "EventsAndFrames",
    "data_tools.logs.cameras._content.LARGEST_CALIB_TXT": "LARGEST",
    "data_tools.simulation.point_matches.Matched": "Matches",
    "evcalib.heading._matches.Pairs": "Matches",
    "evcalib.kernels.features.event_image.align": "patch_aligner",
    "evcalib.kernels.heading.turn.turn_misfits": "squared_residuals",
    "evcalib.design._information.SIGHTINGS": "OBSERVATIONS",
    "evcalib.kernels.joint.observation_model.sighting": "observe",
    "evcalib.alignment.offset.WIDE_REACHES": "WIDE_LOSS_SCALES",
    "evcalib.alignment.rotation.misfits": "cosine_residuals",
    "evcalib.alignment.rotation.tukey_reach": "tukey_scale",
}
"""Names that changed as well: the new module with the old name, and the new name."""


def _intervals(headings: Any) -> Any:
    told = headings.t_start is not None
    return (headings.t_start, headings.t_end) if told else (headings.t, headings.t)


METHODS: Mapping[str, Callable[[Any], Any]] = {
    "evcalib.track.intervals": lambda pair: _intervals,
    "evcalib.offset.weights": lambda pair: lambda headings: pair.of(headings, None).weight,
    "evcalib.offset.covered_at_all": lambda pair: (
        lambda headings, track, offsets: pair.of(headings, track).covered_at_all(offsets).headings
    ),
    "evcalib.offset.no_overlap": lambda pair: (
        lambda headings, track, where: pair.of(headings, track).no_overlap(where)
    ),
    "evcalib.baselines.rival.track_of": lambda pair: lambda streams: streams.pair().track,
    "evcalib.baselines.rival.paired": lambda pair: (
        lambda headings, track, offset: (lambda covered: (covered[0].headings, covered[1]))(
            pair.of(headings, track).covered(offset)
        )
    ),
}
"""Functions that became methods of `evcalib.alignment.StreamPair`, as they were called."""


class _Stand(Loader):
    """A module in the old place that looks its names up in the new ones."""

    def __init__(self, homes: Sequence[str]) -> None:
        self.homes = homes

    def exec_module(self, module: ModuleType) -> None:
        new = " and ".join(dict.fromkeys(map(_shown, self.homes)))
        warnings.warn(
            f"{module.__name__} has moved: import from {new}", DeprecationWarning, stacklevel=2
        )

        vars(module)["__getattr__"] = _look_up(module.__name__, self.homes)


def _shown(home: str) -> str:
    """Return how a reader reaches a module: a private file through its folder."""
    folder, _, file = home.rpartition(".")
    return folder if file.startswith("_") else home


def _look_up(old: str, homes: Sequence[str]) -> Callable[[str], Any]:
    def look_up(name: str) -> Any:
        if f"{old}.{name}" in METHODS:
            return METHODS[f"{old}.{name}"](import_module("evcalib.alignment").StreamPair)
        for home in map(import_module, homes):
            new = RENAMED.get(f"{home.__name__}.{name}", name)
            if new in vars(home):
                return getattr(home, new)
        raise AttributeError(f"module {old!r} has no attribute {name!r}")

    return look_up


def leftovers(folder: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a folder that an old module had the name of."""
    look_up = _look_up(folder, LEFT[folder].split())

    def tell(name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(f"module {folder!r} has no attribute {name!r}")
        found = look_up(name)
        warnings.warn(f"{folder}.{name} is public no more", DeprecationWarning, stacklevel=2)
        return found

    return tell


def renamed_fields(**new: str) -> Callable[[type[T]], type[T]]:
    """Let a dataclass be made and read by old names of its fields, with a warning."""

    def name_now(old: str) -> str:
        text = f"{old} is called {new[old]} now"
        warnings.warn(text, DeprecationWarning, stacklevel=3)
        return new[old]

    def reader(old: str) -> property:
        return property(lambda self: getattr(self, name_now(old)))

    def decorate(cls: type[T]) -> type[T]:
        made = cls.__init__

        @wraps(made)
        def init(self: T, *args: Any, **named: Any) -> None:
            for old in new.keys() & named.keys():
                # `replace` also gives the present value by the new name: the old name counts.
                named[name_now(old)] = named.pop(old)
            made(self, *args, **named)

        cls.__init__ = init  # type: ignore
        for old in new:
            setattr(cls, old, reader(old))
        return cls

    return decorate


def renamed(module: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a module that stays where it was, with names that do not."""
    look_up = _look_up(module, [module])

    def tell(name: str) -> Any:
        found = look_up(name)
        now = RENAMED[f"{module}.{name}"]
        warnings.warn(f"{module}.{name} is called {now} now", DeprecationWarning, stacklevel=2)
        return found

    return tell


class _Finder(MetaPathFinder):
    def __init__(self, moved: Mapping[str, str]) -> None:
        self.moved = moved

    def find_spec(self, name: str, path: object, target: object = None) -> ModuleSpec | None:
        homes = self.moved.get(name)
        if homes is None:
            return None
        parent = any(other.startswith(f"{name}.") for other in self.moved)
        return ModuleSpec(name, _Stand(homes.split()), is_package=parent)


def install(moved: Mapping[str, str]) -> None:
    """Let the old paths be imported; they are asked for last."""
    sys.meta_path.append(_Finder(moved))
