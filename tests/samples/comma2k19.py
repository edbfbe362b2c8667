"""The sample drive as a segment of comma2k19: folders of two NumPy arrays without suffix."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from samples.drive import EPOCH_UTC_S, sample_drive

CLOCK_TOLERANCE_S = 0.011
"""The receiver's stamps are made even by their median, which is 0, 10 or 20 ms."""
BOOT_S = 46408.5
"""What the phone's clock read when the drive began."""


def write(folder: Path) -> Path:
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    bias = np.array([-0.01, -0.035, 0.068])
    north, east, _ = log.velocity_ned.T
    speed, bearing = np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360.0
    latitude, longitude, height = log.position_llh.T
    utc_ms = 1e3 * (EPOCH_UTC_S + log.gnss_time)
    fixes = np.column_stack((np.degrees(latitude), np.degrees(longitude), speed, utc_ms, height, bearing))
    # Messages come up to 20 ms late; every other one does.
    received = log.gnss_time + 0.02 * (np.arange(log.gnss_time.size) % 2)
    wheel_time = np.arange(0.0, 30.0, 0.04)
    wheels = np.interp(wheel_time, log.gnss_time, speed)[:, np.newaxis] + np.array([0.1, -0.1, 0.2, -0.2])
    signals = {
        "IMU/accelerometer": (log.time, log.accel),
        "IMU/gyro_uncalibrated": (log.time, log.gyro + bias),
        "IMU/gyro": (log.time, log.gyro),
        "GNSS/live_gnss_ublox": (received, fixes),
        "GNSS/live_gnss_qcom": (received[::5], fixes[::5]),
        "CAN/wheel_speed": (wheel_time, wheels),
    }
    segment = folder / "7"
    for name, (time, value) in signals.items():
        at = segment / "processed_log" / name
        at.mkdir(parents=True)
        for part, array in (("t", time + BOOT_S), ("value", np.ascontiguousarray(value))):
            with (at / part).open("wb") as file:
                np.save(file, array, allow_pickle=False)
    return segment
