"""KITTI's raw drives: a folder ``oxts`` with one small text file for each sample of an OxTS RT3003 on a car's roof.

``oxts/timestamps.txt`` has one line per sample, ``oxts/data/0000000000.txt`` and so on 30 numbers each. All of them are
the output of an inertial navigation system: its biases are taken off the readings, and its velocities come at the
IMU's rate. Axes are forward, left, up: level and at rest the z axis reads +9.8.
"""

from __future__ import annotations

import itertools
import os
import re
from collections import Counter
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.pieces import FLU_TO_FRD, GnssData, ImuData, Pieces, none_if_absent
from levelhead.logs.readers.base import Reader, Source
from levelhead.logs.readers.receivers import dropped, known_std

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NUMBERS: Final = 30
"""Numbers in one file of ``data``."""
MAX_FILE_BYTES: Final = 4096
"""A file of 30 numbers has some 500 bytes; of a longer one no more is read, and it counts as broken."""
MAX_STAMP_BYTES: Final = 1 << 28
"""``timestamps.txt`` of a day at 100 Hz has this size, bytes."""
SNIFFED_FILES: Final = 10
GNSS_PERIOD_S: Final = 0.1
"""The INS tells velocity and position with every sample; of those no more than one in this time becomes an epoch, s."""

_VN, _VE, _VU = 6, 7, 10
_ACCEL: Final = slice(11, 14)
_GYRO: Final = slice(17, 20)
_POS_ACCURACY, _VEL_ACCURACY, _NAVSTAT = 23, 24, 25
_NO_SOLUTION: Final = (0, 1, 2)
"""Values of ``navstat``: nothing, raw IMU data only, initialising. (3 is locking, 4 locked.)"""

_SAMPLE_FILE: Final = re.compile(r"\d{1,10}\.txt", re.ASCII)
_STAMP: Final = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{1,9}")
COMPENSATED: Final = (
    "The OxTS system took its own estimates of the biases off the readings before it wrote them; what is estimated "
    "here is the rest, near zero."
)


class _Samples(NamedTuple):
    """Samples by the number in their file's name: values (n, 30), NaN altogether where a file is broken."""

    number: IntArray
    values: FloatArray
    broken: BoolArray


def sniff(path: Path, head: bytes) -> bool:
    """Return whether a folder is an ``oxts`` folder of KITTI, or a drive that has one."""
    return not head and _find_folder(path) is not None


def read(source: Source) -> Pieces:
    """Read a drive's folder, or its folder ``oxts``.

    The stamps are those of the recording computer, whose time zone nobody declares. GNSS epochs are every sample, but
    no more than one in `GNSS_PERIOD_S`: the INS's velocities are smoother, and more alike, than a receiver's.

    Raises
    ------
    LogError
        When the folder has no such layout, or not one sample that can be read.
    """
    folder = _find_folder(source.path)
    if folder is None:
        raise LogError(f"{source.path} has no oxts/timestamps.txt and oxts/data with KITTI's files; pass the drive.")
    stamps, bad_stamps = _read_stamps(folder / "timestamps.txt")
    samples = _read_samples(folder / "data")
    usable = samples.number < stamps.size
    usable[usable] &= np.isfinite(stamps[samples.number[usable]])
    usable &= ~samples.broken
    if not usable.any():
        raise LogError(
            f"{source.path.name}: not one of the {usable.size} samples in oxts/data has {NUMBERS} numbers and a stamp; "
            "copy the drive anew."
        )
    time, values = stamps[samples.number[usable]], samples.values[usable]
    flip = np.diag(FLU_TO_FRD)
    imu = ImuData(time=time, gyro=values[:, _GYRO] * flip, accel=values[:, _ACCEL] * flip)
    gnss, events = _epochs(time, values)
    left_out, damaged = _damage(source.path.name, samples, stamps, bad_stamps)
    unstamped = int((np.isnan(stamps) & ~bad_stamps).sum())
    events = (*events, *dropped(unstamped, "samples to which KITTI gives no time"))
    return Pieces(
        imu=None if source.role == "gnss" else imu,
        gnss=gnss,
        left_out=left_out,
        damaged=damaged,
        from_zero=True,
        meta={"dcm_file_to_body": FLU_TO_FRD},
        events=events,
        compensated=COMPENSATED,
    )


def _find_folder(path: Path) -> Path | None:
    """Return the folder that holds ``timestamps.txt`` and ``data`` with files of 30 numbers."""
    for folder in (path / "oxts", path):
        data = folder / "data"
        if (folder / "timestamps.txt").is_file() and data.is_dir():
            with os.scandir(data) as entries:
                names = itertools.islice((entry.path for entry in entries if _is_sample(entry)), SNIFFED_FILES)
                if any(len(_content(name).split()) == NUMBERS for name in names):
                    return folder
    return None


def _is_sample(entry: os.DirEntry[str]) -> bool:
    # A FIFO with such a name would be waited for.
    return _SAMPLE_FILE.fullmatch(entry.name) is not None and entry.is_file()


def _content(path: str) -> bytes:
    """Return what a small file holds: three system calls, where Python's file objects need eight."""
    file = os.open(path, os.O_RDONLY)
    try:
        return os.read(file, MAX_FILE_BYTES)
    finally:
        os.close(file)


def _read_stamps(path: Path) -> tuple[FloatArray, BoolArray]:
    """Return seconds since 1970 in the zone of the recording computer, NaN where a line has none, and which are bad.

    KITTI leaves a line empty where it lost a sample; a line that is neither empty nor a stamp is bad.
    """
    with path.open("rb") as file:
        content = file.read(MAX_STAMP_BYTES)
    lines = [line.strip() for line in content.rstrip(b"\r\n").split(b"\n")]
    width = max(Counter(len(line) for line in lines if line).items(), key=lambda item: item[1], default=(0, 0))[0]
    good = np.array([len(line) == width and _STAMP.fullmatch(line) is not None for line in lines])
    bad = np.array([bool(line) for line in lines]) & ~good
    texts = np.array([line.decode() if ok else "NaT" for line, ok in zip(lines, good, strict=True)])
    try:
        instants = texts.astype("datetime64[ns]")
    except (ValueError, OverflowError):
        # A month 13 has the form of a stamp.
        instants = np.array([_instant(text) for text in texts], dtype="datetime64[ns]")
        bad |= good & np.isnat(instants)
    seconds = instants.astype(np.int64) / 1e9
    return np.where(np.isnat(instants), np.nan, seconds), bad


def _instant(text: str) -> np.datetime64:
    try:
        return np.datetime64(text, "ns")
    except (ValueError, OverflowError):
        return np.datetime64("NaT", "ns")


def _read_samples(folder: Path) -> _Samples:
    """Read every file of the folder, in the order of their numbers."""
    with os.scandir(folder) as entries:
        paths = sorted((int(entry.name[:-4]), entry.path) for entry in entries if _is_sample(entry))
    rows = [_content(path).split() for _, path in paths]
    broken = np.array([len(row) != NUMBERS for row in rows])
    values = np.full((len(rows), NUMBERS), np.nan)
    whole = np.flatnonzero(~broken)
    if whole.size:
        values[whole] = _parse([b" ".join(rows[k]) for k in whole])
    broken |= ~np.isfinite(values).all(axis=1)
    broken |= (np.abs(values[:, 0]) > 90.0) | (np.abs(values[:, 1]) > 180.0)
    return _Samples(number=np.array([number for number, _ in paths]), values=values, broken=broken)


def _parse(lines: list[bytes]) -> FloatArray:
    """Return the numbers of lines of `NUMBERS` words each, NaN where a line has another word."""
    import pyarrow as pa
    from pyarrow import csv

    names = [str(k) for k in range(NUMBERS)]
    try:
        table = csv.read_csv(
            pa.BufferReader(b"\n".join(lines)),
            read_options=csv.ReadOptions(column_names=names, use_threads=False),
            parse_options=csv.ParseOptions(delimiter=" ", quote_char=False, newlines_in_values=False),
            convert_options=csv.ConvertOptions(column_types=dict.fromkeys(names, pa.float64())),
        )
    except pa.ArrowInvalid:
        return np.array([_numbers(line) for line in lines])
    return np.column_stack([table.column(name).to_numpy() for name in names])


def _numbers(line: bytes) -> list[float]:
    try:
        return [float(word) for word in line.split()]
    except ValueError:
        return [float("nan")] * NUMBERS


def _epochs(time: FloatArray, values: FloatArray) -> tuple[GnssData, tuple[Event, ...]]:
    """Return the INS's velocities and positions at no more than one in `GNSS_PERIOD_S`, and what was left out."""
    solved = ~np.isin(values[:, _NAVSTAT], _NO_SOLUTION)
    events = [*dropped(int((~solved).sum()), "velocities from before the INS had found its state")]
    rows = np.flatnonzero(solved)
    rows = rows[np.argsort(time[rows], kind="stable")]
    kept = rows[_thinned(time[rows])]
    if kept.size < rows.size:
        detail = f"{kept.size} of {rows.size}, no more than {1.0 / GNSS_PERIOD_S:g} in a second."
        events.append(Event(code="I_DECIMATED", count=int(rows.size - kept.size), detail=detail))
    v = values[kept]
    gnss = GnssData(
        time=time[kept],
        velocity_ned=np.column_stack((v[:, _VN], v[:, _VE], -v[:, _VU])),
        velocity_std=_horizontal(v[:, _VEL_ACCURACY]),
        position_llh=np.column_stack((np.radians(v[:, :2]), v[:, 2])),
        position_std=_horizontal(v[:, _POS_ACCURACY]),
    )
    return gnss, tuple(events)


def _thinned(time: FloatArray) -> IntArray:
    """Return indices of sorted stamps at least `GNSS_PERIOD_S` apart; stamps jitter by some milliseconds."""
    kept = []
    at, apart = 0, 0.95 * GNSS_PERIOD_S
    while at < time.size:
        kept.append(at)
        at = int(np.searchsorted(time, time[at] + apart))
    return np.array(kept, dtype=np.int64)


def _horizontal(accuracy: FloatArray) -> FloatArray | None:
    """Return sigmas (m, 3): KITTI declares those of north and east, none of down."""
    known = known_std(accuracy)
    return none_if_absent(np.column_stack((known, known, np.full_like(known, np.nan))))


def _damage(name: str, samples: _Samples, stamps: FloatArray, bad_stamps: BoolArray) -> tuple[int, str]:
    """Return how many samples lack at the ends of the drive, and a sentence for those that lack in its middle."""
    good = np.zeros(stamps.size, dtype=np.bool_)
    numbers = samples.number[(samples.number < stamps.size) & ~samples.broken]
    good[numbers] = True
    good &= ~bad_stamps
    unstamped = int((samples.number >= stamps.size).sum())
    first, last = (int(k) for k in np.flatnonzero(good)[[0, -1]])
    lacking = np.flatnonzero(~good[first : last + 1]) + first
    ends = unstamped + first + stamps.size - 1 - last
    if not lacking.size:
        return ends, ""
    return ends, (
        f"{name}: {lacking.size} of {stamps.size} samples have no stamp or no file of {NUMBERS} numbers, the first of "
        f"them is number {lacking[0]}."
    )


READER: Final = Reader(name="kitti", title="KITTI raw drive (folder oxts)", sniff=sniff, read=read)
