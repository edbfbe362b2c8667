"""All that levelhead knows of datums and height references: which it takes, which it refuses, and how it says so.

levelhead takes latitude, longitude and height as it finds them and converts nothing. That is right for WGS84 and for
what lies within a metre of it; positions of another datum would put a vehicle tens or hundreds of metres beside its
place, so a log that declares one is refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from levelhead.errors import LogError, printable

DATUM_KEY: Final = "datum"
"""Key of `Log.meta`, of a mapping's ``[gnss]`` section and of Parquet metadata."""
HEIGHT_KEY: Final = "height"
"""The same for what the heights count from."""

WGS84: Final = "WGS84"
ELLIPSOIDAL: Final = "ellipsoidal"
MEAN_SEA_LEVEL: Final = "mean sea level"
HEIGHTS: Final = (ELLIPSOIDAL, MEAN_SEA_LEVEL)

MAX_NAME: Final = 60
"""Characters of a declared name that are shown at most."""

_GLOBAL: Final = re.compile(r"WGS(19)?84(G\d+)?|EPSG(4326|4979)|ITRF(\d\d|\d{4})|IG[SB]\w?(\d\d|\d{4})|PZ9011|CGCS2000")
"""Frames that move with no plate: realisations of one, some centimetres apart."""
_PLATES: Final = re.compile(r"ETRS89|ETRF(\d\d|\d{4})|RGF93|GDA2020|SIRGAS2000|JGD2011|KGD2002")
"""Frames that are tied to a plate, or to a date: less than a metre from WGS84, but not the same."""

_OTHER: Final[dict[str, str]] = {
    "NAD27": "up to 200 m",
    "NAD83": "1 to 2 m",
    "ED50": "100 to 200 m",
    "TOKYO": "some 400 m",
    "PULKOVO": "some 100 m",
    "SK42": "some 100 m",
    "SK95": "some 100 m",
    "GCJ02": "100 to 700 m, differently at every place,",
    "BD09": "up to 1 km, differently at every place,",
    "OSGB36": "some 100 m",
    "OSGB1936": "some 100 m",
    "AGD": "some 200 m",
    "GDA94": "up to 2 m",
    "CH1903": "some 100 m",
    "DHDN": "some 100 m",
    "MGI": "some 100 m",
    "NTF": "some 100 m",
}
"""Datums that logs are known to come in, and how far the same numbers lie from the place in WGS84."""


def checked_datum(where: str, datum: str) -> str:
    """Return a datum's name if its positions may be taken as WGS84.

    Parameters
    ----------
    where : str
        Begins the error's sentence: the file, or the mapping's section.
    datum : str
        The name as declared; case, blanks and punctuation do not matter.

    Raises
    ------
    LogError
        When the datum is further than a metre from WGS84, or not known.
    """
    key = _key(datum)
    if _GLOBAL.fullmatch(key) or _PLATES.fullmatch(key):
        return printable(datum.strip())[:MAX_NAME]
    remedy = (
        "convert the positions to WGS84 (EPSG:4979) or another datum within a metre of it, such as ETRS89 or ITRF2020"
    )
    for name, distance in _OTHER.items():
        if key.startswith(name):
            raise LogError(
                f"{where}: the datum is {datum[:MAX_NAME]!r}, whose positions lie {distance} off in WGS84; {remedy}."
            )
    raise LogError(f"{where}: the datum {datum[:MAX_NAME]!r} is not known to lie within a metre of WGS84; {remedy}.")


def checked_height(where: str, height: str) -> str:
    """Return a height reference, one of `HEIGHTS`; a LogError says which there are."""
    if height not in HEIGHTS:
        raise LogError(
            f"{where}: the heights count from {height[:MAX_NAME]!r}; declare one of {', '.join(map(repr, HEIGHTS))}."
        )
    return height


def declared(where: str, *, datum: str | None, height: str | None) -> dict[str, object]:
    """Return what a file declares, checked, as entries of `Log.meta`; what it does not declare is left out."""
    meta: dict[str, object] = {}
    if datum is not None:
        meta[DATUM_KEY] = checked_datum(where, datum)
    if height is not None:
        meta[HEIGHT_KEY] = checked_height(where, height)
    return meta


def check_agreement(name: str, meta: Mapping[str, object], other: str, other_meta: Mapping[str, object]) -> None:
    """Refuse two files of one log that declare different datums or height references.

    Parameters
    ----------
    name, other : str
        The files' names.
    meta, other_meta : mapping
        What each declares (see `declared`); a file that declares nothing agrees with any.

    Raises
    ------
    LogError
        When both declare one, and not the same.
    """
    for key, what in ((DATUM_KEY, "datum"), (HEIGHT_KEY, "height reference")):
        here, there = meta.get(key), other_meta.get(key)
        if here is None or there is None or _family(str(here)) == _family(str(there)):
            continue
        raise LogError(
            f"{name} declares the {what} {here!r}, {other} {there!r}; convert one of them, or correct the declaration: "
            f"a log has one {what}."
        )


def _key(name: str) -> str:
    """Return a name without case, blanks and punctuation."""
    return re.sub(r"[^A-Z0-9]", "", name.upper())


def _family(name: str) -> str:
    """Return what two names must share to mean the same: the global frames are one."""
    key = _key(name)
    return WGS84 if _GLOBAL.fullmatch(key) else key
