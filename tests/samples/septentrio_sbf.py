"""The sample drive as an SBF stream of an INS receiver: ExtSensorMeas, PVTGeodetic and its covariances.

The few lines that write blocks are here, because pysbf2 knows no ExtSensorMeas and pads no block; the tests hold what
is written against pysbf2's reader.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from pathlib import Path

import numpy as np

from samples.cuts import between_records
from samples.drive import EPOCH_UTC_S, sample_drive

LEAP_S = 18
WEEK_MS = 604_800_000
ABSENT = -2e10


CUT_UNSEEN = between_records(0, lambda content, at: int.from_bytes(content[at + 6 : at + 8], "little"))


def block(number: int, payload: bytes, *, revision: int = 0) -> bytes:
    """Return a block: padded to a multiple of four bytes, with its CRC."""
    payload += bytes(-len(payload) % 4)
    body = struct.pack("<HH", number | revision << 13, len(payload) + 8) + payload
    return b"$@" + struct.pack("<H", crc_hqx(body, 0)) + body


def stamp(utc_s: float) -> bytes:
    """Return time of week and week."""
    week, tow = divmod(round(1e3 * (utc_s - 315964800 + LEAP_S)), WEEK_MS)
    return struct.pack("<IH", tow, week)


def pvt(utc_s: float, velocity: np.ndarray, llh: np.ndarray, *, mode: int = 4, error: int = 0, datum: int = 0) -> bytes:
    """Return PVTGeodetic, revision 2."""
    north, east, down = velocity.tolist()
    payload = stamp(utc_s) + struct.pack(
        "<BB3d5fdf", mode, error, *llh.tolist(), 47.0, north, east, -down, 90.0, 0.1, 0.0
    )
    payload += struct.pack("<BBBBHHIBBHHHHB", 0, datum, 20, 0, 1, 50, 0, 0, 1, 0, 30, 2, 3, 0)
    return block(4007, payload, revision=2)


def covariance(number: int, utc_s: float, variances: tuple[float, float, float]) -> bytes:
    """Return PosCovGeodetic (5906) or VelCovGeodetic (5908)."""
    return block(number, stamp(utc_s) + struct.pack("<BB10f", 4, 0, *variances, *[0.0] * 7))


def measurements(utc_s: float, *sets: tuple[int, np.ndarray], source: int = 32, info: int = 0) -> bytes:
    """Return ExtSensorMeas with measurements by their kind."""
    payload = stamp(utc_s) + struct.pack("<BB", len(sets), 28)
    for kind, xyz in sets:
        payload += struct.pack("<BBBB3d", source, 20, kind, info, *xyz.tolist())
    return block(4050, payload)


def blocks() -> list[bytes]:
    """Return the drive's blocks in the order of their times."""
    drive = sample_drive()
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    timed = []
    for time, gyro, accel in zip(drive.time.tolist(), drive.gyro, drive.accel, strict=True):
        timed.append((time, 0, measurements(EPOCH_UTC_S + time, (0, accel), (1, np.degrees(gyro)))))
    for time, velocity, llh in zip(drive.gnss_time.tolist(), drive.velocity_ned, drive.position_llh, strict=True):
        utc_s = EPOCH_UTC_S + time
        timed.append((time, 1, pvt(utc_s, velocity, llh)))
        timed.append((time, 2, covariance(5906, utc_s, (1e-4, 4e-4, 9e-4))))
        timed.append((time, 3, covariance(5908, utc_s, (1e-3, 4e-3, 9e-3))))
    return [content for _, _, content in sorted(timed, key=lambda t: t[:2])]


def write(folder: Path) -> Path:
    """Write the drive and return its path."""
    path = folder / "drive.sbf"
    path.write_bytes(b"".join(blocks()))
    return path
