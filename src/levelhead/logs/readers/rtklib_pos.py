"""RTKLIB's solution file ``.pos``: GNSS only, geodetic positions and, where configured, velocities.

Header lines begin with ``%``; the last one names the columns. Times are calendar or GPS week and second, in GPST or
UTC; `vu` is UP. See RTKLIB's manual, appendix B.1.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.logs.datum import ELLIPSOIDAL, MEAN_SEA_LEVEL, declared
from levelhead.logs.pieces import GnssData, Pieces, none_if_absent
from levelhead.logs.readers.base import Reader, Source, content_of, shown, shown_names
from levelhead.logs.readers.csv_table import is_text
from levelhead.logs.readers.receivers import known_std
from levelhead.logs.timescales import gps_instant

_COLUMN_LINE = re.compile(rb"^%\s*(GPST|UTC|JST)\b(.*)$", re.MULTILINE)
_DATUM_LINE = re.compile(rb"^%\s*\(lat/lon/height=([^/,)\r\n]*)/([^,)\r\n]*)", re.MULTILINE)
_HEIGHTS: Final = {"ellipsoidal": ELLIPSOIDAL, "geodetic": MEAN_SEA_LEVEL}
"""RTKLIB's words for what heights count from; "geodetic" are those over its geoid model."""
_STAMP: Final = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{0,12})?", re.ASCII)
_IN_NUMBERS: Final = frozenset("0123456789+-.eE")
_POSITION: Final = ("latitude", "longitude", "height")


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the text has RTKLIB's line of column names, or its program line."""
    return is_text(head) and head.startswith(b"%") and (b"RTKLIB" in head or _COLUMN_LINE.search(head) is not None)


def read(source: Source) -> Pieces:
    """Read a ``.pos`` file; times become seconds since 1970 in the file's own time scale.

    Raises
    ------
    LogError
        On formats without latitude, longitude and height in degrees, on datums that are not WGS84 or within a metre of
        it, and on lines that are no solution.
    """
    name = source.path.name
    content = content_of(source.path)
    scale, names = _column_names(name, content)
    meta = _datum(name, content)
    lines, numbers_of, left_out = _solution_lines(content, len(names) + 2)
    words = _words(lines, numbers_of, name, len(names) + 2)
    if not words:
        raise LogError(f"{name}: the file has a header but no solution; check RTKLIB's processing.")
    time = _times(name, words[0], words[1], numbers_of)
    values = {n: _numbers(name, n, words[k + 2], numbers_of) for k, n in enumerate(names) if n in _USED}
    _check_globe(name, values, numbers_of)
    llh = np.column_stack([values[n] for n in _POSITION])
    gnss = GnssData(
        time=time,
        velocity_ned=_triple(values, ("vn", "ve", "vu"), down=-1.0),
        velocity_std=_deviations(values, ("sdvn", "sdve", "sdvu")),
        position_llh=np.column_stack((np.radians(llh[:, :2]), llh[:, 2])),
        position_std=_deviations(values, ("sdn", "sde", "sdu")),
        time_scale=scale,
    )
    return Pieces(gnss=gnss, left_out=left_out, meta={"gnss_time_scale": scale, **meta})


_USED: Final = frozenset((*_POSITION, "vn", "ve", "vu", "sdvn", "sdve", "sdvu", "sdn", "sde", "sdu"))


def _column_names(name: str, content: bytes) -> tuple[str, list[str]]:
    """Return the time scale and the names of the columns after the time, without their units."""
    matches = list(_COLUMN_LINE.finditer(content))
    if not matches:
        raise LogError(f'{name}: no header line names the columns ("%  GPST  latitude(deg) ..."); export with header.')
    text = matches[-1].group(2).decode("utf-8", errors="replace").replace(",", " ")
    names = text.split()
    if "latitude(deg)" not in names or "longitude(deg)" not in names:
        raise LogError(
            f"{name}: the solutions are not latitude, longitude and height in degrees (the columns are "
            f"{shown_names(names[:3])}); set RTKLIB's out-solformat = llh and out-degform = deg."
        )
    return matches[-1].group(1).decode(), [n.partition("(")[0] for n in names]


def _datum(name: str, content: bytes) -> dict[str, object]:
    """Return the datum and the height reference of the header line ``% (lat/lon/height=WGS84/ellipsoidal,...)``."""
    line = _DATUM_LINE.search(content)
    if line is None:
        return {}
    datum, height = (text.decode("utf-8", errors="replace").strip() for text in line.groups())
    return declared(name, datum=datum, height=_HEIGHTS.get(height, height))


def _check_globe(name: str, values: dict[str, FloatArray], numbers_of: Sequence[int]) -> None:
    for column, limit in (("latitude", 90.0), ("longitude", 360.0)):
        beyond = np.flatnonzero(np.abs(values[column]) > limit)
        if beyond.size:
            raise LogError(
                f"{name}, line {numbers_of[int(beyond[0])]}: the {column} is beyond {limit:g} degrees ({beyond.size} "
                "such lines in all); repair or remove the line."
            )


def _solution_lines(content: bytes, width: int) -> tuple[list[bytes], list[int], int]:
    """Return the solution lines with their line numbers; a cut last line is left out and counted."""
    body = content.rstrip(b"\r\n\0")
    numbered = [
        (number, line.replace(b",", b" "))
        for number, line in enumerate(body.split(b"\n"), 1)
        if line.strip() and not line.startswith(b"%")
    ]
    # RTKLIB ends every line: a last one without end, or too short, was cut.
    ended = content.endswith(b"\n")
    left_out = 0
    if numbered and (not ended or len(numbered[-1][1].split()) < width):
        numbered.pop()
        left_out = 1
    return [line for _, line in numbered], [number for number, _ in numbered], left_out


def _words(lines: Sequence[bytes], numbers_of: Sequence[int], name: str, width: int) -> list[tuple[str, ...]]:
    """Return the columns of words."""
    rows = [line.decode("utf-8", errors="replace").split() for line in lines]
    for row, number in zip(rows, numbers_of, strict=True):
        if len(row) != width:
            raise LogError(
                f"{name}, line {number}: the line has {len(row)} columns where {width} are expected; repair or remove "
                "the line."
            )
    return list(zip(*rows, strict=True))


def _times(name: str, days: Sequence[str], clocks: Sequence[str], numbers_of: Sequence[int]) -> FloatArray:
    """Return seconds since 1970: from ``yyyy/mm/dd hh:mm:ss.sss``, or from GPS week and second of the week."""
    if "/" not in days[0]:
        week = _numbers(name, "week", days, numbers_of)
        return gps_instant(week, _numbers(name, "second of the week", clocks, numbers_of))
    stamps = [f"{day.replace('/', '-')}T{clock}" for day, clock in zip(days, clocks, strict=True)]
    try:
        if not all(map(_STAMP.fullmatch, stamps)):
            raise ValueError
        instants = np.array(stamps, dtype="datetime64[us]")
    except ValueError:
        bad = next(k for k, stamp in enumerate(stamps) if not _is_instant(stamp))
        raise LogError(
            f"{name}, line {numbers_of[bad]}: {shown(f'{days[bad]} {clocks[bad]}')} is not a time; repair or remove "
            "the line."
        ) from None
    return instants.astype(np.int64).astype(np.float64) / 1e6


def _is_instant(text: str) -> bool:
    if _STAMP.fullmatch(text) is None:
        return False
    try:
        np.datetime64(text, "us")
    except ValueError:
        return False
    return True


def _numbers(name: str, column: str, texts: Sequence[str], numbers_of: Sequence[int]) -> FloatArray:
    try:
        # Python would also take 1_0 and the digits of other scripts.
        if not _IN_NUMBERS.issuperset("".join(texts)):
            raise ValueError
        values = np.array(list(map(float, texts)))
    except ValueError:
        values = np.array([_number_or_nan(text) for text in texts])
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        k = int(bad[0])
        raise LogError(
            f"{name}, line {numbers_of[k]}: the column {column} holds {shown(texts[k])} where a number is expected; "
            "repair or remove the line."
        )
    return values


def _number_or_nan(text: str) -> float:
    try:
        return float(text) if _IN_NUMBERS.issuperset(text) else float("nan")
    except ValueError:
        return float("nan")


def _triple(values: dict[str, FloatArray], names: tuple[str, str, str], *, down: float = 1.0) -> FloatArray | None:
    if any(n not in values for n in names):
        return None
    north, east, vertical = (values[n] for n in names)
    return np.column_stack((north, east, down * vertical))


def _deviations(values: dict[str, FloatArray], names: tuple[str, str, str]) -> FloatArray | None:
    """Return standard deviations; RTKLIB writes 0 where it knows none."""
    triple = _triple(values, names)
    return None if triple is None else none_if_absent(known_std(triple))


READER: Final = Reader(name="rtklib-pos", title="RTKLIB solution (.pos)", sniff=sniff, read=read)
