"""What to drive."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from data_tools.cli import _options as common
from data_tools.cli._options import app
from evcalib.errors import InputError


@app.command()
def plan(
    vehicle: Annotated[Path, typer.Argument(help="Vehicle file.", metavar="VEHICLE.yaml")],
    space: Annotated[
        str, typer.Option(help="Free space, length x width in metres, such as 3x2.", metavar="LxW")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Velocities to drive (CSV).")
    ] = None,
    commands: Annotated[
        Path | None, typer.Option(help="The same for the wheels to write (CSV): a wheel log.")
    ] = None,
    time: Annotated[float, typer.Option(help="The drive takes no longer, in seconds.")] = 20.0,
    offset_sd: Annotated[
        float | None, typer.Option(help="Ask for so small a bar of the offset, in ms (sd).")
    ] = None,
    rotation_sd: Annotated[
        float | None,
        typer.Option(help="Of the rotation about the axis that shows least, in degrees (sd)."),
    ] = None,
    position_sd: Annotated[
        float | None, typer.Option(help="Of the worse of the camera's x and y, in mm (sd).")
    ] = None,
    max_speed: Annotated[float, typer.Option(help="Of all corners of the vehicle, in m/s.")] = 0.5,
    max_acceleration: Annotated[float, typer.Option(help="Likewise, in m/s^2.")] = 0.5,
    max_yaw_rate: Annotated[float, typer.Option(help="In degrees per second.")] = 45.0,
    max_steering: Annotated[
        float,
        typer.Option(help="Of a wheel in degrees, where an axle does not steer."),
    ] = 30.0,
    margin: Annotated[
        float,
        typer.Option(help="How far the vehicle reaches beyond its wheels, in metres."),
    ] = 0.1,
    looks: Annotated[
        float, typer.Option(help="Where the camera looks: degrees to the left of ahead.")
    ] = 0.0,
    max_offset: common.MaxOffset = 1.0,
) -> None:
    """Plan the drive that tells most in a space and a time, and predict its error bars.

    With a bar asked for, the drive is the shortest of those tried that is predicted to reach it.
    Vehicles that strafe keep their heading, unless --position-sd is asked for.  The bars are those
    of the best method there can be, for a small camera indoors.
    """
    from data_tools.files.atomic import write_file
    from data_tools.logs.series_files import write_velocities
    from data_tools.logs.vehicle_files import read_vehicle
    from data_tools.logs.wheel_logs import write_wheel_log
    from evcalib import design
    from evcalib.kinematics import WheelLog

    what = read_vehicle(vehicle)
    found = design.plan(
        what,
        _space(space),
        time=time,
        offset_sd=None if offset_sd is None else 1e-3 * offset_sd,
        rotation_sd=None if rotation_sd is None else float(np.radians(rotation_sd)),
        position_sd=None if position_sd is None else 1e-3 * position_sd,
        limits=design.Limits(
            max_speed,
            max_acceleration,
            float(np.radians(max_yaw_rate)),
            float(np.radians(max_steering)),
            margin,
        ),
        viewing=design.Viewing(direction=float(np.radians(looks))),
        max_offset=max_offset,
    )
    drive = found.velocities
    if output is not None:
        write_file(output, lambda path: write_velocities(path, drive))
    if commands is not None:
        assert drive.yaw_rate is not None
        log = WheelLog(drive.t, what.wheel_states(drive.v[:, :2], drive.yaw_rate))
        write_file(commands, lambda path: write_wheel_log(path, log, what))
    common.tell(found.text, output, commands)
    if not (found.prediction.offset_determined and found.prediction.rotation_determined):
        raise typer.Exit(common.NO_ANSWER)


def _space(text: str) -> tuple[float, float]:
    """Return length and width [m]."""
    found = re.fullmatch(r"\s*([\d.]+)\s*[xX]\s*([\d.]+)\s*", text)
    try:
        length, width = map(float, found.groups() if found else ())
    except ValueError:
        raise InputError(
            f"--space must be a length and a width in metres, such as 3x2, not {text!r}"
        ) from None
    return length, width
