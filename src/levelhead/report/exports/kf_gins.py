"""``kf-gins``: initial biases and their sigma for the configuration of KF-GINS (Wuhan University)."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.errors import LogError
from levelhead.report.exports.base import Calibration, Document, Exporter, heading, plain
from levelhead.report.exports.yaml_text import row

KEYS: Final = {
    "gyro": ("initgyrbias", "initbgstd", "deg/h", float(np.degrees(3600.0))),
    "accel": ("initaccbias", "initbastd", "mGal", 1e5),
}
"""Key of the bias, key of its sigma, their unit, and how many of it make an SI unit."""


def render(calibration: Calibration) -> Document:
    """Return lines for the configuration; see docs/exports.md."""
    rows, notes = [], []
    for sensor, (bias_key, std_key, unit, factor) in KEYS.items():
        biases = getattr(calibration, sensor)
        if not all(biases.known):
            # KF-GINS takes three numbers or none.
            notes.append(f"{bias_key} is left out: not all axes of the {sensor} are known.")
            continue
        rows.append(f"{bias_key}: {row(factor * biases.value)}  # {unit}")
        if np.isfinite(biases.std).all():
            rows.append(f"{std_key}: {row(factor * biases.std)}  # {unit}")
    if not rows:
        raise LogError(
            "No calibration is written: KF-GINS takes the biases of three axes, and no sensor's are all known."
        )
    lines = [
        "Lines for kf-gins.yaml, axes forward, right, down. KF-GINS takes them off the readings as levelhead does.",
        "Its IMU file must be in the vehicle's axes, as in the log that levelhead reads.",
    ]
    if calibration.old.by:
        lines.append(f"What was left when this had been taken off before: {plain(calibration.old.by)}")
    head = heading(calibration, "Initial biases for KF-GINS", *lines, *notes)
    return Document(text="\n".join((*head, *rows)) + "\n", notes=tuple(notes))


EXPORTER: Final = Exporter(
    name="kf-gins", title="lines for KF-GINS", file_name="calibration-kf-gins.yaml", render=render
)
