"""ArduPilot's DataFlash: the sample drive comes back, the messages mean what they say, damage is told."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from pymavlink import DFReader

from levelhead.conventions import GRAVITY
from levelhead.errors import LevelheadError, LogError
from levelhead.events import Event
from levelhead.logs.log import Log
from levelhead.logs.pieces import GnssData, ImuData, Pieces
from levelhead.logs.readers import read
from levelhead.logs.readers.ardupilot_bin import READER
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.dataflash import DataFlashFile, in_units
from samples import ardupilot_bin as dataflash
from samples.drive import sample_drive

Put = Callable[[bytes], Path]

# float32 keeps 24 bits: of rates below 0.5 rad/s, of forces below 16 m/s^2.
GYRO_STEP, ACCEL_STEP = 2.0**-25, 2.0**-20
# Speeds below 16 m/s to 2^-20, and the course's 2^-16 degrees turn 16 m/s by 4e-6 m/s.
SPEED_STEP = 2.0**-20 + 16.0 * np.radians(2.0**-16)
# Half of 1e-7 degree, and half of 1 cm.
PLACE_STEP = np.array([np.radians(0.5e-7), np.radians(0.5e-7), 0.005]) * 1.001
# Stamps are whole us, and float64 counts seconds since 1970 to 0.24 us.
STAMP_STEP = 1e-6


@pytest.fixture
def put(tmp_path: Path) -> Put:
    """Write what follows the descriptions and parameters of the sample, and return the file's path."""

    def put(body: bytes) -> Path:
        path = tmp_path / "a.bin"
        path.write_bytes(dataflash.head() + body)
        return path

    return put


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    return dataflash.write(tmp_path)


def pieces_of(path: Path, **choice: str) -> Pieces:
    return READER.read(Source(path=path, **choice))  # type: ignore[arg-type]


def imu_of(pieces: Pieces) -> ImuData:
    assert pieces.imu is not None
    return pieces.imu


def gnss_of(pieces: Pieces) -> GnssData:
    assert pieces.gnss is not None
    return pieces.gnss


def details(events: tuple[Event, ...]) -> dict[str, str]:
    return {event.code: event.detail for event in events}


def test_the_drive_comes_back(sample: Path) -> None:
    log, drive = read(sample), sample_drive()
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    assert log.velocity_std is not None
    assert log.position_std is not None
    np.testing.assert_allclose(log.time, drive.time, rtol=0, atol=STAMP_STEP)
    np.testing.assert_allclose(log.gyro, drive.gyro, rtol=0, atol=GYRO_STEP)
    np.testing.assert_allclose(log.accel, drive.accel, rtol=0, atol=ACCEL_STEP)
    # The first two epochs had no fix yet.
    np.testing.assert_allclose(log.gnss_time, drive.gnss_time[2:], rtol=0, atol=STAMP_STEP)
    np.testing.assert_allclose(log.velocity_ned, drive.velocity_ned[2:], rtol=0, atol=SPEED_STEP)
    assert (np.abs(log.position_llh - drive.position_llh[2:]) <= PLACE_STEP).all()
    np.testing.assert_allclose(log.velocity_std, np.full((148, 3), 0.13))
    np.testing.assert_allclose(log.position_std[0], [0.5, 0.5, 0.75])


def test_the_log_says_what_it_is(sample: Path) -> None:
    log = read(sample)
    assert log.meta["format"] == "ardupilot-bin"
    assert log.meta["completeness"] == "complete"
    assert log.meta["height"] == "mean sea level"
    assert log.meta["gnss_time_scale"] == "GPST"
    assert log.meta["epoch"] == pytest.approx(dataflash.EPOCH_GPST_S, abs=STAMP_STEP)
    assert log.meta["boot_instant_s"] == pytest.approx(dataflash.EPOCH_GPST_S - dataflash.BOOT_S, abs=STAMP_STEP)
    assert log.meta["imu_instance"] == 0
    assert log.meta["calibration"] == dict(dataflash.PARAMETERS[:4])
    assert "INS_GYROFFS" in str(log.meta["compensated"])
    assert details(log.events)["W_DROPPED"] == "2 GNSS epochs without a 3D fix."


def test_one_of_several_imus_is_chosen(put: Put) -> None:
    path = put(dataflash.in_order(dataflash.readings(0), dataflash.readings(1)[::2]))
    assert [s.name for s in pieces_of(path).streams] == ["IMU.0", "IMU.1"]
    assert imu_of(pieces_of(path)).time.size == 1500
    other = pieces_of(path, imu="IMU.1")
    assert imu_of(other).time.size == 750
    assert other.meta["imu_instance"] == 1
    with pytest.raises(LogError, match=r"no IMU called 'x'; choose one of: IMU\.0"):
        pieces_of(path, imu="x")


def test_receivers_are_told_apart(put: Put) -> None:
    path = put(dataflash.in_order(dataflash.fixes(0), dataflash.fixes(1)[::2], dataflash.fixes(2)[::3]))
    streams = pieces_of(path, role="gnss").streams
    assert [(s.name, s.samples, s.note) for s in streams] == [
        ("GPS.0", 150, ""),
        ("GPS.1", 75, ""),
        ("GPS.2", 50, "blended from the others"),
    ]
    assert gnss_of(pieces_of(path, role="gnss", gnss="GPS.1")).time.size == 74


@pytest.mark.parametrize("healthy", [(0, 1), (1, 0)])
def test_readings_that_are_not_healthy_are_left_out(put: Put, healthy: tuple[int, int]) -> None:
    sick = dataflash.readings(healthy=healthy)[:40]
    pieces = pieces_of(put(dataflash.in_order(sick, dataflash.readings()[40:])))
    assert imu_of(pieces).time.size == 1460
    assert details(pieces.events)["W_DROPPED"].startswith("40 IMU samples")


def test_every_sample_is_read_where_the_filtered_ones_are_slow(put: Put) -> None:
    drive = sample_drive()
    # The accelerometer samples 5 ms after the gyro, and both are logged 2 ms after that.
    samples = []
    for t, w, f in zip(drive.time, drive.gyro, drive.accel, strict=True):
        gyro, accel = dataflash.microseconds(t), dataflash.microseconds(t + 0.005)
        samples.append((t, dataflash.message("GYR", gyro + 2000, 0, gyro, *w)))
        samples.append((t + 0.005, dataflash.message("ACC", accel + 2000, 0, accel, *f)))
    pieces = pieces_of(put(dataflash.in_order(samples, dataflash.readings()[::10])))
    assert [s.name for s in pieces.streams] == ["IMU.0", "GYR.0"]
    imu = imu_of(pieces)
    np.testing.assert_allclose(imu.time - dataflash.BOOT_S, drive.time[1:], rtol=0, atol=STAMP_STEP)
    np.testing.assert_allclose(imu.gyro, drive.gyro[1:], rtol=0, atol=GYRO_STEP)
    # 5 ms late in 20 ms: a quarter of the reading before, three of the one at the stamp.
    expected = 0.25 * drive.accel[:-1] + 0.75 * drive.accel[1:]
    np.testing.assert_allclose(imu.accel, expected, rtol=0, atol=2 * ACCEL_STEP)


def test_logs_of_2014_have_a_kind_for_each_imu_and_milliseconds(tmp_path: Path) -> None:
    drive = sample_drive()
    kinds = (
        dataflash.fmt(128, "BBnNZ", "FMT", "Type,Length,Name,Format,Columns"),
        dataflash.fmt(10, "Iffffff", "IMU", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        dataflash.fmt(11, "Iffffff", "IMU2", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        dataflash.fmt(12, "BIHLLeEefI", "GPS", "Status,TimeMS,Week,Lat,Lng,Alt,Spd,GCrs,VZ,T"),
    )
    head, body = bytes([0xA3, 0x95]), []
    for t, w, f in zip(drive.time, drive.gyro, drive.accel, strict=True):
        stamp = dataflash.microseconds(t) // 1000
        row = np.array((stamp, *w, *f), dtype="<u4,<f4,<f4,<f4,<f4,<f4,<f4").tobytes()
        body += [(t, head + b"\x0a" + row), (t, head + b"\x0b" + row)]
    place = (400_000_000, -1_050_000_000, 160_000)
    row_type = np.dtype("<u1,<u4,<u2,<i4,<i4,<i4,<u4,<i4,<f4,<u4")
    for t in range(5):
        row = np.array((3, 1000 * t, 2000, *place, 500, 9000, -0.25, 60_000 + 1000 * t), dtype=row_type).tobytes()
        body.append((float(t), head + b"\x0c" + row))
    path = tmp_path / "a.bin"
    path.write_bytes(b"".join(kinds) + dataflash.in_order(body))
    pieces = pieces_of(path, imu="IMU.1")
    assert [s.name for s in pieces.streams] == ["IMU.0", "IMU.1", "GPS.0"]
    assert pieces.meta["boot_instant_s"] == 315964800.0 + 604800.0 * 2000 - 60.0
    np.testing.assert_allclose(imu_of(pieces).gyro, drive.gyro, rtol=0, atol=GYRO_STEP)
    gnss = gnss_of(pieces)
    assert gnss.velocity_ned is not None
    assert gnss.position_llh is not None
    # 1e-3 for stamps of whole ms: fix and sample of one instant agree.
    np.testing.assert_allclose(gnss.time, imu_of(pieces).time[::50][:5], rtol=0, atol=1e-3)
    # 5 m/s eastwards; a course of 90 degrees leaves 16 digits of it to the north.
    np.testing.assert_allclose(gnss.velocity_ned, np.tile([0.0, 5.0, -0.25], (5, 1)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(gnss.position_llh, np.tile([*np.radians([40.0, -105.0]), 1600.0], (5, 1)), rtol=1e-15)


def test_a_receiver_without_vertical_velocity_has_a_wide_sigma_there(put: Put) -> None:
    pieces = pieces_of(put(dataflash.in_order(dataflash.readings(), dataflash.fixes(vertical=False))))
    gnss = gnss_of(pieces)
    assert gnss.velocity_ned is not None
    assert gnss.velocity_std is not None
    assert ("I_VELOCITY_2D", 148) in [(e.code, e.count) for e in pieces.events]
    speed = np.hypot(*gnss.velocity_ned[:, :2].T)
    np.testing.assert_array_equal(gnss.velocity_std[:, 2], np.maximum(0.5, 0.05 * speed))


def test_accuracies_that_are_not_told_are_not_known(put: Put) -> None:
    # The message of accuracies follows that of the fix.
    size = len(dataflash.message("GPS", *([0] * 15)))
    pieces = pieces_of(put(b"".join(body[:size] for _, body in dataflash.fixes())), role="gnss")
    assert gnss_of(pieces).velocity_std is None
    assert gnss_of(pieces).position_std is None


def test_a_change_of_the_calibration_is_told(put: Put) -> None:
    rows = dataflash.readings()
    change = dataflash.parameter("INS_GYROFFS_X", 0.5, 3.0)
    pieces = pieces_of(put(dataflash.in_order(rows[:300]) + change + dataflash.in_order(rows[300:])))
    assert details(pieces.events)["W_CALIBRATION_CHANGED"] == "INS_GYROFFS_X."
    calibration = pieces.meta["calibration"]
    assert isinstance(calibration, dict)
    # The value that held for most of the log.
    assert calibration["INS_GYROFFS_X"] == 0.5


def test_a_calibration_at_the_end_is_not_the_one_of_the_log(put: Put) -> None:
    pieces = pieces_of(put(dataflash.in_order(dataflash.readings()) + dataflash.parameter("INS_GYROFFS_X", 0.5, 30.0)))
    calibration = pieces.meta["calibration"]
    assert isinstance(calibration, dict)
    assert calibration["INS_GYROFFS_X"] == 0.015625


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (dataflash.head(), "no messages of an IMU or a receiver (it has: PARM)."),
        (dataflash.head()[:-1], "(it has: PARM). The file ends within a message: it was cut."),
        (b"\xa3\x95\x81" + bytes(200), "does not begin as an ArduPilot log does"),
        (b"\xa3\x95\x80\x80" + bytes(85), "no messages of an IMU or a receiver (it has: none)."),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(content)
    with pytest.raises(LogError, match=re.escape(sentence)):
        pieces_of(path)
    with pytest.raises(LogError):
        pieces_of(path, role="gnss")


@pytest.mark.parametrize(
    "wrong",
    [
        dataflash.fmt(200, "Qf", "XYZ", "TimeUS"),
        dataflash.fmt(200, "Qf", "XYZ", "A,A"),
        dataflash.fmt(200, "Qf", "XYZ", "A,"),
        dataflash.fmt(200, "Qf", "IMU", "TimeUS,A"),
        dataflash.fmt(130, "Qf", "XYZ", "TimeUS,A"),
        dataflash.fmt(200, "Qf", "XYZ", "TimeUS,A").replace(b"Qf", b"Q?"),
        dataflash.fmt(200, "Qf", "XYZ", "TimeUS,A").replace(b"Qf", b"QQ"),
    ],
)
def test_a_description_that_cannot_be_is_damage(put: Put, wrong: bytes) -> None:
    rows = dataflash.readings()
    pieces = pieces_of(put(dataflash.in_order(rows[:-1]) + wrong + rows[-1][1]))
    assert "89 bytes in all are no known messages." in pieces.damaged
    assert imu_of(pieces).time.size == 1500


def test_damage_in_the_middle_costs_what_is_damaged(sample: Path) -> None:
    content = bytearray(sample.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 300] = bytes(300)
    sample.write_bytes(content)
    log = read(sample)
    # 300 bytes touch at most 7 messages of 54 bytes.
    assert 1493 <= log.time.size < 1500
    assert log.meta["completeness"] == "malformed_record"
    assert re.fullmatch(r"At byte \d+, \d+ bytes in all are no known messages.", details(log.events)["W_DAMAGED"])


def test_what_looks_like_a_message_within_damage_is_none(put: Put) -> None:
    rows = [body for _, body in dataflash.readings()]
    fake = bytes(10) + rows[0][:3] + bytes(30)
    pieces = pieces_of(put(b"".join(rows[:700]) + fake + b"".join(rows[700:])))
    np.testing.assert_allclose(imu_of(pieces).gyro, sample_drive().gyro, rtol=0, atol=GYRO_STEP)
    assert f"{len(fake)} bytes in all" in pieces.damaged


def test_a_receiver_that_never_had_a_fix_gives_none(put: Put) -> None:
    path = put(dataflash.in_order(dataflash.readings(), dataflash.fixes()[:2]))
    assert details(pieces_of(path).events)["W_DROPPED"] == "2 GNSS epochs without a 3D fix."
    assert pieces_of(path).gnss is None
    with pytest.raises(LogError, match=r"a\.bin .* holds no GNSS data; pass the file that does as gnss="):
        read(path)


def test_zeros_to_the_end_are_a_cut(sample: Path) -> None:
    sample.write_bytes(sample.read_bytes() + bytes(200_000))
    log = read(sample)
    assert log.time.size == 1500
    assert log.meta["completeness"] == "truncated"
    assert "200000 bytes in all are no known messages." in details(log.events)["W_DAMAGED"]


def boundaries(content: bytes) -> set[int]:
    """Return where messages of a sound file end."""
    sizes = {number: len(dataflash.fmt(number, *rest)) for number, *rest in [(128, "BBnNZ", "FMT", "")]}
    ends, pos = set(), 0
    while pos < len(content):
        if content[pos + 2] == 128:
            sizes[content[pos + 3]] = content[pos + 4]
        pos += sizes[content[pos + 2]]
        ends.add(pos)
    return ends


def test_a_cut_file_is_marked(sample: Path) -> None:
    content = sample.read_bytes()
    ends = boundaries(content)
    for cut in np.linspace(1, len(content) - 1, 101).astype(int).tolist():
        sample.write_bytes(content[:cut])
        log = log_or_refusal(sample)
        # At the end of a message the format cannot tell a cut file from a whole one.
        assert log is None or log.meta["completeness"] == "truncated" or cut in ends


def test_hostile_bytes_give_a_log_or_a_sentence(sample: Path) -> None:
    content = sample.read_bytes()
    rng = np.random.default_rng(11)
    head = len(dataflash.head())
    for k in range(200):
        changed = bytearray(content)
        # Every other change hits the descriptions.
        at = int(rng.integers(0, head if k % 2 else len(content)))
        some = rng.integers(0, 256, int(rng.integers(1, 9)), dtype=np.uint8).tobytes()
        match k % 4:
            case 0:
                changed[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                changed[at : at + len(some)] = some
            case 2:
                del changed[at : at + len(some)]
            case 3:
                changed[at:at] = some
        sample.write_bytes(changed)
        log = log_or_refusal(sample)
        if log is not None and k % 4 >= 2:
            # Bytes that are missing or too many shift what follows, which is then no message.
            assert log.meta["completeness"] != "complete", (k, at)


def log_or_refusal(path: Path) -> Log | None:
    try:
        return read(path)
    except LevelheadError:
        return None


def messages(path: Path) -> Iterator[object]:
    """Give what ArduPilot's own library reads."""
    log = DFReader.DFReader_binary(str(path))
    while (message := log.recv_msg()) is not None:
        yield message
    log.close()


def agrees_with_pymavlink(path: Path) -> int:
    """Hold every number of every message against pymavlink's, and return how many messages there were."""
    ours = DataFlashFile(path)
    seen: dict[str, list[dict[str, float]]] = {}
    for message in messages(path):
        seen.setdefault(message.get_type(), []).append(message.to_dict())  # type: ignore[attr-defined]
    for name, kind in ours.kinds.items():
        records, theirs = ours.records(kind), seen.get(name, [])
        assert len(records) == len(theirs), name
        for field in kind.dtype.names or ():
            if len(theirs) and kind.dtype[field].kind in "iuf":
                # One unit in the last place: they divide, we multiply.
                expected = np.array([row[field] for row in theirs], dtype=np.float64)
                np.testing.assert_allclose(in_units(kind, records, [field])[:, 0], expected, rtol=4e-16)
    return sum(len(rows) for name, rows in seen.items() if name in ours.kinds)


def test_ardupilots_own_library_reads_the_same(sample: Path) -> None:
    assert agrees_with_pymavlink(sample) == 2 * 1500 + 2 * 150 + len(dataflash.PARAMETERS)


def test_a_recorded_log(data_folder: Path) -> None:
    path = data_folder / "formats" / "ardupilot_test.BIN"
    pieces = pieces_of(path)
    imu, gnss = imu_of(pieces), gnss_of(pieces)
    assert [(s.name, s.samples) for s in pieces.streams] == [("IMU.0", 45), ("IMU.1", 45), ("GPS.0", 5)]
    # The first 64 KiB of a longer log.
    assert (pieces.left_out, pieces.damaged) == (1, "")
    # At rest; the accelerometer calibrated to 2 %.
    mean = imu.accel.mean(axis=0)
    assert np.linalg.norm(mean) == pytest.approx(GRAVITY, rel=0.02)
    assert mean[2] < -9.0
    assert gnss.velocity_ned is not None
    assert gnss.velocity_std is not None
    assert gnss.position_llh is not None
    # At rest: within three of the receiver's sigmas.
    assert (np.abs(gnss.velocity_ned) < 3.0 * gnss.velocity_std).all()
    np.testing.assert_allclose(np.degrees(gnss.position_llh[0, :2]), [-35.3626, 149.1653], atol=1e-4)
    assert gnss.position_llh[0, 2] == pytest.approx(588.82, abs=0.005)
    calibration = pieces.meta["calibration"]
    assert isinstance(calibration, dict)
    assert calibration["INS_ACCOFFS_Y"] == pytest.approx(2.485, abs=5e-4)
    assert agrees_with_pymavlink(path) == 1599
