"""RTKLIB's time tags: when which byte of a recorded stream arrived, beside the recording as ``NAME.tag``.

A tag file is the text ``TIMETAG RTKLIB`` filled up to 64 bytes, the instant of the beginning in GPST (whole seconds
since 1970 as uint32, the rest as float64), and then pairs of uint32: milliseconds since the beginning, bytes received.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.logs.timescales import GPS_EPOCH_S

_MAGIC: Final = b"TIMETAG RTKLIB"
_START: Final = struct.Struct("<Id")
_START_AT: Final = 64
_MAX_SCATTER_S: Final = 0.05
"""Lines whose arrivals scatter by more (median) about a host's clock were not stamped by it."""
_MIN_COVERED: Final = 0.5
"""Share of the lines that must lie within the bytes that the tags count."""


def zero_of_clock(tag: Path, ends: NDArray[np.int64], lines: NDArray[np.int64], stamps: FloatArray) -> float | None:
    """Return what a host's clock lacks to GPST, by when its lines had arrived.

    Parameters
    ----------
    tag : Path
        The tag file.
    ends : ndarray, shape (k,)
        Bytes of the recording up to the end of each of its lines, line end included.
    lines : ndarray, shape (n,)
        The lines (from 0) that have a stamp.
    stamps : ndarray, shape (n,)
        Their stamps by the host's clock, s.

    Returns
    -------
    float or None
        Seconds since 1970 in GPST at which the host's clock read zero; None where the tags are damaged or of another
        recording.
    """
    content = tag.read_bytes()
    if len(content) < _START_AT + _START.size + 8 or not content.startswith(_MAGIC):
        return None
    whole, fraction = _START.unpack_from(content, _START_AT)
    if whole < GPS_EPOCH_S or not 0.0 <= fraction < 1.0:
        return None
    pairs = content[_START_AT + _START.size :]
    ticks, received = np.frombuffer(pairs[: len(pairs) // 8 * 8], dtype="<u4").reshape(-1, 2).astype(np.int64).T
    if (np.diff(received) < 0).any() or (np.diff(ticks) < 0).any():
        return None
    best: tuple[float, float] | None = None
    # The stream may have had a line end of two bytes of which the file kept one.
    for lost in (0, 1):
        place = np.searchsorted(received, ends[lines] + lost * (lines + 1))
        covered = place < received.size
        if covered.mean() < _MIN_COVERED:
            continue
        lag = ticks[place[covered]] / 1000.0 - stamps[covered]
        zero = float(np.median(lag))
        scatter = float(np.median(np.abs(lag - zero)))
        if best is None or scatter < best[0]:
            best = (scatter, zero)
    return None if best is None or best[0] > _MAX_SCATTER_S else float(whole + fraction + best[1])
