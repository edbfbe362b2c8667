"""Canonical columns into pieces: the checks that every tabular format shares, with file and row in each error."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import (
    ACCEL_COLUMNS,
    CANONICAL_UNITS,
    GYRO_COLUMNS,
    POSITION_COLUMNS,
    POSITION_STD_COLUMN,
    TIME_COLUMN,
    UNIT_FACTORS,
    VELOCITY_COLUMNS,
    VELOCITY_STD_COLUMN,
    WHEEL_SPEED_COLUMN,
    FloatArray,
)
from levelhead.errors import LogError
from levelhead.logs.pieces import Fact, GnssData, ImuData, Pieces, none_if_absent
from levelhead.logs.readers.base import MAX_TEXT_SHOWN, Role, Table, shown, shown_names
from levelhead.logs.timescales import GPST, UTC

BoolArray = NDArray[np.bool_]

IMU_COLUMNS: Final = (*GYRO_COLUMNS, *ACCEL_COLUMNS)
GNSS_COLUMNS: Final = (*VELOCITY_COLUMNS, *POSITION_COLUMNS)
SINCE_1970: Final = (UTC, GPST)
"""Units of a time column that is seconds since 1970 in that time scale."""

_NAME_AND_UNIT = re.compile(r"\s*([^\[\]]*?)\s*(?:\[([^\]]*)\])?\s*")
MAX_NAMES_COMPARED: Final = 200
"""Column names among which that which was meant is looked for."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """Where a canonical column is found in a file, the factor to its canonical unit, and whether the file says so.

    ``time_scale`` is what a time column counts in, where its unit says that: ``time[UTC]``, ``time[GPST]``.
    """

    index: int
    factor: float
    declared: bool = True
    time_scale: str | None = None


def split_unit(text: str) -> tuple[str, str | None]:
    """Split a header cell: ``gyro_x[deg/s]`` gives ``gyro_x`` and ``deg/s``."""
    match = _NAME_AND_UNIT.fullmatch(text)
    if match is None:
        return text.strip(), None
    unit = match.group(2)
    return match.group(1), None if unit is None else unit.strip()


def unit_factor(column: str, unit: str, *, where: str) -> float:
    """Return the factor from `unit` to the canonical unit of `column`; `where` begins the error's sentence."""
    factors = UNIT_FACTORS[CANONICAL_UNITS[column]]
    if unit not in factors:
        raise LogError(f"{where}: the unit {shown(unit)} of {column} is not known; use one of {', '.join(factors)}.")
    return factors[unit]


def find_columns(name: str, headers: Sequence[str], units: Sequence[str | None], *, role: Role) -> dict[str, Column]:
    """Return the canonical columns among `headers`; all other columns are left alone.

    Parameters
    ----------
    name : str
        The file's name, for errors.
    headers : sequence of str
        Column names, each with its unit in brackets or without.
    units : sequence of str or None
        Units that are declared elsewhere (Parquet metadata); a unit in the name wins.
    role : {"imu", "gnss"}
        With ``gnss``, the IMU columns (wheel speed is one of them) are not asked for and not read.

    Raises
    ------
    LogError
        On columns that are missing, given twice or of no use without others, and on unknown units.
    """
    found: dict[str, Column] = {}
    skipped: set[str] = set()
    for index, (header, unit_elsewhere) in enumerate(zip(headers, units, strict=True)):
        column, unit = split_unit(header)
        unit = unit_elsewhere if unit is None else unit
        if column not in CANONICAL_UNITS:
            continue
        if column in found:
            raise LogError(f"{name}: the column {column} appears twice in the header; rename or remove one of them.")
        if role == "gnss" and column in (*IMU_COLUMNS, WHEEL_SPEED_COLUMN):
            skipped.add(column)
            continue
        scale = unit if column == TIME_COLUMN and unit in SINCE_1970 else None
        factor = 1.0 if unit is None or scale is not None else unit_factor(column, unit, where=name)
        found[column] = Column(index=index, factor=factor, declared=unit is not None, time_scale=scale)
    _require(name, headers, found, (TIME_COLUMN,))
    _refuse_alone(name, found.keys() | skipped)
    if any(c in found for c in IMU_COLUMNS) or not any(c in found for c in GNSS_COLUMNS):
        _require(name, headers, found, IMU_COLUMNS if role == "imu" else VELOCITY_COLUMNS)
    for group in (VELOCITY_COLUMNS, POSITION_COLUMNS):
        if any(c in found for c in group):
            _require(name, headers, found, group)
    return found


def assumed_facts(columns: Mapping[str, Column], *, frames_declared: bool = False) -> tuple[Fact, ...]:
    """Return what the canonical log's rules say of a file, and the file itself does not."""
    facts: list[Fact] = []
    units: tuple[tuple[Fact, tuple[str, ...]], ...] = (("gyro_unit", GYRO_COLUMNS), ("accel_unit", ACCEL_COLUMNS))
    facts += [fact for fact, names in units if any(c in columns and not columns[c].declared for c in names)]
    if not frames_declared:
        frames: tuple[tuple[Fact, str], ...] = (("axes", GYRO_COLUMNS[0]), ("velocity_frame", VELOCITY_COLUMNS[0]))
        facts += [fact for fact, name in frames if name in columns]
    return tuple(facts)


def _refuse_alone(name: str, columns: Set[str]) -> None:
    """Refuse columns that say nothing without those that they belong to."""
    for column, partner, remedy in (
        (WHEEL_SPEED_COLUMN, IMU_COLUMNS[0], "a wheel speed belongs to an IMU sample: put it into the IMU file"),
        (POSITION_COLUMNS[2], POSITION_COLUMNS[0], "a height alone is no position: add lat and lon, or rename it"),
        (POSITION_STD_COLUMN, POSITION_COLUMNS[0], "add the positions that it is the deviation of, or rename it"),
    ):
        if column in columns and partner not in columns:
            raise LogError(f"{name}: the column {column} stands without {partner}; {remedy}.")


def _require(name: str, headers: Sequence[str], found: dict[str, Column], wanted: Sequence[str]) -> None:
    missing = [c for c in wanted if c not in found]
    if not missing:
        return
    have = [split_unit(h)[0] for h in headers]
    near = [h for h in have[:MAX_NAMES_COMPARED] if h not in found and len(h) <= MAX_TEXT_SHOWN]
    close = difflib.get_close_matches(missing[0], near, n=1)
    hint = f" Is {close[0]} meant as {missing[0]}?" if close else ""
    raise LogError(
        f"{name}: the column{'s' if len(missing) > 1 else ''} {', '.join(missing)} "
        f"{'are' if len(missing) > 1 else 'is'} missing (found: {shown_names(have)}).{hint} "
        "Name the columns canonically or describe them in a mapping file (mapping=)."
    )


def pieces_from_table(table: Table) -> Pieces:
    """Return the IMU and GNSS data in a table of canonical columns.

    A row is an IMU sample, a GNSS epoch, or both; what it is not, is empty.

    Raises
    ------
    LogError
        On empty or half-empty rows, infinite numbers, places that are not on the globe, deviations that are none, and
        time stamps that are absent.
    """
    time = table.columns[TIME_COLUMN]
    if time.size == 0:
        raise LogError(f"{table.name}: the file has a header but no rows; record data or check the export.")
    for column, values in table.columns.items():
        _refuse(table, np.isinf(values), f"{column} is infinite", "remove that row")
    _refuse(table, np.isnan(time), "the time stamp is absent", "every row needs one")
    imu_rows = _present(table, IMU_COLUMNS)
    _check_wheel_speed(table, imu_rows)
    _check_positions(table)
    gnss_rows = _present(table, VELOCITY_COLUMNS) | _present(table, POSITION_COLUMNS)
    if IMU_COLUMNS[0] in table.columns:
        _refuse(table, ~imu_rows & ~gnss_rows, "the row has neither IMU readings nor a GNSS fix", "remove that row")
        if not imu_rows.any():
            raise LogError(f"{table.name}: every row of the IMU columns is empty; export the IMU readings too.")
    if not gnss_rows.any() and any(c in table.columns for c in GNSS_COLUMNS):
        raise LogError(f"{table.name}: the GNSS columns are empty on every row; a log needs GNSS fixes.")
    imu = None
    if imu_rows.any():
        gyro, accel = _stacked(table, GYRO_COLUMNS, imu_rows), _stacked(table, ACCEL_COLUMNS, imu_rows)
        wheel_speed = _column(table, WHEEL_SPEED_COLUMN, imu_rows)
        imu = ImuData(time=time[imu_rows], gyro=gyro, accel=accel, wheel_speed=wheel_speed, time_scale=table.time_scale)
    gnss = _gnss(table, gnss_rows) if gnss_rows.any() else None
    return Pieces(imu=imu, gnss=gnss, left_out=table.left_out)


def _present(table: Table, names: Sequence[str]) -> BoolArray:
    """Return which rows have the columns `names`; half a row is an error."""
    size = table.columns[TIME_COLUMN].size
    if names[0] not in table.columns:
        return np.zeros(size, dtype=np.bool_)
    present = np.array([~np.isnan(table.columns[c]) for c in names])
    rows: BoolArray = np.logical_and.reduce(present, axis=0)
    half = np.flatnonzero(present.any(axis=0) & ~rows)
    if half.size:
        k = int(half[0])
        empty = ", ".join(c for c, here in zip(names, present[:, k], strict=True) if not here)
        raise LogError(
            f"{table.name}, {table.where(k)}: {empty} is empty where the other readings of the row are present "
            f"({half.size} such rows in all); fill in the row or remove it."
        )
    return rows


def _stacked(table: Table, names: Sequence[str], rows: BoolArray) -> FloatArray:
    """Return some rows of the columns `names` side by side, NaN where the file has no such columns."""
    if names[0] not in table.columns:
        return np.full((int(rows.sum()), len(names)), np.nan)
    return np.column_stack([table.columns[c][rows] for c in names])


def _column(table: Table, name: str, rows: BoolArray) -> FloatArray | None:
    """Return some rows of a column that a file may lack or leave empty."""
    return none_if_absent(table.columns[name][rows]) if name in table.columns else None


def _check_wheel_speed(table: Table, imu_rows: BoolArray) -> None:
    if WHEEL_SPEED_COLUMN not in table.columns:
        return
    alone = ~np.isnan(table.columns[WHEEL_SPEED_COLUMN]) & ~imu_rows
    remedy = "give each wheel speed on the row of the IMU sample nearest to it"
    _refuse(table, alone, f"{WHEEL_SPEED_COLUMN} stands on a row without IMU readings", remedy)


def _check_positions(table: Table) -> None:
    """Refuse places beyond the globe, heights without a place, and deviations without one or of no size."""
    if POSITION_COLUMNS[0] not in table.columns:
        return
    lat, lon, height = (table.columns[c] for c in POSITION_COLUMNS)
    for name, values, limit in (("lat", lat, 90.0), ("lon", lon, 360.0)):
        what = f"{name} is beyond {limit:g} degrees"
        _refuse(table, np.abs(values) > limit, what, "give degrees as decimal numbers, not ddmm.mmmm")
    alone = ~np.isnan(height) & np.isnan(lat) & np.isnan(lon)
    _refuse(table, alone, "the height has no lat and lon beside it", "fill them in, or leave the height empty too")
    if POSITION_STD_COLUMN in table.columns:
        std = table.columns[POSITION_STD_COLUMN]
        _refuse(table, std <= 0.0, f"{POSITION_STD_COLUMN} is not positive", "leave it empty where it is not known")
        if np.isfinite(std).any() and not np.isfinite(lat).any():
            raise LogError(
                f"{table.name}: {POSITION_STD_COLUMN} has values, but lat, lon and height are empty on every row; fill "
                "in the positions, or leave it out."
            )


def _gnss(table: Table, rows: BoolArray) -> GnssData:
    position = _stacked(table, POSITION_COLUMNS, rows)
    position_rad = np.column_stack((np.radians(position[:, :2]), position[:, 2]))
    return GnssData(
        time=table.columns[TIME_COLUMN][rows],
        velocity_ned=none_if_absent(_stacked(table, VELOCITY_COLUMNS, rows)),
        velocity_std=_column(table, VELOCITY_STD_COLUMN, rows),
        position_llh=none_if_absent(position_rad),
        position_std=_column(table, POSITION_STD_COLUMN, rows),
        time_scale=table.time_scale,
    )


def _refuse(table: Table, bad: BoolArray, what: str, remedy: str) -> None:
    rows = np.flatnonzero(bad)
    if rows.size:
        raise LogError(f"{table.name}, {table.where(int(rows[0]))}: {what} ({rows.size} such rows in all); {remedy}.")
