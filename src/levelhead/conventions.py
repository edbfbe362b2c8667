"""Frames, units, signs and column names: the one table that every other module refers to.

Frames
    body (b)
        x forward, y right, z down (FRD).
    navigation (n)
        North, East, Down (NED).
Signs
    ``reading = truth + bias``: a bias estimate is subtracted from the reading. Level and at rest the
    accelerometer reads ``(0, 0, -GRAVITY)``.
Units
    SI and radians everywhere inside; degrees only at the border, in names with ``_deg`` or ``_deg_s``,
    and in latitude and longitude columns of log files.
Time
    Seconds as float64 from the start of the log, strictly increasing. NaN means absent, never 0.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
StatusArray = NDArray[np.uint32]

ImuArrays = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""IMU samples as the kernel takes them: time (n,), gyro and accel (n, 3), wheel speed (n,) or (0,)."""
GnssArrays = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""GNSS epochs: time (m,), velocity, its sigma, position (rad, rad, m), its sigma, each (m, 3), NaN where absent."""
OutArrays = tuple[FloatArray | StatusArray, ...]
"""What the kernel fills, in the order of the fields of `levelhead.estimators.streaming.Trace`."""

GRAVITY: Final = 9.80665
"""Standard gravity, m/s^2, used unless a position gives the local value."""

AXES: Final = ("x", "y", "z")

TIME_COLUMN: Final = "time"
GYRO_COLUMNS: Final = ("gyro_x", "gyro_y", "gyro_z")
ACCEL_COLUMNS: Final = ("accel_x", "accel_y", "accel_z")
VELOCITY_COLUMNS: Final = ("vel_n", "vel_e", "vel_d")
VELOCITY_STD_COLUMN: Final = "vel_std"
POSITION_COLUMNS: Final = ("lat", "lon", "height")
POSITION_STD_COLUMN: Final = "pos_std"
WHEEL_SPEED_COLUMN: Final = "wheel_speed"

CANONICAL_UNITS: Final[dict[str, str]] = {
    TIME_COLUMN: "s",
    **dict.fromkeys(GYRO_COLUMNS, "rad/s"),
    **dict.fromkeys(ACCEL_COLUMNS, "m/s^2"),
    **dict.fromkeys(VELOCITY_COLUMNS, "m/s"),
    VELOCITY_STD_COLUMN: "m/s",
    "lat": "deg",
    "lon": "deg",
    "height": "m",
    POSITION_STD_COLUMN: "m",
    WHEEL_SPEED_COLUMN: "m/s",
}
"""Columns of a canonical log file and the unit each has when the file declares none."""

UNIT_FACTORS: Final[dict[str, dict[str, float]]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "rad/s": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180.0, "deg/h": math.pi / 648000.0},
    "m/s^2": {"m/s^2": 1.0, "m/s2": 1.0, "g": GRAVITY, "mg": GRAVITY * 1e-3},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1.0 / 3.6, "knot": 1852.0 / 3600.0},
    "deg": {"deg": 1.0, "rad": 180.0 / math.pi},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
}
"""``UNIT_FACTORS[canonical][declared]`` turns a number in the declared unit into the canonical one."""
