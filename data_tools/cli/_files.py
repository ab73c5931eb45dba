"""Files: what is in them, and in other forms."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from data_tools.cli import _options as common
from data_tools.cli._options import app

if TYPE_CHECKING:
    from data_tools.recordings import Recording


@app.command()
def info(
    recording: Annotated[Path, typer.Argument(help="Events, in any format that is known.")],
    size: common.Size = None,
    time_unit: common.TimeUnit = None,
    format: common.Format = None,
    stream: common.Stream = None,
    as_json: common.Json = False,
) -> None:
    """Say what a recording holds: sensor, count, rate, duration, gaps, disorder, losses."""
    from data_tools.recordings import describe

    found = describe(_opened(recording, size, time_unit=time_unit, format=format, stream=stream))
    print(json.dumps(found.to_dict(), indent=2) if as_json else found.text())


@app.command()
def convert(
    recording: Annotated[Path, typer.Argument(help="Events, in any format that is known.")],
    target: Annotated[Path, typer.Argument(help="File to write: .h5, .npz, .csv or .txt.")],
    size: common.Size = None,
    time_unit: common.TimeUnit = None,
    format: common.Format = None,
    disorder: common.Disorder = "refuse",
    stream: common.Stream = None,
    denoise: Annotated[
        bool, typer.Option("--denoise", help="Leave out noise, hot pixels and flicker of lamps.")
    ] = False,
) -> None:
    """Write a recording in another format."""
    from data_tools.recordings.convert import Denoised
    from data_tools.recordings.convert import convert as write

    opened = _opened(
        recording, size, time_unit=time_unit, format=format, disorder=disorder, stream=stream
    )
    cleaned = Denoised(opened) if denoise else None
    count = write(cleaned or opened, target)
    common.tell(f"{count} events written to {target}", target)
    if cleaned is not None:
        common.tell(f"left out: {cleaned.noise.text()}", target)
    for what, lost in opened.losses.items():
        if lost:
            common.tell(f"lost: {lost} {what}", target)
    for line in opened.notes:
        common.tell(f"note: {line}", target)


@app.command()
def imu(
    recording: Annotated[Path, typer.Argument(help="Recording that holds an IMU.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Samples to write (CSV).")],
    format: common.Format = None,
    imu_stream: common.ImuStream = None,
) -> None:
    """Take the samples of the IMU out of a recording: t, wx, wy, wz and, if known, ax, ay, az.

    Times are in seconds on the recording's own clock, rates in rad/s, accelerations in m/s^2.
    """
    from data_tools.files.atomic import write_file
    from data_tools.logs.imu_files import write_imu
    from data_tools.recordings import read_imu

    found = read_imu(recording, format=format, stream=imu_stream)
    write_file(output, lambda path: write_imu(path, found.imu))
    common.tell(f"{len(found.imu)} samples written to {output}", output)
    for line in found.notes:
        common.tell(f"note: {line}", output)


def _opened(recording: Path, size: str | None, **options: Any) -> Recording:
    from data_tools.recordings import open_recording
    from data_tools.runs.headings import parse_size

    return open_recording(recording, size=None if size is None else parse_size(size), **options)


@app.command()
def fetch(
    name: Annotated[str, typer.Argument(help="Data set: paper-data.")],
    folder: Annotated[
        Path | None, typer.Option(help="Where its files are kept; by default the user's cache.")
    ] = None,
) -> None:
    """Download a data set, or check the files of it that are there; print their folder."""
    from data_tools.files.datasets import fetch as get

    print(get(name, folder=folder))


@app.command()
def export(
    calibration: Annotated[Path, typer.Argument(help="A calibration.yaml.")],
    to: Annotated[str, typer.Option(help="kalibr, ros-tf or urdf.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File to write; else standard output.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Export also a rotation that is not determined.")
    ] = False,
) -> None:
    """Write a calibration in the form of another tool."""
    from data_tools.files.atomic import write_file
    from data_tools.runs.export import export as convert_to
    from data_tools.runs.export import read_calibration

    stored = read_calibration(calibration)
    text = convert_to(stored, to)
    if not (stored.rotation_observable or force):
        print(
            f"evcalib: {calibration}: the rotation is not determined (--force exports it all the"
            " same)",
            file=sys.stderr,
        )
        raise typer.Exit(common.NO_ANSWER)
    if output is None:
        print(text, end="")
    else:
        write_file(output, lambda path: path.write_text(text, encoding="utf-8"))
