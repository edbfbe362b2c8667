"""PX4's ULog: the sample drive comes back, the streams mean what they say, damage is told."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pyulog import ULog

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.errors import LevelheadError, LogError
from levelhead.events import Event
from levelhead.logs.log import Log
from levelhead.logs.pieces import ImuData, Pieces
from levelhead.logs.readers import read
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.px4_ulog import READER
from levelhead.logs.readers.ulog import UlogFile
from samples import px4_ulog as ulog
from samples.drive import EPOCH_UTC_S, sample_drive

Put = Callable[[bytes], Path]

# float32 keeps 24 bits: of rates below 0.5 rad/s, of forces below 16 m/s^2, of speeds below 16 m/s.
GYRO_STEP, ACCEL_STEP, SPEED_STEP = 2.0**-25, 2.0**-20, 2.0**-20
# Stamps are whole us, and float64 counts seconds since 1970 to 0.24 us.
STAMP_STEP = 1e-6
TOPICS = ulog.subscription(0, "sensor_combined") + ulog.subscription(1, "sensor_gps")


@pytest.fixture
def put(tmp_path: Path) -> Put:
    """Write what follows the definitions and parameters of the sample, and return the file's path."""

    def put(body: bytes) -> Path:
        path = tmp_path / "a.ulg"
        path.write_bytes(ulog.head() + body)
        return path

    return put


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    return ulog.write(tmp_path)


def pieces_of(path: Path, **choice: str) -> Pieces:
    return READER.read(Source(path=path, **choice))  # type: ignore[arg-type]


def imu_of(pieces: Pieces) -> ImuData:
    assert pieces.imu is not None
    return pieces.imu


def details(events: tuple[Event, ...]) -> dict[str, str]:
    return {event.code: event.detail for event in events}


def raw(gyro: int, accel: int, *, late_s: float = 0.0) -> bytes:
    """Return the drive as raw readings, the accelerometer's at the gyro's stamps plus so much."""
    log = sample_drive()
    records = []
    for t, w, f in zip(log.time, log.gyro, log.accel, strict=True):
        sampled = ulog.microseconds(t)
        records.append((t, ulog.data(gyro, "2QI3f", sampled + 500, sampled, 77, *w)))
        sampled = ulog.microseconds(t + late_s)
        records.append((t + late_s, ulog.data(accel, "2QI3f", sampled + 500, sampled, 78, *f)))
    return ulog.in_order(records)


def test_the_drive_comes_back(sample: Path) -> None:
    log, drive = read(sample), sample_drive()
    np.testing.assert_allclose(log.time, drive.time, rtol=0, atol=STAMP_STEP)
    np.testing.assert_allclose(log.gyro, drive.gyro, rtol=0, atol=GYRO_STEP)
    np.testing.assert_allclose(log.accel, drive.accel, rtol=0, atol=ACCEL_STEP)
    # The first two epochs had no fix yet.
    np.testing.assert_allclose(log.gnss_time, drive.gnss_time[2:], rtol=0, atol=STAMP_STEP)
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    assert log.velocity_std is not None
    assert log.position_std is not None
    np.testing.assert_allclose(log.velocity_ned, drive.velocity_ned[2:], rtol=0, atol=SPEED_STEP)
    # Degrees and radians are float64 in both: a few units in the last place of 1 rad and of 100 m.
    np.testing.assert_allclose(log.position_llh, drive.position_llh[2:], rtol=1e-15, atol=1e-13)
    np.testing.assert_array_equal(log.velocity_std, np.full((148, 3), 0.125))
    np.testing.assert_array_equal(log.position_std[0], [0.5, 0.5, 0.75])


def test_the_log_says_what_it_is(sample: Path) -> None:
    meta = read(sample).meta
    assert meta["format"] == "px4-ulog"
    assert meta["completeness"] == "complete"
    assert meta["height"] == "mean sea level"
    assert meta["gnss_time_scale"] == "UTC"
    assert meta["epoch"] == EPOCH_UTC_S
    assert meta["boot_instant_s"] == EPOCH_UTC_S - ulog.BOOT_S
    assert meta["imu_device_ids"] == {"gyro": 2424842, "accel": 2424842}
    assert meta["calibration"] == {name: value for name, value in ulog.PARAMETERS if not name.startswith("MPC")}
    assert "CAL_GYRO*" in str(meta["compensated"])
    assert details(read(sample).events)["W_DROPPED"] == "2 GNSS epochs without a 3D fix."


def test_the_containers_own_library_reads_the_same(sample: Path) -> None:
    agrees_with_pyulog(sample)


def agrees_with_pyulog(path: Path) -> int:
    """Hold every number of every topic against pyulog's, and return how many topics there were."""
    theirs, ours = ULog(str(path)), UlogFile(path)
    assert len(theirs.data_list) == sum(len(topic.starts) > 0 for topic in ours.topics.values())
    for topic in theirs.data_list:
        records = ours.records(ours.topics[topic.name, topic.multi_id])
        for name, values in topic.data.items():
            field, _, index = name.rstrip("]").partition("[")
            # Structures within structures are not taken apart: nothing that we need is in them.
            if field in (records.dtype.names or ()) and records[field].dtype.kind in "iuf":
                np.testing.assert_array_equal(records[field][:, int(index)] if index else records[field], values)
    everything = re.compile(".*")
    first = {**theirs.initial_parameters, **{name: v for _, name, v in theirs.changed_parameters}}
    assert ours.parameters.lasting(everything, 0).keys() == first.keys()
    return len(theirs.data_list)


def test_without_utc_the_stamps_count_from_boot(put: Put) -> None:
    fixes = [(t, body.replace(body[21:29], bytes(8))) for t, body in ulog.fixes()]
    pieces = pieces_of(put(TOPICS + ulog.in_order(ulog.combined(), fixes)))
    assert imu_of(pieces).time[0] == ulog.BOOT_S
    assert imu_of(pieces).time_scale is None
    assert "boot_instant_s" not in pieces.meta


def test_a_solution_from_elsewhere_fits_the_clock(sample: Path, tmp_path: Path) -> None:
    # GPS time is 18 s ahead of UTC, and the drive begins at 05:47:23 UTC.
    lines = [f"2025/06/27 05:47:{41 + t}.000 40.0 -105.0 1600.0 1 20" for t in range(1, 11)]
    solution = tmp_path / "a.pos"
    header = "% (lat/lon/height=WGS84/ellipsoidal)\n%  GPST  latitude(deg) longitude(deg) height(m) Q ns\n"
    solution.write_text(header + "\n".join(lines) + "\n")
    log = read(sample, gnss=solution)
    np.testing.assert_allclose(log.gnss_time, np.arange(1.0, 11.0), rtol=0, atol=STAMP_STEP)
    # The solution's heights, not those of the receiver in the log.
    assert log.meta["height"] == "ellipsoidal"


def test_raw_readings_are_put_on_the_gyros_stamps(put: Put) -> None:
    body = ulog.subscription(0, "sensor_gyro", 1) + ulog.subscription(1, "sensor_accel", 1) + raw(0, 1, late_s=0.005)
    pieces, drive = pieces_of(put(body)), sample_drive()
    imu = imu_of(pieces)
    assert [s.name for s in pieces.streams] == ["sensor_gyro.1"]
    assert pieces.compensated == ""
    assert pieces.undeclared == ()
    assert pieces.meta["imu_device_ids"] == {"gyro": 77, "accel": 78}
    # The first gyro sample has no accelerometer reading before it.
    np.testing.assert_allclose(imu.time - ulog.BOOT_S, drive.time[1:], rtol=0, atol=STAMP_STEP)
    np.testing.assert_allclose(imu.gyro, drive.gyro[1:], rtol=0, atol=GYRO_STEP)
    # 5 ms late in 20 ms: a quarter of the reading before, three of the one at the stamp.
    expected = 0.25 * drive.accel[:-1] + 0.75 * drive.accel[1:]
    np.testing.assert_allclose(imu.accel, expected, rtol=0, atol=2 * ACCEL_STEP)
    assert pieces.events == ()


def test_no_reading_is_made_up_in_a_gap(put: Put) -> None:
    # Record by record gyro and accel alternate; the accelerometer is lost for half a second.
    size = len(ulog.data(0, "2QI3f", 0, 0, 0, 0.0, 0.0, 0.0))
    both = raw(0, 1, late_s=0.005)
    kept = [both[k : k + size] for k in range(0, len(both), size)]
    body = b"".join(r for k, r in enumerate(kept) if not (k % 2 == 1 and 400 <= k < 450))
    pieces = pieces_of(put(ulog.subscription(0, "sensor_gyro") + ulog.subscription(1, "sensor_accel") + body))
    # 25 accelerometer readings are gone, 26 gyro samples have none on one side.
    detail = "26 IMU samples that lack a reading of the accelerometer, or are marked as unhealthy."
    assert details(pieces.events) == {"W_DROPPED": detail}
    assert imu_of(pieces).time.size == 1499 - 26


def test_a_turned_board_leaves_the_axes_of_raw_readings_open(put: Put) -> None:
    topics = ulog.subscription(0, "sensor_gyro") + ulog.subscription(1, "sensor_accel")
    turned = ulog.parameter("SENS_BOARD_ROT", 4)
    path = put(turned + topics + ulog.subscription(2, "sensor_combined") + raw(0, 1) + ulog.in_order(ulog.combined(2)))
    assert pieces_of(path, imu="sensor_gyro.0").undeclared == ("axes",)
    assert pieces_of(path).undeclared == ()


def test_before_px4_1_11_the_drivers_calibrated(tmp_path: Path) -> None:
    old = ulog.GYRO.replace("uint64_t timestamp_sample", "uint64_t integral_dt")
    head = ulog.head().replace(ulog.definition(ulog.GYRO), ulog.definition(old))
    path = tmp_path / "a.ulg"
    path.write_bytes(head + ulog.subscription(0, "sensor_gyro") + ulog.subscription(1, "sensor_accel") + raw(0, 1))
    assert "CAL_GYRO*" in pieces_of(path).compensated


def test_increments_become_rates(put: Put) -> None:
    drive = sample_drive()
    body = b"".join(
        ulog.data(
            0, "2Q2I6f2H", ulog.microseconds(t) + 900, ulog.microseconds(t), 5, 6, *w * 0.02, *f * 0.01, 20000, 10000
        )
        for t, w, f in zip(drive.time, drive.gyro, drive.accel, strict=True)
    )
    pieces = pieces_of(put(ulog.subscription(0, "vehicle_imu", 2) + body))
    assert [s.name for s in pieces.streams] == ["vehicle_imu.2"]
    assert pieces.meta["imu_device_ids"] == {"gyro": 6, "accel": 5}
    np.testing.assert_allclose(imu_of(pieces).gyro, drive.gyro, rtol=0, atol=GYRO_STEP)
    np.testing.assert_allclose(imu_of(pieces).accel, drive.accel, rtol=0, atol=ACCEL_STEP)


def test_the_calibrated_stream_is_read_unless_another_is_wanted(put: Put) -> None:
    topics = ulog.subscription(0, "sensor_gyro") + ulog.subscription(1, "sensor_accel")
    path = put(topics + ulog.subscription(2, "sensor_combined") + raw(0, 1) + ulog.in_order(ulog.combined(2)[::2]))
    assert [s.name for s in pieces_of(path).streams] == ["sensor_combined", "sensor_gyro.0"]
    assert imu_of(pieces_of(path)).time.size == 750
    assert imu_of(pieces_of(path, imu="sensor_gyro.0")).time.size == 1500
    with pytest.raises(LogError, match="no IMU called 'x'; choose one of: sensor_combined"):
        pieces_of(path, imu="x")


def test_a_stream_that_is_too_slow_is_not_chosen(put: Put) -> None:
    topics = ulog.subscription(0, "sensor_gyro") + ulog.subscription(1, "sensor_accel")
    path = put(topics + ulog.subscription(2, "sensor_combined") + raw(0, 1) + ulog.in_order(ulog.combined(2)[::50]))
    assert imu_of(pieces_of(path)).time.size == 1500


def test_a_change_of_the_calibration_is_told(put: Put) -> None:
    records = ulog.combined()
    first, rest = ulog.in_order(records[:300]), ulog.in_order(records[300:])
    other = ulog.data(3, "QII", ulog.microseconds(3.0), 9, 9)
    body = TOPICS + ulog.subscription(3, "sensor_selection") + ulog.data(3, "QII", ulog.microseconds(0.0), 8, 8)
    pieces = pieces_of(put(body + first + ulog.parameter("CAL_GYRO0_XOFF", 0.5) + other + rest))
    told = details(pieces.events)["W_CALIBRATION_CHANGED"]
    assert told == "CAL_GYRO0_XOFF, sensor_combined went over to another IMU 1 times."
    # The value that held for most of the log.
    calibration = pieces.meta["calibration"]
    assert isinstance(calibration, dict)
    assert calibration["CAL_GYRO0_XOFF"] == 0.5


def test_what_the_logger_lost_is_told(put: Put) -> None:
    body = TOPICS + ulog.message("O", b"\x10\x00") + ulog.message("O", b"\x20\x00") + ulog.in_order(ulog.combined())
    assert details(pieces_of(put(body)).events) == {"W_LOGGER_DROPOUT": "2 times, 48 ms in all."}


def test_a_receiver_without_vertical_velocity_has_a_wide_sigma_there(put: Put) -> None:
    def flat(body: bytes) -> bytes:
        # vel_d is the last of the six floats before the two flags.
        return body[:-6] + bytes(4) + body[-2:]

    fixes = [(t, flat(body)) for t, body in ulog.fixes()]
    pieces = pieces_of(put(TOPICS + ulog.in_order(ulog.combined(), fixes)))
    assert pieces.gnss is not None
    assert pieces.gnss.velocity_ned is not None
    assert pieces.gnss.velocity_std is not None
    assert ("I_VELOCITY_2D", 148) in [(e.code, e.count) for e in pieces.events]
    speed = np.hypot(*pieces.gnss.velocity_ned[:, :2].T)
    np.testing.assert_array_equal(pieces.gnss.velocity_std[:, 2], np.maximum(0.5, 0.05 * speed))
    np.testing.assert_array_equal(pieces.gnss.velocity_std[:, :2], 0.125)


def test_a_velocity_that_is_not_valid_is_none(put: Put) -> None:
    fixes = [(t, body[:-1] + bytes([k % 2])) for k, (t, body) in enumerate(ulog.fixes())]
    gnss = pieces_of(put(TOPICS + ulog.in_order(ulog.combined(), fixes))).gnss
    assert gnss is not None
    assert gnss.velocity_ned is not None
    assert np.isnan(gnss.velocity_ned[::2]).all()
    assert np.isfinite(gnss.velocity_ned[1::2]).all()


def test_a_file_for_its_gnss_data_alone(sample: Path, put: Put) -> None:
    pieces = pieces_of(sample, role="gnss")
    assert pieces.imu is None
    assert pieces.gnss is not None
    with pytest.raises(LogError, match=r"a.ulg has no GNSS topic with samples \(topics: sensor_combined, sensor_gps\)"):
        pieces_of(put(TOPICS + ulog.in_order(ulog.combined())), role="gnss")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (ulog.HEADER, "no topic of an IMU or a receiver with samples (topics: none)."),
        (ulog.head() + ulog.subscription(0, "airspeed"), "What the topic 'airspeed' holds is not defined."),
        (ulog.HEADER + ulog.FLAGS.replace(bytes(16), bytes(8) + b"\x02" + bytes(7)), "newer ULog format"),
        (ulog.HEADER[:9], "has no ULog header"),
        (ulog.head()[:-1], "(topics: none). The file ends within a message: it was cut."),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "a.ulg"
    path.write_bytes(content)
    with pytest.raises(LogError, match=re.escape(sentence)):
        pieces_of(path)


def test_formats_that_nest_without_end_or_grow_without_bound_are_no_formats(tmp_path: Path) -> None:
    texts = ("a:b x;", "b:a x;", "c:double[65535] x;", "d:c[65535] x;", "e:nothing x;", "f:int8_t x;int8_t x;")
    path = tmp_path / "a.ulg"
    topics = b"".join(ulog.subscription(k, name) for k, name in enumerate("abcdef"))
    path.write_bytes(ulog.HEADER + b"".join(map(ulog.definition, texts)) + topics)
    with pytest.raises(LogError) as error:
        pieces_of(path)
    assert str(error.value).count("is not defined") == 6


def test_what_was_appended_after_a_crash_is_read(tmp_path: Path) -> None:
    whole = ulog.write(tmp_path).read_bytes()
    records = sorted((*ulog.combined(), *ulog.fixes()), key=lambda record: record[0])
    cut = len(whole) - len(b"".join(body for _, body in records[1000:]))
    first, appended = whole[: cut + 30], whole[cut + len(records[1000][1]) :]
    flags = ulog.FLAGS[:3] + bytes(8) + b"\x01" + bytes(7) + len(first).to_bytes(8, "little") + bytes(16)
    path = tmp_path / "a.ulg"
    path.write_bytes((first + appended).replace(ulog.FLAGS, flags))
    log = read(path)
    assert log.time.size == 1500 - 1
    assert "where data was appended after a crash" in details(log.events)["W_DAMAGED"]
    assert log.meta["completeness"] == "malformed_record"


def test_damage_in_the_middle_costs_what_is_damaged(sample: Path) -> None:
    content = bytearray(sample.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 300] = bytes(300)
    sample.write_bytes(content)
    log = read(sample)
    # 300 bytes touch at most 6 records of 57 bytes.
    assert 1494 <= log.time.size < 1500
    assert log.meta["completeness"] == "malformed_record"
    assert re.fullmatch(r"At byte \d+, \d+ bytes in all are no sound messages.", details(log.events)["W_DAMAGED"])


def test_a_record_of_another_size_is_no_record(put: Put) -> None:
    rows = [body for _, body in ulog.combined()]
    short = ulog.message("D", rows[700][3:-5])
    pieces = pieces_of(put(TOPICS + b"".join(rows[:700]) + short + b"".join(rows[701:])))
    assert imu_of(pieces).time.size == 1499
    assert f"{len(short)} bytes in all" in pieces.damaged


def test_a_receiver_that_never_had_a_fix_gives_none(put: Put) -> None:
    path = put(TOPICS + ulog.in_order(ulog.combined(), ulog.fixes()[:2]))
    assert details(pieces_of(path).events)["W_DROPPED"] == "2 GNSS epochs without a 3D fix."
    assert pieces_of(path).gnss is None
    with pytest.raises(LogError, match=r"a\.ulg .* holds no GNSS data; pass the file that does as gnss="):
        read(path)


def test_an_imu_without_a_single_whole_sample_is_refused(put: Put) -> None:
    # The accelerometer's stamp of every record says that there is no reading.
    rows = [body[:29] + b"\xff\xff\xff\x7f" + body[33:] for _, body in ulog.combined()]
    with pytest.raises(LogError, match="sensor_combined has no usable sample"):
        pieces_of(put(TOPICS + b"".join(rows)))


def test_noise_is_not_taken_for_messages(put: Put) -> None:
    # Half a megabyte of random bytes: by chance some of them look like the head of a message.
    noise = np.random.default_rng(3).integers(0, 256, 500_000, dtype=np.uint8).tobytes()
    pieces = pieces_of(put(TOPICS + noise + ulog.in_order(ulog.combined())))
    assert imu_of(pieces).time.size == 1500
    assert "500000 bytes in all" in pieces.damaged


def test_zeros_to_the_end_are_a_cut(sample: Path) -> None:
    content = sample.read_bytes()
    sample.write_bytes(content + bytes(200_000))
    log = read(sample)
    assert log.time.size == 1500
    assert log.meta["completeness"] == "truncated"
    assert "on nothing can be read (200000 bytes)." in details(log.events)["W_DAMAGED"]


def boundaries(content: bytes) -> set[int]:
    """Return where messages of a sound file end."""
    ends, pos = set(), len(ulog.HEADER)
    while pos < len(content):
        pos += 3 + int.from_bytes(content[pos : pos + 2], "little")
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
    head = len(ulog.head())
    for k in range(200):
        changed = bytearray(content)
        # Every other change hits the definitions.
        at = int(rng.integers(0, head + 60 if k % 2 else len(content)))
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
            # Bytes that are missing or too many shift a message, which is never taken for a sound one.
            assert log.meta["completeness"] != "complete", (k, at)


def log_or_refusal(path: Path) -> Log | None:
    try:
        return read(path)
    except LevelheadError:
        return None


def gravity(accel: FloatArray) -> FloatArray:
    return np.asarray(np.median(accel, axis=0))


def test_a_recorded_log_of_2016(data_folder: Path) -> None:
    path = data_folder / "formats" / "px4_sample.ulg"
    assert agrees_with_pyulog(path) == 15
    pieces = pieces_of(path)
    imu = imu_of(pieces)
    assert [s.name for s in pieces.streams] == ["sensor_combined"]
    assert imu.time.size == 17070
    # 250 Hz as designed, a few samples lost.
    assert np.diff(imu.time).mean() == pytest.approx(0.004, rel=0.01)
    # In a hovering multicopter z is down; within 0.5 m/s^2 of gravity, for it tilts and vibrates.
    assert gravity(imu.accel)[2] == pytest.approx(-GRAVITY, abs=0.5)
    assert pieces.gnss is None
    assert details(pieces.events)["W_LOGGER_DROPOUT"] == "4 times, 119 ms in all."
    assert (pieces.left_out, pieces.damaged) == (0, "")


def test_a_recorded_log_of_2021(data_folder: Path) -> None:
    path = data_folder / "formats" / "px4_small.ulg"
    assert agrees_with_pyulog(path) == 70
    pieces = pieces_of(path)
    imu, gnss = imu_of(pieces), pieces.gnss
    assert [s.name for s in pieces.streams if s.kind == "imu"] == [
        "sensor_combined",
        *(f"vehicle_imu.{n}" for n in range(3)),
        *(f"sensor_gyro.{n}" for n in range(3)),
    ]
    assert imu.time.size == 1298
    assert np.diff(imu.time).mean() == pytest.approx(0.005, rel=0.01)
    # At rest on the ground, the accelerometer calibrated to 2 %.
    assert np.linalg.norm(gravity(imu.accel)) == pytest.approx(GRAVITY, rel=0.02)
    assert gravity(imu.accel)[2] < 0.0
    assert gnss is not None
    assert gnss.velocity_ned is not None
    assert gnss.position_llh is not None
    assert gnss.time.size == 32
    # At rest: within three of the receiver's sigmas, 0.65 m/s.
    assert np.abs(gnss.velocity_ned).max() < 2.0
    np.testing.assert_allclose(np.degrees(gnss.position_llh[0, :2]), [63.4171, 10.4082], atol=1e-4)
    # The board is turned, so the raw readings' axes are not the vehicle's.
    assert pieces_of(path, imu="sensor_gyro.0").undeclared == ("axes",)
    assert pieces.meta["imu_device_ids"] == {"gyro": 2424842, "accel": 2424842}
