"""The drive as somebody's own CSV: other names, units in the names, GNSS as speed and course."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from samples.drive import EPOCH_UTC_S, sample_drive

HEADER = (
    "timestamp_ms,GyroX [deg/s],GyroY [deg/s],GyroZ [deg/s],AccX (g),AccY (g),AccZ (g),"
    "latitude,longitude,altitude,vel_n_m_s,vel_e_m_s,vel_u_m_s\n"
)


def write(folder: Path) -> Path:
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    fixes = {round(float(t), 3): k for k, t in enumerate(log.gnss_time)}
    lines = [HEADER]
    for k, time in enumerate(log.time):
        gyro, accel = np.degrees(log.gyro[k]), log.accel[k] / 9.80665
        cells = [f"{(EPOCH_UTC_S + time) * 1e3:.0f}", *(f"{v:.7f}" for v in gyro), *(f"{v:.8f}" for v in accel)]
        fix = fixes.get(round(float(time), 3))
        if fix is None:
            cells += [""] * 6
        else:
            lat, lon, height = log.position_llh[fix]
            north, east, down = log.velocity_ned[fix]
            cells += [f"{np.degrees(lat):.10f}", f"{np.degrees(lon):.10f}", f"{height:.4f}"]
            cells += [f"{north:.5f}", f"{east:.5f}", f"{-down:.5f}"]
        lines.append(",".join(cells) + "\n")
    path = folder / "someones.csv"
    path.write_text("".join(lines), encoding="utf-8")
    return path
