"""The sample drive as KF-GINS text: increments in one file, positions and velocities in the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from levelhead.conventions import FloatArray
from samples.drive import sample_drive

START_S = 456300.0
"""Second of the GPS week when the drive began."""


def increments() -> FloatArray:
    """Return stamps and increments (n - 1, 7): the integral of straight lines between the drive's readings."""
    log = sample_drive()
    readings = np.column_stack((log.gyro, log.accel))
    step = np.diff(log.time)[:, np.newaxis]
    return np.column_stack((START_S + log.time[1:], 0.5 * (readings[1:] + readings[:-1]) * step))


def write(folder: Path) -> Path:
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    path = folder / "drive_imu.txt"
    rows = (f"{row[0]:.9f} " + "".join(f"   {value:.10f}" for value in row[1:]) + "  \n" for row in increments())
    path.write_text("".join(rows), encoding="ascii")
    fixes = np.column_stack(
        (
            START_S + log.gnss_time,
            np.degrees(log.position_llh[:, :2]),
            log.position_llh[:, 2],
            np.full((log.gnss_time.size, 3), 0.02),
            log.velocity_ned,
            np.full((log.gnss_time.size, 3), 0.05),
        )
    )
    lines = (f"{fix[0]:.6f}   {fix[1]:.10f}  {fix[2]:.10f} " + " ".join(f"{v:.8f}" for v in fix[3:]) for fix in fixes)
    (folder / "drive_gnss.txt").write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    return path
