"""The drive as two texts in a logger's own units, columns and axes: a mapping says what they mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from levelhead.conventions import GRAVITY
from samples.cuts import last_cell
from samples.drive import sample_drive

MAPPING = """
[imu]
header = false
columns = { time = 1, accel_x = 2, accel_y = 3, accel_z = 4, gyro_x = 5, gyro_y = 6, gyro_z = 7 }
units = { time = "ms", accel = "g", gyro = "deg/s" }
axes = ["x", "-y", "-z"]

[gnss]
units = { vel = "km/h" }
[gnss.columns]
time = "stamp"
lat = "latitude"
lon = "longitude"
height = "altitude"
vel_n = "vn"
vel_e = "ve"
vel_u = "vu"
"""

CUT_UNSEEN = last_cell


def write(folder: Path) -> Path:
    """Write the IMU's file, and the GNSS file beside it under a name that goes with its."""
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    turned = [1.0, -1.0, -1.0]
    readings = np.column_stack((log.time * 1e3, log.accel * turned / GRAVITY, np.degrees(log.gyro) * turned))
    path = folder / "drive_imu.csv"
    np.savetxt(path, readings, fmt="%.9g", delimiter=",")
    place = np.column_stack((np.degrees(log.position_llh[:, :2]), log.position_llh[:, 2]))
    fixes = np.column_stack((log.gnss_time, place, log.velocity_ned * [3.6, 3.6, -3.6]))
    header = "stamp,latitude,longitude,altitude,vn,ve,vu"
    np.savetxt(folder / "drive_gnss.csv", fixes, fmt="%.12g", delimiter=",", header=header, comments="")
    return path
