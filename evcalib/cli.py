"""The command line, thin over the library; the one module of evcalib that knows files.

Exit codes: 0 the rotation is determined; 2 bad input; 3 the motion cannot answer.
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from evcalib.errors import EvcalibError, InputError

if TYPE_CHECKING:
    from evcalib.results import Calibration
    from evcalib.series import HeadingSeries, VelocitySeries

BAD_INPUT = 2
NO_ANSWER = 3

app = typer.Typer(
    help="Time offset and rotation between an event camera and an omni-directional vehicle.",
    add_completion=False,
    pretty_exceptions_enable=False,
)

MaxOffset = Annotated[float, typer.Option(help="Search offsets from -MAX to MAX, in seconds.")]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", help="Folder for calibration.yaml and the plots.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON alone on standard output.")]


# The class of all errors of usage; typer has it from click, or brings its own copy of click.
UsageError: Any = typer.BadParameter.__bases__[0]


def main() -> None:
    """Run the command line; errors of the input are one line on stderr and exit code 2."""
    try:
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except UsageError as error:
        _fail(f"{error.format_message()} (see evcalib --help)")
    except EvcalibError as error:
        _fail(str(error))
    except KeyboardInterrupt:
        print("evcalib: interrupted", file=sys.stderr)
        sys.exit(130)
    sys.exit(code)


@app.command()
def velocities(
    wheels: Annotated[Path, typer.Argument(help="Wheel log (CSV).", metavar="WHEELS.csv")],
    vehicle: Annotated[Path, typer.Option(help="Vehicle file (YAML).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Velocities to write (CSV).")],
    max_slip: Annotated[
        float | None, typer.Option(help="Remove rows that slip more, in m/s.")
    ] = None,
    max_yaw_rate: Annotated[
        float | None, typer.Option(help="Remove rows that turn faster, in rad/s.")
    ] = None,
) -> None:
    """Turn a wheel log into body velocities."""
    from data_tools.series_files import write_velocities
    from data_tools.wheel_logs import velocities_from_files

    result = velocities_from_files(wheels, vehicle, max_slip=max_slip, max_yaw_rate=max_yaw_rate)
    _write(output, lambda path: write_velocities(path, result.velocities))
    print(
        f"{len(result.velocities)} of {result.rows} rows written to {output}"
        f" ({result.over_slip} over the slip limit, {result.over_yaw_rate} over the yaw-rate limit)"
    )


@app.command()
def align(
    headings: Annotated[
        Path, typer.Argument(help="Headings (CSV), or the authors' .npz.", metavar="HEADINGS.csv")
    ],
    velocities: Annotated[
        Path | None, typer.Argument(help="Velocities (CSV).", metavar="[VELOCITIES.csv]")
    ] = None,
    max_offset: MaxOffset = 1.0,
    offset_method: Annotated[
        str, typer.Option(help="profile, trace, canonical, scalar or none.")
    ] = "profile",
    rotation_method: Annotated[str, typer.Option(help="tukey, l1, kabsch, gnc or cca.")] = "tukey",
    offset: Annotated[
        float | None, typer.Option(help="Offset in seconds, to use if the motion does not tell it.")
    ] = None,
    max_gap: Annotated[
        float | None,
        typer.Option(help="Longest step to interpolate over, in seconds."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the bootstrap.")] = 0,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Find offset and rotation between headings and velocities."""
    from evcalib.calibration import align as run

    camera, body, hold = _streams(headings, velocities)
    calibration = run(
        camera,
        body,
        max_offset=max_offset,
        offset_method=offset_method,
        rotation_method=rotation_method,
        offset=offset,
        max_gap=max_gap,
        hold=hold,
        seed=seed,
    )
    _report(calibration, output, as_json)


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
    from data_tools.export import export as convert
    from data_tools.export import read_calibration

    stored = read_calibration(calibration)
    text = convert(stored, to)
    if not (stored.rotation_observable or force):
        print(
            f"evcalib: {calibration}: the rotation is not determined (--force exports it all the"
            " same)",
            file=sys.stderr,
        )
        raise typer.Exit(NO_ANSWER)
    if output is None:
        print(text, end="")
    else:
        _write(output, lambda path: path.write_text(text, encoding="utf-8"))


@app.command()
def headings(
    recording: Annotated[Path, typer.Argument(help="Events (text, .gz or the dataset's .zip).")],
    camera: Annotated[Path, typer.Option(help="Camera file (calib.txt or Kalibr YAML).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Headings to write (CSV).")],
    surface: Annotated[str, typer.Option(help="tos_ts, tos, ts, silc or dist.")] = "tos_ts",
    solver: Annotated[str, typer.Option(help="two_point or five_point.")] = "two_point",
    rate: Annotated[float, typer.Option(help="Keyframes per second.")] = 20.0,
    size: Annotated[
        str | None, typer.Option(help="Sensor size WIDTHxHEIGHT, where no file tells it.")
    ] = None,
    time_unit: Annotated[
        str | None, typer.Option(help="s, ms, us or ns, where the recording does not tell it.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of descriptor and solver.")] = 0,
) -> None:
    """Find the direction of motion of an event camera from its events."""
    from data_tools.headings import headings_from_files
    from data_tools.series_files import write_headings

    result = headings_from_files(
        recording,
        camera,
        size=size,
        surface=surface,
        solver=solver,
        rate=rate,
        seed=seed,
        time_unit=time_unit,
    )
    _write(output, lambda path: write_headings(path, result.estimate.headings))
    print(result.summary)
    if not len(result.estimate.headings):
        raise typer.Exit(NO_ANSWER)


@app.command()
def demo(
    output: Output = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated drive.")] = 1,
    as_json: Json = False,
) -> None:
    """Calibrate a simulated drive and compare with the truth."""
    import numpy as np

    from data_tools.demo import demo_streams
    from evcalib.calibration import align as run
    from evcalib.geometry import rotation_angle

    streams = demo_streams(seed)
    calibration = run(streams.headings, streams.velocities)
    _report(calibration, output, as_json, true=streams.offset, exit_after=False)
    if not as_json:
        turn = np.degrees(rotation_angle(calibration.R_body_cam, streams.R_body_cam))
        error = 1e3 * (calibration.offset - streams.offset)
        print(
            "\nSimulated drive: S-curve of 20 s, 10 % outliers, noise of 3 deg.\n"
            f"  offset    found {calibration.offset:+.4f} s, true {streams.offset:+.4f} s:"
            f" error {error:+.1f} ms (sd {1e3 * calibration.offset_sd:.1f} ms)\n"
            f"  rotation  error {turn:.2f} deg"
            f" (95 % radius {np.degrees(calibration.rotation_radius):.2f} deg)"
        )
    _exit(calibration)


def _streams(
    headings: Path, velocities: Path | None
) -> tuple[HeadingSeries, VelocitySeries, float]:
    from data_tools.series_files import read_headings, read_paired_streams, read_velocities

    if headings.suffix == ".npz":
        if velocities is not None:
            raise InputError(f"{headings} holds both streams: give no velocities beside it")
        pairs = read_paired_streams(headings)
        return pairs.headings, pairs.velocities, pairs.hold
    if velocities is None:
        raise InputError(f"a velocities file is needed beside {headings}")
    return read_headings(headings), read_velocities(velocities), 0.0


def _report(
    calibration: Calibration,
    output: Path | None,
    as_json: bool,
    *,
    true: float | None = None,
    exit_after: bool = True,
) -> None:
    from data_tools.export import summary_dict, summary_text

    if output is not None:
        _write_folder(output, calibration, true)
    if as_json:
        print(json.dumps(summary_dict(calibration), indent=2))
    else:
        print(summary_text(calibration))
        if output is not None:
            print(f"\nWritten to {output}: calibration.yaml and the plots.")
    if exit_after:
        _exit(calibration)


def _exit(calibration: Calibration) -> None:
    if not calibration.rotation_observable:
        raise typer.Exit(NO_ANSWER)


def _write_folder(folder: Path, calibration: Calibration, true: float | None) -> None:
    from data_tools.export import write_calibration
    from evcalib.plots.alignment import alignment_figures
    from evcalib.plots.style import png

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        _fail(f"cannot make the folder {folder}: {error.strerror or error}")
    for name, figure in alignment_figures(calibration, true=true).items():
        picture = png(figure)
        _write(folder / f"{name}.png", lambda path, data=picture: path.write_bytes(data))
    # Last, so that a calibration.yaml means that everything is there.
    _write(folder / "calibration.yaml", lambda path: write_calibration(path, calibration))


def _write(path: Path, writer: Any) -> None:
    """Write beside the final name first: nothing half-written ever stands under it."""
    if path.is_dir() or not path.name:
        _fail(f"cannot write {path}: it is a folder, not a file")
    part = path.with_name(path.name + ".part")
    try:
        writer(part)
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        _fail(f"cannot write {path}: {error.strerror or error}")


def _fail(message: str) -> None:
    print(f"evcalib: {message}", file=sys.stderr)
    sys.exit(BAD_INPUT)
