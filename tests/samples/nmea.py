"""The sample drive's GNSS as NMEA sentences, beside its IMU as canonical CSV that the same clock (UTC) stamps."""

from __future__ import annotations

import datetime as dt
import math
from pathlib import Path

import numpy as np

from levelhead.conventions import ACCEL_COLUMNS, GYRO_COLUMNS, TIME_COLUMN
from samples.cuts import last_cell, sentence_end
from samples.drive import EPOCH_UTC_S, sample_drive

KNOT = 1852.0 / 3600.0


def CUT_UNSEEN(name: str, content: bytes, length: int) -> bool:  # noqa: N802  # what `samples` calls it
    """Return whether a cut file of either format can pass for a whole one."""
    return (sentence_end if name.endswith(".nmea") else last_cell)(name, content, length)


def sentence(text: str) -> str:
    """Return a sentence with its checksum and line end."""
    total = 0
    for byte in text.encode():
        total ^= byte
    return f"${text}*{total:02X}\r\n"


def degrees(angle: float, width: int, sides: str) -> str:
    """Return degrees and minutes to 1e-7 of a minute, and the side."""
    whole, minutes = divmod(round(abs(math.degrees(angle)) * 60e7), 600_000_000)
    return f"{whole:0{width}d}{minutes / 1e7:010.7f},{sides[angle < 0]}"


def clock(utc_s: float) -> str:
    """Return the time of day, hhmmss.ss."""
    return dt.datetime.fromtimestamp(round(utc_s, 2), tz=dt.UTC).strftime("%H%M%S.%f")[:9]


def gga(utc_s: float, llh: np.ndarray, *, quality: int = 4, separation: float = 47.5) -> str:
    """Return a GGA sentence; the altitude counts from a sea level that lies `separation` above the ellipsoid."""
    lat, lon, height = (float(v) for v in llh)
    place = f"{degrees(lat, 2, 'NS')},{degrees(lon, 3, 'EW')}"
    return sentence(
        f"GNGGA,{clock(utc_s)},{place},{quality},20,0.6,{height - separation:.3f},M,{separation:.3f},M,1.0,0000"
    )


def course(velocity: np.ndarray) -> tuple[float, float]:
    """Return speed (m/s) and course (deg)."""
    return math.hypot(velocity[0], velocity[1]), math.degrees(math.atan2(velocity[1], velocity[0])) % 360.0


def rmc(utc_s: float, llh: np.ndarray, velocity: np.ndarray, *, status: str = "A") -> str:
    """Return an RMC sentence: knots to a thousandth, degrees to a hundredth."""
    speed, angle = course(velocity)
    day = dt.datetime.fromtimestamp(round(utc_s, 2), tz=dt.UTC).strftime("%d%m%y")
    place = f"{degrees(float(llh[0]), 2, 'NS')},{degrees(float(llh[1]), 3, 'EW')}"
    return sentence(f"GNRMC,{clock(utc_s)},{status},{place},{speed / KNOT:.3f},{angle:.2f},{day},,,R")


def vtg(velocity: np.ndarray) -> str:
    """Return a VTG sentence."""
    speed, angle = course(velocity)
    return sentence(f"GNVTG,{angle:.2f},T,,M,{speed / KNOT:.3f},N,{speed * 3.6:.3f},K,D")


def gst(utc_s: float) -> str:
    """Return a GST sentence: 1, 2 and 3 cm."""
    return sentence(f"GNGST,{clock(utc_s)},0.5,0.03,0.01,40.0,0.010,0.020,0.030")


def lines() -> list[str]:
    """Return the drive's sentences."""
    drive = sample_drive()
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    text = []
    for time, velocity, llh in zip(drive.gnss_time.tolist(), drive.velocity_ned, drive.position_llh, strict=True):
        utc_s = EPOCH_UTC_S + time
        text += [rmc(utc_s, llh, velocity), gga(utc_s, llh), gst(utc_s)]
    return text


def write(folder: Path) -> Path:
    """Write ``drive.imu.csv``, whose path is returned, and ``drive.gps.nmea``, which is found beside it."""
    (folder / "drive.gps.nmea").write_bytes("".join(lines()).encode())
    drive = sample_drive()
    table = np.column_stack((drive.time + EPOCH_UTC_S, drive.gyro, drive.accel)).tolist()
    rows = [",".join(f"{v:.9g}" if k else f"{v:.3f}" for k, v in enumerate(row)) for row in table]
    header = ",".join((f"{TIME_COLUMN}[UTC]", *GYRO_COLUMNS, *ACCEL_COLUMNS))
    (folder / "drive.imu.csv").write_text("\n".join([header, *rows, ""]))
    return folder / "drive.imu.csv"
