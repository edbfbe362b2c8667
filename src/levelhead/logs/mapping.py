"""The mapping file: a TOML text that says which columns of a foreign CSV or MATLAB file mean what.

::

    [imu]                 # wheel_speed is one more column that it may have
    header = false        # the columns are numbered from 1; true (the default): they are named by the first line
    delimiter = ","       # the default
    columns = { time = 7, accel_x = 1, accel_y = 2, accel_z = 3, gyro_x = 4, gyro_y = 5, gyro_z = 6 }
    units = { time = "ms", accel = "g", gyro = "deg/s" }   # else s, m/s^2, rad/s
    axes = ["-x", "y", "-z"]      # forward, right, down as axes of the file
    mounting_deg = { yaw = 5.35, pitch = 0.0, roll = 0.0 }
    time_zero = "2025-07-08T19:30:00.090"  # when the file's clock reads zero, in the time scale of the GNSS file
    time_offset_s = -0.125        # added to the stamps

    [gnss]                # only for a GNSS CSV; vel_n, vel_e, vel_d (or vel_u) and/or lat, lon, height
    columns = { time = "stamp", lat = "latitude", lon = "longitude", height = "altitude" }
    units = { time = "s" }
    time_offset_s = -0.5
    datum = "ETRS89"      # within a metre of WGS84, the default
    height = "mean sea level"     # or "ellipsoidal"

Positions may be given as ``ecef_x``, ``ecef_y``, ``ecef_z`` (m), velocities as ``vel_ecef_x``, ``vel_ecef_y``,
``vel_ecef_z`` (m/s), Earth-centred and Earth-fixed: they are turned into latitude, longitude, height and north, east,
down.

In a MATLAB file (``.mat``) the columns are names of variables, of fields of a struct (``"log.gyro"``), and columns of
either (``"log.gyro(:,3)"``). ``variable = "IMU"`` names a matrix whose columns are then numbers from 1 on, or a struct
whose fields the columns then are.

Mounting is the attitude of the IMU (its axes already forward, right, down) relative to the vehicle, as yaw, pitch,
roll (3-2-1): ``v_vehicle = Rz(yaw) Ry(pitch) Rx(roll) v_imu``. An IMU whose x axis points to the right of the
vehicle's has a positive yaw. The readings are turned into the vehicle's axes.
"""

from __future__ import annotations

import datetime
import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

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
from levelhead.errors import UsageError
from levelhead.logs.datum import DATUM_KEY, HEIGHT_KEY, declared

MAX_BYTES: Final = 1 << 20
UP_COLUMN: Final = "vel_u"
"""A velocity column of mappings only: up, the negative of vel_d."""
ECEF_COLUMNS: Final = ("ecef_x", "ecef_y", "ecef_z")
"""Positions of mappings only: Earth-centred, Earth-fixed, m."""
ECEF_VELOCITY_COLUMNS: Final = ("vel_ecef_x", "vel_ecef_y", "vel_ecef_z")
"""Velocities along the same axes, m/s."""
_UNITS: Final = {
    **CANONICAL_UNITS,
    **dict.fromkeys((UP_COLUMN, *ECEF_VELOCITY_COLUMNS), "m/s"),
    **dict.fromkeys(ECEF_COLUMNS, "m"),
}
VARIABLE: Final = re.compile(r"[A-Za-z]\w*(?:\.[A-Za-z]\w*)*", re.ASCII)
"""A MATLAB variable, or a field of a struct."""

_CSV_KEYS: Final = ("header", "delimiter")
_TABLE_KEYS: Final = (*_CSV_KEYS, "variable", "columns", "units", "time_offset_s")
_IMU_KEYS: Final = (*_TABLE_KEYS, "axes", "mounting_deg", "time_zero")
_GNSS_KEYS: Final = (*_TABLE_KEYS, DATUM_KEY, HEIGHT_KEY)
_IMU_COLUMNS: Final = (TIME_COLUMN, *GYRO_COLUMNS, *ACCEL_COLUMNS)
_GNSS_COLUMNS: Final = (
    TIME_COLUMN,
    *VELOCITY_COLUMNS,
    UP_COLUMN,
    *ECEF_VELOCITY_COLUMNS,
    VELOCITY_STD_COLUMN,
    *POSITION_COLUMNS,
    *ECEF_COLUMNS,
    POSITION_STD_COLUMN,
)
_GROUPS: Final = ("gyro", "accel", "vel", "ecef")
"""Unit keys that stand for all columns which begin with them."""


@dataclass(frozen=True, kw_only=True)
class TableMapping:
    """Which columns of a CSV or of a MATLAB file mean what.

    Attributes
    ----------
    variable : str or None
        The variable of a MATLAB file that the columns are part of; None for a CSV, and for variables of their own.
    columns : mapping
        Canonical name to the file's column: a name, or a number from 1 where the file has no header.
    factors : mapping
        Canonical name to the factor that turns the file's unit into the canonical one.
    time_offset_s : float
        Added to the stamps, s.
    """

    header: bool
    delimiter: str
    variable: str | None
    columns: Mapping[str, str | int]
    factors: Mapping[str, float]
    time_offset_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ImuMapping:
    """The section ``[imu]``.

    Attributes
    ----------
    dcm_file_to_body : ndarray, shape (3, 3)
        Rotation from the file's axes to the vehicle's forward, right, down: axes and mounting together.
    time_zero_s : float or None
        Seconds from 1970 to the instant at which the file's clock reads zero, in the GNSS file's time scale.
    """

    table: TableMapping
    dcm_file_to_body: FloatArray
    time_zero_s: float | None


@dataclass(frozen=True, kw_only=True)
class GnssMapping:
    """The section ``[gnss]``; `meta` has the datum and the height reference that it declares."""

    table: TableMapping
    meta: Mapping[str, object]


@dataclass(frozen=True, kw_only=True)
class LogMapping:
    """A mapping file: what it says of the IMU file and of the GNSS file."""

    imu: ImuMapping | None
    gnss: GnssMapping | None


def load_mapping(path: str | os.PathLike[str]) -> LogMapping:
    """Read a mapping file.

    Raises
    ------
    UsageError
        When it does not exist, is not TOML, has an unknown key or a value that makes no sense.
    LogError
        When it declares a datum that levelhead does not take.
    """
    file = Path(path)
    try:
        if file.exists() and not file.is_file():
            # Opening a FIFO would wait for its writer for ever.
            raise UsageError(f"The mapping {file} is not a regular file; pass a TOML file.")
        if file.stat().st_size > MAX_BYTES:
            raise UsageError(f"The mapping {file} has {file.stat().st_size} bytes; pass a mapping file, not a log.")
        text = file.read_text(encoding="utf-8")
        document = tomllib.loads(text)
    except OSError as error:
        raise UsageError(f"The mapping {file} cannot be read: {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"The mapping {file.name} is not TOML: {error}.") from error
    except RecursionError as error:
        raise UsageError(
            f"The mapping {file.name} is nested too deeply; see docs/logs.md for what it holds."
        ) from error
    _known_keys(file.name, document, ("imu", "gnss"))
    if not document:
        raise UsageError(f"The mapping {file.name} is empty; it needs a section [imu], [gnss] or both.")
    imu = _section(file.name, document, "imu")
    gnss = _section(file.name, document, "gnss")
    return LogMapping(
        imu=None if imu is None else _imu(f"{file.name}, [imu]", imu),
        gnss=None if gnss is None else _gnss(f"{file.name}, [gnss]", gnss),
    )


def rotation_321(*, roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return ``Rz(yaw) Ry(pitch) Rx(roll)`` (angles in rad): from the rotated axes to the reference axes."""
    (sr, cr), (sp, cp), (sy, cy) = ((np.sin(a), np.cos(a)) for a in (roll, pitch, yaw))
    rx = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    dcm: FloatArray = rz @ ry @ rx
    return dcm


def _imu(where: str, section: Mapping[str, object]) -> ImuMapping:
    _known_keys(where, section, _IMU_KEYS)
    mounting = _numbers(where, "mounting_deg", section.get("mounting_deg", {}), ("yaw", "pitch", "roll"))
    turns = {name: float(np.radians(angle)) for name, angle in mounting.items()}
    mounted = rotation_321(roll=turns.get("roll", 0.0), pitch=turns.get("pitch", 0.0), yaw=turns.get("yaw", 0.0))
    axes = _axes(where, section.get("axes", ["x", "y", "z"]))
    return ImuMapping(
        table=_table(where, section, (*_IMU_COLUMNS, WHEEL_SPEED_COLUMN), required=_IMU_COLUMNS),
        # Without mounting the product would only add rounding and negative zeros.
        dcm_file_to_body=mounted @ axes if any(turns.values()) else axes,
        time_zero_s=_instant(where, section["time_zero"]) if "time_zero" in section else None,
    )


def _gnss(where: str, section: Mapping[str, object]) -> GnssMapping:
    _known_keys(where, section, _GNSS_KEYS)
    table = _table(where, section, _GNSS_COLUMNS, required=(TIME_COLUMN,))
    _check_gnss_columns(where, set(table.columns))
    datum, height = (_text(where, key, section.get(key)) for key in (DATUM_KEY, HEIGHT_KEY))
    return GnssMapping(table=table, meta=declared(where, datum=datum, height=height))


def _check_gnss_columns(where: str, has: set[str]) -> None:
    """Refuse columns that say nothing without others, and two columns for one thing."""
    geodetic, ecef = set(POSITION_COLUMNS), set(ECEF_COLUMNS)
    if VELOCITY_COLUMNS[2] in has and UP_COLUMN in has:
        raise UsageError(f"{where}: columns has both vel_d and vel_u; give one of them.")
    horizontal, vertical = set(VELOCITY_COLUMNS[:2]), {VELOCITY_COLUMNS[2], UP_COLUMN}
    for group, other, names in (
        (ecef, geodetic, "positions as ecef_x, ecef_y, ecef_z and as lat, lon, height"),
        (set(ECEF_VELOCITY_COLUMNS), horizontal | vertical, "velocities as vel_ecef_x, ... and as vel_n, ..."),
    ):
        if has & group and has & other:
            raise UsageError(f"{where}: columns has {names}; give one of them.")
        if has & group and not group <= has:
            raise UsageError(f"{where}: columns has some of {', '.join(sorted(group))}; give all three or none.")
    velocity = horizontal <= has and bool(vertical & has)
    position = geodetic <= has or ecef <= has
    if not (velocity or position) or (has & (horizontal | vertical) and not velocity):
        raise UsageError(
            f"{where}: columns must have vel_n, vel_e and vel_d (or vel_u), or lat, lon and height (or ecef_x, ecef_y, "
            "ecef_z), or all of them; vel_ecef_x, vel_ecef_y and vel_ecef_z need a position."
        )
    if has & geodetic and not position:
        raise UsageError(f"{where}: columns has some of lat, lon and height; give all three or none.")
    if POSITION_STD_COLUMN in has and not position:
        raise UsageError(
            f"{where}: columns has pos_std without lat, lon and height; give the positions or leave it out."
        )


def _table(
    where: str, section: Mapping[str, object], known: tuple[str, ...], *, required: tuple[str, ...]
) -> TableMapping:
    header = section.get("header", True)
    if not isinstance(header, bool):
        raise UsageError(f"{where}: header is {header!r}; write true or false.")
    delimiter = section.get("delimiter", ",")
    if not isinstance(delimiter, str) or len(delimiter) != 1 or not delimiter.isascii():
        raise UsageError(f'{where}: delimiter is {delimiter!r}; write one character such as ";".')
    variable = section.get("variable")
    if variable is not None and (not isinstance(variable, str) or VARIABLE.fullmatch(variable) is None):
        raise UsageError(f'{where}: variable is {variable!r}; write a variable of a MATLAB file, such as "IMU".')
    of_csv = [key for key in _CSV_KEYS if key in section]
    if variable is not None and of_csv:
        raise UsageError(f"{where}: variable is for a MATLAB file, {of_csv[0]} for a CSV; give one of them.")
    columns = _columns(where, section.get("columns"), known, header=header, variable=variable)
    missing = [c for c in required if c not in columns]
    if missing:
        raise UsageError(f"{where}: columns lacks {', '.join(missing)}.")
    offset = _number(where, "time_offset_s", section.get("time_offset_s", 0.0))
    factors = _factors(where, section.get("units", {}), columns)
    return TableMapping(
        header=header,
        delimiter=delimiter,
        variable=variable,
        columns=columns,
        factors=factors,
        time_offset_s=offset,
    )


def _columns(
    where: str, value: object, known: tuple[str, ...], *, header: bool, variable: str | None
) -> dict[str, str | int]:
    if not isinstance(value, dict) or not value:
        raise UsageError(f"{where}: columns is missing; write columns = {{ time = ..., ... }}.")
    _known_keys(f"{where}, columns", value, known)
    columns: dict[str, str | int] = {}
    for column, target in value.items():
        number = isinstance(target, int) and not isinstance(target, bool) and target >= 1
        if variable is not None and not number and not (isinstance(target, str) and target):
            raise UsageError(
                f"{where}: the column {column} is {target!r}; write a number from 1 on, or a field of {variable}."
            )
        if variable is None and header and not (isinstance(target, str) and target):
            raise UsageError(
                f"{where}: the column {column} is {target!r}; write a name of the header line, or header = false."
            )
        if variable is None and not header and not number:
            raise UsageError(f"{where}: the column {column} is {target!r}; without a header write a number from 1 on.")
        columns[column] = target
        if list(columns.values()).count(target) > 1:
            raise UsageError(f"{where}: the column {target!r} of the file is used twice; each has one meaning.")
    return columns


def _factors(where: str, value: object, columns: Mapping[str, str | int]) -> dict[str, float]:
    """Return the factor of each column: the unit of its own name goes before that of its group."""
    if not isinstance(value, dict):
        raise UsageError(f'{where}: units is {value!r}; write units = {{ time = "s", ... }}.')
    keys = [g for g in _GROUPS if any(c.startswith(f"{g}_") for c in columns)]
    _known_keys(f"{where}, units", value, (*columns, *keys))
    factors = {}
    for column in columns:
        canonical = _UNITS[column]
        unit = value.get(column, value.get(column.partition("_")[0], canonical))
        known = UNIT_FACTORS[canonical]
        if not isinstance(unit, str) or unit not in known:
            raise UsageError(f"{where}: the unit {unit!r} of {column} is not known; use one of {', '.join(known)}.")
        factors[column] = known[unit]
    return factors


def _axes(where: str, value: object) -> FloatArray:
    """Return the signed permutation from the file's axes to forward, right, down."""
    matrix = np.zeros((3, 3))
    names = value if isinstance(value, list) else []
    for row, name in enumerate(names[:3]):
        letter = name.lstrip("+-") if isinstance(name, str) else ""
        if letter not in ("x", "y", "z") or len(name) > 2:
            raise UsageError(f'{where}: axes has {name!r}; write x, y or z with an optional sign, such as "-x".')
        matrix[row, "xyz".index(letter)] = -1.0 if name.startswith("-") else 1.0
    if len(names) != 3:
        raise UsageError(f'{where}: axes is {value!r}; write three axes such as ["x", "-y", "-z"].')
    if not (np.abs(matrix).sum(axis=0) == 1.0).all():
        raise UsageError(f"{where}: axes is {value!r}, which uses an axis twice; use each of x, y and z once.")
    if np.linalg.det(matrix) < 0.0:
        raise UsageError(
            f"{where}: axes is {value!r}, a mirror image: no sensor can be turned so. Check the signs against gravity "
            "and a turn."
        )
    return matrix


def _instant(where: str, value: object) -> float:
    """Return seconds from 1970 to an instant without time zone."""
    instant: object = value
    if isinstance(value, str):
        try:
            instant = datetime.datetime.fromisoformat(value)
        except ValueError:
            instant = None
    if not isinstance(instant, datetime.datetime) or instant.tzinfo is not None:
        raise UsageError(
            f"{where}: time_zero is {str(value)!r}; write an instant without time zone, in the time scale of the GNSS "
            'file, such as "2025-07-08T19:30:00.090".'
        )
    return (instant - datetime.datetime(1970, 1, 1)) / datetime.timedelta(seconds=1)


def _section(where: str, document: Mapping[str, object], name: str) -> Mapping[str, object] | None:
    section = document.get(name)
    if section is not None and not isinstance(section, dict):
        raise UsageError(f"The mapping {where} has {name} = {section!r}; write a section [{name}].")
    return section


def _known_keys(where: str, table: Mapping[str, object], known: tuple[str, ...]) -> None:
    unknown = [key for key in table if key not in known]
    if unknown:
        raise UsageError(f"{where}: the key {unknown[0]!r} is not known; the keys are {', '.join(known)}.")


def _text(where: str, key: str, value: object) -> str | None:
    if value is not None and not isinstance(value, str):
        raise UsageError(f"{where}: {key} is {value!r}; write text in quotation marks.")
    return value


def _number(where: str, key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise UsageError(f"{where}: {key} is {value!r}; write a number.")
    return float(value)


def _numbers(where: str, key: str, value: object, known: tuple[str, ...]) -> dict[str, float]:
    if not isinstance(value, dict):
        raise UsageError(f"{where}: {key} is {value!r}; write {key} = {{ {known[0]} = 0.0, ... }}.")
    _known_keys(f"{where}, {key}", value, known)
    return {name: _number(where, f"{key}.{name}", number) for name, number in value.items()}
