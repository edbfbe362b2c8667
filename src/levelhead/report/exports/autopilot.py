"""What the autopilots share: offsets are taken off in the sensor's axes, then come scale and rotation.

``calibrated = R ((raw - offset) * scale)``, for PX4 (``sensor_calibration``) and ArduPilot
(``AP_InertialSensor_Backend``) alike, the gyros without scale. A bias b of calibrated readings is therefore gone with
``offset + (R^T b) / scale``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from levelhead.conventions import AXES, FloatArray
from levelhead.errors import LogError
from levelhead.logs.mapping import rotation_321
from levelhead.report.exports.base import Biases, Calibration

SHARED_ROTATIONS: Final[tuple[tuple[int, int, int], ...]] = (
    *((0, 0, yaw) for yaw in range(0, 360, 45)),  # 0 to 7
    *((180, 0, yaw) for yaw in (0, 45, 90, 135)),
    (0, 180, 0),  # 12
    *((180, 0, yaw) for yaw in (225, 270, 315)),
    *((90, 0, yaw) for yaw in (0, 45, 90, 135)),  # 16 to 19
    *((270, 0, yaw) for yaw in (0, 45, 90, 135)),
    (0, 90, 0),  # 24
    (0, 270, 0),
    (0, 180, 90),
    (0, 180, 270),
    *((roll, 90, 0) for roll in (90, 180, 270)),  # 28 to 30
    *((roll, 180, 0) for roll in (90, 270)),
    *((roll, 270, 0) for roll in (90, 180, 270)),  # 33 to 35
    (90, 180, 90),
    (90, 0, 270),
)
"""Roll, pitch, yaw in degrees of MAVLink's sensor orientations 0 to 37; both autopilots have these."""
SAME_SCALE: Final = 1e-6
"""How far a scale is from 1 that makes no difference: float32's resolution."""


def old_values(parameters: Mapping[str, float], pattern: str) -> FloatArray:
    """Return three parameters, of the x, y and z axis; `pattern` has ``{}`` for X, Y and Z.

    Raises
    ------
    LogError
        When one is missing.
    """
    names = [pattern.format(axis.upper()) for axis in AXES]
    missing = [name for name in names if name not in parameters]
    if missing:
        raise LogError(
            f"The vehicle's parameters lack {missing[0]}, which the new offsets depend on; pass the whole parameter "
            "file of the vehicle, as it was at the time of the drive (--calibration)."
        )
    return np.array([parameters[name] for name in names])


def new_offsets(biases: Biases, *, dcm_sensor_to_file: FloatArray, old: FloatArray, scale: FloatArray) -> Biases:
    """Return the offsets (3,) in the sensor's axes after which these biases of calibrated readings are gone."""
    sensor = biases.turned(dcm_sensor_to_file.T)
    return Biases(value=old + sensor.value / scale, std=sensor.std / np.abs(scale))


def check_scale(scale: FloatArray, names: str) -> None:
    """Refuse scale factors that make no sense."""
    if not ((scale > 0.5) & (scale < 2.0)).all():
        raise LogError(f"{names} is {scale.tolist()}; a scale lies near 1. Check the parameter file.")


def refuse_scaled(scale: FloatArray, names: str) -> None:
    """Refuse raw accelerometer readings that the autopilot will scale.

    levelhead takes a scale that is off for a bias, which holds for readings with that scale only.
    """
    if (np.abs(scale - 1.0) > SAME_SCALE).any():
        raise LogError(
            f"The log has raw accelerometer readings, but the autopilot scales them ({names} is {scale.tolist()}): an "
            "offset for raw readings would be wrong by the scale's part of gravity. Estimate from the calibrated "
            "readings of the log."
        )


def dcm_of(table: Mapping[int, tuple[float, float, float]], value: float, name: str) -> FloatArray:
    """Return the rotation from the sensor's axes to the autopilot's that an orientation parameter means."""
    angles = table.get(int(value)) if float(value).is_integer() else None
    if angles is None:
        raise LogError(
            f"{name} is {value:g}, an orientation that levelhead does not know, so that the axes of the offsets are "
            "not known; export to another target (--export json) and turn the biases yourself."
        )
    roll, pitch, yaw = (float(np.radians(angle)) for angle in angles)
    return rotation_321(roll=roll, pitch=pitch, yaw=yaw)


def starting_lines(calibration: Calibration) -> tuple[list[str], list[str]]:
    """Return comment lines on what the new offsets start from, and the notes of them that the user must see."""
    if calibration.old.applied:
        return ["New offset = old offset + estimate: the readings in the log had the old one taken off."], []
    note = (
        "The readings are taken as raw: these offsets replace those of the vehicle. Were offsets taken off before "
        "recording, pass the vehicle's parameter file (--calibration)."
    )
    return [], [note] if calibration.old.parameters is None else []


def sigma_line(offsets: Biases, unit: str) -> str:
    """Return a comment line with one sigma of each axis."""
    shown = [f"{s:.2g}" if np.isfinite(s) else "unknown" for s in offsets.std]
    return f"# one sigma: {', '.join(shown)} {unit}"


def number(value: float) -> str:
    """Return an offset as text: to 1e-9, without exponent, without a negative zero."""
    return f"{value + 0.0 if round(value, 9) else 0.0:.9f}"
