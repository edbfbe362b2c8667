"""The sample drive as a UBX stream of a receiver with an IMU: ESF-MEAS and NAV-PVT, encoded by pyubx2."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
from pyubx2 import GET, UBXMessage

from samples.cuts import between_records
from samples.drive import EPOCH_UTC_S, sample_drive

SENSOR_START_MS = 91_000
"""What the sensor's clock read when the drive began."""
GYRO_TYPES = (14, 13, 5)
ACCEL_TYPES = (16, 17, 18)
LEAP_S = 18


CUT_UNSEEN = between_records(0, lambda content, at: 8 + int.from_bytes(content[at + 4 : at + 6], "little"))
CLOCK_TOLERANCE_S = 0.02
"""The sensor's clock is set by the order of readings and fixes in the whole file."""


def meas(tag_ms: int, types: tuple[int, ...], values: list[int], *, provider: int = 0) -> bytes:
    """Return an ESF-MEAS frame of readings in units of their 24 bits."""
    words = [(kind << 24) | (value & 0xFFFFFF) for kind, value in zip(types, values, strict=True)]
    head = (tag_ms % 2**32).to_bytes(4, "little") + (len(words) << 11).to_bytes(2, "little")
    payload = head + provider.to_bytes(2, "little") + b"".join(w.to_bytes(4, "little") for w in words)
    return bytes(UBXMessage("ESF", "ESF-MEAS", GET, payload=payload).serialize())


def readings(gyro: np.ndarray, accel: np.ndarray) -> list[list[int]]:
    """Return readings (rad/s, m/s^2) in units of their 24 bits, six a row."""
    counts = np.column_stack((np.degrees(gyro) * 2.0**12, accel * 2.0**10))
    rows: list[list[int]] = np.round(counts).astype(int).tolist()
    return rows


def pvt(utc_s: float, velocity: np.ndarray, llh: np.ndarray, **changes: object) -> bytes:
    """Return a NAV-PVT frame of a fix."""
    instant = dt.datetime.fromtimestamp(utc_s, tz=dt.UTC)
    north, east, down = (round(1e3 * v) for v in velocity.tolist())
    fields: dict[str, object] = {
        "iTOW": round(1e3 * ((utc_s - 315964800 + LEAP_S) % 604800)),
        "year": instant.year,
        "month": instant.month,
        "day": instant.day,
        "hour": instant.hour,
        "min": instant.minute,
        "second": instant.second,
        "validDate": 1,
        "validTime": 1,
        "fullyResolved": 1,
        "nano": 1000 * instant.microsecond,
        "fixType": 3,
        "gnssFixOk": 1,
        "numSV": 20,
        "lat": float(np.degrees(llh[0])),
        "lon": float(np.degrees(llh[1])),
        "height": round(1e3 * float(llh[2])),
        "hMSL": round(1e3 * float(llh[2])) - 47_000,
        "hAcc": 14,
        "vAcc": 20,
        "velN": north,
        "velE": east,
        "velD": down,
        "sAcc": 50,
    }
    return bytes(UBXMessage("NAV", "NAV-PVT", GET, **{**fields, **changes}).serialize())


def frames() -> list[bytes]:
    """Return the drive's frames in the order in which a receiver without any delay would send them."""
    drive = sample_drive()
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    timed = []
    for time, row in zip(drive.time.tolist(), readings(drive.gyro, drive.accel), strict=True):
        tag = SENSOR_START_MS + round(1e3 * time)
        timed += [(time, 0, meas(tag, GYRO_TYPES, row[:3])), (time, 1, meas(tag, ACCEL_TYPES, row[3:]))]
    for time, velocity, llh in zip(drive.gnss_time.tolist(), drive.velocity_ned, drive.position_llh, strict=True):
        timed.append((time, 2, pvt(EPOCH_UTC_S + time, velocity, llh)))
    return [frame for _, _, frame in sorted(timed, key=lambda t: t[:2])]


def write(folder: Path) -> Path:
    """Write the drive and return its path."""
    path = folder / "drive.ubx"
    path.write_bytes(b"".join(frames()))
    return path
