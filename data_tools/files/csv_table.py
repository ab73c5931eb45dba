"""Plain tables of numbers: CSV as people's tools leave it, checked to the last cell.

Columns are separated by commas, semicolons, tabs or spaces (the first line tells, or a line
``sep=;`` before it); numbers may have decimal commas, where these separate nothing.  Lines that
begin with ``#``, ``%`` or ``//`` are comments.  UTF-8, UTF-16 and Latin-1; any end of line; gzip.
Dates and times of day (ISO 8601) become seconds.  What was done about oddities is told in
`Table.notes`.
"""

from __future__ import annotations

import csv
import re
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_tools.files.dates import seconds_of
from data_tools.files.headers import our_names
from data_tools.files.row_times import advancing, unwrapped
from data_tools.files.text import check_end
from data_tools.files.unpack import check_ratio
from evcalib.arrays import Flags, Floats, Integers
from evcalib.errors import InputError

LARGEST = 1 << 30
"""Bytes of a table, which is read as a whole."""

_COMMENT = ("#", "%", "//")
_SEP_LINE = re.compile(r'"?sep=(.)"?\s*', re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(e[+-]?\d+)?", re.IGNORECASE)
_NOT_TEXT = re.compile(r"[\x00-\x08\x0b\x0e-\x19\x1b-\x1f]")
_MISSING = {"nan", "null", "none", "na", "n/a"}
_OTHERS = {
    b"PK\x03\x04": "is a zip file, or a workbook (.xlsx, .ods): save its sheet as CSV",
    b"\xd0\xcf\x11\xe0": "is an Excel workbook (.xls): save its sheet as CSV",
    b"PAR1": "is a Parquet file: write it as CSV (pandas.read_parquet, to_csv)",
    b"\x89HDF": "is an HDF5 file: write the columns as CSV",
    b"ULog": "is a PX4 log: write its topic as CSV (ulog2csv)",
    b"MATLAB": "is a MATLAB file: write the columns as CSV (writetable)",
    b"WPILOG": "is a WPILib log: --wheels and --velocities read one",
}
"""What other files are, by their first bytes, and what to do."""
_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "spaces"}


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of finite numbers and where in the file each row stands.

    Attributes
    ----------
    path : str
        The file, for messages.
    columns : dict of str to ndarray, shape (n,)
        Values by column name, in the order of the file.
    line : ndarray of int, shape (n,)
        Line of the file (the first is line 1) of each row.
    notes : tuple of str
        What was taken for granted, held or left out.
    foreign : tuple of str
        Columns that were passed over, whatever they hold.
    units : dict of str to str
        Units that stand in the header, and ``"date"`` where dates became seconds.
    """

    path: str
    columns: dict[str, Floats]
    line: Integers
    notes: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)

    def where(self, bad: Flags) -> str:
        """Return ``"FILE line LINE"`` of the first bad row."""
        return f"{self.path} line {self.line[int(np.argmax(bad))]}"

    def rows(self, keep: Flags, *notes: str) -> Table:
        """Return a part of the rows, with further notes."""
        columns = {name: values[keep] for name, values in self.columns.items()}
        return replace(self, columns=columns, line=self.line[keep], notes=(*self.notes, *notes))


def read_table(
    path: str | Path,
    only: Collection[str | int] | None = None,
    *,
    ours: Collection[str] = (),
    alias: Callable[[str], str] | None = None,
    names: Mapping[int, tuple[str, ...]] | None = None,
    hold: bool = False,
) -> Table:
    """Read a CSV file of finite numbers with at least two rows.

    Parameters
    ----------
    path : path
        The file.
    only : collection of str or int, optional
        Columns to read, by name or by number (the first is 1; they are then called ``"1"``); the
        others are passed over, whatever they hold.
    ours : collection of str
        In place of `only`: names that the reader knows, however they are spelt (see
        `data_tools.files.headers`); other columns are passed over, and told in `Table.foreign`.
    alias : callable, optional
        Returns our name of a column of another name.
    names : mapping of int to tuple of str, optional
        What the columns of a file without a header are, by how many there are.
    hold : bool
        An empty cell holds the value above it, as logs do that write what changes.  Otherwise, and
        where there is nothing above it yet, its row is left out, as are rows with NaN.

    Raises
    ------
    InputError
        If the file cannot be read, is empty or has one row, repeats a column, or holds a cell
        that is no finite number; the message names file, line and column.  And if it ends within
        a number, without the end of a line: digits may be missing.
    """
    cells = _read_cells(path)
    header, notes = cells.header, list(cells.notes)
    if header is None:
        if only is None:
            header = list((names or {}).get(cells.width, ()))
            at = f"{path} line {cells.lines[0] if cells.lines.size else 1}"
            if not header and names:
                told = " or ".join(f"{k} ({', '.join(these)})" for k, these in names.items())
                raise InputError(
                    f"{at} has {cells.width} numbers; where no line names the columns, there must"
                    f" be {told}"
                )
            if not header:
                raise InputError(
                    f"{at} holds numbers: no line names the columns; add one, or name them by"
                    " number in a column map (--columns), as in t: 1"
                )
            notes.append(f"no header: columns are taken to be {', '.join(header)}")
        else:
            header = [""] * cells.width
    if only is None:
        places, units = _known(path, cells, header, ours, alias, notes)
    else:
        places, units = _picked(path, header, only), {}
    if len(cells.rows) < 2:
        have = "no row" if not cells.rows else "one row"
        raise InputError(f"{path} has {have} below its header; at least two are needed")
    picked = [[row[k] for k in places.values()] for row in cells.rows]
    foreign = tuple(filter(None, (n for k, n in enumerate(header) if k not in places.values())))
    values, keep, dates = _values(path, cells, list(places), picked, hold, notes)
    columns = dict(zip(places, values.T.copy(), strict=True))
    units |= dict.fromkeys(dates, "date")
    table = Table(str(path), columns, cells.lines, (), foreign, units)
    return replace(table, notes=tuple(notes)) if keep.all() else table.rows(keep, *notes)


def _known(
    path: str | Path,
    cells: _Cells,
    header: list[str],
    ours: Collection[str],
    alias: Callable[[str], str] | None,
    notes: list[str],
) -> tuple[dict[str, int], dict[str, str]]:
    """Return the places of the columns that the reader knows, and the units of their header."""
    if not any(header):
        raise InputError(f"{path} names no column")
    twice = [name for name in header if name and header.count(name) > 1]
    if twice:
        raise InputError(f"{path} names the column {twice[0]} twice")
    if any(row[k].strip() for k, name in enumerate(header) if not name for row in cells.rows):
        notes.append("columns without a name were passed over")
    try:
        found = our_names(header, ours, alias)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    places = {own: found[own][0] for own in ours if own in found}
    renamed = [f"{header[k]} is {own}" for own, k in places.items() if header[k] != own]
    if renamed:
        notes.append(f"columns: {', '.join(renamed)}")
    return places, {own: unit for own, (_, unit) in found.items() if unit}


def _picked(path: str | Path, header: list[str], only: Collection[str | int]) -> dict[str, int]:
    """Return the places of columns that are asked for by name or by number."""
    places: dict[str, int] = {}
    for k, name in enumerate(header):
        wanted = [name] if name in only else []
        wanted += [str(k + 1)] if k + 1 in only else []
        for one in filter(None, wanted):
            if one in places:
                raise InputError(f"{path} names the column {one} twice")
            places[one] = k
    return places


def read_columns(path: str | Path) -> dict[str, NDArray[Any]]:
    """Read a small table of labels and numbers, such as a study leaves.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        By name: numbers where every cell is a number or empty (NaN), else text.

    Raises
    ------
    InputError
        If the file cannot be read, or its rows do not fit its header.
    """
    cells = _read_cells(path)
    header, rows = cells.header or [], cells.rows
    twice = [name for name in header if header.count(name) > 1]
    if twice or not header:
        raise InputError(f"{path} names {f'the column {twice[0]} twice' if twice else 'no column'}")
    return {name: _column([row[k] for row in rows]) for k, name in enumerate(header)}


def _column(cells: list[str]) -> NDArray[Any]:
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    except ValueError:
        return np.array(cells)


def check_times(
    table: Table,
    column: str = "t",
    max_step: float | None = None,
    max_jump: float = 3600.0,
) -> Table:
    """Return the rows whose times [s] increase; refuse steps that betray another unit, or a jump.

    A step above `max_jump` [s] is taken for a clock that was set, not for a gap.
    """
    t = table.columns[column]
    step = float(np.median(np.diff(t)))
    if max_step is not None and step > max_step:
        units = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
        likely = [unit for unit, factor in units.items() if 1e-3 <= step * factor <= 1.0]
        raise InputError(
            f"{table.path}: the median step of column {column} is {step:.6g} s"
            + (f", which would be {step * units[likely[0]]:.3g} s in {likely[0]}" if likely else "")
            + "; are the times in seconds? say their unit (--time-unit; or, in a column map, t:"
            f" {{column: NAME, unit: {likely[0] if likely else 'ms'}}})"
        )
    t, mended = unwrapped(t)
    keep, notes = advancing(
        t, lambda row: f"{table.path} line {table.line[row]}", max_jump=max_jump
    )
    return replace(table, columns=table.columns | {column: t}).rows(keep, *mended, *notes)


def in_our_units(table: Table) -> Table:
    """Return a table whose header names no other units than ours (seconds and metres)."""
    other = {name: unit for name, unit in table.units.items() if unit not in ("s", "m", "date")}
    if other:
        told = ", ".join(f"{name} in {unit}" for name, unit in other.items())
        raise InputError(f"{table.path} has {told}, by its header: write times in s, lengths in m")
    return table


def write_table(path: str | Path, columns: dict[str, Floats]) -> None:
    """Write columns of equal length so that reading them gives the same numbers again."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(np.stack(list(columns.values()), axis=1).tolist())


@dataclass(frozen=True, eq=False)
class _Cells:
    """Rows of text, all as wide as the header, which is None where the first line has numbers."""

    header: list[str] | None
    rows: list[list[str]]
    lines: Integers
    width: int
    separator: str
    notes: list[str]


def _read_cells(path: str | Path) -> _Cells:
    text, notes = _decoded(path)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if lines and not _is_comment(lines[-1]):
        check_end(path, lines[-1])
    start = next(
        (k for k, line in enumerate(lines) if line.strip() and not _is_comment(line)), None
    )
    declared = None
    if start is not None and (match := _SEP_LINE.fullmatch(lines[start])):
        declared, start = match[1], start + 1
    if start is None or start >= len(lines) or not lines[start].strip(' ,;\t"'):
        raise InputError(f"{path} is empty: its first line must name the columns")
    separator = declared or _separator(lines[start])
    numbered = _NumberedLines(path, lines, start, separator)
    try:
        header: list[str] | None = [name.strip() for name in next(numbered.reader)]
        assert header is not None
        # Where most are numbers, a word among them is a broken value, not a name.
        if sum(_is_number(cell) for cell in header) > len(header) / 2:
            width = len(header)
            header, numbered = None, _NumberedLines(path, lines, start, separator)
            comment = next((line for line in reversed(lines[:start]) if line.strip()), "")
            named = re.split(r"[\s,;]+", comment.strip().lstrip("#%/ ").rstrip())
            if len(named) == width and not any(map(_is_number, named)):
                header = named
                notes.append(f"columns are named by a comment: {', '.join(named)}")
        else:
            while len(header) > 1 and not header[-1]:
                header.pop()
            width = len(header)
        rows, places = _rows(path, numbered, width, separator)
    except csv.Error:
        raise InputError(f"{path} is not a CSV text file") from None
    if rows and places[-1] == len(lines) and not rows[-1][-1].strip():
        rows.pop()
        places.pop()
        notes.append("the last line ends within its row, which was left out")
    if numbered.comments:
        notes.append(f"{numbered.comments} comments between rows were passed over")
    if separator != ",":
        notes.append(f"columns are separated by {_NAMES.get(separator, repr(separator))}")
    return _Cells(header, rows, np.array(places, dtype=np.int64), width, separator, notes)


def _rows(
    path: str | Path, numbered: _NumberedLines, width: int, separator: str
) -> tuple[list[list[str]], list[int]]:
    rows, places = [], []
    for row in numbered.reader:
        if not any(cell.strip() for cell in row):
            continue
        while len(row) > width and not row[-1].strip():
            row.pop()
        if len(row) != width:
            hint = ""
            if separator == "," and len(row) == 2 * width:
                hint = ": decimal commas between commas? write it anew with semicolons or points"
            raise InputError(
                f"{path} line {numbered.number} has {len(row)} values, but the first line has"
                f" {width} columns{hint}"
            )
        rows.append(row)
        places.append(numbered.number)
    return rows, places


class _NumberedLines:
    """Lines of a table without comments and empty lines, and a reader of their cells."""

    def __init__(self, path: str | Path, lines: list[str], start: int, separator: str) -> None:
        self.path, self.separator = path, separator
        self.number, self.comments, self.width = start, 0, 0
        plain = self._plain(lines, start)
        if separator == " ":
            self.reader: Iterator[list[str]] = (line.split() for line in plain)
        else:
            self.reader = csv.reader(plain, delimiter=separator, skipinitialspace=True)

    def _plain(self, lines: list[str], start: int) -> Iterator[str]:
        separator = None if self.separator == " " else self.separator
        for number, line in enumerate(lines[start:], start=start + 1):
            if _is_comment(line):
                cells = [cell.strip() for cell in line.split(separator)]
                if len(cells) == self.width > 1 and all(map(_is_number, cells[1:])):
                    raise InputError(
                        f"{self.path} line {number}: a comment that looks like a damaged row; take"
                        " it out"
                    )
                self.comments += 1
            elif line.strip():
                self.number = number
                self.width = self.width or len(line.split(separator))
                yield line + "\n"


def _decoded(path: str | Path) -> tuple[str, list[str]]:
    try:
        with open(path, "rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    if len(data) > LARGEST:
        raise InputError(f"{path} is over {LARGEST} bytes, too long for a table; cut it")
    if data[:2] == b"\x1f\x8b":
        data = _unzipped(path, data)
    for magic, what in _OTHERS.items():
        if data.startswith(magic):
            raise InputError(f"{path} {what}")
    notes = []
    zeros = data[:200].count(0), data[1:200:2].count(0)
    wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    guess = "utf-16" if wide else "utf-16-le" if zeros[1] > 50 else "utf-16-be"
    try:
        if wide or zeros[0] > 50:
            text = data.decode(guess)
            notes.append("text is UTF-16")
        else:
            text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        if wide or zeros[0]:
            raise InputError(f"{path} is not a CSV text file") from None
        text = data.decode("latin-1")
        notes.append("text is not UTF-8: read as Latin-1")
    text = text.rstrip("\x1a")
    if _NOT_TEXT.search(text):
        raise InputError(f"{path} is not a CSV text file")
    if text.lstrip()[:1] in ("{", "["):
        raise InputError(f"{path} holds JSON: write it as CSV (pandas.read_json, to_csv)")
    return text, notes


def _unzipped(path: str | Path, data: bytes) -> bytes:
    unzip = zlib.decompressobj(wbits=31)
    text, packed = bytearray(), len(data)
    try:
        while len(text) <= LARGEST and (part := unzip.decompress(data, 1 << 20)):
            text += part
            check_ratio(len(text), packed)
            data = unzip.unconsumed_tail
    except (zlib.error, InputError) as error:
        raise InputError(f"{path} is damaged: {error}") from None
    if len(text) > LARGEST:
        raise InputError(f"{path} holds over {LARGEST} bytes, too long for a table; cut it")
    if not unzip.eof:
        raise InputError(f"{path} is cut off: its gzip stream has no end; fetch it again")
    return bytes(text)


def _separator(line: str) -> str:
    """Return what separates the cells of a first line: ``;`` or tabs, else commas, else spaces."""
    for separator in (";", "\t"):
        if separator in line:
            return separator
    words = line.split()
    if "," not in line or (len(words) > 1 and all(map(_is_number, words))):
        return " " if len(words) > 1 else ","
    return ","


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENT)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return bool(_DECIMAL_COMMA.fullmatch(cell.strip()))
    return True


def _values(
    path: str | Path,
    cells: _Cells,
    names: list[str],
    rows: list[list[str]],
    hold: bool,
    notes: list[str],
) -> tuple[Floats, Flags, list[str]]:
    """Return numbers, which rows have all of them, and the columns that held dates."""
    dates: list[str] = []
    try:
        values = np.array(rows, dtype=np.float64)
    except ValueError:
        rows, dates = _without_dates(names, rows, notes)
        values = np.array(_with_decimal_points(path, cells, rows, notes))
    bad = ~np.isfinite(values)
    if not bad.any():
        return values, np.ones(len(rows), dtype=bool), dates
    empty = np.zeros_like(bad)
    for row, column in np.argwhere(bad):
        cell = rows[row][column].strip()
        empty[row, column] = not cell
        if cell and cell.lower() not in _MISSING:
            raise InputError(
                f"{path} line {cells.lines[row]}: {names[column]} is {cell!r}, not a finite"
                f" number; {_remedy([cells[column] for cells in rows])}"
            )
    if hold and empty.any():
        last = np.maximum.accumulate(np.where(~empty, np.arange(len(rows))[:, None], -1), axis=0)
        held = empty & (last >= 0)
        values = np.where(held, np.take_along_axis(values, np.maximum(last, 0), axis=0), values)
        notes.append(f"{int(held.any(axis=1).sum())} rows with empty cells hold the value before")
    keep = np.asarray(np.isfinite(values).all(axis=1))
    if not keep.all():
        notes.append(
            f"{int((~keep).sum())} rows without a value (empty or NaN) were left out (the first:"
            f" line {cells.lines[int(np.argmin(keep))]})"
        )
    if keep.sum() < 2:
        raise InputError(
            f"{path}: only {int(keep.sum())} of {keep.size} rows have a number in each of"
            f" {', '.join(names)}; two at least are needed"
        )
    return values, keep, dates


def _without_dates(
    names: list[str], rows: list[list[str]], notes: list[str]
) -> tuple[list[list[str]], list[str]]:
    """Return rows in which dates are seconds, and the names of their columns."""
    dates = []
    rows = [list(row) for row in rows]
    for k, name in enumerate(names):
        if _is_number(rows[0][k]) or (found := seconds_of([row[k] for row in rows])) is None:
            continue
        seconds, since = found
        for row, value in zip(rows, seconds.tolist(), strict=True):
            row[k] = repr(value)
        dates.append(name)
        notes.append(f"{name} holds times in words, which were read as seconds {since}")
    return rows, dates


def _remedy(column: list[str]) -> str:
    """Return what to do about a cell that is no number, by what else its column holds."""
    if not any(map(_is_number, column)):
        return (
            "nor is any other value of that column: it takes numbers, and for times also dates as"
            " in 2024-05-01T12:00:00.25"
        )
    return "correct or remove this row"


def _with_decimal_points(
    path: str | Path, cells: _Cells, rows: list[list[str]], notes: list[str]
) -> list[list[float]]:
    commas = [
        (k, cell)
        for k, row in enumerate(rows)
        for cell in row
        if _DECIMAL_COMMA.fullmatch(cell.strip())
    ]
    if not commas:
        return [[_number(cell) for cell in row] for row in rows]
    for k, row in enumerate(rows):
        for cell in row:
            if "." in cell and _is_number(cell):
                line, example = cells.lines[commas[0][0]], commas[0][1].strip()
                raise InputError(
                    f"{path} has decimal points ({cell.strip()}, line {cells.lines[k]}) and commas"
                    f" ({example}, line {line}); which of them is the decimal sign? write it with"
                    " one of them"
                )
    notes.append(f"decimal commas: {commas[0][1].strip()} is {_number(commas[0][1], ',')!r}")
    return [[_number(cell, ",") for cell in row] for row in rows]


def _number(cell: str, point: str = ".") -> float:
    try:
        return float(cell.replace(",", ".") if point == "," else cell)
    except ValueError:
        return float("nan")
