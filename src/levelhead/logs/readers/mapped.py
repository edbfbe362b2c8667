"""What a mapping says of numbers, applied to them, whatever the file that they come from (CSV or MATLAB)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from levelhead.conventions import POSITION_COLUMNS, TIME_COLUMN, VELOCITY_COLUMNS, FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.ecef import GLOBE_M, llh_from_ecef, ned_from_ecef
from levelhead.logs.mapping import ECEF_COLUMNS, ECEF_VELOCITY_COLUMNS, UP_COLUMN, TableMapping
from levelhead.logs.pieces import GnssData, ImuData, Pieces
from levelhead.logs.readers.base import Source, Table
from levelhead.logs.readers.columns import pieces_from_table
from levelhead.logs.readers.receivers import dropped

Numbers = Callable[[TableMapping], Table]
"""Gets the columns of a section out of the file, as they stand there, under the mapping's names."""


def mapped_pieces(source: Source, numbers: Numbers) -> Pieces:
    """Return what the mapping describes: IMU data, GNSS data, or both from one file.

    Raises
    ------
    LogError
        Naming file, row and column of what is wrong.
    """
    imu: ImuData | None = None
    gnss: GnssData | None = None
    left_out = 0
    events: tuple[Event, ...] = ()
    if source.imu_mapping is not None:
        table, _ = _canonical(numbers, source.imu_mapping.table, source.imu_mapping.time_zero_s or 0.0)
        left_out = table.left_out
        raw = pieces_from_table(table).imu
        if raw is not None:
            dcm = source.imu_mapping.dcm_file_to_body
            imu = replace(raw, gyro=raw.gyro @ dcm.T, accel=raw.accel @ dcm.T)
    if source.gnss_mapping is not None:
        table, events = _canonical(numbers, source.gnss_mapping.table, 0.0)
        left_out = max(left_out, table.left_out)
        gnss = pieces_from_table(table).gnss
    meta: dict[str, object] = {} if source.gnss_mapping is None else dict(source.gnss_mapping.meta)
    if imu is not None and source.imu_mapping is not None:
        meta["dcm_file_to_body"] = tuple(tuple(float(v) for v in row) for row in source.imu_mapping.dcm_file_to_body)
    return Pieces(imu=imu, gnss=gnss, left_out=left_out, from_zero=True, meta=meta, events=events)


def _canonical(numbers: Numbers, mapping: TableMapping, time_zero_s: float) -> tuple[Table, tuple[Event, ...]]:
    """Return a section's columns with canonical names, units and signs, and what was left out."""
    table = numbers(mapping)
    columns = {c: values * mapping.factors[c] for c, values in table.columns.items()}
    columns[TIME_COLUMN] = columns[TIME_COLUMN] + (mapping.time_offset_s + time_zero_s)
    if UP_COLUMN in columns:
        columns["vel_d"] = -columns.pop(UP_COLUMN)
    table = replace(table, columns=columns)
    if not any(c in columns for c in (*ECEF_COLUMNS, *ECEF_VELOCITY_COLUMNS)):
        return table, ()
    return _from_ecef(table)


def _from_ecef(table: Table) -> tuple[Table, tuple[Event, ...]]:
    """Return a table with positions and velocities at the place instead of those along the Earth's axes."""
    columns = dict(table.columns)
    if ECEF_COLUMNS[0] in columns:
        position = np.column_stack([columns.pop(c) for c in ECEF_COLUMNS])
        llh = llh_from_ecef(position)
        half = np.flatnonzero(np.isnan(position).any(axis=1) & ~np.isnan(position).all(axis=1))
        if half.size:
            raise LogError(
                f"{table.name}, {table.where(int(half[0]))}: part of ecef_x, ecef_y, ecef_z is empty ({half.size} such "
                "rows in all); fill in the row or remove it."
            )
        # Zeros are what receivers write without a fix; anything else that is no place is a wrong unit or column.
        lost = (position == 0.0).all(axis=1)
        wrong = np.flatnonzero(np.isnan(llh[:, 0]) & ~np.isnan(position[:, 0]) & ~lost)
        if wrong.size:
            distance = float(np.linalg.norm(position[wrong[0]]))
            raise LogError(
                f"{table.name}, {table.where(int(wrong[0]))}: ecef_x, ecef_y, ecef_z lie {distance:.4g} m from the "
                f"Earth's centre, which is no place ({GLOBE_M[0]:g} to {GLOBE_M[1]:g} m are; {wrong.size} such rows in "
                "all); check the mapping's columns and units."
            )
        columns |= dict(zip(POSITION_COLUMNS, (np.degrees(llh[:, 0]), np.degrees(llh[:, 1]), llh[:, 2]), strict=True))
    else:
        llh = np.radians(np.column_stack([columns[c] for c in POSITION_COLUMNS]))
        lost = np.zeros(len(llh), dtype=np.bool_)
    if ECEF_VELOCITY_COLUMNS[0] in columns:
        velocity = np.column_stack([columns.pop(c) for c in ECEF_VELOCITY_COLUMNS])
        ned = ned_from_ecef(velocity, llh)
        lost |= np.isnan(ned[:, 0]) & np.isfinite(velocity).all(axis=1)
        columns |= dict(zip(VELOCITY_COLUMNS, ned.T, strict=True))
    columns = _without_place(columns, llh)
    return replace(table, columns=columns), dropped(int(lost.sum()), "GNSS epochs without a position")


def _without_place(columns: dict[str, FloatArray], llh: FloatArray) -> dict[str, FloatArray]:
    """Return the columns with the sigma of a position left out where there is no position."""
    if "pos_std" in columns:
        columns["pos_std"] = np.where(np.isnan(llh[:, 0]), np.nan, columns["pos_std"])
    return columns
