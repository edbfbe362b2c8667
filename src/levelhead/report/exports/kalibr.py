"""``kalibr``: the noise that the method reckoned with, as Kalibr's ``imu.yaml``; it has no place for a bias."""

from __future__ import annotations

import math
from typing import Final

from levelhead.errors import LogError
from levelhead.report.exports.base import Calibration, Document, Exporter, heading
from levelhead.report.exports.yaml_text import scalar

TWO_SIDED: Final = math.sqrt(0.5)
"""Our densities are one-sided (sigma = d sqrt(f / 2) at the rate f), Kalibr's two-sided (sigma = d sqrt(f))."""
KEYS: Final = (
    ("accelerometer_noise_density", "accel_noise", TWO_SIDED, "m/s^2/sqrt(Hz), two-sided"),
    ("accelerometer_random_walk", "accel_bias_walk", 1.0, "m/s^3/sqrt(Hz)"),
    ("gyroscope_noise_density", "gyro_noise", TWO_SIDED, "rad/s/sqrt(Hz), two-sided"),
    ("gyroscope_random_walk", "gyro_bias_walk", 1.0, "rad/s^2/sqrt(Hz)"),
)


def render(calibration: Calibration) -> Document:
    """Return ``imu.yaml``; see docs/exports.md."""
    rows = []
    for key, name, factor, unit in KEYS:
        value = calibration.params.get(name)
        if not isinstance(value, int | float):
            raise LogError(
                f"The method {calibration.method!r} has no {name} among its parameters, which Kalibr needs; estimate "
                "with 'smoother', 'phasor' or 'ekf'."
            )
        rows.append(f"{key}: {scalar(factor * value)}  # {unit}")
    rate = calibration.log_info["imu_rate_hz"]
    rows += ["rostopic: /imu0  # put the topic of the IMU here", f"update_rate: {rate:.1f}  # Hz"]
    head = heading(
        calibration,
        "IMU noise for Kalibr",
        "What the method reckoned with, the vehicle's vibration included. Kalibr has no field for a bias.",
    )
    return Document(text="\n".join((*head, *rows)) + "\n")


EXPORTER: Final = Exporter(
    name="kalibr", title="imu.yaml for Kalibr", file_name="calibration-kalibr.yaml", render=render, has_biases=False
)
