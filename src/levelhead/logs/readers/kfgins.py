"""KF-GINS and the awesome-gins data: numbers without header, stamped with the GPS second of the week.

The IMU file has seven columns (text, or float64 in the binary form): the stamp at the END of the interval, the angle
increments (rad) and the velocity increments (m/s) over it, forward, right, down; an eighth column is a wheel speed,
m/s. The GNSS file has latitude, longitude (degrees), height and their sigmas, and with 13 columns velocities (north,
east, down) and their sigmas besides.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.errors import LogError
from levelhead.logs.datum import ELLIPSOIDAL, HEIGHT_KEY
from levelhead.logs.pieces import GnssData, ImuData, Pieces, none_if_absent
from levelhead.logs.readers.base import Reader, Source
from levelhead.logs.readers.csv_table import find_layout, is_text, read_numbers
from levelhead.logs.readers.receivers import known_std
from levelhead.logs.timescales import WEEK_S

BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]

IMU_WIDTHS: Final = (7, 8)
GNSS_WIDTHS: Final = (7, 13)
RECORD: Final = np.dtype("<f8")
RECORD_BYTES: Final = 7 * RECORD.itemsize

SNIFFED_LINES: Final = 400
MIN_LINES: Final = 2
IMU_PERIODS_S: Final = (0.0005, 0.1)
"""What an IMU's interval may be, s."""
GNSS_PERIODS_S: Final = (0.02, 60.0)
GRAVITY_TOLERANCE: Final = 1.0
"""The median specific force of a land vehicle is this close to gravity, m/s^2."""
MIN_DOWN: Final = -5.0
"""And its down component is below this: the IMU's z axis points down, m/s^2."""
MAX_RATE: Final = 20.0
"""Angular rates stay below this, rad/s."""
MAX_WHEEL_SPEED: Final = 100.0
MAX_SIGMA_M: Final = 1000.0
MAX_DEGREES_S: Final = 0.01
"""No land vehicle changes its latitude or longitude by more than this in a second (1 km/s), degrees."""
HEIGHTS_M: Final = (-1000.0, 10_000.0)
MAX_INCREMENT_S: Final = 1000.0
"""A larger angle (rad) or velocity (m/s) in a second is none that an IMU measures."""
MAX_RESYNCS: Final = 100
RESYNC_BYTES: Final = 10_000
"""How far beyond damage the next record is sought."""
RESYNC_S: Final = 60.0
"""And how far its stamp may be behind the last one, s."""
ODD_INTERVAL: Final = 1.5
"""An interval longer than the usual one by this factor, or shorter by it, may not be what its increments span."""

_BLANKS = re.compile(rb"[ \t]+")
_LINE_ENDS = re.compile(rb" ?\r?\n ?")


def sniff(path: Path, head: bytes) -> bool:
    """Return whether a file begins like one of the three forms: rows of numbers that can hardly be anything else."""
    return _form(path, head) is not None


def read(source: Source) -> Pieces:
    """Read an IMU file or a GNSS file; both count from the start of a GPS week that neither names.

    Increments become mean rates over their intervals, stamped in the middle of these: where they are joined by
    straight lines, as levelhead does, the integral is that of the increments, without delay.

    Raises
    ------
    LogError
        Naming file and line of what is wrong; on a GNSS file whose 13 columns can be read in two ways.
    """
    # Damaged numbers may be huge, or no numbers; what comes of them is checked.
    with np.errstate(over="ignore", invalid="ignore"):
        return _read(source)


def _read(source: Source) -> Pieces:
    """Read one of the three forms."""
    with source.path.open("rb") as file:
        head = file.read(65536)
    form = _form(source.path, head)
    name = source.path.name
    if form is None:
        raise LogError(
            f"{name}: the rows are not those of KF-GINS: second of the week and increments (7 or 8 columns), or second "
            "of the week, position and sigmas (7 or 13 columns)."
        )
    rows, left_out, damaged = _binary(source.path) if form == "binary" else (*_text(source.path), "")
    good = (rows[:, 0] >= 0.0) & (rows[:, 0] <= WEEK_S) if form == "gnss" else _possible(rows, _usual(rows[:, 0]))
    if not good.all() and not damaged:
        damaged = (
            f"{name}: {int((~good).sum())} of {good.size} rows hold numbers that cannot be, the first of them row "
            f"{int(np.argmin(good)) + 1}."
        )
    rows = rows[good]
    if len(rows) < MIN_LINES:
        raise LogError(f"{name}: the file has {len(rows)} whole rows; check the recording or the copy.")
    rows[:, 0] = _unwrapped(rows[:, 0])
    if form == "gnss":
        meta = {HEIGHT_KEY: ELLIPSOIDAL}
        return Pieces(gnss=_gnss(name, rows), left_out=left_out, damaged=damaged, from_zero=True, meta=meta)
    return Pieces(imu=_imu(rows), left_out=left_out, damaged=damaged, from_zero=True)


def _form(path: Path, head: bytes) -> str | None:
    """Return "imu", "gnss" or "binary", or None for another format."""
    if not head or path.is_dir():
        return None
    if not is_text(head):
        rows = np.frombuffer(head[: len(head) // RECORD_BYTES * RECORD_BYTES], dtype=RECORD).reshape(-1, 7)
        return "binary" if _is_imu(rows[:SNIFFED_LINES].astype(np.float64)) else None
    rows = _first_rows(head)
    if rows.shape[1] in IMU_WIDTHS and _is_imu(rows):
        return "imu"
    return "gnss" if rows.shape[1] in GNSS_WIDTHS and _is_gnss(rows) else None


def _first_rows(head: bytes) -> FloatArray:
    """Return the numbers of the first whole lines, as far as they are numbers and equally many."""
    rows: list[list[float]] = []
    for line in head.split(b"\n")[:-1][:SNIFFED_LINES]:
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            break
        if rows and len(row) != len(rows[0]):
            break
        rows.append(row)
    return np.array(rows).reshape(len(rows), len(rows[0]) if rows else 0)


def _stamps_fit(time: FloatArray, periods: tuple[float, float]) -> bool:
    if time.size < MIN_LINES or not ((time >= 0.0) & (time <= WEEK_S)).all():
        return False
    steps = np.diff(time)
    return bool((steps > 0.0).mean() > 0.9 and periods[0] <= np.median(steps) <= periods[1])


def _is_imu(rows: FloatArray) -> bool:
    with np.errstate(all="ignore"):
        if not np.isfinite(rows).all() or not _stamps_fit(rows[:, 0], IMU_PERIODS_S):
            return False
        period = float(np.median(np.diff(rows[:, 0])))
        rates, forces = rows[:, 1:4] / period, rows[:, 4:7] / period
        return bool(
            abs(np.median(np.linalg.norm(forces, axis=1)) - GRAVITY) < GRAVITY_TOLERANCE
            and np.median(forces[:, 2]) < MIN_DOWN
            and np.median(np.abs(rates)) < MAX_RATE
            and (np.abs(rows[:, 7:]) < MAX_WHEEL_SPEED).all()
        )


def _is_gnss(rows: FloatArray) -> bool:
    if not np.isfinite(rows).all() or not _stamps_fit(rows[:, 0], GNSS_PERIODS_S):
        return False
    steps = np.diff(rows[:, 0])
    latitude, longitude, height = rows[:, 1:4].T
    sigmas = rows[:, 4:7] if rows.shape[1] == 7 else rows[:, 10:13]
    return bool(
        (np.abs(latitude) <= 90.0).all()
        and (np.abs(longitude) <= 360.0).all()
        and ((height > HEIGHTS_M[0]) & (height < HEIGHTS_M[1])).all()
        and ((sigmas >= 0.0) & (sigmas < MAX_SIGMA_M)).all()
        # Places move slowly and are not all zero: rates and forces jump about, or are small.
        and (np.abs(np.diff(rows[:, 1:3], axis=0)) < MAX_DEGREES_S * np.maximum(steps, 1.0)[:, np.newaxis]).all()
        and np.abs(rows[:, 1:3]).max() > 1.0
        and np.max(sigmas) > 0.0
    )


def _usual(time: FloatArray) -> float:
    """Return the usual time between samples, s."""
    steps = np.diff(time)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if steps.size else 1.0


def _possible(rows: FloatArray, period: float) -> BoolArray:
    """Return which rows are numbers that an IMU of this period (s) can have written."""
    with np.errstate(all="ignore"):
        largest = np.abs(rows[:, 1:7]).max(axis=1, initial=0.0)
        possible: BoolArray = (rows[:, 0] >= 0.0) & (rows[:, 0] <= WEEK_S) & (largest <= MAX_INCREMENT_S * period)
    return possible


def _binary(path: Path) -> tuple[FloatArray, int, str]:
    """Return the records of a binary file, whether a cut one ends it, and a sentence where it is damaged.

    Nothing marks the beginning of a record: behind one that cannot be, the next byte is sought from which several
    records are possible and go on in time.
    """
    content = np.fromfile(path, dtype=np.uint8)
    period = _usual(_records(content[: SNIFFED_LINES * RECORD_BYTES])[:, 0])
    pieces: list[FloatArray] = []
    damaged, at = "", 0
    for _ in range(MAX_RESYNCS):
        rows = _records(content[at:])
        bad = np.flatnonzero(~_possible(rows, period))
        if not bad.size:
            pieces.append(rows)
            at += rows.size * RECORD.itemsize
            break
        pieces.append(rows[: bad[0]])
        at += int(bad[0]) * RECORD_BYTES
        damaged = damaged or f"{path.name} is damaged at byte {at}; records there were not read."
        last = next((float(piece[-1, 0]) for piece in reversed(pieces) if len(piece)), 0.0)
        at = _next_record(content, at + 1, last, period)
    return np.concatenate(pieces), int(at < content.size), damaged


def _records(content: ByteArray) -> FloatArray:
    whole = content.size // RECORD_BYTES
    return content[: whole * RECORD_BYTES].view(RECORD).reshape(whole, 7).astype(np.float64)


def _next_record(content: ByteArray, at: int, last: float, period: float) -> int:
    """Return the first byte from which three records are possible, close behind the last stamp; or the end."""
    for start in range(at, min(at + RESYNC_BYTES, content.size - 3 * RECORD_BYTES + 1)):
        rows = _records(content[start : start + 3 * RECORD_BYTES])
        if _possible(rows, period).all() and last < rows[0, 0] < last + RESYNC_S and (np.diff(rows[:, 0]) > 0.0).all():
            return start
    return content.size


def _text(path: Path) -> tuple[FloatArray, int]:
    """Return the numbers of a text file; its last line is left out where it has no end, for it was cut."""
    content = path.read_bytes()
    cut = 0
    stripped = content.rstrip(b"\0")
    if not stripped.endswith(b"\n"):
        content, cut = stripped[: stripped.rfind(b"\n") + 1], 1
    try:
        return np.loadtxt(io.BytesIO(content), dtype=np.float64, comments=None, ndmin=2), cut
    except ValueError:
        # Something is wrong in it, and the slow way says where.
        pass
    # Columns are padded with blanks; one blank in the place of several leaves lines and their numbers as they are.
    content = _LINE_ENDS.sub(b"\n", _BLANKS.sub(b" ", content)).lstrip(b" ")
    layout = find_layout(content, name=path.name, header=False, delimiter=" ")
    wanted = {number: k for k, number in enumerate(layout.names)}
    numbers = read_numbers(path, content, layout, wanted, time_column=layout.names[0])
    return np.column_stack([numbers.columns[number] for number in layout.names]), cut + numbers.left_out


def _unwrapped(time: FloatArray) -> FloatArray:
    """Return seconds that go on where the week ends and they begin anew."""
    return time + WEEK_S * np.cumsum(np.diff(time, prepend=time[:1]) < -0.5 * WEEK_S)


def _imu(rows: FloatArray) -> ImuData:
    """Return mean rates over the intervals, stamped in their middle."""
    time, increments = rows[:, 0], rows[:, 1:7]
    interval = _intervals(time, np.linalg.norm(rows[:, 4:7], axis=1))
    rates = increments / interval[:, np.newaxis]
    return ImuData(
        time=time - 0.5 * interval,
        gyro=rates[:, :3],
        accel=rates[:, 3:],
        wheel_speed=rows[:, 7] if rows.shape[1] > 7 else None,
    )


def _intervals(time: FloatArray, dvel: FloatArray) -> FloatArray:
    """Return the interval that each sample's increments span, s.

    That is the time since the sample before. Where samples are lost, some IMUs add the increments up and some lose
    them too: of an odd interval and the usual one, that which makes the specific force more like gravity is taken.
    """
    usual = _usual(time)
    interval = np.concatenate(([usual], np.diff(time)))
    odd = np.flatnonzero(~((interval < ODD_INTERVAL * usual) & (interval > usual / ODD_INTERVAL)))
    fits = np.zeros(odd.size, dtype=np.bool_)
    ahead = interval[odd] > 0.0
    own, common = dvel[odd[ahead]] / interval[odd[ahead]], dvel[odd[ahead]] / usual
    fits[ahead] = np.abs(own - GRAVITY) < np.abs(common - GRAVITY)
    interval[odd[~fits]] = usual
    return interval


def _gnss(name: str, rows: FloatArray) -> GnssData:
    position = np.column_stack((np.radians(rows[:, 1:3]), rows[:, 3]))
    beyond = np.flatnonzero((np.abs(rows[:, 1]) > 90.0) | (np.abs(rows[:, 2]) > 360.0))
    if beyond.size:
        raise LogError(
            f"{name}, line {beyond[0] + 1}: the position is beyond 90 or 360 degrees ({beyond.size} such lines in "
            "all); repair or remove the line."
        )
    if rows.shape[1] == 7:
        return GnssData(time=rows[:, 0], position_llh=position, position_std=_sigma(rows[:, 4:7]))
    first, second = rows[:, 4:7], rows[:, 7:10]
    sigma_first, sigma_second = (bool((block >= 0.0).all()) for block in (first, second))
    if sigma_first == sigma_second:
        # KF-GINS-Matlab writes sigmas before velocities, some offspring of KF-GINS the other way round.
        found = "neither" if not sigma_first else "both"
        raise LogError(
            f"{name}: of columns 5 to 7 and 8 to 10 one must be velocities and one sigmas, but {found} could be sigmas "
            "(no number is negative); describe the columns in a mapping file (mapping=)."
        )
    velocity, sigma = (second, first) if sigma_first else (first, second)
    return GnssData(
        time=rows[:, 0],
        velocity_ned=velocity,
        velocity_std=_sigma(rows[:, 10:13]),
        position_llh=position,
        position_std=_sigma(sigma),
    )


def _sigma(values: FloatArray) -> FloatArray | None:
    return none_if_absent(known_std(values))


READER: Final = Reader(name="kfgins", title="KF-GINS text or binary", sniff=sniff, read=read)
