"""The drive as SBG's sbgBasicLogger exports it: a folder of tab-separated texts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from samples.cuts import sentence_end
from samples.drive import sample_drive

CUT_UNSEEN = sentence_end
KEEPS_PREFIX = False
CLOCK_TOLERANCE_S = 0.005
"""Of an epoch whose velocity is gone the position remains, which is stamped 4 ms later, and the other way round."""
START_US = 2**32 - 12_345_678
"""The device was on for 71 minutes: its counter begins anew during the drive."""
GOOD, NONE = "0x00000080", "0x00000001"
"""A Doppler velocity (also: a single point) was computed; not enough satellites."""


def _table(path: Path, titles: str, units: str, rows: list[str]) -> Path:
    path.write_text("\n".join((titles.replace(" ", "\t"), units.replace(" ", "\t"), *rows)) + "\n", encoding="ascii")
    return path


def write(folder: Path) -> Path:
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None

    def stamp(time: float) -> str:
        return f"{(START_US + round(1e6 * time)) % 2**32:10d}"

    path = _table(
        folder / "imuData.txt",
        "timestamp status accelX accelY accelZ gyroX gyroY gyroZ temperature",
        "(us) (na) (m.s^-2) (m.s^-2) (m.s^-2) (deg.s^-1) (deg.s^-1) (deg.s^-1) (degC)",
        [
            "\t".join((stamp(t), "0x0000037f", *(f"{v:.9f}" for v in (*accel, *np.degrees(gyro))), "31.250000000"))
            for t, accel, gyro in zip(log.time, log.accel, log.gyro, strict=True)
        ],
    )
    tows = [round(240_000_000 + 1e3 * t) for t in log.gnss_time]
    _table(
        folder / "gnss1Vel.txt",
        "timestamp status gpsTow velN velE velD velStdN velStdE velStdD track trackStd",
        "(us) (na) (ms) (m.s^-1) (m.s^-1) (m.s^-1) (m.s^-1) (m.s^-1) (m.s^-1) (deg) (deg)",
        [
            "\t".join((stamp(t), GOOD if k else NONE, str(tow), *(f"{x:.9f}" for x in (*v, 0.05, 0.05, 0.1, 0.0, 1.0))))
            for k, (t, tow, v) in enumerate(zip(log.gnss_time, tows, log.velocity_ned, strict=True))
        ],
    )
    degrees = np.column_stack((np.degrees(log.position_llh[:, :2]), log.position_llh[:, 2]))
    _table(
        folder / "gnss1Pos.txt",
        "timestamp status statusExt gpsTow latitude longitude altitude undulation latitudeStd longitudeStd altitudeStd "
        "numSvTracked numSvUsed baseStationId diffAge nrDiagReboots upTime",
        "(us) (na) (na) (ms) (deg) (deg) (m) (m) (m) (m) (m) (na) (na) (na) (0.01s) (na) (s)",
        [
            "\t".join(
                (stamp(t + 0.004), GOOD, "0x00000000", str(tow), *(f"{x:.9f}" for x in (*p, 47.0, 0.5, 0.5, 0.9)))
            )
            + "\t20\t18\t65535\t65535\t0\t4500"
            for t, tow, p in zip(log.gnss_time, tows, degrees, strict=True)
        ],
    )
    return path
