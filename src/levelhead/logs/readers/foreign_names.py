"""What the columns of tables are called that follow no contract, and in which units they say they are.

A name is taken apart into words (``GyroX[deg/s]``, ``imu.gyro_x_dps`` and ``/imu/gyro/x`` all begin with "gyro"); what
is left when units and the path of a topic are taken off is looked up in one table.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from levelhead.conventions import (
    ACCEL_COLUMNS,
    AXES,
    CANONICAL_UNITS,
    GYRO_COLUMNS,
    TIME_COLUMN,
    UNIT_FACTORS,
    WHEEL_SPEED_COLUMN,
)
from levelhead.errors import LogError
from levelhead.logs.mapping import UP_COLUMN
from levelhead.logs.readers.columns import SINCE_1970

VELOCITY_XYZ: Final = ("velocity_x", "velocity_y", "velocity_z")
"""A velocity whose axes the header does not name by directions."""
SPEED, COURSE, SPEED_STD = "speed", "course", "speed_std"
POSITION_STD_H, POSITION_STD_V = "position_std_h", "position_std_v"
NANOSECONDS: Final = "nanoseconds"
"""The part of a stamp below the second, where a header has one column for whole seconds and one for this."""
FIX, FIX_TYPE, NAVSAT_STATUS = "fix", "fix_type", "navsat_status"

_UNITS: Final[Mapping[str, str]] = {
    **CANONICAL_UNITS,
    UP_COLUMN: "m/s",
    **dict.fromkeys(VELOCITY_XYZ, "m/s"),
    SPEED: "m/s",
    SPEED_STD: "m/s",
    COURSE: "deg",
    POSITION_STD_H: "m",
    POSITION_STD_V: "m",
}
"""The canonical unit of everything that a name can mean; what has none is a number without unit."""


def _with_axes(columns: Sequence[str], *words: str) -> dict[str, str]:
    return {f"{word}{axis}": column for word in words for axis, column in zip(AXES, columns, strict=True)}


def _all(column: str, *words: str) -> dict[str, str]:
    return dict.fromkeys(words, column)


_MEANINGS: Final[Mapping[str, tuple[str, int]]] = {
    name: (column, rank)
    for rank, table in enumerate(
        (
            {
                **_all(TIME_COLUMN, "headerstamp", "headertimestamp"),
                **_all("height", "ellipsoidalheight", "heightellipsoid", "altellipsoid", "hae", "hellipsoid"),
            },
            {
                **_all(TIME_COLUMN, "time", "timestamp", "stamp", "t", "ts", "unixtime", "epochtime", "systime"),
                **_all(TIME_COLUMN, "utctime", "timeutc", "timestamputc", "utc", "gpst", "gpsttime", "tow"),
                **_with_axes(GYRO_COLUMNS, "gyro", "gyr", "gyroscope", "g", "w", "omega", "angularvelocity", "angvel"),
                **_with_axes(GYRO_COLUMNS, "angularrate", "rotationrate", "angrate", "wrss", "gyros"),
                **_with_axes(ACCEL_COLUMNS, "accel", "acc", "a", "acceleration", "accelerometer", "linearacceleration"),
                **_with_axes(ACCEL_COLUMNS, "specificforce", "arss", "f"),
                **_all("lat", "lat", "latitude", "latdeg", "poslat"),
                **_all("lon", "lon", "lng", "long", "longitude", "poslon"),
                **_all("height", "height", "alt", "altitude", "elevation", "ele", "posalt"),
                **_all("vel_n", "veln", "vn", "velnorth", "velocitynorth", "northvelocity", "vnorth", "velocityn"),
                **_all("vel_e", "vele", "ve", "veleast", "velocityeast", "eastvelocity", "veast", "velocitye"),
                **_all("vel_d", "veld", "vd", "veldown", "velocitydown", "downvelocity", "vdown", "velocityd"),
                **_all(UP_COLUMN, "velu", "vu", "velup", "velocityup", "upvelocity", "vup", "velocityu"),
                **_with_axes(VELOCITY_XYZ, "vel", "v", "velocity", "twistlinear", "twisttwistlinear"),
                **_all(SPEED, "speed", "groundspeed", "speedoverground", "sog", "gspeed", "velocity", "spd"),
                **_all(COURSE, "course", "cog", "courseoverground", "headingmotion", "headmot", "track", "bearing"),
                **_all("vel_std", "velstd", "velocitystd", "velacc", "velocityaccuracy"),
                **_all(SPEED_STD, "speedaccuracy", "sacc", "speedacc", "speedstd"),
                **_all(POSITION_STD_H, "hacc", "horizontalaccuracy", "hstd", "horizontalstd", "posstd", "posacc"),
                **_all(POSITION_STD_V, "vacc", "verticalaccuracy", "vstd", "verticalstd"),
                **_all(FIX, "fixquality", "gpsquality", "fixvalid"),
                **_all(FIX_TYPE, "fixtype"),
                **_all(NAVSAT_STATUS, "statusstatus"),
                **_all(WHEEL_SPEED_COLUMN, "wheelspeed", "vehiclespeed", "odospeed"),
            },
            {
                **_all(
                    TIME_COLUMN, "elapsedtime", "timeelapsed", "elapsed", "secondselapsed", "relativetime", "timerel"
                ),
                **_all(
                    "height", "heightmsl", "altmsl", "altitudemsl", "hmsl", "mslaltitude", "altitudeabovemeansealevel"
                ),
            },
        )
    )
    for name, column in table.items()
}
"""Meaning and rank by the words of a name without blanks; of two columns with one meaning the lower rank is taken."""

_SPELLINGS: Final[Mapping[str, Mapping[str, str]]] = {
    "s": {
        **_all("s", "s", "sec", "secs", "second", "seconds"),
        **_all("ms", "ms", "msec", "millis", "milliseconds", "millisecond"),
        **_all("us", "us", "usec", "micros", "microseconds", "microsecond"),
        **_all("ns", "ns", "nsec", "nanos", "nanoseconds", "nanosecond", "nanosec"),
        **_all("min", "min"),
    },
    "rad/s": {
        **_all("rad/s", "rads", "radps", "radpersec", "radsec", "rads1"),
        **_all("mrad/s", "mrads"),
        **_all("deg/s", "degs", "dps", "degps", "degpersec", "degsec", "degs1"),
        **_all("deg/h", "degh", "degph", "dph", "deghr"),
    },
    "m/s^2": {
        **_all("m/s^2", "ms2", "mps2", "mss", "mpss", "mssq", "ms2"),
        **_all("g", "g", "gs", "gee"),
        **_all("mg", "mg"),
    },
    "m/s": {
        **_all("m/s", "ms", "mps", "ms1"),
        **_all("cm/s", "cms", "cmps"),
        **_all("mm/s", "mms", "mmps"),
        **_all("km/h", "kmh", "kph", "kmph"),
        **_all("knot", "knot", "knots", "kn", "kt", "kts"),
    },
    "deg": {**_all("deg", "deg", "degrees", "degree"), **_all("rad", "rad", "radians")},
    "m": {**_all("m", "m", "meter", "meters", "metre", "metres"), **_all("cm", "cm"), **_all("mm", "mm")},
}
"""How units are written, without signs and blanks, by the canonical unit."""

_PATH: Final = re.compile(r"[./:\s]+")
_WORDS: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_BRACKETS: Final = re.compile(r"\s*([^\[(]*?)\s*[\[(]([^\])]*)[\])]\s*")
_ABOUT_THE_SENSOR: Final = frozenset(
    ("field", "msg", "message", "data", "imu", "gps", "gnss", "rtk", "sensor", "sensors", "meas", "measured", "value")
)
"""Words at the beginning of a name that say where a number comes from, not what it is."""

_MAX_NAME: Final = 200
_MAX_WORDS: Final = 12
"""A name has fewer letters than this, and what it means stands in fewer words: each part of them is looked up."""


@dataclass(frozen=True, kw_only=True)
class Named:
    """A column whose name is understood: what it means, how sure the name is of that, and its unit where it has one."""

    column: str
    rank: int
    index: int
    unit: str | None


@dataclass(frozen=True, kw_only=True)
class NamedColumns:
    """The columns of a header that are understood, one for each meaning; `rivals` where there are several.

    Attributes
    ----------
    chosen : mapping
        By meaning.
    rivals : mapping
        Header cells that mean the same, by meaning.
    """

    chosen: Mapping[str, Named]
    rivals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def has(self, columns: Sequence[str]) -> bool:
        """Whether all these meanings are there."""
        return all(c in self.chosen for c in columns)


def understand(name: str, headers: Sequence[str], units: Sequence[str] = ()) -> NamedColumns:
    """Find what the columns of a header mean.

    Parameters
    ----------
    name : str
        The file's name, for errors.
    headers, units : sequence of str
        Header cells, and what a line under them says of units.

    Raises
    ------
    LogError
        On a unit in brackets that is not known, of a column whose name is understood.
    """
    found: dict[str, list[Named]] = {}
    for index, header in enumerate(headers):
        named = _named(name, header, units[index] if index < len(units) else "", index)
        if named is not None:
            found.setdefault(named.column, []).append(named)
    chosen, rivals = {}, {}
    for column, candidates in found.items():
        best = min(c.rank for c in candidates)
        same = [c for c in candidates if c.rank == best]
        chosen[column] = same[0]
        if column == TIME_COLUMN and [c.unit for c in same] == ["s", "ns"]:
            chosen[NANOSECONDS] = replace(same[1], column=NANOSECONDS)
        elif len(same) > 1:
            rivals[column] = tuple(headers[c.index] for c in same)
    return NamedColumns(chosen=chosen, rivals=rivals)


def factor_of(named: Named) -> float:
    """Return what turns the numbers of a column into its canonical unit, 1 where it declares none."""
    return 1.0 if named.unit is None else UNIT_FACTORS[_UNITS[named.column]][named.unit]


def _named(name: str, header: str, unit_below: str, index: int) -> Named | None:
    if len(header) > _MAX_NAME:
        return None
    match = _BRACKETS.fullmatch(header)
    text, declared = (match.group(1), match.group(2)) if match else (header, unit_below)
    parts = [part for part in _PATH.split(text) if part]
    words = [[w.lower() for w in _WORDS.findall(part)] for part in parts]
    for first in range(len(words)):
        rest = [w for part in words[first:] for w in part]
        meaning = _meaning(rest) if len(rest) <= _MAX_WORDS else None
        if meaning is None:
            continue
        column, rank, unit = meaning
        if declared in SINCE_1970 and column == TIME_COLUMN:
            unit = "s"
        elif declared and column in _UNITS:
            unit = _unit(column, declared)
            if unit is None and match is not None:
                known = ", ".join(UNIT_FACTORS[_UNITS[column]])
                raise LogError(
                    f"{name}: the unit {declared!r} of the column {header!r} is not known; use one of {known}, or a "
                    "mapping file (mapping=)."
                )
        return Named(column=column, rank=rank, index=index, unit=unit)
    return None


def _meaning(words: list[str]) -> tuple[str, int, str | None] | None:
    """Return meaning, rank and unit of a name's words: as they are, without what tells the sensor, without a unit."""
    while True:
        known = _MEANINGS.get("".join(words))
        if known is not None:
            return (*known, None)
        for start in range(1, len(words)):
            for end in range(len(words), start, -1):
                rest = _MEANINGS.get("".join(words[:start] + words[end:]))
                unit = None if rest is None else _unit(rest[0], "".join(words[start:end]))
                if rest is not None and unit is not None:
                    return (*rest, unit)
        if len(words) < 2 or words[0] not in _ABOUT_THE_SENSOR:
            return None
        words = words[1:]


def _unit(column: str, text: str) -> str | None:
    """Return a unit as `UNIT_FACTORS` spells it; None for one that this column cannot have."""
    plain = text.lower().replace("²", "2").replace("°", "deg").replace("µ", "u").replace("μ", "u")
    plain = plain.replace("sec", "s") if column != TIME_COLUMN else plain
    canonical = _UNITS.get(column)
    return None if canonical is None else _SPELLINGS[canonical].get(re.sub(r"[^a-z0-9]", "", plain))
