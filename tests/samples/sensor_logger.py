"""The drive as the phone app Sensor Logger records it: a zip of one CSV for each sensor."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from levelhead.conventions import FloatArray
from samples.drive import EPOCH_UTC_S, sample_drive

FRD_TO_PHONE = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""The phone lies on its back, its top to the front: x right, y forward, z up."""
LATER_S = 0.003
"""Accelerometer samples come so much later than those of the gyroscope."""


KEEPS_PREFIX = False
"""The index of a zip is at its end."""


def _stamps(times: FloatArray) -> list[str]:
    begin = int(EPOCH_UTC_S) * 10**9
    return [str(begin + round(1e9 * t)) for t in times]


def _csv(times: FloatArray, values: FloatArray) -> str:
    rows = zip(_stamps(times), times, values, strict=True)
    lines = [f"{stamp},{t:.9f},{z:.9f},{y:.9f},{x:.9f}" for stamp, t, (x, y, z) in rows]
    return "\n".join(["time,seconds_elapsed,z,y,x", *lines])


def members(platform: str = "android", *, standard: bool | None = None) -> dict[str, str]:
    """Return the files of a recording by an Android phone or an iPhone ("ios")."""
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    later = log.time + LATER_S
    accel = np.column_stack([np.interp(later, log.time, a) for a in log.accel.T]) @ FRD_TO_PHONE.T
    iphone = platform == "ios" and not standard
    north, east, _ = log.velocity_ned.T
    bearing = np.degrees(np.arctan2(east, north)) % 360.0
    places = [
        f"{stamp},{t:.3f},2.0,0.1,1.5,3.0,{np.hypot(n, e):.9f},{course:.9f},"
        f"{h:.6f},{np.degrees(lon):.11f},{np.degrees(lat):.11f}"
        for stamp, t, n, e, course, (lat, lon, h) in zip(
            _stamps(log.gnss_time), log.gnss_time, north, east, bearing, log.position_llh, strict=True
        )
    ]
    header = (
        "time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing,altitude,"
        "longitude,latitude"
    )
    told = "" if standard is None else str(standard).lower()
    return {
        "GyroscopeUncalibrated.csv": _csv(log.time, log.gyro @ FRD_TO_PHONE.T),
        "Gyroscope.csv": _csv(log.time, (log.gyro - 0.01) @ FRD_TO_PHONE.T),
        "AccelerometerUncalibrated.csv": _csv(later, accel / (-9.80665 if iphone else 1.0)),
        "TotalAcceleration.csv": _csv(later, accel * (-1.0 if iphone else 1.0)),
        "Location.csv": "\n".join([header, *places]),
        "Metadata.csv": f"version,device name,platform,appVersion,standardisation\n3,a phone,{platform},1.30,{told}",
    }


def pack(folder: Path, files: dict[str, str]) -> Path:
    """Write files into a zip, without the time of the day."""
    path = folder / "drive-2025-06-27.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)
    return path


def write(folder: Path) -> Path:
    return pack(folder, members())
