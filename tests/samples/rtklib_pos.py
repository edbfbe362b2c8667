"""The GNSS data of the drive as RTKLIB's solution, with velocities."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from samples.cuts import line_end
from samples.drive import EPOCH_UTC_S, sample_drive

GNSS_ONLY = True
CUT_UNSEEN = line_end

HEADER = """\
% program   : RTKLIB ver.2.4.3
% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)
%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu    sdvne    sdveu    sdvun
"""  # noqa: E501  # RTKLIB writes it so
GPST_AHEAD_S = 18
"""Leap seconds in 2025."""


def write(folder: Path) -> Path:
    """Write every epoch with the digits that RTKLIB writes: 1 ms, 0.1 mm, 1e-5 m/s."""
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    start = np.datetime64(int(EPOCH_UTC_S) + GPST_AHEAD_S, "s").astype("datetime64[ms]")
    lines = [HEADER]
    for time, (lat, lon, height), (north, east, down) in zip(
        log.gnss_time, log.position_llh, log.velocity_ned, strict=True
    ):
        stamp = str(start + np.timedelta64(round(time * 1e3), "ms")).replace("-", "/").replace("T", " ")
        lines.append(
            f"{stamp} {np.degrees(lat):14.9f} {np.degrees(lon):14.9f} {height:10.4f} {1:3d} {14:3d} "
            f"{0.02:8.4f} {0.02:8.4f} {0.03:8.4f} {0.0:8.4f} {0.0:8.4f} {0.0:8.4f} {0.0:6.2f} {20.0:6.1f} "
            f"{north:10.5f} {east:10.5f} {-down:10.5f} {0.03:9.5f} {0.03:8.5f} {0.05:8.5f} "
            f"{0.0:8.5f} {0.0:8.5f} {0.0:8.5f}\n"
        )
    path = folder / "drive.pos"
    path.write_text("".join(lines), encoding="ascii")
    return path
