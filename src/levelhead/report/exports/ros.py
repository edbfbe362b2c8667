"""``ros``: biases in ROS's axes (REP-103: x forward, y left, z up) as YAML."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.report.exports.base import Calibration, Document, Exporter, heading, plain
from levelhead.report.exports.yaml_text import row, scalar

FRD_TO_FLU: Final = np.diag([1.0, -1.0, -1.0])
UNITS: Final = {"gyro": "rad/s", "accel": "m/s^2"}


def render(calibration: Calibration) -> Document:
    """Return the YAML; see docs/exports.md."""
    lines = ["reading = truth + bias: take these off the readings. null: never observable."]
    if calibration.old.by:
        lines.append(f"What was left when this had been taken off before: {plain(calibration.old.by)}")
    rows = ["frame: body_flu  # of the vehicle: x forward, y left, z up (REP-103)"]
    for sensor, unit in UNITS.items():
        biases = getattr(calibration, sensor).turned(FRD_TO_FLU)
        rows += [f"{sensor}_bias: {row(biases.value)}  # {unit}", f"{sensor}_bias_std: {row(biases.std)}"]
    if calibration.dcm_file_to_body is not None:
        rows += ["as_recorded:  # in the axes of the messages in the log, whatever these are"]
        for sensor, unit in UNITS.items():
            biases = calibration.recorded(sensor)
            rows += [f"  {sensor}_bias: {row(biases.value)}  # {unit}", f"  {sensor}_bias_std: {row(biases.std)}"]
    if calibration.latency_s is not None:
        rows.append(f"gnss_latency: {scalar(calibration.latency_s)}  # s; positive: the GNSS's stamps are late")
    head = heading(calibration, "IMU biases for ROS", *lines)
    return Document(text="\n".join((*head, *rows)) + "\n")


EXPORTER: Final = Exporter(name="ros", title="YAML for ROS", file_name="calibration-ros.yaml", render=render)
