"""u-blox UBX: frames are found behind any damage, fields are those of pyubx2, the sensor's clock is set by order."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage, UBXReader

from hostile import cases
from levelhead.errors import LevelheadError, LogError
from levelhead.logs.log import Log
from levelhead.logs.pieces import GnssData, ImuData, Pieces
from levelhead.logs.readers import frames as binary
from levelhead.logs.readers import read
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.ublox_ubx import LAYOUTS, PVT, READER, UBX
from samples import ublox_ubx
from samples.drive import EPOCH_UTC_S, sample_drive

LLH = np.array([0.84, 0.16, 300.0])
NORTH = np.array([3.0, 0.0, 0.0])
GPST_S = EPOCH_UTC_S + 18.0


@pytest.fixture(scope="module")
def frames() -> list[bytes]:
    return ublox_ubx.frames()


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ublox_ubx.write(tmp_path_factory.mktemp("ubx"))


def pieces_of(path: Path, content: bytes, **asked: object) -> Pieces:
    path = path / "a.ubx"
    path.write_bytes(content)
    return READER.read(dataclasses.replace(Source(path=path), **asked))  # type: ignore[arg-type]


def gnss_of(path: Path, content: bytes) -> GnssData:
    gnss = pieces_of(path, content, role="gnss").gnss
    assert gnss is not None
    return gnss


def imu_of(pieces: Pieces) -> ImuData:
    assert pieces.imu is not None
    return pieces.imu


def nav(name: str, **fields: object) -> bytes:
    return bytes(UBXMessage("NAV", name, GET, **fields).serialize())


def test_the_drive_comes_back(sample: Path) -> None:
    drive, log = sample_drive(), read(sample)
    assert log.meta["format"] == "ublox-ubx"
    assert log.meta["completeness"] == "complete"
    assert log.meta["undeclared"] == ("axes", "clock")
    # Stamps: the tick is fitted to the epochs; float64 at 1.75e9 s resolves 2.4e-7 s.
    np.testing.assert_allclose(log.time, drive.time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(log.gnss_time, drive.gnss_time, rtol=0, atol=1e-6)
    # Half of a unit: 2^-12 deg/s, 2^-10 m/s^2, 1 mm/s; latitude and longitude are cut at 1e-7 deg, the height at 1 mm.
    np.testing.assert_allclose(log.gyro, drive.gyro, rtol=0, atol=np.radians(2.0**-13) * 1.001)
    np.testing.assert_allclose(log.accel, drive.accel, rtol=0, atol=2.0**-11 * 1.001)
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    np.testing.assert_allclose(log.velocity_ned, drive.velocity_ned, rtol=0, atol=5.01e-4)
    np.testing.assert_allclose(log.position_llh[:, :2], drive.position_llh[:, :2], rtol=0, atol=np.radians(1.01e-7))
    np.testing.assert_allclose(log.position_llh[:, 2], drive.position_llh[:, 2], rtol=0, atol=1.01e-3)
    np.testing.assert_array_equal(log.velocity_std, np.full((drive.gnss_time.size, 3), 0.05))
    assert log.position_std is not None
    np.testing.assert_allclose(log.position_std[0], [0.014, 0.014, 0.02], rtol=1e-12)
    # 2025-06-27 05:47:23 UTC is 18 s later in GPS time.
    assert log.meta["epoch"] == pytest.approx(GPST_S + drive.time[0], abs=1e-6)


def test_the_frames_and_fields_of_a_recording_are_those_of_pyubx2(data_folder: Path) -> None:
    path = data_folder / "formats" / "walk_0827.ubx"
    found = binary.scan(path, UBX, (PVT,))
    with path.open("rb") as file:
        theirs = [m for _, m in UBXReader(file, quitonerror=0) if m.identity.startswith(("NAV", "RXM"))]
    assert found.count == len(theirs) == 3400
    assert (found.damaged_places, found.cut_start, found.cut_end) == (0, False, False)
    rows = found.frames[PVT].rows(LAYOUTS[PVT].itemsize)[0].view(LAYOUTS[PVT])[:, 0]
    expected = [m for m in theirs if m.identity == "NAV-PVT"]
    assert rows.size == len(expected) == 536
    names = {"nano": "nano", "fix": "fixType", "height": "height", "hacc": "hAcc", "vacc": "vAcc", "sacc": "sAcc"}
    names |= {"vn": "velN", "ve": "velE", "vd": "velD", "year": "year", "minute": "min", "second": "second"}
    for ours, name in names.items():
        np.testing.assert_array_equal(rows[ours], [getattr(m, name) for m in expected])
    np.testing.assert_allclose(1e-7 * rows["lat"], [m.lat for m in expected], rtol=1e-15)
    np.testing.assert_allclose(1e-7 * rows["lon"], [m.lon for m in expected], rtol=1e-15)


def test_a_recorded_walk_is_gnss_beside_an_imu_file(data_folder: Path) -> None:
    pieces = READER.read(Source(path=data_folder / "formats" / "walk_0827.ubx", role="gnss"))
    gnss = pieces.gnss
    assert gnss is not None
    assert gnss.velocity_ned is not None
    assert gnss.position_llh is not None
    assert [(s.name, s.samples) for s in pieces.streams] == [("NAV-PVT", 536)]
    # 4 Hz without a gap; the first at 17:30:21.749543 UTC on 2025-08-28, 18 s later in GPS time.
    np.testing.assert_allclose(np.diff(gnss.time), 0.25, atol=2e-6)
    assert gnss.time[0] == pytest.approx(1756402221.749543 + 18.0, abs=1e-6)
    # Somebody walks, in Colorado, at 1580 m above the ellipsoid.
    assert np.hypot(*gnss.velocity_ned[:, :2].T).max() < 2.0
    np.testing.assert_allclose(np.degrees(gnss.position_llh[0, :2]), [40.0967, -105.1472], atol=1e-4)
    assert np.ptp(gnss.position_llh[:, 2]) < 2.0
    # The velocity is the derivative of the position: over 134 s they agree to the centimetres of an RTK fix.
    north = 6_370_000.0 * (gnss.position_llh[-1, 0] - gnss.position_llh[0, 0])
    assert np.trapezoid(gnss.velocity_ned[:, 0], gnss.time) == pytest.approx(north, abs=0.3)
    assert pieces.meta == {"height": "ellipsoidal"}


def test_no_frame_is_lost_behind_a_false_header(tmp_path: Path, frames: list[bytes]) -> None:
    # A header whose length reaches over the next frames: pyubx2 takes it at its word.
    whole, middle = b"".join(frames), len(b"".join(frames[:1600]))
    false = b"\xb5\x62\x01\x07\x00\x40"
    broken = whole[:middle] + false + whole[middle:]
    theirs = [m for _, m in UBXReader(BytesIO(broken), quitonerror=0) if m is not None]
    assert len(theirs) < len(frames)
    pieces, clean = pieces_of(tmp_path, broken), pieces_of(tmp_path, whole)
    np.testing.assert_array_equal(imu_of(pieces).gyro, imu_of(clean).gyro)
    assert pieces.damaged == (
        "a.ubx: 6 bytes in 1 places are neither UBX frames with the right checksum nor NMEA or RTCM."
    )


def test_nmea_rtcm_and_padding_between_the_frames_are_no_damage(tmp_path: Path, frames: list[bytes]) -> None:
    rtcm = b"\xd3\x00\x04\x43\x20\xb5\x62" + b"\x01\x02\x03"
    others = itertools.cycle([b"$GNGLL,,,,,,V,N*7A\r\n", rtcm, b"\xff" * 7, b"", b"\r\n"])
    mixed = b"".join(frame + next(others) for frame in frames)
    pieces = pieces_of(tmp_path, mixed)
    assert (pieces.damaged, pieces.left_out) == ("", 0)
    np.testing.assert_array_equal(imu_of(pieces).gyro, imu_of(pieces_of(tmp_path, b"".join(frames))).gyro)


@pytest.mark.parametrize("chunk", [4096, 5000, 40_001])
def test_a_long_file_is_read_in_parts(
    sample: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    content = sample.read_bytes()
    mixed = content[:50_000] + b"junk" * 500 + content[50_000:] + b"$GNGLL,,,,,,V,N*7A\r\n"
    (tmp_path / "b.ubx").write_bytes(mixed)
    wanted = (PVT, 0x1002)
    once = binary.scan(tmp_path / "b.ubx", UBX, wanted)
    # Frames of this file are shorter than 1100 bytes, as are sentences and RTCM messages always.
    monkeypatch.setattr(binary, "_LONGEST", 1100)
    monkeypatch.setattr(binary, "_CHUNK", chunk)
    parts = binary.scan(tmp_path / "b.ubx", UBX, wanted)
    for message in wanted:
        np.testing.assert_array_equal(parts.frames[message].at, once.frames[message].at)
        np.testing.assert_array_equal(parts.frames[message].data, once.frames[message].data)
    assert (parts.count, parts.damaged_bytes, parts.damaged_places) == (once.count, once.damaged_bytes, 1)


def raw_frames(time: np.ndarray, tick_s: float, *, batch: int, start: int = 0) -> Iterator[tuple[float, bytes]]:
    """Yield ESF-RAW frames of `batch` samples whose tags have 24 bits, with the instants of their last samples.

    The gyroscope's z axis tells the time since the first sample, 0.1 deg/s for each second.
    """
    for rows in np.split(time, range(batch, time.size, batch)):
        payload = bytes(4)
        for t in rows.tolist():
            tag = (start + round((t - time[0]) / tick_s)) % 2**24
            values = (0, 0, round(0.1 * (t - time[0]) * 4096), 0, 0, -10042)
            for kind, value in zip((14, 13, 5, 16, 17, 18), values, strict=True):
                payload += ((kind << 24) | (value & 0xFFFFFF)).to_bytes(4, "little") + tag.to_bytes(4, "little")
        yield rows[-1], bytes(UBXMessage("ESF", "ESF-RAW", GET, payload=payload).serialize())


@pytest.mark.parametrize("batch", [1, 10])
def test_the_tick_of_esf_raw_is_found_over_an_overflow_of_its_clock(tmp_path: Path, batch: int) -> None:
    # 100 Hz for 200 s; the tick is 0.6 % off its 39.0625 us, and its 24 bits overflow after 100 s.
    tick_s = 39.0625e-6 * 1.006
    time = GPST_S + 0.01 * np.arange(20_000)
    late = np.random.default_rng(3).exponential(0.02, 1000)
    sent = [(t + 0.005, frame) for t, frame in raw_frames(time, tick_s, batch=batch, start=2**24 - round(100 / tick_s))]
    for k in range(1000):
        t = 0.2 * k
        # The receiver needs 30 ms to compute a fix, at times far longer.
        sent.append((GPST_S + t + 0.03 + late[k], ublox_ubx.pvt(EPOCH_UTC_S + t, NORTH, LLH)))
    pieces = pieces_of(tmp_path, b"".join(frame for _, frame in sorted(sent, key=lambda s: s[0])))
    imu = imu_of(pieces)
    assert imu.time.size == 20_000
    assert pieces.events == ()
    truth = GPST_S + np.degrees(imu.gyro[:, 2]) * 10.0
    error = imu.time - truth
    # The gyroscope tells the time to half of its unit, 1.2 ms; the fitted rate is off by less than 20 ms over the drive
    # (0.6 % would be 1.2 s), and what stays is the delay of the receiver less that of a message: 0.03 s and, for
    # batches, up to one batch (0.1 s).
    assert np.ptp(error) < 0.02
    assert -0.05 < np.median(error) < (0.01 if batch == 1 else 0.1)
    np.testing.assert_allclose(imu.accel[:, 2], -10042 / 1024)


def test_a_restarted_sensor_clock_is_set_anew(tmp_path: Path) -> None:
    content, truth = [], []
    for part, start in ((0, 5_000_000), (1, 1_000)):
        for k in range(2000):
            t = 60.0 * part + 0.01 * k
            values = [0, 0, k, 0, 0, -10042]
            tag = start + 10 * k
            content.append(ublox_ubx.meas(tag, (*ublox_ubx.GYRO_TYPES, *ublox_ubx.ACCEL_TYPES), values))
            truth.append(GPST_S + t)
            if k % 20 == 0:
                content.append(ublox_ubx.pvt(EPOCH_UTC_S + t, NORTH, LLH))
    imu = imu_of(pieces_of(tmp_path, b"".join(content)))
    # Tags are whole milliseconds, the epochs exact: float64 at 1.75e9 s.
    np.testing.assert_allclose(imu.time, truth, rtol=0, atol=1e-6)


def test_an_accelerometer_with_tags_of_its_own_is_interpolated(tmp_path: Path) -> None:
    content = []
    for k in range(2000):
        content.append(ublox_ubx.meas(10 * k, ublox_ubx.GYRO_TYPES, [0, 0, k]))
        content.append(ublox_ubx.meas(10 * k + 4, ublox_ubx.ACCEL_TYPES, [2 * k, 0, -10042]))
        if k % 20 == 0:
            content.append(ublox_ubx.pvt(EPOCH_UTC_S + 0.01 * k, NORTH, LLH))
    pieces = pieces_of(tmp_path, b"".join(content))
    imu = imu_of(pieces)
    # The line 2 k at tags 10 k + 4, read at 10 k: 0.8 less, and the first gyroscope sample has nothing before it.
    np.testing.assert_allclose(imu.accel[:, 0] * 1024, 2.0 * np.arange(1, 2000) - 0.8, atol=1e-9)
    assert "accelerometer interpolated" in pieces.streams[0].note
    assert [(e.code, e.count) for e in pieces.events] == [("W_DROPPED", 1)]


def test_wheels_tell_their_speed_with_its_sign(tmp_path: Path) -> None:
    content = []
    for k in range(1000):
        values = [0, 0, k, 0, 0, -10042]
        content.append(ublox_ubx.meas(10 * k, (*ublox_ubx.GYRO_TYPES, *ublox_ubx.ACCEL_TYPES), values))
        if k % 10 == 0:
            # Another provider with a clock of its own.
            content.append(ublox_ubx.meas(777_000 + 10 * k, (11,), [-k], provider=3))
        if k % 20 == 0:
            content.append(ublox_ubx.pvt(EPOCH_UTC_S + 0.01 * k, NORTH, LLH))
    speed = imu_of(pieces_of(tmp_path, b"".join(content))).wheel_speed
    assert speed is not None
    told = np.flatnonzero(np.isfinite(speed))
    assert told.size > 95
    # Within a step of the IMU: 10 samples are 10 mm/s.
    np.testing.assert_allclose(speed[told], -1e-3 * told, atol=1.01e-2)


def test_several_imus_are_offered(tmp_path: Path, frames: list[bytes]) -> None:
    time = GPST_S + 0.01 * np.arange(3000)
    raw = [frame for _, frame in raw_frames(time, 39.0625e-6, batch=1)]
    # One frame of each in turn; the stamps do not matter here.
    mixed = b"".join(f + (raw[k] if k < len(raw) else b"") for k, f in enumerate(frames))
    pieces = pieces_of(tmp_path, mixed)
    assert [(s.kind, s.name) for s in pieces.streams] == [
        ("imu", "ESF-RAW"),
        ("imu", "ESF-MEAS"),
        ("gnss", "NAV-PVT"),
    ]
    assert imu_of(pieces).time.size == pieces.streams[0].samples
    assert imu_of(pieces_of(tmp_path, mixed, imu="ESF-MEAS")).time.size == 1500
    with pytest.raises(LogError, match="has no IMU called 'ESF-INS'; choose one of: ESF-RAW"):
        pieces_of(tmp_path, mixed, imu="ESF-INS")


def older(tow_ms: int, *, fix: int = 3, ok: int = 1, velocity: bool = True) -> bytes:
    """Return the messages of an epoch of a receiver without NAV-PVT."""
    content = nav("NAV-POSLLH", iTOW=tow_ms, lat=48.0, lon=9.0, height=310_000, hMSL=263_000, hAcc=2000, vAcc=3000)
    if velocity:
        content += nav("NAV-VELNED", iTOW=tow_ms, velN=300, velE=-400, velD=5, sAcc=30)
    sol = {"gpsFix": fix, "gpsfixOK": ok, "wknSet": 1, "towSet": 1}
    return content + nav("NAV-SOL", iTOW=tow_ms, fTOW=-250_000, week=2372, **sol)


def test_older_receivers_tell_position_velocity_and_fix_apart(tmp_path: Path) -> None:
    content = older(1000) + older(2000, fix=0, ok=0) + older(3000, velocity=False)
    pieces = pieces_of(tmp_path, content, role="gnss")
    gnss = pieces.gnss
    assert gnss is not None
    assert gnss.velocity_ned is not None
    start = 315964800 + 2372 * 604800
    np.testing.assert_allclose(gnss.time, [start + 0.99975, start + 2.99975], rtol=0, atol=1e-6)
    np.testing.assert_allclose(gnss.velocity_ned, [[3.0, -4.0, 0.05], [np.nan] * 3])
    np.testing.assert_allclose(gnss.position_llh, [[np.radians(48.0), np.radians(9.0), 310.0]] * 2)  # type: ignore[arg-type]
    np.testing.assert_allclose(gnss.position_std, [[2.0, 2.0, 3.0]] * 2)  # type: ignore[arg-type]
    assert [(e.code, e.count, e.detail) for e in pieces.events] == [
        ("W_DROPPED", 1, "1 NAV-POSLLH messages without a fix in NAV-SOL.")
    ]


def test_high_precision_positions_are_taken_where_they_are(tmp_path: Path) -> None:
    hp = nav("NAV-HPPOSLLH", iTOW=20_861_000, lon=0, lat=0, height=0, hMSL=0, hAcc=14.1, vAcc=20.5)
    body = bytearray(hp[6:-2])
    body[8:16] = (91_673_248).to_bytes(4, "little") + (481_284_546).to_bytes(4, "little")
    body[16:20] = (300_000).to_bytes(4, "little")
    body[24:27] = bytes([37, 256 - 12, 5])
    hp = bytes(UBXMessage("NAV", "NAV-HPPOSLLH", GET, payload=bytes(body)).serialize())
    tow = round(1e3 * ((GPST_S - 315964800) % 604800))
    hp = bytes(
        UBXMessage("NAV", "NAV-HPPOSLLH", GET, payload=hp[6:10] + tow.to_bytes(4, "little") + hp[14:-2]).serialize()
    )
    gnss = gnss_of(tmp_path, ublox_ubx.pvt(EPOCH_UTC_S, NORTH, LLH) + hp + ublox_ubx.pvt(EPOCH_UTC_S + 1, NORTH, LLH))
    assert gnss.position_llh is not None
    assert gnss.position_std is not None
    np.testing.assert_allclose(np.degrees(gnss.position_llh[0, :2]), [48.128454588, 9.167324837], rtol=0, atol=1e-12)
    assert gnss.position_llh[0, 2] == pytest.approx(300.0005, abs=1e-9)
    np.testing.assert_allclose(gnss.position_std[:, 0], [0.0141, 0.014])


def test_only_fixes_count_and_a_flat_one_tells_little_of_the_vertical(tmp_path: Path) -> None:
    def at(k: int, **changes: object) -> bytes:
        return ublox_ubx.pvt(EPOCH_UTC_S + k, 5.0 * NORTH, LLH, **changes)

    content = (
        at(0, fixType=0) + at(1, fixType=1) + at(2, fixType=5) + at(3, gnssFixOk=0) + at(4, fixType=2)
        + at(5, fixType=4) + at(6, invalidLlh=1) + at(7, sAcc=0, hAcc=2**32 - 1)
    )  # fmt: skip
    pieces = pieces_of(tmp_path, content, role="gnss")
    gnss = pieces.gnss
    assert gnss is not None
    assert gnss.velocity_std is not None
    assert gnss.position_llh is not None
    assert gnss.position_std is not None
    np.testing.assert_allclose(gnss.time - GPST_S, [4, 5, 6, 7])
    # 5 % of 15 m/s.
    np.testing.assert_allclose(gnss.velocity_std, [[0.05, 0.05, 0.75], [0.05] * 3, [0.05] * 3, [np.nan] * 3])
    np.testing.assert_array_equal(np.isnan(gnss.position_llh).all(axis=1), [False, False, True, False])
    np.testing.assert_array_equal(np.isnan(gnss.position_std[:, 0]), [False, False, True, True])
    assert [e.detail for e in pieces.events] == ["4 NAV-PVT messages without a fix."]
    assert pieces.streams[0].note == "1 fixes are the receiver's own fusion of GNSS with its sensors"


def test_a_date_that_is_not_valid_yet_is_told_by_the_next(tmp_path: Path) -> None:
    first = ublox_ubx.pvt(EPOCH_UTC_S, NORTH, LLH, validDate=0, year=1980, month=0, day=0)
    gnss = gnss_of(tmp_path, first + ublox_ubx.pvt(EPOCH_UTC_S + 0.25, NORTH, LLH))
    np.testing.assert_allclose(gnss.time, [GPST_S, GPST_S + 0.25], rtol=0, atol=1e-6)
    assert gnss.time_scale == "GPST"
    alone = gnss_of(tmp_path, first)
    assert alone.time_scale is None


def test_sensors_without_any_fix_are_refused_with_the_reason(tmp_path: Path) -> None:
    content = ublox_ubx.meas(0, ublox_ubx.GYRO_TYPES, [1, 2, 3]) * 3
    with pytest.raises(
        LogError, match=r"holds neither GNSS fixes .* Left out: 9 sensor readings whose time no GNSS epoch"
    ):
        pieces_of(tmp_path, content)


def test_accelerations_free_of_gravity_are_not_taken(tmp_path: Path) -> None:
    ins = bytes(UBXMessage("ESF", "ESF-INS", GET, payload=bytes(36)).serialize())
    pieces = pieces_of(tmp_path, ins * 3 + ublox_ubx.pvt(EPOCH_UTC_S, NORTH, LLH))
    assert pieces.imu is None
    assert [e.detail for e in pieces.events] == ["3 ESF-INS messages, whose accelerations are free of gravity."]


def unchanged(log: Log, clean: Log) -> bool:
    return np.array_equal(log.gyro, clean.gyro) and np.array_equal(log.gnss_time, clean.gnss_time)


def test_a_cut_file_is_marked_or_refused(sample: Path, frames: list[bytes], tmp_path: Path) -> None:
    content = sample.read_bytes()
    # The format has no end mark: a file cut between two frames is whole for all that can be told.
    between = set(itertools.accumulate(len(f) for f in frames))
    for length in cases.cuts(content, 100):
        path = tmp_path / "cut.ubx"
        path.write_bytes(content[:length])
        try:
            log = read(path)
        except LevelheadError:
            continue
        assert log.meta["completeness"] == "truncated" or length in between


def test_damage_is_marked_or_refused(sample: Path, tmp_path: Path) -> None:
    clean = read(sample)
    for k, content in enumerate(cases.mutations(sample.read_bytes())):
        path = tmp_path / "hurt.ubx"
        path.write_bytes(content)
        try:
            log = read(path)
        except LevelheadError:
            continue
        # A deletion that takes out one frame as a whole shows by the readings that are left alone.
        assert log.meta["completeness"] != "complete" or log.events or unchanged(log, clean), k


def test_nonsense_with_the_right_checksum_is_read_or_refused(tmp_path: Path, frames: list[bytes]) -> None:
    rng = np.random.default_rng(3)
    kinds = (b"\x01\x07", b"\x01\x02", b"\x01\x12", b"\x01\x06", b"\x01\x14", b"\x10\x02", b"\x10\x03")
    for _ in range(100):
        content = frames[:200]
        for k in rng.integers(len(kinds), size=20):
            size = int(rng.choice([0, 3, 8, 28, 36, 52, 60, 92]))
            body = kinds[k] + size.to_bytes(2, "little") + rng.integers(0, 256, size, dtype=np.uint8).tobytes()
            first = np.cumsum(np.frombuffer(body, dtype=np.uint8), dtype=np.uint8)
            frame = b"\xb5\x62" + body + bytes([first[-1], first.sum(dtype=np.uint8)])
            content.insert(int(rng.integers(len(content))), frame)
        try:
            pieces = pieces_of(tmp_path, b"".join(content))
        except LevelheadError:
            continue
        assert pieces.damaged == ""


@pytest.mark.parametrize(
    "head", [b"", b"\xb5", b"\xb5\x62\x01\x07\x5c\x00", b"\xb5\x62" * 9000, b"\xd3" * 70_000, b"$GPGGA,1*2\r\n"]
)
def test_what_only_looks_like_it_is_left_to_others(head: bytes) -> None:
    assert not READER.sniff(Path(), head)
