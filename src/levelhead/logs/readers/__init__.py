"""Reading logs: `read` finds the format by content; each format is one file here and one line in `READERS`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from levelhead.errors import LogError, UsageError
from levelhead.events import Event
from levelhead.logs.datum import check_agreement
from levelhead.logs.log import Log
from levelhead.logs.mapping import GnssMapping, ImuMapping, LogMapping, load_mapping
from levelhead.logs.pieces import Pieces, join
from levelhead.logs.readers import canonical_csv, canonical_parquet, mapped_csv, rtklib_pos
from levelhead.logs.readers.base import Reader, Role, Source
from levelhead.logs.readers.csv_table import is_text

PathLike = str | os.PathLike[str]

READERS: Final[dict[str, Reader]] = {
    reader.name: reader
    for reader in (
        canonical_csv.READER,
        canonical_parquet.READER,
        mapped_csv.READER,
        rtklib_pos.READER,
    )
}
"""Every format by its name, in the order in which they are tried."""

SNIFFED_BYTES: Final = 65536


def read(
    path: PathLike, *, format: str | None = None, gnss: PathLike | None = None, mapping: PathLike | None = None
) -> Log:
    """Read a log of any supported format.

    Parameters
    ----------
    path : path
        The log, or its IMU file. For ``NAME.imu.csv`` the GNSS data is taken from ``NAME.gnss.csv`` beside it.
    format : str, optional
        A key of `READERS`; without it the content of the file decides.
    gnss : path, optional
        The file with the GNSS data, where it is not in `path`; of any format that holds GNSS data.
    mapping : path, optional
        The TOML file that says what the columns of a foreign CSV mean, see `levelhead.logs.mapping`.

    Returns
    -------
    Log
        ``meta`` has ``source``, ``format`` and ``completeness`` (and ``gnss_source``, ``gnss_format`` with two
        files), ``datum`` and, where a file declares it, ``height`` (see `levelhead.logs.datum`), and ``epoch``, the
        reading of the file's clock at the log's zero, where the clock was foreign.

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
    gnss_path = _sibling(main) if gnss is None else Path(gnss)
    imu_mapping, gnss_mapping = _sections(mapped, two_files=gnss_path is not None)

    pieces, reader = _read_file(main, "imu", format, imu_mapping, None if gnss_path else gnss_mapping)
    if pieces.imu is None:
        raise LogError(
            f"{main.name} ({reader.title}) holds GNSS data only; an IMU file is needed too: pass that one first and "
            f"{main.name} as gnss=."
        )
    meta: dict[str, object] = {"source": main.name, "format": reader.name, **pieces.meta}
    cut = {main.name: pieces.left_out}
    gnss_data = pieces.gnss
    if gnss_path is not None:
        if gnss_data is not None:
            raise UsageError(f"{main.name} has GNSS columns of its own; leave out the GNSS file {gnss_path.name}.")
        gnss_pieces, gnss_reader = _read_file(gnss_path, "gnss", None, None, gnss_mapping)
        check_agreement(main.name, pieces.meta, gnss_path.name, gnss_pieces.meta)
        gnss_data = gnss_pieces.gnss
        meta = {**gnss_pieces.meta, **meta, "gnss_source": gnss_path.name, "gnss_format": gnss_reader.name}
        cut[gnss_path.name] = gnss_pieces.left_out
    if gnss_data is None:
        raise LogError(f"{main.name} holds no GNSS data; pass the file that does as gnss=.")

    cut = {name: count for name, count in cut.items() if count}
    meta["completeness"] = "truncated" if cut else "complete"
    detail = ", ".join(f"{name}: {count}" for name, count in cut.items())
    events = (Event(code="W_TRUNCATED", count=sum(cut.values()), detail=f"Lines: {detail}."),) if cut else ()
    try:
        return join(pieces.imu, gnss_data, from_zero=pieces.from_zero, meta=meta, events=events)
    except LogError as error:
        raise LogError(f"{main.name}: {error}") from None


def _sibling(path: Path) -> Path | None:
    """Return ``NAME.gnss.csv`` beside ``NAME.imu.csv`` (or Parquet), if it is there."""
    stem = Path(path.stem)
    if stem.suffix != ".imu":
        return None
    sibling = path.with_name(f"{stem.stem}.gnss{path.suffix}")
    return sibling if sibling.is_file() else None


def _sections(mapped: LogMapping | None, *, two_files: bool) -> tuple[ImuMapping | None, GnssMapping | None]:
    if mapped is None:
        return None, None
    if mapped.imu is None and not two_files:
        raise UsageError("The mapping describes GNSS data only; pass the GNSS file as gnss= beside the IMU file.")
    return mapped.imu, mapped.gnss


def _read_file(
    path: Path, role: Role, format_name: str | None, imu: ImuMapping | None, gnss: GnssMapping | None
) -> tuple[Pieces, Reader]:
    """Read one file in the format that its content, the mapping or the caller names."""
    try:
        head = _head(path)
        reader = READERS[format_name] if format_name is not None else _find_reader(path, head, imu or gnss)
        source = Source(path=path, role=role, imu_mapping=imu, gnss_mapping=gnss)
        return reader.read(source), reader
    except OSError as error:
        raise LogError(f"{path} cannot be read: {error.strerror or error}.") from error


def _head(path: Path) -> bytes:
    """Return the first bytes of a regular file that is not empty."""
    if not path.exists():
        raise UsageError(f"{path} does not exist; check the path.")
    if path.is_dir():
        raise LogError(f"{path} is a directory; pass the log file itself.")
    if not path.is_file():
        # Opening a FIFO would wait for its writer for ever.
        raise LogError(f"{path} is not a regular file; pass a log file.")
    with path.open("rb") as file:
        head = file.read(SNIFFED_BYTES)
    if not head:
        raise LogError(f"{path.name} is empty; check the recording or the copy.")
    return head


def _find_reader(path: Path, head: bytes, section: ImuMapping | GnssMapping | None) -> Reader:
    sniffed = next((reader for reader in READERS.values() if reader.sniff(head)), None)
    if section is not None:
        if sniffed is not None and sniffed is not canonical_csv.READER:
            raise UsageError(
                f"{path.name} is {sniffed.title}, which needs no mapping; leave out the mapping's section for it."
            )
        if is_text(head):
            return mapped_csv.READER
    if sniffed is not None:
        return sniffed
    known = ", ".join(reader.title for reader in READERS.values())
    if not is_text(head):
        raise LogError(f"{path.name}: the format is not known (binary data); levelhead reads {known}.")
    first = head.decode("utf-8", errors="replace").splitlines()[0][:60]
    raise LogError(
        f"{path.name}: the format is not known (the first line is {first!r}); levelhead reads {known}. For a CSV with "
        "other columns pass a mapping file (mapping=)."
    )
