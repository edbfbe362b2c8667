"""``json``: biases and sigma in SI units, with what is known of axes and clocks, for programs of one's own."""

from __future__ import annotations

import json
import math
from typing import Final

from levelhead.conventions import FloatArray
from levelhead.report.exports.base import Biases, Calibration, Document, Exporter
from levelhead.version import __version__


def render(calibration: Calibration) -> Document:
    """Return the JSON; see docs/exports.md."""

    def triads(gyro: Biases, accel: Biases) -> dict[str, object]:
        return {
            "gyro_bias_rad_s": _list(gyro.value),
            "gyro_bias_std_rad_s": _list(gyro.std),
            "accel_bias_m_s2": _list(accel.value),
            "accel_bias_std_m_s2": _list(accel.std),
        }

    dcm = calibration.dcm_file_to_body
    content = {
        "levelhead": __version__,
        "source": calibration.log_info.get("source"),
        "completeness": calibration.log_info["completeness"],
        "method": calibration.method,
        "sign": "reading = truth + bias",
        "axes": "vehicle: x forward, y right, z down",
        **triads(calibration.gyro, calibration.accel),
        "known": {"gyro": calibration.gyro.known, "accel": calibration.accel.known},
        "dcm_file_to_body": None if dcm is None else dcm.tolist(),
        # Without the rotation nobody knows whether the reader turned the file's axes.
        "as_recorded": None if dcm is None else triads(calibration.recorded("gyro"), calibration.recorded("accel")),
        "taken_off_before": calibration.old.by or None,
        "latency_s": calibration.latency_s,
        "mounting_deg": None if calibration.mounting_deg is None else dict(calibration.mounting_deg),
    }
    return Document(text=json.dumps(content, indent=2, allow_nan=False) + "\n")


def _list(values: FloatArray) -> list[float | None]:
    return [float(v) if math.isfinite(v) else None for v in values]


EXPORTER: Final = Exporter(name="json", title="JSON", file_name="calibration.json", render=render)
