"""MATLAB files (``.mat``): through a mapping, or with the matrices ``IMU`` and ``RTK`` of the TUMSAT drives.

These are IMU: t, ax, ay, az, gx, gy, gz, t again by another clock, and wheel speed; RTK: t, quality (1 fix, 2 float),
position and velocity, Earth-centred and Earth-fixed. Stamps are GPS seconds of the week, units SI, axes forward, right,
down. A name and a number of columns declare none of that: units of the accelerometer are checked, and the rest is left
to be found in the data.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import GRAVITY, TIME_COLUMN, FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.events import Event
from levelhead.logs.datum import ELLIPSOIDAL, HEIGHT_KEY
from levelhead.logs.ecef import llh_from_ecef, ned_from_ecef
from levelhead.logs.mapping import VARIABLE, TableMapping
from levelhead.logs.pieces import GnssData, ImuData, Pieces
from levelhead.logs.readers.base import Reader, Source, Table
from levelhead.logs.readers.mapped import mapped_pieces
from levelhead.logs.readers.matlab_file import MAGIC, MatFile, Value, open_mat
from levelhead.logs.readers.receivers import dropped

IMU, IMU_COLUMNS = "IMU", 9
RTK, RTK_COLUMNS = "RTK", 8
QUALITY_SIGMA_M: Final = {1: 0.03, 2: 2.0}
"""One sigma of positions by quality. Over 10 s the positions of the public drive move away from the sum of its
velocities by 0.2 m where they are fixed (most of that from the velocities) and by 3.4 m where they are float."""
GRAVITY_TOLERANCE: Final = 1.0
"""The median specific force of a land vehicle is this close to gravity, m/s^2."""

_COLUMN: Final = re.compile(rf"({VARIABLE.pattern})(?:\(:,\s*(\d{{1,6}})\))?", re.ASCII)
_HOW: Final = (
    'say in a mapping file (mapping=) what they mean: variable = "NAME" and columns = { time = 1, ... }, or columns = '
    '{ time = "NAME", ... }'
)


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether a file has the header of a MAT-file of level 5, or of 7.3, which is refused with a sentence."""
    return head.startswith((MAGIC, b"MATLAB 7.3 MAT-file"))


def read(source: Source) -> Pieces:
    """Read the variables that the mapping names, or those of the known layout.

    Raises
    ------
    LogError
        When a variable is absent, damaged, or not what it should be.
    UsageError
        When the mapping names columns by number without saying of which variable.
    """
    mat = open_mat(source.path)
    # Damaged numbers may be huge; what comes of them is checked.
    with np.errstate(over="ignore", invalid="ignore"):
        if source.imu_mapping is not None or source.gnss_mapping is not None:
            pieces = mapped_pieces(source, lambda mapping: _numbers(mat, mapping))
        else:
            pieces = _known_layout(mat, source)
    return replace(pieces, left_out=pieces.left_out + int(mat.cut), damaged=mat.damaged)


def _numbers(mat: MatFile, mapping: TableMapping) -> Table:
    """Return the mapped columns as they stand in the file."""
    known: dict[str, Value | None] = {}
    columns = {column: _column(mat, known, mapping.variable, target) for column, target in mapping.columns.items()}
    size = columns[TIME_COLUMN].size
    for column, values in columns.items():
        if values.size != size:
            raise LogError(
                f"{mat.name}: {mapping.columns[column]!r} has {values.size} numbers, the time has {size}; check the "
                "mapping."
            )
    return Table(name=mat.name, columns=columns, where=lambda row: f"row {row + 1}")


def _column(mat: MatFile, known: dict[str, Value | None], variable: str | None, target: str | int) -> FloatArray:
    """Return one column: of a matrix by its number, of a variable or field by name, of either by ``name(:,2)``."""
    if isinstance(target, int):
        if variable is None:
            raise UsageError(f'{mat.name} has variables; write variable = "NAME" beside the column numbers.')
        return _of_matrix(mat, variable, _lookup(mat, known, variable), target)
    match = _COLUMN.fullmatch(target)
    if match is None:
        raise UsageError(f"{mat.name}: the column {target!r} is no name of a variable, nor one such as 'gyro(:,2)'.")
    path = match.group(1) if variable is None else f"{variable}.{match.group(1)}"
    value, number = _lookup(mat, known, path), match.group(2)
    if number is not None:
        return _of_matrix(mat, path, value, int(number))
    if value.size != max(value.shape):
        raise LogError(f"{mat.name}: {path} is a {_shape(value)} matrix; name one column of it, such as '{path}(:,1)'.")
    return value.reshape(-1)


def _of_matrix(mat: MatFile, path: str, value: FloatArray, number: int) -> FloatArray:
    if value.ndim != 2 or not 1 <= number <= value.shape[1]:
        raise LogError(f"{mat.name}: {path} is {_shape(value)} and has no column {number}; check the mapping.")
    return value[:, number - 1]


def _lookup(mat: MatFile, known: dict[str, Value | None], path: str) -> FloatArray:
    """Return the numbers of a variable, or of a field of a struct."""
    first, *rest = path.split(".")
    if first not in mat.variables:
        cut = "; the file is cut short" if mat.cut else ""
        raise LogError(f"{mat.name} has no variable {first} (it holds {mat.listing()}){cut}; check the mapping.")
    if first not in known:
        known[first] = mat.values(first)
    value = known[first]
    for name in rest:
        if not isinstance(value, Mapping) or name not in value:
            have = f"has the fields {', '.join(list(value)[:12])}" if isinstance(value, Mapping) else "is no struct"
            raise LogError(f"{mat.name}: {path} is not there: what should hold {name} {have}; check the mapping.")
        value = value[name]
    if not isinstance(value, np.ndarray):
        raise LogError(
            f"{mat.name}: {path} is no array of real numbers; save tables and objects as matrices or structs of them."
        )
    return value


def _shape(value: FloatArray) -> str:
    return "x".join(map(str, value.shape))


def _known_layout(mat: MatFile, source: Source) -> Pieces:
    """Return what the matrices IMU and RTK hold."""
    imu = _matrix(mat, IMU, IMU_COLUMNS)
    rtk = _matrix(mat, RTK, RTK_COLUMNS)
    if imu is None and rtk is None:
        cut = " Its end is cut off." if mat.cut else ""
        raise LogError(f"{mat.name} holds {mat.listing()}: no layout that is known; {_HOW}.{cut}")
    events: tuple[Event, ...] = ()
    gnss = None
    if rtk is not None:
        gnss, events = _gnss(rtk)
    data = _imu(mat.name, imu) if imu is not None and source.role == "imu" else None
    return Pieces(
        imu=data,
        gnss=gnss,
        from_zero=True,
        meta={} if gnss is None else {HEIGHT_KEY: ELLIPSOIDAL},
        events=events,
        undeclared=() if data is None else ("gyro_unit", "axes", "clock"),
    )


def _matrix(mat: MatFile, name: str, columns: int) -> FloatArray | None:
    """Return a matrix of the known layout, None where there is none of that name and width."""
    variable = mat.variables.get(name)
    if variable is None or len(variable.shape) != 2 or variable.shape[1] != columns:
        return None
    value = mat.values(name)
    return value if isinstance(value, np.ndarray) else None


def _imu(name: str, rows: FloatArray) -> ImuData:
    """Return the IMU data; the second clock is not used."""
    force = float(np.median(np.linalg.norm(rows[:, 1:4], axis=1))) if len(rows) else float("nan")
    if not abs(force - GRAVITY) < GRAVITY_TOLERANCE:
        raise LogError(
            f"{name}: columns 2 to 4 of {IMU} have the median length {force:.4g}, which is no gravity in m/s^2; {_HOW}."
        )
    return ImuData(time=rows[:, 0], accel=rows[:, 1:4], gyro=rows[:, 4:7], wheel_speed=_finite(rows[:, 8]))


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _gnss(rows: FloatArray) -> tuple[GnssData, tuple[Event, ...]]:
    """Return the epochs whose quality is known and whose position is a place, and how many are not."""
    sigma = np.full(len(rows), np.nan)
    for quality, value in QUALITY_SIGMA_M.items():
        sigma[rows[:, 1] == quality] = value
    llh = llh_from_ecef(rows[:, 2:5])
    usable: NDArray[np.bool_] = np.isfinite(sigma) & np.isfinite(llh[:, 0]) & np.isfinite(rows).all(axis=1)
    events = dropped(int((~usable).sum()), f"epochs of {RTK} without a fix")
    llh = llh[usable]
    gnss = GnssData(
        time=rows[usable, 0],
        velocity_ned=ned_from_ecef(rows[usable, 5:8], llh),
        position_llh=llh,
        position_std=sigma[usable],
    )
    return gnss, events


READER: Final = Reader(name="matlab", title="MATLAB file (.mat)", sniff=sniff, read=read)
