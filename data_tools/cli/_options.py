"""What the commands share."""

from __future__ import annotations

import json
import os
import shlex
import sys
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from evcalib.errors import EvcalibError, InputError

if TYPE_CHECKING:
    from evcalib.alignment import Calibration

BAD_INPUT = 2
NO_ANSWER = 3
DOUBTS = 4
INTERRUPTED = 130

INPUTS = (
    *("recording", "camera", "wheels", "vehicle", "velocities", "columns", "headings"),
    *("trajectory", "calibration", "imu_columns"),
)
"""Parameters of commands that are files to read.  Not the list of a batch: its paths are relative
to it, so it has to stand somewhere."""
OUTPUTS = ("output", "target", "plot", "commands")
"""Parameters of commands that are files to write."""

_COPIES: dict[str, str] = {}
"""Copies of what came out of pipes, and the pipes."""


class Interrupted(Exception):
    """Ctrl-C, with what there is to say of it; Typer would make a bare exit code of it."""


class _Commands(TyperGroup):
    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            raise Interrupted(f": {stop}" if str(stop) else "") from None


class _Command(TyperCommand):
    """A command that may be given pipes, like ``<(...)``, for the files that it reads."""

    def invoke(self, ctx: Any) -> Any:
        """Run it on copies of what comes out of the pipes; messages name what was given."""
        from data_tools.files.pipes import copy_pipe, is_pipe, refuse_pipe

        with ExitStack() as stack:
            stack.callback(_COPIES.clear)
            for name, given in ctx.params.items():
                if name not in INPUTS or given is None:
                    continue
                if not is_pipe(given):
                    refuse_pipe(given)
                    continue
                home = stack.enter_context(tempfile.TemporaryDirectory(prefix="evcalib-"))
                copy = Path(home) / Path(given).name
                copy_pipe(given, copy)
                ctx.params[name] = type(given)(copy)
                _COPIES[str(copy)] = str(given)
            _refuse_loss(ctx.params)
            try:
                return super().invoke(ctx)
            except EvcalibError as error:
                if not _COPIES:
                    raise
                raise type(error)(as_given(str(error))) from None


def as_given(text: str) -> str:
    """Return a text with the names of pipes in place of those of their copies."""
    for copy, pipe in _COPIES.items():
        text = text.replace(copy, pipe)
    return text


def _refuse_loss(parameters: dict[str, Any]) -> None:
    """Refuse to write over a file that is read, or that is written as well."""
    keys = (*INPUTS, *OUTPUTS)
    taken = {key: Path(parameters[key]) for key in keys if parameters.get(key)}
    for key in OUTPUTS:
        for other, path in taken.items():
            if other == key or key not in taken or not _one_file(taken[key], path):
                continue
            what = "written by" if other in OUTPUTS else "read as"
            raise InputError(f"{taken[key]} is also {what} {other}: give another name to write to")


def _one_file(one: Path, other: Path) -> bool:
    if os.path.isfile(one) and os.path.isfile(other):
        return os.path.samefile(one, other)
    return not os.path.exists(one) and os.path.abspath(one) == os.path.abspath(other)


class _App(typer.Typer):
    def command(self, *args: Any, **kwargs: Any) -> Any:
        return super().command(*args, **{"cls": _Command, **kwargs})


app = _App(
    cls=_Commands,
    help="Time offset and rotation between an event camera and an omni-directional vehicle.",
    add_completion=False,
    pretty_exceptions_enable=False,
)

MaxOffset = Annotated[float, typer.Option(help="Search offsets from -MAX to MAX, in seconds.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON alone on standard output.")]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="Replace an earlier calibration in the folder.")
]
Size = Annotated[str | None, typer.Option(help="Sensor size WIDTHxHEIGHT, where no file tells it.")]
TimeUnit = Annotated[
    str | None, typer.Option(help="s, ms, us or ns, where the recording does not tell it.")
]
Format = Annotated[
    str | None, typer.Option(help="Format of the recording, if its content does not tell it.")
]
Disorder = Annotated[
    str, typer.Option(help="Events out of order: refuse, sort (up to 50 ms late) or drop.")
]
Stream = Annotated[
    str | None, typer.Option(help="Topic, camera or file, where the recording holds several.")
]
Imu = Annotated[
    str | None,
    typer.Option(help="IMU of the camera: auto for that of the recording, or a file (CSV, ...)."),
]
ImuRotation = Annotated[
    str | None,
    typer.Option(
        help="Axes of the IMU along the camera's X,Y,Z, like -x,y,-z; nine numbers; or estimate."
    ),
]
ImuUnit = Annotated[str | None, typer.Option(help="Unit of the IMU's rates (CSV): rad/s or deg/s.")]
ImuColumns = Annotated[Path | None, typer.Option(help="Column map of the IMU's table (YAML).")]
ImuTimeUnit = Annotated[str | None, typer.Option(help="s, ms, us or ns: unit of the IMU's times.")]
ImuStream = Annotated[str | None, typer.Option(help="Topic or group of the IMU, if several.")]


def imu_options(
    imu: str | None,
    rotation: str | None,
    unit: str | None,
    columns: Path | None,
    time_unit: str | None,
    stream: str | None,
) -> dict[str, Any] | None:
    """Return what a run is told of the IMU; None without one."""
    from data_tools.runs.imu import rotation_of

    more = {"unit": unit, "columns": columns, "time_unit": time_unit, "stream": stream}
    if imu is None:
        told = [name for name, value in {"rotation": rotation, **more}.items() if value is not None]
        if told:
            option = told[0].replace("_", "-")
            raise InputError(f"--imu-{option} needs an IMU: give --imu auto, or --imu FILE")
        return None
    rotation_of(rotation)
    return {"source": imu, "rotation": rotation, **more}


Seed = Annotated[int, typer.Option(min=0, help="Seed of everything that is drawn.")]


def print_calibration(
    calibration: Calibration, as_json: bool, more: Mapping[str, Any] | None = None
) -> None:
    """Print a calibration as words, or as JSON alone with more beside it."""
    from data_tools.runs.export import summary_dict, summary_text

    if as_json:
        print(json.dumps({**summary_dict(calibration), **(more or {})}, indent=2))
    else:
        print(summary_text(calibration))


def exit_by(calibration: Calibration) -> None:
    """End with the code of a motion that cannot answer, or of data that contradict the model."""
    if not calibration.rotation_observable:
        raise typer.Exit(NO_ANSWER)
    if calibration.verdict.doubts:
        raise typer.Exit(DOUBTS)


def command_line() -> str:
    """Return what was typed."""
    return shlex.join(["evcalib", *sys.argv[1:]])


def tell(text: str, *outputs: Path | None) -> None:
    """Print what was done; on standard error, where an output itself goes to standard output."""
    from data_tools.files.atomic import is_output

    taken = any(path is not None and is_output(path) for path in outputs)
    print(as_given(text), file=sys.stderr if taken else sys.stdout)


def note(text: str) -> None:
    """Say something on standard error on a terminal, nothing in a script."""
    if sys.stderr.isatty():
        print(text, file=sys.stderr)
