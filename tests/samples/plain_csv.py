"""The drive as a CSV of nothing but numbers, as a microcontroller prints it: g, deg/s, milliseconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from samples.cuts import last_cell
from samples.drive import sample_drive

CUT_UNSEEN = last_cell
SHORTEST_S = 30.0
KEEPS_PREFIX = False
"""The gyro is told from other sensors by turns and straights: without most of them the file is refused."""


def write(folder: Path) -> Path:
    log = sample_drive()
    rows = np.column_stack((log.accel / 9.80665, np.degrees(log.gyro), 1e3 * log.time + 5000.0))
    path = folder / "numbers.csv"
    np.savetxt(path, rows, fmt=["%.6f"] * 6 + ["%.0f"], delimiter=",")
    return path


def write_gnss(folder: Path) -> Path:
    """Write the fixes with a header, on the same clock."""
    log = sample_drive()
    assert log.velocity_ned is not None
    rows = np.column_stack((log.gnss_time + 5.0, log.velocity_ned))
    path = folder / "fixes.csv"
    np.savetxt(path, rows, fmt="%.6f", delimiter=",", header="time,vel_n,vel_e,vel_d", comments="")
    return path
