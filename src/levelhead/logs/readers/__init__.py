"""Reading logs: `read` finds the format by content; each format is one file here and one line in `READERS`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from levelhead.errors import LogError, UsageError, printable
from levelhead.events import Event
from levelhead.logs.datum import DATUM_KEY, HEIGHT_KEY, check_agreement
from levelhead.logs.log import Log
from levelhead.logs.mapping import GnssMapping, ImuMapping, LogMapping, load_mapping
from levelhead.logs.pieces import ABSOLUTE_CLOCK_S, FACTS, Fact, Pieces, join
from levelhead.logs.readers import (
    ardupilot_bin,
    canonical_csv,
    canonical_parquet,
    comma2k19,
    kfgins,
    kitti_oxts,
    mapped_csv,
    matlab_mat,
    mcap,
    named_csv,
    nmea,
    plain_csv,
    px4_ulog,
    ros1_bag,
    ros2_bag,
    rtklib_pos,
    sbg,
    sensor_logger,
    septentrio_sbf,
    ublox_ubx,
    vectornav,
    vectornav_ascii,
)
from levelhead.logs.readers.base import Reader, Role, Source
from levelhead.logs.readers.csv_table import is_text
from levelhead.logs.readers.foreign_files import what_it_is
from levelhead.logs.readers.siblings import find_sibling

PathLike = str | os.PathLike[str]

READERS: Final[dict[str, Reader]] = {
    reader.name: reader
    for reader in (
        px4_ulog.READER,
        ardupilot_bin.READER,
        ros1_bag.READER,
        ros2_bag.READER,
        mcap.READER,
        ublox_ubx.READER,
        septentrio_sbf.READER,
        matlab_mat.READER,
        kitti_oxts.READER,
        comma2k19.READER,
        sensor_logger.READER,
        nmea.READER,
        rtklib_pos.READER,
        vectornav.READER,
        vectornav_ascii.READER,
        sbg.READER,
        named_csv.READER,
        canonical_csv.READER,
        canonical_parquet.READER,
        mapped_csv.READER,
        kfgins.READER,
        plain_csv.READER,
    )
}
"""Every format by its name, in the order in which they are tried."""

_MAPPABLE: Final = (named_csv.READER, canonical_csv.READER, plain_csv.READER)
"""Formats that a mapping may read otherwise: what the columns mean is taken from their names or their numbers."""

_TABLES: Final = (canonical_csv.READER, canonical_parquet.READER, mapped_csv.READER, named_csv.READER)
"""Formats whose one table is the whole log: a GNSS file besides contradicts it."""

_META_OF_GNSS: Final = (DATUM_KEY, HEIGHT_KEY, "gnss_time_scale", "gnss_stamp")
_EVENTS_OF_GNSS: Final = ("I_VELOCITY_2D", "I_DECIMATED")
_FACTS_OF: Final[dict[Role, tuple[Fact, ...]]] = {
    "imu": ("gyro_unit", "accel_unit", "axes", "clock"),
    "gnss": ("velocity_frame", "clock"),
}
"""What a file tells of its receiver, and of its IMU: it does not matter where that one is not used."""

SNIFFED_BYTES: Final = 65536


# Numbers at the end of float's range overflow in any unit: what comes of it is infinite, and refused as such.
@np.errstate(over="ignore", invalid="ignore")
def read(
    path: PathLike,
    *,
    format: str | None = None,
    gnss: PathLike | None = None,
    imu: str | None = None,
    mapping: PathLike | None = None,
) -> Log:
    """Read a log of any supported format.

    Parameters
    ----------
    path : path
        The log, or its IMU file; some formats are folders. A GNSS file that lies beside an IMU file under a name that
        goes with its name (``NAME.gnss.csv`` beside ``NAME.imu.csv``, ``gps_7.csv`` beside ``imu_7.csv``) is found.
    format : str, optional
        A key of `READERS`; without it the content of the file decides.
    gnss : path or str, optional
        The file with the GNSS data, where it is not in `path`, of any format that holds GNSS data; or, where there is
        no such file, the name of one of several receivers in the log.
    imu : str, optional
        The name of one of several IMUs in the log; without it the first of those with the most samples is read.
    mapping : path, optional
        The TOML file that says what the columns of a foreign CSV mean, see `levelhead.logs.mapping`.

    Returns
    -------
    Log
        ``meta`` has ``source``, ``format`` and ``completeness`` (and ``gnss_source``, ``gnss_format`` with two
        files), ``datum`` and, where a file declares it, ``height`` (see `levelhead.logs.datum`), and ``epoch``, the
        reading of the file's clock at the log's zero, where the clock was foreign; ``streams``, what there was to
        choose from; ``compensated``, where biases were taken off before recording, by what; ``undeclared`` and
        ``assumed``, what must be found in the data (see `levelhead.logs.pieces`).

    Raises
    ------
    UsageError
        When a file does not exist, or an option is wrong or does not go with the others.
    LogError
        When a file cannot be read or trusted; the sentence names file, line and column.
    """
    if format is not None and format not in READERS:
        raise UsageError(f"The format {format!r} is not known; the formats are {', '.join(READERS)}.")
    main = Path(path)
    mapped = None if mapping is None else load_mapping(mapping)
    receiver = str(gnss) if gnss is not None and not _exists(Path(gnss)) else None
    gnss_path = None if gnss is None or receiver is not None else Path(gnss)
    beside = find_sibling(main) if gnss is None else None
    imu_mapping, gnss_mapping = _sections(mapped, two_files=(gnss_path or beside) is not None)

    source = Source(path=main, imu_mapping=imu_mapping, gnss_mapping=gnss_mapping, imu=imu, gnss=receiver)
    if gnss_path or beside:
        source = replace(source, gnss_mapping=None)
    pieces, reader = _read_file(source, format)
    _check_choice(source, pieces)
    if pieces.imu is None:
        raise LogError(
            f"{main.name} ({reader.title}) holds GNSS data only; an IMU file is needed too: pass that one first and "
            f"{main.name} as gnss=."
        )
    imu_data, gnss_data = pieces.imu, pieces.gnss
    meta: dict[str, object] = {"source": main.name, "format": reader.name, **pieces.meta}
    parts = [(main.name, pieces)]
    found: tuple[Event, ...] = ()
    if gnss_data is None and gnss_path is None and beside is not None:
        gnss_path = beside
        found = (Event(code="I_SIBLING", count=1, detail=f"{beside.name}."),)
    if gnss_path is not None:
        if gnss_data is not None and reader in _TABLES:
            raise UsageError(f"{main.name} has GNSS columns of its own; leave out the GNSS file {gnss_path.name}.")
        other, gnss_reader = _read_file(Source(path=gnss_path, role="gnss", gnss_mapping=gnss_mapping), None)
        other = _only(other, "gnss")
        if gnss_data is not None:
            pieces = _only(pieces, "imu")
            meta = {key: value for key, value in meta.items() if key not in _META_OF_GNSS}
        check_agreement(main.name, meta, gnss_path.name, other.meta)
        gnss_data = other.gnss
        meta = {**other.meta, **meta, "gnss_source": gnss_path.name, "gnss_format": gnss_reader.name}
        if imu_mapping is None or imu_mapping.time_zero_s is None:
            other = _against(pieces, other)
        parts = [(main.name, pieces), (gnss_path.name, other)]
    if gnss_data is None:
        name, title = (main.name, reader.title) if gnss_path is None else (gnss_path.name, gnss_reader.title)
        raise LogError(f"{name} ({title}) holds no GNSS data; pass the file that does as gnss=.")
    meta |= _known([part for _, part in parts])
    try:
        return join(imu_data, gnss_data, from_zero=pieces.from_zero, meta=meta, events=(*found, *_events_of(parts)))
    except LogError as error:
        raise LogError(f"{main.name}: {error}") from None


def _only(pieces: Pieces, kind: Role) -> Pieces:
    """Return what a file tells of its IMU or of its receiver, where the other one is taken from another file."""
    facts = _FACTS_OF[kind]
    pieces = replace(
        pieces,
        undeclared=tuple(f for f in pieces.undeclared if f in facts),
        assumed=tuple(f for f in pieces.assumed if f in facts),
    )
    if kind == "imu":
        return replace(pieces, gnss=None, events=tuple(e for e in pieces.events if e.code not in _EVENTS_OF_GNSS))
    # Calibration, devices and the like are those of an IMU that is not used.
    meta = {key: value for key, value in pieces.meta.items() if key in _META_OF_GNSS}
    return replace(pieces, imu=None, compensated="", meta=meta)


def _against(one: Pieces, other: Pieces) -> Pieces:
    """Return the second file's pieces with what it means that their clocks are two.

    A computer's clock may be seconds off. And where both count from 1970, but only one says in which time scale, they
    may be the leap seconds apart: 18 s are too few to be noticed by where the files begin and end.
    """
    if one.imu is None or other.gnss is None:
        return other
    scales, events = (one.imu.time_scale, other.gnss.time_scale), other.events
    told_by_one = scales[0] != scales[1] and None in scales
    if told_by_one and min(np.nanmax(t, initial=0.0) for t in (one.imu.time, other.gnss.time)) > ABSOLUTE_CLOCK_S:
        known = scales[0] or scales[1]
        events = (*events, Event(code="W_TIME_SCALE", count=1, detail=f"{known} is what the other one counts in."))
    elif not (one.host_clock or other.host_clock):
        return other
    return replace(other, events=events, undeclared=tuple(dict.fromkeys((*other.undeclared, "clock"))))


def _known(parts: Sequence[Pieces]) -> dict[str, object]:
    """Return what the files together tell of the log, as entries of `Log.meta`."""
    whole = "malformed_record" if any(p.damaged for p in parts) else "complete"
    meta: dict[str, object] = {"completeness": "truncated" if any(p.left_out for p in parts) else whole}
    # Names and notes stand in the file: they must not command a terminal that lists them.
    streams = tuple(replace(s, name=printable(s.name), note=printable(s.note)) for p in parts for s in p.streams)
    compensated = printable(" ".join(p.compensated for p in parts if p.compensated))
    undeclared = tuple(fact for fact in FACTS if any(fact in p.undeclared for p in parts))
    assumed = tuple(fact for fact in FACTS if fact not in undeclared and any(fact in p.assumed for p in parts))
    entries = {"streams": streams, "compensated": compensated, "undeclared": undeclared, "assumed": assumed}
    return {**meta, **{name: value for name, value in entries.items() if value}}


def _events_of(parts: Sequence[tuple[str, Pieces]]) -> tuple[Event, ...]:
    """Return what happened while the files were read; two of them may have one name, in two folders."""
    pieces = [part for _, part in parts]
    events = [event for p in pieces for event in p.events]
    cut = [(name, p.left_out) for name, p in parts if p.left_out]
    if cut:
        detail = ", ".join(f"{name}: {count}" for name, count in cut)
        events.append(Event(code="W_TRUNCATED", count=sum(count for _, count in cut), detail=f"{detail}."))
    events += [Event(code="W_DAMAGED", count=1, detail=p.damaged) for p in pieces if p.damaged]
    events += [Event(code="W_COMPENSATED", count=1, detail=p.compensated) for p in pieces if p.compensated]
    return tuple(events)


def _check_choice(source: Source, pieces: Pieces) -> None:
    """Refuse a choice among streams where the file has only one of each."""
    for wanted, kind in ((source.imu, "imu"), (source.gnss, "gnss")):
        if wanted is None or any(s.kind == kind and s.name == wanted for s in pieces.streams):
            continue
        names = [s.name for s in pieces.streams if s.kind == kind]
        have = f"it has {', '.join(names)}" if names else f"it has no {kind} streams to choose from"
        missing = " and there is no such file" if kind == "gnss" else ""
        raise UsageError(f"{source.path.name} has no {kind} stream {wanted!r}{missing}; {have}.")


def _sections(mapped: LogMapping | None, *, two_files: bool) -> tuple[ImuMapping | None, GnssMapping | None]:
    if mapped is None:
        return None, None
    if mapped.imu is None and not two_files:
        raise UsageError("The mapping describes GNSS data only; pass the GNSS file as gnss= beside the IMU file.")
    return mapped.imu, mapped.gnss


def _read_file(source: Source, format_name: str | None) -> tuple[Pieces, Reader]:
    """Read one file in the format that its content, the mapping or the caller names."""
    path = source.path
    try:
        head = _head(path)
        section = source.imu_mapping or source.gnss_mapping
        reader = READERS[format_name] if format_name is not None else _find_reader(path, head, section)
        return reader.read(source), reader
    except OSError as error:
        raise LogError(f"{path} cannot be read: {error.strerror or error}.") from error
    except MemoryError as error:
        raise LogError(f"{path.name} needs more memory than there is; split it, or free some.") from error


def _exists(path: Path) -> bool:
    """Return whether there is such a file; of a name that no file can have, False."""
    try:
        return path.exists()
    except OSError:
        return False


def _head(path: Path) -> bytes:
    """Return the first bytes of a regular file that is not empty; of a folder, none."""
    if not path.exists():
        raise UsageError(f"{path} does not exist; check the path.")
    if path.is_dir():
        return b""
    if not path.is_file():
        # Opening a FIFO would wait for its writer for ever.
        raise LogError(f"{path} is not a regular file; pass a log file.")
    with path.open("rb") as file:
        head = file.read(SNIFFED_BYTES)
    if not head:
        raise LogError(f"{path.name} is empty; check the recording or the copy.")
    return head


def _find_reader(path: Path, head: bytes, section: ImuMapping | GnssMapping | None) -> Reader:
    sniffed = next((reader for reader in READERS.values() if reader.sniff(path, head)), None)
    if section is not None and sniffed is not matlab_mat.READER:
        if sniffed is not None and sniffed not in _MAPPABLE:
            raise UsageError(
                f"{path.name} is {sniffed.title}, which needs no mapping; leave out the mapping's section for it."
            )
        if is_text(head):
            return mapped_csv.READER
    if sniffed is not None:
        return sniffed
    known = ", ".join(reader.title for reader in READERS.values())
    if path.is_dir():
        raise LogError(f"{path} is a directory, and no log in a known layout of files; pass the log file itself.")
    if what := what_it_is(head):
        raise LogError(f"{path.name} is {what}.")
    if not is_text(head):
        raise LogError(f"{path.name}: the format is not known (binary data); levelhead reads {known}.")
    first = head.decode("utf-8", errors="replace").splitlines()[0][:60]
    raise LogError(
        f"{path.name}: the format is not known (the first line is {first!r}); levelhead reads {known}. For a CSV with "
        "other columns pass a mapping file (mapping=)."
    )
