"""Two files of one drive: the GNSS file that lies beside an IMU file and whose name goes with it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from levelhead.errors import UsageError

_IMU: Final = re.compile(r"(?<![A-Za-z])imu(?:data)?(?![A-Za-z])", re.IGNORECASE)
_GNSS: Final = r"(?:gnss|gps|rtk)(?:data)?"
_SUFFIXES: Final = (".csv", ".txt", ".parquet", ".pos", ".nmea", ".ubx", ".sbf", ".mat")


def find_sibling(path: Path) -> Path | None:
    """Return the GNSS file of an IMU file: ``gps_7_sf.pos`` beside ``imu_7.csv``, ``a_gps.csv`` beside ``a_imu.csv``.

    The name must be the same with gnss, gps or rtk in the place of imu; behind it anything may follow.

    Raises
    ------
    UsageError
        When several files fit.
    """
    match = _IMU.search(path.stem)
    try:
        if match is None or not path.is_file():
            return None
        beside = sorted(p for p in path.parent.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file())
    except OSError:
        # A folder whose files may be read but not listed, or a name that no file can have.
        return None
    before, after = re.escape(path.stem[: match.start()]), re.escape(path.stem[match.end() :])
    pattern = re.compile(f"{before}{_GNSS}{after}(?![A-Za-z0-9]).*", re.IGNORECASE)
    fitting = [p for p in beside if pattern.fullmatch(p.stem)]
    exact = [p for p in fitting if p.suffix == path.suffix] or fitting
    if len(exact) > 1:
        raise UsageError(
            f"Several GNSS files go with {path.name}: {', '.join(p.name for p in exact)}; choose one with gnss=."
        )
    return exact[0] if exact else None
