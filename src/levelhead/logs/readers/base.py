"""What a reader of one format is, and the table of numbers that the readers of tabular formats share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from levelhead.conventions import FloatArray
from levelhead.logs.mapping import GnssMapping, ImuMapping
from levelhead.logs.pieces import Pieces

Role = Literal["imu", "gnss"]


@dataclass(frozen=True, kw_only=True)
class Source:
    """What a reader is asked for.

    Attributes
    ----------
    path : Path
        An existing regular file that is not empty.
    role : {"imu", "gnss"}
        ``imu``: the log itself, with or without GNSS data; ``gnss``: only its GNSS data is wanted.
    imu_mapping, gnss_mapping : optional
        The sections of the mapping that describe this file.
    """

    path: Path
    role: Role = "imu"
    imu_mapping: ImuMapping | None = None
    gnss_mapping: GnssMapping | None = None


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
        Whether a file that begins with these bytes (64 KiB at most) has this format.
    read : callable
        Takes a `Source`, returns `Pieces`, raises `LogError`.
    """

    name: str
    title: str
    sniff: Callable[[bytes], bool]
    read: Callable[[Source], Pieces]


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Numbers by canonical column name, in canonical units (see `levelhead.conventions`); NaN means absent.

    ``where(row)`` says in words where a row (from 0) stands in the file; ``left_out`` counts cut lines.
    """

    name: str
    columns: Mapping[str, FloatArray]
    where: Callable[[int], str]
    left_out: int = 0
