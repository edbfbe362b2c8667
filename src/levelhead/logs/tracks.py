"""Tracks for other programs: where a vehicle was, as KML, GeoJSON and RTKLIB solution."""

from __future__ import annotations

import itertools
import json
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from levelhead.atomic import atomic_path
from levelhead.conventions import FloatArray
from levelhead.earth import shortest_turn
from levelhead.errors import LogError, UsageError
from levelhead.logs.datum import DATUM_KEY, HEIGHT_KEY, MEAN_SEA_LEVEL, WGS84
from levelhead.logs.log import Log
from levelhead.logs.timescales import GPS_EPOCH_S, TIME_SCALES
from levelhead.version import __version__

BoolArray = NDArray[np.bool_]

SINGLE: Final = 5
"""RTKLIB's quality that claims least; a log does not keep what kind of fix a position came from."""
DEAD_RECKONING: Final = 7
"""RTKLIB's quality of what was carried on without GNSS."""
ANGLE_DIGITS: Final = 9
"""Decimals of a degree in every file: 0.1 mm."""
HEIGHT_DIGITS: Final = 4

_UNPRINTABLE: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")
"""Characters that XML forbids or that would end a header line; file names may hold them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Places in time order, and what is known of them; rows without a position are not part of a track.

    Attributes
    ----------
    name : str
        Of the log, for people; whatever would break a file is replaced.
    point : str
        What was at these places: ``GNSS antenna``, ``IMU``, ``reference point``.
    time : ndarray, shape (m,)
        Seconds on the log's clock, strictly increasing.
    position_llh : ndarray, shape (m, 3)
        Latitude (rad), longitude (rad), height (m).
    position_std, velocity_ned, velocity_std : ndarray, shape (m, 3), or None
        One sigma along North, East, Down (m); velocity and its sigma (m/s); NaN where not known.
    coasting : ndarray of bool, shape (m,), or None
        Where no GNSS was at work; None where it always was.
    meta : mapping
        `Log.meta`: ``epoch``, ``gnss_time_scale``, ``datum`` and ``height`` are used.
    """

    name: str
    point: str
    time: FloatArray
    position_llh: FloatArray
    position_std: FloatArray | None = None
    velocity_ned: FloatArray | None = None
    velocity_std: FloatArray | None = None
    coasting: BoolArray | None = None
    meta: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", _UNPRINTABLE.sub("\ufffd", self.name))
        if self.time.size < 2:
            raise LogError(f"{self.name} has {self.time.size} positions; a track needs two at least.")

    @property
    def epoch(self) -> float | None:
        """Seconds from 1970 to the log's zero; None where its clock is not known to be a calendar's."""
        value = self.meta.get("epoch")
        # Less is the reading of some counter: no GNSS receiver ran before GPS time began.
        return float(value) if isinstance(value, int | float) and value >= GPS_EPOCH_S else None

    def rows(self, keep: BoolArray) -> Track:
        """Return the track of some of its rows."""

        def pick(values: FloatArray | None) -> FloatArray | None:
            return None if values is None else values[keep]

        return replace(
            self,
            time=self.time[keep],
            position_llh=self.position_llh[keep],
            position_std=pick(self.position_std),
            velocity_ned=pick(self.velocity_ned),
            velocity_std=pick(self.velocity_std),
            coasting=None if self.coasting is None else self.coasting[keep],
        )


def track_of_log(log: Log) -> Track:
    """Return the GNSS positions of a log; a LogError says that it has none."""
    name = str(log.meta.get("source", "log"))
    if log.position_llh is None or not np.isfinite(log.position_llh).any():
        raise LogError(f"{name} has no GNSS positions, so that there is no track to write; record positions too.")
    keep = np.isfinite(log.position_llh).all(axis=1)

    def columns(std: FloatArray | None) -> FloatArray | None:
        if std is None:
            return None
        return std[keep] if std.ndim == 2 else np.repeat(std[keep, np.newaxis], 3, axis=1)

    return Track(
        name=name,
        point="GNSS antenna",
        time=log.gnss_time[keep],
        position_llh=log.position_llh[keep],
        position_std=columns(log.position_std),
        velocity_ned=None if log.velocity_ned is None else log.velocity_ned[keep],
        velocity_std=columns(log.velocity_std),
        meta=log.meta,
    )


def thinned(track: Track, every: float) -> Track:
    """Return the first position of every `every` seconds, and the last of all; all of them where `every` is 0.

    Raises
    ------
    UsageError
        When `every` is negative or not a number.
    """
    if not 0.0 <= every < np.inf:
        raise UsageError(f"One position every {every:g} s cannot be; pass 0 for all of them, or a number of seconds.")
    if every == 0.0:
        return track
    # A stamp at the very edge, such as 0.3 of 0.1, belongs to the new span in spite of its rounding.
    span = np.floor((track.time - track.time[0]) / every + 1e-6)
    keep = np.concatenate(([True], np.diff(span) > 0.0))
    keep[-1] = True
    return track.rows(keep)


def write_track(track: Track, path: str | os.PathLike[str]) -> None:
    """Write a track in the format that the suffix of `path` names, whole or not at all.

    Raises
    ------
    UsageError
        On a suffix that is not in `TRACK_WRITERS`.
    OutputError
        When the file cannot be written.
    """
    target = Path(path)
    if target.suffix not in TRACK_WRITERS:
        raise UsageError(f"{target.name}: a track is written as {', '.join(TRACK_WRITERS)}.")
    text = TRACK_WRITERS[target.suffix](track)
    with atomic_path(target) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def _stretches(track: Track) -> list[tuple[bool, slice]]:
    """Return the stretches with GNSS (True) and without; each reaches to the next one's first position."""
    size = track.time.size
    coasting = np.zeros(size, dtype=np.bool_) if track.coasting is None else track.coasting
    edges = [0, *(int(k) + 1 for k in np.flatnonzero(coasting[1:] != coasting[:-1])), size]
    stretches = [(not coasting[begin], slice(begin, min(end + 1, size))) for begin, end in itertools.pairwise(edges)]
    # A last stretch of one position is a line of no length, and the end of the one before.
    return [(aided, rows) for aided, rows in stretches if rows.stop - rows.start > 1]


def _lines(track: Track, rows: slice) -> list[FloatArray]:
    """Return longitude (deg, within 180), latitude (deg) and height (m) of a stretch, cut at the antimeridian."""
    latitude, longitude, height = track.position_llh[rows].T
    points = np.column_stack((np.degrees(shortest_turn(longitude)), np.degrees(latitude), height))
    lines, first, lead = [], 0, points[:0]
    for k in np.flatnonzero(np.abs(np.diff(points[:, 0])) > 180.0):
        here, there = points[k], points[k + 1]
        side = np.copysign(180.0, here[0])
        span = there[0] + 2.0 * side - here[0]
        edge = here + (there - here) * ((side - here[0]) / span if span else 0.0)
        lines.append(np.vstack((lead, points[first : k + 1], (side, *edge[1:]))))
        first, lead = int(k) + 1, np.array([(-side, *edge[1:])])
    return [*lines, np.vstack((lead, points[first:]))]


def _geojson(track: Track) -> str:
    """Return RFC 7946: one feature per stretch; a line over the antimeridian is cut in two (section 3.1.9)."""

    def feature(aided: bool, rows: slice) -> dict[str, object]:
        lines = [
            [[round(x, ANGLE_DIGITS), round(y, ANGLE_DIGITS), round(h, HEIGHT_DIGITS)] for x, y, h in line.tolist()]
            for line in _lines(track, rows)
        ]
        geometry: dict[str, object] = {"type": "LineString", "coordinates": lines[0]}
        if len(lines) > 1:
            geometry = {"type": "MultiLineString", "coordinates": lines}
        start, end = float(track.time[rows.start]), float(track.time[rows.stop - 1])
        about = {"name": track.name, "point": track.point, "aided": aided, "start_s": start, "end_s": end}
        return {"type": "Feature", "properties": about, "geometry": geometry}

    features = [feature(aided, rows) for aided, rows in _stretches(track)]
    document = {"type": "FeatureCollection", "features": features}
    return json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n"


_KML_STYLES: Final = {True: ("aided", "ff3c8f2e", "With GNSS"), False: ("coasting", "ff2b52d9", "Without GNSS")}
"""Identifier, colour (alpha, blue, green, red) and words for stretches that are aided, or are not."""


def _kml(track: Track) -> str:
    """Return KML 2.2: one document, one placemark per stretch."""
    heights = track.meta.get(HEIGHT_KEY) or "as the log has them"
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2">',
        "<Document>",
        f"<name>{escape(track.name)}</name>",
        f"<description>{escape(f'Path of the {track.point}. Heights: {heights}.')}</description>",
    ]
    for style, colour, _ in _KML_STYLES.values():
        lines.append(f'<Style id="{style}"><LineStyle><color>{colour}</color><width>3</width></LineStyle></Style>')
    for aided, rows in _stretches(track):
        style, _, words = _KML_STYLES[aided]
        span = f"{track.time[rows.start]:.1f} to {track.time[rows.stop - 1]:.1f} s"
        lines += [f"<Placemark><name>{words}, {span}</name><styleUrl>#{style}</styleUrl><MultiGeometry>"]
        for line in _lines(track, rows):
            places = " ".join(f"{x:.{ANGLE_DIGITS}f},{y:.{ANGLE_DIGITS}f},{h:.{HEIGHT_DIGITS}f}" for x, y, h in line)
            mode = "<altitudeMode>absolute</altitudeMode>"
            lines.append(f"<LineString>{mode}<coordinates>{places}</coordinates></LineString>")
        lines.append("</MultiGeometry></Placemark>")
    return "\n".join([*lines, "</Document>", "</kml>", ""])


_POS_NAMES: Final = "latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  "
_POS_VELOCITY_NAMES: Final = "    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu    sdvne    sdveu    sdvun"
_POS_LINE: Final = "%s  %14.9f %14.9f %10.4f %3d   0 %8.4f %8.4f %8.4f   0.0000   0.0000   0.0000   0.00    0.0"
_POS_VELOCITY: Final = " %10.5f %10.5f %10.5f %9.5f %8.5f %8.5f  0.00000  0.00000  0.00000"


def _pos(track: Track) -> str:
    """Return RTKLIB's solution: up for down, 0 for a sigma that is not known; satellites and covariances are not."""
    scale, remarks = _time_scale(track)
    velocity = track.velocity_ned
    if velocity is not None and not np.isfinite(velocity).all():
        remarks.append("% velocity  : left out, because some positions have none")
        velocity = None
    coasting = np.zeros(track.time.size, dtype=np.bool_) if track.coasting is None else track.coasting
    quality = np.where(coasting, DEAD_RECKONING, SINGLE)
    llh = track.position_llh
    angles = np.degrees(np.column_stack((llh[:, 0], shortest_turn(llh[:, 1]))))
    columns = [angles, llh[:, 2:], quality[:, np.newaxis], _printable(track.position_std, track.time.size, 1e-4)]
    if velocity is not None:
        columns += [velocity * (1.0, 1.0, -1.0), _printable(track.velocity_std, track.time.size, 1e-5)]
    form = _POS_LINE if velocity is None else _POS_LINE + _POS_VELOCITY
    height = "geodetic" if track.meta.get(HEIGHT_KEY) == MEAN_SEA_LEVEL else "ellipsoidal"
    header = [
        f"% program   : levelhead {__version__}",
        f"% inp file  : {track.name}",
        f"% point     : {track.point}",
        *remarks,
        f"% quality   : {SINGLE} stands for a fix of any kind, {DEAD_RECKONING} for dead reckoning; ns is not known",
        "%",
        f"% (lat/lon/height={track.meta.get(DATUM_KEY, WGS84)}/{height},"
        "Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,7:dr,ns=# of satellites)",
        f"%  {scale:<25} {_POS_NAMES}sdun(m) age(s)  ratio{'' if velocity is None else _POS_VELOCITY_NAMES}",
    ]
    stamps = _calendar(track)
    body = [form % (stamp, *row) for stamp, row in zip(stamps, np.hstack(columns).tolist(), strict=True)]
    return "\n".join([*header, *body, ""])


def _time_scale(track: Track) -> tuple[str, list[str]]:
    """Return the name for the header's time column, and what must be said about the time."""
    if track.epoch is None:
        return "GPST", [
            "% time      : not known absolutely; 1980/01/06 00:00:00 (GPS week 0, second 0) is the log's zero"
        ]
    scale = track.meta.get("gnss_time_scale")
    if scale in TIME_SCALES:
        return str(scale), []
    return "GPST", ["% time      : the log does not name its time scale; taken as that of GPS"]


def _calendar(track: Track) -> list[str]:
    """Return stamps to the microsecond: a coarser one would move a vehicle further than the last digit of a place."""
    epoch = GPS_EPOCH_S if track.epoch is None else track.epoch
    whole = np.floor(epoch)
    microseconds = np.rint((epoch - whole + track.time) * 1e6).astype(np.int64) + int(whole) * 1_000_000
    texts = np.datetime_as_string(microseconds.astype("datetime64[us]"))
    return [str(text).replace("-", "/").replace("T", " ") for text in texts]


def _printable(std: FloatArray | None, size: int, smallest: float) -> FloatArray:
    """Return sigmas that print as 0 only where they are not known: `smallest` is one of the last digit."""
    if std is None:
        return np.zeros((size, 3))
    return np.where(np.isfinite(std), np.maximum(std, smallest), 0.0)


TRACK_WRITERS: Final[dict[str, Callable[[Track], str]]] = {".kml": _kml, ".geojson": _geojson, ".pos": _pos}
"""The text of a track by the suffix of its file."""
