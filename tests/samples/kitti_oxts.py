"""The sample drive as a KITTI raw drive: a folder ``oxts`` with a file of 30 numbers for every IMU sample."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from levelhead.conventions import FloatArray
from samples.drive import EPOCH_UTC_S, sample_drive


def velocity_and_position(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the drive's GNSS velocity and position between its epochs: an INS writes them with every sample."""
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    velocity, position = (
        np.column_stack([np.interp(at, log.gnss_time, column) for column in values.T])
        for values in (log.velocity_ned, log.position_llh)
    )
    return velocity, position


def write(folder: Path) -> Path:
    log = sample_drive()
    velocity, position = velocity_and_position(log.time)
    zero = np.zeros(log.time.size)
    forward, right, down = log.accel.T
    roll_rate, pitch_rate, yaw_rate = log.gyro.T
    columns = [
        *np.degrees(position[:, :2]).T, position[:, 2], zero, zero, zero,
        velocity[:, 0], velocity[:, 1], zero, zero, -velocity[:, 2],
        # Forward, left, up; the levelled af, al, au and wf, wl, wu behind them are of no use.
        forward, -right, -down, zero + 77.0, zero + 77.0, zero + 77.0,
        roll_rate, -pitch_rate, -yaw_rate, zero + 7.0, zero + 7.0, zero + 7.0,
        zero + 0.05, zero + 0.02, zero + 4, zero + 9, zero + 4, zero + 4, zero + 6,
    ]  # fmt: skip
    drive = folder / "2025_06_27_drive_0001_extract"
    data = drive / "oxts" / "data"
    data.mkdir(parents=True)
    begin = np.datetime64(int(EPOCH_UTC_S), "s").astype("datetime64[ns]")
    stamps = begin + np.round(log.time * 1e9).astype("timedelta64[ns]")
    text = "".join(f"{stamp}\n".replace("T", " ") for stamp in stamps)
    (drive / "oxts" / "timestamps.txt").write_text(text, encoding="ascii")
    for number, row in enumerate(np.column_stack(columns)):
        (data / f"{number:010d}.txt").write_text(" ".join(f"{value:.14g}" for value in row) + "\n", encoding="ascii")
    return drive
