"""CSV whose header names the columns in other words than ours: what it does not say is left to be found in the data."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import (
    ACCEL_COLUMNS,
    CANONICAL_UNITS,
    GYRO_COLUMNS,
    POSITION_COLUMNS,
    TIME_COLUMN,
    VELOCITY_COLUMNS,
    VELOCITY_STD_COLUMN,
    WHEEL_SPEED_COLUMN,
    FloatArray,
)
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import ELLIPSOIDAL, MEAN_SEA_LEVEL, declared
from levelhead.logs.mapping import UP_COLUMN
from levelhead.logs.pieces import Fact, GnssData, Pieces
from levelhead.logs.readers.base import Reader, Source, Table, shown_names
from levelhead.logs.readers.columns import (
    IMU_COLUMNS,
    pieces_from_table,
    split_unit,
)
from levelhead.logs.readers.csv_table import CsvLayout, find_layout, guess_layout, is_text, read_numbers
from levelhead.logs.readers.foreign_names import (
    COURSE,
    FIX,
    FIX_TYPE,
    NANOSECONDS,
    NAVSAT_STATUS,
    POSITION_STD_H,
    POSITION_STD_V,
    SPEED,
    SPEED_STD,
    VELOCITY_XYZ,
    NamedColumns,
    factor_of,
    understand,
)
from levelhead.logs.readers.receivers import dropped, known_std, unmeasured_vertical_std, velocity_of
from levelhead.logs.readers.stamps import GNSS_INTERVALS_S, IMU_INTERVALS_S, are_unix, unit_of_stamps
from levelhead.logs.timescales import GPST, UTC

BoolArray = NDArray[np.bool_]

_NORTH_EAST: Final = VELOCITY_COLUMNS[:2]
_GNSS_KINDS: Final = (
    (*_NORTH_EAST, VELOCITY_COLUMNS[2]),
    (*_NORTH_EAST, UP_COLUMN),
    _NORTH_EAST,
    (SPEED, COURSE),
    VELOCITY_XYZ,
)
"""The ways in which a velocity can be given, the best first."""
_LOWEST_FIX: Final = {FIX: 1.0, FIX_TYPE: 2.0, NAVSAT_STATUS: 0.0}
"""Columns that tell a fix from none, and the lowest value of a fix: GGA's quality, u-blox's type, ROS's status."""
_WEIGHTLESS: Final = 0.5
"""Median length of the acceleration below which gravity cannot be in it, whether it is in g or in m/s^2."""
_SECOND_NS: Final = 1e9
_BY_MAPPING: Final = "say what the columns mean in a mapping file (mapping=)"
_FEW_IMU_COLUMNS: Final = 3
"""IMU columns from which on a header is one of an IMU, though something is missing."""
_VERTICAL_STD: Final = "vertical_std"
"""A column that the reader makes: the sigma of a vertical velocity that was not measured, m/s."""


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the header names an IMU or GNSS data, and not in the words of the canonical CSV."""
    if not is_text(head):
        return False
    try:
        layout = guess_layout(head, name="")
        if not layout.header:
            return False
        found = understand("", layout.names, layout.units)
    except LogError:
        return False
    if _is_canonical(layout, found) and find_layout(head, name="").names == layout.names:
        return False
    if found.has((TIME_COLUMN, *IMU_COLUMNS)) or _has_gnss(found):
        return True
    canonical = {split_unit(n)[0] for n in layout.names} & set(CANONICAL_UNITS)
    return sum(c in found.chosen for c in IMU_COLUMNS) >= _FEW_IMU_COLUMNS and len(canonical) <= 1


def read(source: Source) -> Pieces:
    """Read the columns that are understood by their names.

    Raises
    ------
    LogError
        On columns that are missing or ambiguous, on a time unit that cannot be told, and naming file, line and column
        of what is wrong.
    """
    path = source.path
    content = path.read_bytes()
    layout = guess_layout(content, name=path.name)
    found = understand(path.name, layout.names, layout.units)
    wanted = _wanted(path.name, layout, found, source)
    indices = {c: found.chosen[c].index for c in wanted}
    numbers = read_numbers(path, content, layout, indices, time_column=TIME_COLUMN, doubt_end=True)
    columns = {c: values * _factor(found, c) for c, values in numbers.columns.items()}
    if numbers.columns[TIME_COLUMN].size == 0:
        raise LogError(f"{path.name}: the file has a header but no rows; record data or check the export.")
    columns[TIME_COLUMN] = _seconds(path.name, layout, found, columns)
    undeclared = _undeclared(found, columns)
    _refuse_weightless(path.name, columns)

    events: list[Event] = []
    rows = _useful_rows(columns, events)
    columns = {c: values[rows] for c, values in columns.items()}
    kept = np.flatnonzero(rows)
    table = Table(
        name=path.name,
        columns={c: v for c, v in columns.items() if c in CANONICAL_UNITS},
        where=lambda row: numbers.where(int(kept[row])),
        left_out=numbers.left_out,
    )
    pieces = pieces_from_table(table)
    scale = _time_scale(layout, found) if are_unix(columns[TIME_COLUMN]) else None
    gnss = None if pieces.gnss is None else replace(_with_deviations(pieces.gnss, columns), time_scale=scale)
    imu = None if pieces.imu is None else replace(pieces.imu, time_scale=scale)
    if (imu is None or gnss is None) and scale is None:
        undeclared = (*undeclared, "clock")
    return replace(
        pieces,
        imu=imu,
        gnss=gnss,
        events=tuple(events),
        undeclared=undeclared,
        meta=_height(path.name, layout, found) if gnss is not None else {},
    )


def _is_canonical(layout: CsvLayout, found: NamedColumns) -> bool:
    """Whether the header speaks the words of the canonical CSV, which declare units and axes by contract.

    Most of its IMU columns and most of its GNSS columns must do so: what is wrong then is a mistake in a canonical
    file.
    """
    titles = {split_unit(n)[0] for n in layout.names}
    gnss = (*VELOCITY_COLUMNS, UP_COLUMN, *VELOCITY_XYZ, SPEED, COURSE, *POSITION_COLUMNS)
    groups = [[c for c in group if c in found.chosen] for group in (IMU_COLUMNS, gnss)]
    return TIME_COLUMN in titles and all(sum(c in titles for c in group) >= len(group) / 2 for group in groups)


def _velocity(found: NamedColumns) -> tuple[str, ...]:
    """Return the columns of the best way in which the header gives a velocity; none where it gives none."""
    return next((kind for kind in _GNSS_KINDS if found.has(kind)), ())


def _has_gnss(found: NamedColumns) -> bool:
    return found.has((TIME_COLUMN,)) and (bool(_velocity(found)) or found.has(POSITION_COLUMNS))


def _wanted(name: str, layout: CsvLayout, found: NamedColumns, source: Source) -> tuple[str, ...]:
    """Return the meanings that are read; refuse those that two columns could have."""
    imu = IMU_COLUMNS if source.role == "imu" and found.has(IMU_COLUMNS) else ()
    gnss: tuple[str, ...] = _velocity(found)
    if found.has(POSITION_COLUMNS):
        gnss = (*gnss, *POSITION_COLUMNS)
    if not found.has((TIME_COLUMN,)) or not (imu or gnss):
        needed = (TIME_COLUMN, *IMU_COLUMNS) if source.role == "imu" else (TIME_COLUMN, *VELOCITY_COLUMNS)
        missing = [c for c in needed if c not in found.chosen]
        shown = shown_names(layout.names)
        raise LogError(f"{name}: no column is understood as {', '.join(missing)} (found: {shown}); {_BY_MAPPING}.")
    aside: tuple[str, ...] = (WHEEL_SPEED_COLUMN,) if imu else ()
    if gnss:
        aside = (*aside, VELOCITY_STD_COLUMN, SPEED_STD, POSITION_STD_H, POSITION_STD_V, *_LOWEST_FIX)
    if NANOSECONDS in found.chosen:
        aside = (*aside, NANOSECONDS)
    wanted = (TIME_COLUMN, *imu, *gnss, *(c for c in aside if c in found.chosen and c not in found.rivals))
    for column in wanted:
        if column in found.rivals:
            raise LogError(
                f"{name}: {' and '.join(map(repr, found.rivals[column]))} can each be {column}; say which one is in a "
                "mapping file (mapping=)."
            )
    return wanted


def _seconds(name: str, layout: CsvLayout, found: NamedColumns, columns: Mapping[str, FloatArray]) -> FloatArray:
    """Return the stamps in seconds, by the unit that the header declares or the one that the rows tell."""
    named, stamps = found.chosen[TIME_COLUMN], columns[TIME_COLUMN]
    if NANOSECONDS in columns:
        part = columns[NANOSECONDS]
        if not (np.isnan(part) | ((part >= 0.0) & (part < _SECOND_NS))).all() or (stamps != np.floor(stamps)).any():
            titles = " and ".join(repr(layout.names[found.chosen[c].index]) for c in (TIME_COLUMN, NANOSECONDS))
            raise LogError(f"{name}: {titles} are no whole seconds and nanoseconds; {_BY_MAPPING}.")
        return stamps + part / _SECOND_NS
    if named.unit is not None:
        return stamps
    is_imu = IMU_COLUMNS[0] in columns
    rows = np.isfinite(columns[IMU_COLUMNS[0]]) if is_imu else np.ones(stamps.size, dtype=np.bool_)
    where = f"{name}, column {layout.names[named.index]}"
    unit = unit_of_stamps(where, stamps[rows], IMU_INTERVALS_S if is_imu else GNSS_INTERVALS_S)
    return stamps * factor_of(replace(named, unit=unit))


def _factor(found: NamedColumns, column: str) -> float:
    return 1.0 if column == NANOSECONDS else factor_of(found.chosen[column])


def _undeclared(found: NamedColumns, columns: Mapping[str, FloatArray]) -> tuple[Fact, ...]:
    facts: list[Fact] = []
    if IMU_COLUMNS[0] in columns:
        if any(found.chosen[c].unit is None for c in GYRO_COLUMNS):
            facts.append("gyro_unit")
        if any(found.chosen[c].unit is None for c in ACCEL_COLUMNS):
            facts.append("accel_unit")
        facts.append("axes")
    if VELOCITY_XYZ[0] in columns:
        facts.append("velocity_frame")
    return tuple(facts)


def _refuse_weightless(name: str, columns: Mapping[str, FloatArray]) -> None:
    """Refuse accelerations that had gravity taken off: nothing can be levelled with them."""
    if ACCEL_COLUMNS[0] not in columns:
        return
    with np.errstate(over="ignore"):  # a damaged file may have numbers such as 1e300
        length = np.linalg.norm([columns[c] for c in ACCEL_COLUMNS], axis=0)
    length = length[np.isfinite(length)]
    if length.size and np.median(length) < _WEIGHTLESS:
        raise LogError(
            f"{name}: the acceleration has a median length of {np.median(length):.2g}, so gravity was taken off it; "
            "export what the accelerometer reads, gravity included."
        )


def _useful_rows(columns: dict[str, FloatArray], events: list[Event]) -> BoolArray:
    """Complete the velocity, blank what is no fix, and return the rows that hold anything; count what goes."""
    unused = np.zeros(columns[TIME_COLUMN].size, dtype=np.bool_)
    _complete_velocity(columns, events)
    gnss = [c for c in (*VELOCITY_COLUMNS, *POSITION_COLUMNS) if c in columns]
    if gnss:
        there = _any_number(columns, gnss)
        none = there & _without_fix(columns)
        stale = there & ~none & _repeated(columns, gnss, there)
        for bad, why in ((none, "GNSS rows without a fix"), (stale, "GNSS values repeated from row to row")):
            events += dropped(int(bad.sum()), why)
        unused = none | stale
        for column in gnss:
            columns[column] = np.where(unused, np.nan, columns[column])
    used = [c for c in (*IMU_COLUMNS, *gnss) if c in columns]
    rows = _any_number(columns, used)
    empty = int((~rows & ~unused).sum())
    if IMU_COLUMNS[0] in columns:
        events += dropped(empty, "rows without any of the columns")
    return rows


def _any_number(columns: Mapping[str, FloatArray], names: Sequence[str]) -> BoolArray:
    rows = np.zeros(columns[TIME_COLUMN].size, dtype=np.bool_)
    for name in names:
        rows |= np.isfinite(columns[name])
    return rows


def _complete_velocity(columns: dict[str, FloatArray], events: list[Event]) -> None:
    """Put north, east and down in the place of what the file has instead."""
    if UP_COLUMN in columns:
        columns[VELOCITY_COLUMNS[2]] = -columns.pop(UP_COLUMN)
    if VELOCITY_XYZ[0] in columns:
        for column, canonical in zip(VELOCITY_XYZ, VELOCITY_COLUMNS, strict=True):
            columns[canonical] = columns.pop(column)
    if SPEED in columns:
        speed, course = columns.pop(SPEED), np.radians(columns.pop(COURSE))
        # At rest receivers leave the course empty.
        course = np.where(np.isnan(course) & (speed == 0.0), 0.0, course)
        # A negative speed is that of a receiver that does not know it.
        known = (speed >= 0.0) & np.isfinite(course)
        velocity = velocity_of(speed, np.where(known, course, 0.0))
        for column, values in zip(_NORTH_EAST, velocity.T, strict=False):
            columns[column] = np.where(known, values, np.nan)
    if _NORTH_EAST[0] in columns and VELOCITY_COLUMNS[2] not in columns:
        north, east = (columns[c] for c in _NORTH_EAST)
        with np.errstate(over="ignore"):
            speed = np.hypot(north, east)
        columns[VELOCITY_COLUMNS[2]] = np.where(np.isfinite(speed), 0.0, np.nan)
        columns[_VERTICAL_STD] = unmeasured_vertical_std(speed)
        events.append(Event(code="I_VELOCITY_2D", count=int(np.isfinite(speed).sum())))


def _without_fix(columns: Mapping[str, FloatArray]) -> BoolArray:
    """Return the rows whose receiver says that it has no fix, or that are at 0 North, 0 East."""
    bad = np.zeros(columns[TIME_COLUMN].size, dtype=np.bool_)
    for column, lowest in _LOWEST_FIX.items():
        if column in columns:
            bad |= columns[column] < lowest
    if POSITION_COLUMNS[0] in columns:
        bad |= (columns[POSITION_COLUMNS[0]] == 0.0) & (columns[POSITION_COLUMNS[1]] == 0.0)
    return bad


def _repeated(columns: Mapping[str, FloatArray], gnss: Sequence[str], there: BoolArray) -> BoolArray:
    """Return the rows that only repeat the fix above, where a table writes the last fix into each row of the IMU."""
    values = np.array([columns[c] for c in gnss])
    same = np.zeros(there.size, dtype=np.bool_)
    same[1:] = ((values[:, 1:] == values[:, :-1]) | np.isnan(values[:, 1:])).all(axis=0) & there[:-1]
    held = IMU_COLUMNS[0] in columns and (same & there).sum() > 0.5 * there.sum() > 0
    return same if held else np.zeros_like(same)


def _with_deviations(gnss: GnssData, columns: Mapping[str, FloatArray]) -> GnssData:
    """Return the epochs with the sigmas that the file has; one that is not positive is not known."""
    used = [c for c in (*VELOCITY_COLUMNS, *POSITION_COLUMNS) if c in columns]
    rows = _any_number(columns, used)
    known = {
        c: known_std(columns[c][rows])
        for c in (SPEED_STD, VELOCITY_STD_COLUMN, POSITION_STD_H, POSITION_STD_V, _VERTICAL_STD)
        if c in columns
    }
    horizontal = known.get(VELOCITY_STD_COLUMN, known.get(SPEED_STD))
    blank = np.full(gnss.time.size, np.nan)
    velocity: FloatArray | None = horizontal
    if _VERTICAL_STD in known:
        flat = blank if horizontal is None else horizontal
        velocity = np.column_stack((flat, flat, known[_VERTICAL_STD]))
    position = known.get(POSITION_STD_H)
    if position is not None:
        position = np.column_stack((position, position, known.get(POSITION_STD_V, blank)))
    return replace(
        gnss,
        velocity_std=velocity if gnss.velocity_ned is not None else None,
        position_std=position if gnss.position_llh is not None else None,
    )


def _time_scale(layout: CsvLayout, found: NamedColumns) -> str | None:
    """Return the time scale of Unix stamps where the column's name tells it."""
    title = layout.names[found.chosen[TIME_COLUMN].index].lower()
    # A "gpsTime" or a "gps_timestamp" may be either.
    return GPST if re.search(r"gpst(?!ime|amp)", title) else UTC if "utc" in title else None


def _height(name: str, layout: CsvLayout, found: NamedColumns) -> dict[str, object]:
    """Return what the name of the height says that it counts from, for `Log.meta`."""
    if POSITION_COLUMNS[2] not in found.chosen:
        return {}
    title = layout.names[found.chosen[POSITION_COLUMNS[2]].index].lower()
    if "msl" in title or "sealevel" in title.replace("_", ""):
        return declared(name, datum=None, height=MEAN_SEA_LEVEL)
    if "ellips" in title or title.endswith("hae"):
        return declared(name, datum=None, height=ELLIPSOIDAL)
    return {}


READER: Final = Reader(name="named-csv", title="CSV by its header", sniff=sniff, read=read)
