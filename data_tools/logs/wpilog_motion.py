"""Motion of a robot from a WPILib log: states or positions of swerve modules, or chassis speeds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data_tools.files.row_times import MAX_JUMP, advancing
from data_tools.files.wpilog import DataLog, last_known, read_wpilog
from data_tools.logs.bag_velocities import BagStream, commanded
from data_tools.logs.column_maps import Columns, column_map, converted
from data_tools.logs.wheel_logs import wanted_columns, wheel_log
from evcalib.errors import InputError
from evcalib.kinematics import Vehicle
from evcalib.series import VelocitySeries

STATES, POSITIONS = "struct:SwerveModuleState[]", "struct:SwerveModulePosition[]"
SPEEDS = "struct:ChassisSpeeds"


def read_wpilog_motion(
    path: str | Path,
    *,
    topic: str | None = None,
    vehicle: Vehicle | None = None,
    columns: Columns | None = None,
) -> BagStream:
    """Read wheel states or velocities from an entry of a WPILib log.

    Parameters
    ----------
    path : path
        The log.
    topic : str, optional
        Name of the entry; by default the only one that fits.
    vehicle : Swerve, optional
        With it modules are read, without it chassis speeds.
    columns : mapping or path, optional
        Which module is which wheel: map from ``speed_WHEEL`` to ``speed 0`` (or, where positions
        are logged, ``distance 0``) and from ``steer_WHEEL`` to ``angle 0``, with what
        `data_tools.logs.column_maps` has; by default modules are in the order of the vehicle.

    Raises
    ------
    InputError
        If the log is damaged, there is no such entry or too many, or modules are not those of the
        vehicle.
    """
    types = (SPEEDS,) if vehicle is None else (STATES, POSITIONS)
    log = read_wpilog(path, types)
    name = _chosen(log, types, topic, vehicle is not None)
    entry = log.entries[name]
    t_us, rows = log.values(entry)
    where = f"{path}, entry {name}"
    keep, late = advancing(t_us, lambda k: f"{where}, value {k}", per_second=1e6)
    fields = rows.dtype.names or ()
    t_us, rows = t_us[keep], rows[keep]
    flat = np.stack([rows[f].astype(np.float64) for f in fields], axis=2).reshape(len(rows), -1)
    if not np.isfinite(flat).all():
        good = np.isfinite(flat).all(axis=1)
        t_us, flat = t_us[good], flat[good]
        late.append(f"{int((~good).sum())} values that are no finite numbers were left out")
    if len(t_us) < 2:
        raise InputError(f"{where}: {len(t_us)} usable values, two at least are needed")
    notes = [f"entry {name} ({entry.type}), {len(t_us)} values", *late, *commanded(name)]
    if log.cut_off:
        notes.append(f"{log.cut_off} bytes of a cut-off last record were left out")
    t_us, flat, held = last_known(t_us, flat, MAX_JUMP)
    if held:
        notes.append(f"what does not change is not written: {held} rows hold the value before")
    t = t_us / 1e6
    table = dict(
        zip((f"{_plain(f)} {k}" for k in range(rows.shape[1]) for f in fields), flat.T, strict=True)
    )
    try:
        if vehicle is None:
            if columns is not None:
                raise InputError("chassis speeds take no column map")
            v = np.column_stack([table["vx 0"], table["vy 0"], np.zeros(len(t))])
            told = "chassis speeds are taken to be those in the robot's own frame"
            return BagStream(VelocitySeries(t, v, table["omega 0"]), (*notes, told))
        if columns is None:
            columns = _in_order(rows.shape[1], "speed" in fields, vehicle, notes)
        entries = column_map(columns)
        entries.pop("t", None)
        wanted = wanted_columns(vehicle)[1:]
        lacking = [str(e.column) for e in entries.values() if e.column not in table]
        if lacking or set(entries) != set(wanted):
            raise InputError(
                f"the column map must name {', '.join(wanted)} and say which of"
                f" {', '.join(table)} they are; it names"
                f" {', '.join(f'{n}: {e.column}' for n, e in entries.items())}"
            )
        values = {ours: table[str(one.column)] for ours, one in entries.items()}
        t, values, counted = converted(t, values, entries)
        log_ = wheel_log(t, values, entries, vehicle, lambda k: f"t = {t[k]:.3f} s")
        return BagStream(log_, (*notes, *counted))
    except KeyError as error:
        raise InputError(f"{where}: its struct has no field {error}") from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _plain(field: str) -> str:
    return field.removesuffix(".value")


def _chosen(log: DataLog, types: tuple[str, ...], topic: str | None, modules: bool) -> str:
    """Return the name of the entry that is named, or of the only one that fits and has values."""
    fitting = [n for n, e in log.entries.items() if e.type in types and e.payloads]
    if topic is not None:
        fitting = [name for name in fitting if name.strip("/") == topic.strip("/")]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise InputError(
            f"{log.path} has several entries of {' or '.join(types)}: {', '.join(fitting)}; say"
            " which was measured, not commanded (--topic)"
        )
    what = f"no entry {topic} of" if topic is not None else "no entry of"
    other = (
        "; without a vehicle, chassis speeds are read"
        if modules
        else "; modules of a swerve drive need their vehicle (--vehicle)"
    )
    there = sorted({e.type for n, e in log.entries.items() if not n.startswith("/.schema/")})
    raise InputError(
        f"{log.path} has {what} {' or '.join(types)}{other}; its types are"
        f" {', '.join(there) or 'none'}"
    )


def _in_order(count: int, speeds: bool, vehicle: Vehicle, notes: list[str]) -> Columns:
    """Return the column map of modules that are in the order of the vehicle's wheels."""
    names = vehicle.names
    if count != len(names) or not vehicle.steered:
        raise InputError(
            f"it has {count} modules that steer, and the vehicle has {len(names)} wheels"
            f" ({', '.join(names)}){'' if vehicle.steered else ', which do not'}"
        )
    notes.append(
        f"modules 0 to {count - 1} are taken for {', '.join(names)}, the order of the vehicle; a"
        " column map (--columns) says otherwise"
    )
    return {
        our: column
        for k, name in enumerate(names)
        for our, column in (
            (f"speed_{name}", f"speed {k}" if speeds else {"column": f"distance {k}", "unit": "m"}),
            (f"steer_{name}", {"column": f"angle {k}", "unit": "rad"}),
        )
    }
