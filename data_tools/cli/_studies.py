"""A demonstration, rivals, studies, and many recordings at once."""

from __future__ import annotations

import json
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from data_tools.cli import _options as common
from data_tools.cli._calibrate import streams
from data_tools.cli._options import app
from evcalib.errors import InputError

if TYPE_CHECKING:
    from evcalib.pipeline import Truth

Workers = Annotated[int, typer.Option(min=1, help="Processes on this machine.")]
Scheduler = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler, to run on its workers.")
]


@app.command()
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for the results; replaced each time.")
    ] = Path("evcalib-demo"),
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Simulate a new drive, in place of the one at hand.")
    ] = False,
    recording: Annotated[
        Path | None,
        typer.Option(help="Keep the simulated files here, to play with evcalib calibrate."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated drive.")] = 1,
    as_json: common.Json = False,
) -> None:
    """Calibrate a small recording, from raw events to report, and compare with the truth."""
    from data_tools.runs.calibrate import run_files
    from data_tools.runs.demo import against_truth

    if recording is not None and not simulate:
        raise InputError("--recording keeps the files of a new drive: add --simulate")
    with ExitStack() as stack:
        if simulate:
            home = recording or Path(stack.enter_context(tempfile.TemporaryDirectory()))
            files, truth = _new_drive(home, seed)
        else:
            files, truth = _shipped_drive()
        run = run_files(
            **files,
            output=output,
            overwrite=True,
            command=common.command_line(),
            on_stage=lambda name: common.note(f"{name} ..."),
            truth=truth,
        )
    common.print_calibration(run.calibration, as_json)
    if not as_json:
        print(against_truth(run.calibration, truth))
        print(f"\nWritten to {output}: calibration.yaml, report.html and the data behind them.")
    common.exit_by(run.calibration)


def _new_drive(home: Path, seed: int) -> tuple[dict[str, Any], Truth]:
    from data_tools.runs.demo import demo_drive, write_demo
    from evcalib.pipeline import Truth

    common.note("simulating ...")
    drive = demo_drive(seed)
    return write_demo(home, drive), Truth(drive.R_body_cam, drive.offset)


def _shipped_drive() -> tuple[dict[str, Any], Truth]:
    """Return the files of the sweep that notebook 0 looks at, which every installation has."""
    from data_tools.course import home_of_notebooks
    from data_tools.runs.demo import files_in
    from data_tools.runs.export import read_calibration
    from evcalib.pipeline import Truth

    home = home_of_notebooks()[0] / "data" / "sweep"
    true = read_calibration(home / "truth.yaml")
    return files_in(home), Truth(true.R_body_cam, true.offset)


@app.command()
def baselines(
    headings: Annotated[
        Path, typer.Argument(help="Headings (CSV), or the authors' .npz.", metavar="HEADINGS.csv")
    ],
    velocities: Annotated[
        Path | None, typer.Argument(help="Velocities (CSV).", metavar="[VELOCITIES.csv]")
    ] = None,
    trajectory: Annotated[
        Path | None, typer.Option(help="Trajectory of the camera (TUM), in any scale.")
    ] = None,
    max_offset: common.MaxOffset = 1.0,
    seed: common.Seed = 0,
) -> None:
    """Run all methods on the same two streams: ours, the paper's, and their rivals."""
    from data_tools.logs.trajectory_files import read_tum
    from data_tools.studies.baseline_runs import baseline_table, run_baselines

    camera, body, hold = streams(headings, velocities)
    rows = run_baselines(
        camera,
        body,
        trajectory=None if trajectory is None else read_tum(trajectory),
        max_offset=max_offset,
        hold=hold,
        seed=seed,
    )
    print(baseline_table(rows))


@app.command()
def study(
    name: Annotated[
        str,
        typer.Argument(
            help="paper, drives, ablations, coverage, real, recorded, campaign, lag, repeat,"
            " conditions, mixtures or turning."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for table and plots.")],
    trials: Annotated[int, typer.Option(min=1, help="Trials per group.")] = 100,
    seed: common.Seed = 0,
    workers: Workers = 1,
    scheduler: Scheduler = None,
    data: Annotated[
        Path | None, typer.Option(help="Folder of local files, for the study 'real'.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Only groups whose name holds this; may be given several times."),
    ] = None,
    rows: Annotated[
        bool, typer.Option("--rows", help="Write a table with a line for each trial, too.")
    ] = False,
) -> None:
    """Run a study of many trials; go on with it if it was stopped."""
    from data_tools.studies import describe, run_study, write_summary
    from data_tools.studies import study as study_of

    options: dict[str, Any] = {} if data is None else {"data": data}
    result = run_study(
        study_of(name, **options).only(only or []),
        trials=trials,
        seed=seed,
        folder=output,
        workers=workers,
        scheduler=scheduler,
    )
    write_summary(result, output, rows=rows)
    print(describe(result))


@app.command()
def batch(
    recordings: Annotated[Path, typer.Argument(help="List of recordings.", metavar="LIST.yaml")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for all results.")],
    workers: Workers = 1,
    scheduler: Scheduler = None,
) -> None:
    """Calibrate many recordings; go on with those that are left, or changed in the list.

    The list has the key `recordings`, a list of entries with the keys recording, camera, and either
    velocities, or wheels and vehicle; any option of `evcalib calibrate` may stand in an entry
    under its name with _ for -; the key `defaults` holds what entries leave out.
    """
    from data_tools.studies.batch import run_batch

    result = run_batch(recordings, folder=output, workers=workers, scheduler=scheduler)
    print(result.text())
    if result.failures:
        raise typer.Exit(common.BAD_INPUT)


@app.command()
def repeat(
    runs: Annotated[
        list[Path], typer.Argument(help="Folders of finished runs.", metavar="RUN1 RUN2 ...")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Page to write (HTML).")
    ] = None,
    as_json: common.Json = False,
) -> None:
    """Tell whether several runs of one rig agree within their error bars, and pool them."""
    from data_tools.files.atomic import write_file
    from data_tools.runs.repeat import repeat_runs, repeats_dict, repeats_text
    from evcalib.report import repeats_html

    found = repeat_runs(runs)
    print(json.dumps(repeats_dict(found), indent=2) if as_json else repeats_text(found))
    if output is not None:
        page = repeats_html(found)
        write_file(output, lambda path: path.write_text(page, encoding="utf-8"))
        if not as_json:
            common.tell(f"\nWritten to {output}.", output)
    if found.contradict:
        raise typer.Exit(common.DOUBTS)
