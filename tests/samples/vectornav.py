"""The drive as VectorNav's SDK exports it: one row for each binary message, with the receiver's last fix repeated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from levelhead.logs.timescales import GPS_EPOCH_S, WEEK_S
from samples.drive import EPOCH_UTC_S, sample_drive

START = EPOCH_UTC_S + 18.0 - GPS_EPOCH_S
"""The drive began so many seconds after GPS's beginning: 18 leap seconds."""
HEADER = (
    "TimeStartup,TimeGps,UncompAccX,UncompAccY,UncompAccZ,UncompGyroX,UncompGyroY,UncompGyroZ,AccelX,AccelY,AccelZ,"
    "GyroX,GyroY,GyroZ,Gps1Tow,Gps1Week,Gnss1Fix,Gnss1Lat,Gnss1Lon,Gnss1Alt,Gnss1VelN,Gnss1VelE,Gnss1VelD,"
    "Gnss1PosUncertaintyN,Gnss1PosUncertaintyE,Gnss1PosUncertaintyD,Gnss1VelUncertainty,InsStatus,VelN,VelE,VelD\n"
)
LATENCY = 0.13
"""A fix is in the messages so many seconds after its time."""


def write(folder: Path) -> Path:
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    lines = [HEADER]
    for k, time in enumerate(log.time):
        cells = [f"{round((7.0 + time) * 1e9)}", f"{round((START + time) * 1e9)}"]
        cells += [f"{v:.9f}" for v in (*log.accel[k], *log.gyro[k], *(log.accel[k] - 0.1), *(log.gyro[k] - 0.01))]
        fix = int(np.searchsorted(log.gnss_time + LATENCY, time, side="right")) - 1
        if fix < 0:
            cells += ["0", "0", "0", *["0.0"] * 10]
        else:
            week, tow = divmod(START + log.gnss_time[fix], WEEK_S)
            lat, lon, height = log.position_llh[fix]
            cells += [f"{round(tow * 1e9)}", f"{week:.0f}", "3"]
            cells += [f"{v:.10f}" for v in (np.degrees(lat), np.degrees(lon), height, *log.velocity_ned[fix])]
            cells += ["0.5", "0.5", "0.9", "0.05"]
        cells += ["2", "1.000000", "2.000000", "3.000000"]
        lines.append(",".join(cells) + "\n")
    path = folder / "vn200.csv"
    path.write_text("".join(lines), encoding="ascii")
    return path
