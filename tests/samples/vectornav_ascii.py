"""The drive as a terminal wrote VectorNav's ASCII messages down, each behind the computer's stamp."""

from __future__ import annotations

import functools
import operator
from pathlib import Path

import numpy as np

from samples.cuts import sentence_end
from samples.drive import EPOCH_UTC_S, sample_drive

CUT_UNSEEN = sentence_end


def message(text: str) -> str:
    """Return a message with its checksum: the exclusive or of what is between $ and *."""
    return f"${text}*{functools.reduce(operator.xor, text.encode()):02X}"


def write(folder: Path) -> Path:
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    lines = []
    for time, accel, gyro in zip(log.time, log.accel, log.gyro, strict=True):
        readings = ",".join([*(f"{v:+08.3f}" for v in accel), *(f"{v:+010.6f}" for v in gyro)])
        lines.append((time, message(f"VNIMU,+00.3680,+00.0938,-00.0480,{readings},+20.7,+084.322")))
    for time, (lat, lon, height), velocity in zip(log.gnss_time, log.position_llh, log.velocity_ned, strict=True):
        place = f"{np.degrees(lat):+012.8f},{np.degrees(lon):+013.8f},{height:+010.3f}"
        speeds = ",".join(f"{v:+08.3f}" for v in velocity)
        text = f"VNGPS,{473243.0 + time:013.6f},2372,3,12,{place},{speeds},+000.500,+000.500,+000.900,+000.050,2.10E-08"
        lines.append((time, message(text)))
    lines.sort(key=operator.itemgetter(0))
    path = folder / "vn.log"
    path.write_text("".join(f"{EPOCH_UTC_S + time:.6f} {text}\r\n" for time, text in lines), encoding="ascii")
    return path
