"""CSV of nothing but numbers: the columns are known by what is in them, or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import TIME_COLUMN, UNIT_FACTORS, FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.pieces import Fact, Pieces
from levelhead.logs.readers.base import Reader, Source, Table
from levelhead.logs.readers.columns import IMU_COLUMNS, pieces_from_table
from levelhead.logs.readers.csv_table import CsvNumbers, guess_layout, is_text, read_numbers
from levelhead.logs.readers.rtklib_tag import zero_of_clock
from levelhead.logs.readers.stamps import IMU_INTERVALS_S, are_unix, unit_of_stamps
from levelhead.logs.timescales import GPST

FEWEST_COLUMNS: Final = 7
"""A time and six readings."""
_SNIFFED_ROWS: Final = 3
_GRAVITY: Final = ((0.85, 1.15), (8.3, 11.3), (850.0, 1150.0))
"""Median length of an acceleration in g, m/s^2 and mg: gravity, give or take the errors of a cheap sensor."""
_STEADY: Final = 0.1
"""Scatter (median) of that length as a share of it, beyond which it is not an acceleration with gravity in it."""
_LIVELY: Final = 5.0
"""A turn rate has rest and turns in it: the 90 % quantile of its length is this many times the 10 % quantile.

On recorded drives it is 20 to 60 times; of a magnetometer in a car 2.8 times, of an acceleration 1.1 times."""
_IN_ORDER: Final = 0.99
"""Share of rows on which a time does not step back."""
_FEWEST_COMPARED: Final = 100
_LEAP: Final = 100.0
"""Intervals that a first stamp is away from the second where its first digits are lost."""
_MAPPING: Final = "say what the columns are in a mapping file (mapping=) with header = false"


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the text is rows of at least seven numbers without a header."""
    if not is_text(head):
        return False
    try:
        layout = guess_layout(head, name="")
    except LogError:
        return False
    if layout.header or len(layout.names) < FEWEST_COLUMNS:
        return False
    # The first row may be cut.
    rows = [line for line in head[layout.start :].split(b"\n") if line.strip()][1 : 1 + _SNIFFED_ROWS]
    return bool(rows) and all(_numbers_in(row, layout.delimiter, layout.decimal) == len(layout.names) for row in rows)


def read(source: Source) -> Pieces:
    """Read time, accelerations and turn rates; where RTKLIB's time tags lie beside, the host's clock becomes GPST.

    Raises
    ------
    LogError
        Where the columns cannot be told from each other, and naming line and column of what is wrong.
    """
    path = source.path
    if source.role == "gnss":
        raise LogError(f"{path.name} has no header that names GNSS columns; {_MAPPING}.")
    content = path.read_bytes()
    layout = guess_layout(content, name=path.name)
    if layout.header or len(layout.names) < FEWEST_COLUMNS:
        raise LogError(f"{path.name} is not a table of {FEWEST_COLUMNS} or more columns of numbers; {_MAPPING}.")
    # The last line may be cut: that is judged by the time, which is not known yet.
    whole = content[: content.rfind(b"\n") + 1] or content
    everything = {name: index for index, name in enumerate(layout.names)}
    numbers = read_numbers(path, whole, layout, everything, time_column="1")
    time, unit, wanted = _find_columns(path.name, [numbers.columns[n] for n in layout.names])
    numbers = read_numbers(
        path, content, layout, {TIME_COLUMN: time, **wanted}, time_column=TIME_COLUMN, doubt_end=True
    )
    columns = dict(numbers.columns)
    columns[TIME_COLUMN] = columns[TIME_COLUMN] * UNIT_FACTORS["s"][unit]
    first = next((c for c, index in {TIME_COLUMN: time, **wanted}.items() if index == 0), None)
    cut = first is not None and _first_stands_out(columns[first], is_time=first == TIME_COLUMN)
    if cut:
        columns = {c: values[1:] for c, values in columns.items()}
    table = Table(
        name=path.name,
        columns=columns,
        where=lambda row: numbers.where(row + cut),
        left_out=numbers.left_out + cut,
    )
    pieces = pieces_from_table(table)
    if pieces.imu is None:
        raise LogError(f"{path.name} holds no readings; check the recording.")
    undeclared: tuple[Fact, ...] = ("gyro_unit", "accel_unit", "axes")
    tag = path.with_name(path.name + ".tag")
    if not tag.is_file() or are_unix(pieces.imu.time):
        return replace(pieces, undeclared=(*undeclared, "clock"))
    ends, lines = _lines(content, numbers)
    zero = zero_of_clock(tag, ends, lines[int(cut) :], columns[TIME_COLUMN])
    if zero is None:
        detail = f"The time tags of {tag.name}, which do not go with the file."
        return replace(
            pieces,
            undeclared=(*undeclared, "clock"),
            events=(Event(code="W_DROPPED", count=1, detail=detail),),
        )
    imu = replace(pieces.imu, time=pieces.imu.time + zero, time_scale=GPST)
    return replace(pieces, imu=imu, undeclared=undeclared, host_clock=True)


def _first_stands_out(values: FloatArray, *, is_time: bool) -> bool:
    """Whether the first number of the file lost its beginning, as a line that was cut has: it is like no other."""
    if values.size < _FEWEST_COMPARED:
        return False
    if is_time:
        steps = np.diff(values)
        return bool(abs(steps[0]) > _LEAP * np.median(np.abs(steps)))
    others = values[1:]
    return not float(np.nanmin(others)) <= float(values[0]) <= float(np.nanmax(others))


def _numbers_in(row: bytes, delimiter: str, decimal: str) -> int:
    cells = row.decode("utf-8", errors="replace").split(delimiter)
    try:
        return len([float(cell.replace(decimal, ".")) for cell in cells])
    except ValueError:
        return 0


def _find_columns(name: str, columns: Sequence[FloatArray]) -> tuple[int, str, dict[str, int]]:
    """Return the column of the time, its unit, and those of the readings.

    Gyro and accelerometer are the six columns before or behind the time, three and three.
    """
    times = {k: unit for k, values in enumerate(columns) if (unit := _time_unit(values)) is not None}
    if len(times) > 1:
        times = {k: unit for k, unit in times.items() if not _counts(columns[k])} or times
    if len(times) != 1:
        found = f"{len(times)} columns could be ({', '.join(str(k + 1) for k in times)})" if times else "no column is"
        raise LogError(f"{name}: the header names no columns, and {found} the time; {_MAPPING}.")
    (time, unit), *_ = times.items()
    fitting = []
    for first in (time + 1, time - 6):
        if first < 0 or first + 6 > len(columns):
            continue
        one, two = (np.array(columns[at : at + 3]) for at in (first, first + 3))
        for accel, gyro, swapped in ((one, two, False), (two, one, True)):
            if _is_accel(accel) and not _is_accel(gyro) and _is_gyro(gyro):
                fitting.append((first + 3, first) if swapped else (first, first + 3))
    if len(fitting) != 1:
        raise LogError(
            f"{name}: the header names no columns, and beside the time (column {time + 1}) no three are clearly the "
            f"acceleration (of the length of gravity) and the three next to them the turn rate; {_MAPPING}."
        )
    accel_at, gyro_at = fitting[0]
    places = (*range(gyro_at, gyro_at + 3), *range(accel_at, accel_at + 3))
    return time, unit, dict(zip(IMU_COLUMNS, places, strict=True))


def _time_unit(values: FloatArray) -> str | None:
    """Return the unit that numbers have if they are a time that advances evenly, else None."""
    if values.size >= _FEWEST_COMPARED:
        values = values[1:]  # the first may have lost its beginning
    steps = np.diff(values)
    if not np.isfinite(values).all() or steps.size < 2 or (steps >= 0.0).mean() < _IN_ORDER:
        return None
    try:
        return unit_of_stamps("", values, IMU_INTERVALS_S)
    except LogError:
        return None


def _counts(values: FloatArray) -> bool:
    """Whether a column counts the rows."""
    return bool((np.diff(values) == 1.0).all())


def _length(triple: FloatArray) -> FloatArray:
    with np.errstate(over="ignore"):  # a damaged file may have numbers such as 1e300
        length: FloatArray = np.linalg.norm(triple, axis=0)
    return length[np.isfinite(length)]


def _is_accel(triple: FloatArray) -> bool:
    length = _length(triple)
    if not length.size:
        return False
    middle = float(np.median(length))
    steady = float(np.median(np.abs(length - middle))) < _STEADY * middle
    return steady and any(low <= middle <= high for low, high in _GRAVITY)


def _is_gyro(triple: FloatArray) -> bool:
    length = _length(triple)
    if not length.size:
        return False
    low, high = np.quantile(length, (0.1, 0.9))
    return bool(high > _LIVELY * low)


def _lines(content: bytes, numbers: CsvNumbers) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the bytes up to the end of each line, and which lines (from 0) are the rows."""
    ends = np.flatnonzero(np.frombuffer(content, dtype=np.uint8) == ord("\n")) + 1
    if not ends.size or ends[-1] < len(content):
        ends = np.append(ends, len(content))
    blank = 2 if content[: int(ends[0])].endswith(b"\r\n") else 1
    there = np.flatnonzero(np.diff(ends, prepend=0) > blank)
    rows = there[there >= numbers.first_line - 1]
    return ends, rows[: next(iter(numbers.columns.values())).size]


READER: Final = Reader(name="plain-csv", title="CSV of numbers", sniff=sniff, read=read)
