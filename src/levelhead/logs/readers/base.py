"""What a reader of one format is, and the table of numbers that the readers of tabular formats share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.logs.mapping import GnssMapping, ImuMapping
from levelhead.logs.pieces import Pieces, Stream

Role = Literal["imu", "gnss"]

MAX_CONTENT: Final = 2 << 30
"""Bytes of a text that is read at once; a day at 100 Hz with every digit has 1.3e9."""
MAX_NAMES_SHOWN: Final = 16
"""Column names that an error lists at most."""
MAX_TEXT_SHOWN: Final = 40
"""Characters of a piece of a file that an error shows at most."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """What a reader is asked for.

    Attributes
    ----------
    path : Path
        An existing regular file that is not empty, or a folder for readers that take one.
    role : {"imu", "gnss"}
        ``imu``: the log itself, with or without GNSS data; ``gnss``: only its GNSS data is wanted.
    imu_mapping, gnss_mapping : optional
        The sections of the mapping that describe this file.
    imu, gnss : str, optional
        Which of several IMUs and receivers in the file is wanted; the reader chooses where nobody says, see `choose`.
    """

    path: Path
    role: Role = "imu"
    imu_mapping: ImuMapping | None = None
    gnss_mapping: GnssMapping | None = None
    imu: str | None = None
    gnss: str | None = None


@dataclass(frozen=True, kw_only=True)
class Reader:
    """One format.

    Attributes
    ----------
    name : str
        What ``format=`` calls it.
    title : str
        For people, in errors and in the documentation.
    sniff : callable
        Whether a file that begins with these bytes (64 KiB at most) has this format. Of a folder the bytes are empty
        and the path tells; of a file the content decides, and the path only gives access to more of it.
    read : callable
        Takes a `Source`, returns `Pieces`, raises `LogError`.
    """

    name: str
    title: str
    sniff: Callable[[Path, bytes], bool]
    read: Callable[[Source], Pieces]


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Numbers by canonical column name, in canonical units (see `levelhead.conventions`); NaN means absent.

    ``where(row)`` says in words where a row (from 0) stands in the file; ``left_out`` counts cut lines; ``time_scale``
    is that of stamps which are known to count seconds since 1970 in it.
    """

    name: str
    columns: Mapping[str, FloatArray]
    where: Callable[[int], str]
    left_out: int = 0
    time_scale: str | None = None


def choose(streams: Sequence[Stream], wanted: str | None, *, name: str) -> Stream | None:
    """Return the stream of one kind that is read: the wanted one, else the one with the most samples, first at a tie.

    Parameters
    ----------
    streams : sequence of Stream
        All IMUs, or all receivers, in the order of preference.
    wanted : str or None
        What the user chose (`Source.imu`, `Source.gnss`).
    name : str
        The file's name, for errors.

    Raises
    ------
    LogError
        When there is no such stream; the sentence lists those that there are.
    """
    if wanted is None:
        return max(streams, key=lambda s: s.samples, default=None)
    for stream in streams:
        if stream.name == wanted:
            return stream
    what = "IMU" if not streams or streams[0].kind == "imu" else "GNSS receiver"
    have = ", ".join(f"{s.name} ({s.samples} samples)" for s in streams) or "none"
    raise LogError(f"{name} has no {what} called {wanted!r}; choose one of: {have}.")


def content_of(path: Path) -> bytes:
    """Return the whole content of a file that is read at once.

    Raises
    ------
    LogError
        When it is larger than `MAX_CONTENT`.
    """
    size = path.stat().st_size
    if size > MAX_CONTENT:
        raise LogError(
            f"{path.name} has {size / 1e9:.1f} GB, more than is read at once ({MAX_CONTENT / 1e9:.1f} GB); split it, "
            "or store it as Parquet."
        )
    return path.read_bytes()


def shown_names(names: Sequence[str]) -> str:
    """Return names that stand in a file as an error lists them: not all, and not all of a long one."""
    short = [n if len(n) <= MAX_TEXT_SHOWN else n[:MAX_TEXT_SHOWN] + "..." for n in names[:MAX_NAMES_SHOWN]]
    return ", ".join(short) + (", ..." if len(names) > MAX_NAMES_SHOWN else "")


def shown(text: str) -> str:
    """Return a piece of a file as an error shows it: in quotation marks, and not all of it where it is long."""
    return repr(text if len(text) <= MAX_TEXT_SHOWN else text[:MAX_TEXT_SHOWN] + "...")
