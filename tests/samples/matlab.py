"""The sample drive as MATLAB files, in the layout of the TUMSAT drives: matrices IMU and RTK, Earth-fixed axes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
from scipy.io import savemat

from levelhead.conventions import FloatArray
from samples.drive import sample_drive

START_S = 111184.0
"""Second of the GPS week when the drive began."""


KEEPS_PREFIX = False
"""A variable is whole or nothing where it is compressed."""


def save(path: Path, variables: Mapping[str, Any], *, compress: bool = True) -> Path:
    """Write a file of level 5, with the same bytes every time: its header has the date."""
    savemat(path, dict(variables), do_compression=compress, oned_as="column")
    content = path.read_bytes()
    header = b"MATLAB 5.0 MAT-file, Platform: PCWIN64, Created on: Fri Jun 27 05:47:23 2025".ljust(116)
    path.write_bytes(header + content[116:])
    return path


def rtk() -> FloatArray:
    """Return the drive's GNSS epochs: stamp, quality (1 fix, 2 float), position, velocity along the Earth's axes."""
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    latitude, longitude, height = log.position_llh.T
    north, east, down = log.velocity_ned.T
    position = pymap3d.geodetic2ecef(latitude, longitude, height, deg=False)
    velocity = pymap3d.enu2uvw(east, north, -down, latitude, longitude, deg=False)
    quality = np.where(np.arange(latitude.size) % 10 < 7, 1.0, 2.0)
    return np.column_stack((START_S + log.gnss_time, quality, *position, *velocity))


def write(folder: Path) -> Path:
    log = sample_drive()
    speed = np.interp(log.time, log.gnss_time, np.hypot(*rtk()[:, 5:7].T))
    imu = np.column_stack((START_S + log.time, log.accel, log.gyro, START_S - 1.0 + log.time, speed))
    save(folder / "RTK0627.mat", {"RTK": rtk()})
    return save(folder / "IMUData0627.mat", {"IMU": imu})
