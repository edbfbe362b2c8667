"""Septentrio SBF: fields are those of pysbf2, up is not down, sigmas come from the covariances, damage is told."""

from __future__ import annotations

import dataclasses
import itertools
import time
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from pysbf2 import SBFReader

from hostile import cases
from levelhead.errors import LevelheadError, LogError
from levelhead.logs.log import Log
from levelhead.logs.pieces import GnssData, Pieces
from levelhead.logs.readers import read
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.frames import scan
from levelhead.logs.readers.septentrio_sbf import LAYOUTS, PVT, READER, SBF, VELOCITY_COV, find_blocks
from samples import septentrio_sbf
from samples.drive import EPOCH_UTC_S, sample_drive
from samples.septentrio_sbf import ABSENT, covariance, measurements, pvt

LLH = np.array([0.84, -0.16, 300.0])
EAST = np.array([0.0, 15.0, 0.5])
GPST_S = EPOCH_UTC_S + 18.0
LEVEL = np.array([0.1, 0.2, -9.8])
TURN = np.array([1.0, 2.0, 3.0])


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return septentrio_sbf.write(tmp_path_factory.mktemp("sbf"))


def pieces_of(folder: Path, content: bytes, **asked: object) -> Pieces:
    path = folder / "a.sbf"
    path.write_bytes(content)
    return READER.read(dataclasses.replace(Source(path=path), **asked))  # type: ignore[arg-type]


def gnss_of(folder: Path, content: bytes) -> GnssData:
    gnss = pieces_of(folder, content, role="gnss").gnss
    assert gnss is not None
    return gnss


def test_the_drive_comes_back(sample: Path) -> None:
    drive, log = sample_drive(), read(sample)
    assert log.meta["format"] == "septentrio-sbf"
    assert log.meta["completeness"] == "complete"
    assert log.meta["undeclared"] == ("axes",)
    assert (log.meta["datum"], log.meta["height"]) == ("WGS84", "ellipsoidal")
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    assert log.velocity_ned is not None
    # Whole milliseconds hold 50 Hz; float64 at 1.75e9 s resolves 2.4e-7 s.
    np.testing.assert_allclose(log.time, drive.time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(log.gnss_time, drive.gnss_time, rtol=0, atol=1e-6)
    # Readings and positions are float64, velocities float32.
    np.testing.assert_allclose(log.gyro, drive.gyro, rtol=1e-14)
    np.testing.assert_array_equal(log.accel, drive.accel)
    np.testing.assert_array_equal(log.position_llh, drive.position_llh)
    np.testing.assert_allclose(log.velocity_ned, drive.velocity_ned, rtol=6e-8)
    np.testing.assert_allclose(log.position_std, np.tile([0.01, 0.02, 0.03], (150, 1)), rtol=6e-8)  # type: ignore[arg-type]
    np.testing.assert_allclose(log.velocity_std, np.tile(np.sqrt([1e-3, 4e-3, 9e-3]), (150, 1)), rtol=6e-8)  # type: ignore[arg-type]
    assert log.meta["epoch"] == pytest.approx(GPST_S + drive.time[0], abs=1e-6)


def test_blocks_and_fields_are_those_of_pysbf2(sample: Path) -> None:
    found = scan(sample, SBF, (PVT, VELOCITY_COV))
    # It knows no ExtSensorMeas (4050).
    known = [b for b in septentrio_sbf.blocks() if int.from_bytes(b[4:6], "little") & 0x1FFF != 4050]
    theirs = [m for _, m in SBFReader(BytesIO(b"".join(known)), quitonerror=2)]
    assert len(theirs) == 3 * 150
    assert found.count == 1500 + 3 * 150
    for number, name, fields in (
        (PVT, "PVTGeodetic", {"tow": "TOW", "week": "WNc", "lat": "Latitude", "vn": "Vn", "ve": "Ve", "vu": "Vu"}),
        (PVT, "PVTGeodetic", {"lon": "Longitude", "height": "Height", "mode": "Type", "datum": "Datum"}),
        (VELOCITY_COV, "VelCovGeodetic", {"n": "Cov_VnVn", "e": "Cov_VeVe", "u": "Cov_VuVu"}),
    ):
        layout = LAYOUTS[number]
        rows = found.frames[number].rows(layout.itemsize)[0].view(layout)[:, 0]
        expected = [m for m in theirs if m.identity == name]
        assert rows.size == len(expected) == 150
        for ours, field in fields.items():
            np.testing.assert_array_equal(rows[ours], [getattr(m, field) for m in expected])


def test_epochs_without_a_solution_are_left_out_and_a_held_height_tells_little(tmp_path: Path) -> None:
    t = EPOCH_UTC_S
    no_time = septentrio_sbf.block(4007, b"\xff" * 6 + pvt(t, EAST, LLH)[14:])
    content = (
        pvt(t, EAST, LLH, mode=0) + pvt(t + 1, EAST, LLH, error=1) + pvt(t + 2, EAST, LLH, mode=3) + no_time
        + pvt(t + 3, EAST, LLH, mode=0x81) + pvt(t + 4, EAST, LLH) + covariance(5908, t + 4, (0.01, 0.01, ABSENT))
        + pvt(t + 5, np.array([ABSENT, ABSENT, -ABSENT]), LLH)
    )  # fmt: skip
    pieces = pieces_of(tmp_path, content, role="gnss")
    assert [(e.code, e.count) for e in pieces.events] == [("W_DROPPED", 4)]
    gnss = pieces.gnss
    assert gnss is not None
    np.testing.assert_allclose(gnss.time - GPST_S, [3, 4, 5])
    np.testing.assert_allclose(gnss.velocity_ned, [EAST, EAST, [np.nan] * 3])  # type: ignore[arg-type]
    # 5 % of 15 m/s where the height is held; the covariance's third is absent.
    expected = [[np.nan, np.nan, 0.75], [0.1, 0.1, np.nan], [np.nan] * 3]
    np.testing.assert_allclose(gnss.velocity_std, expected, rtol=6e-8)  # type: ignore[arg-type]
    assert gnss.position_std is None


@pytest.mark.parametrize(("number", "name"), [(30, "ETRS89"), (35, "GDA2020"), (19, None)])
def test_the_datum_of_the_stream_is_kept(tmp_path: Path, number: int, name: str | None) -> None:
    meta = pieces_of(tmp_path, pvt(EPOCH_UTC_S, EAST, LLH, datum=number), role="gnss").meta
    assert meta.get("datum") == name


@pytest.mark.parametrize("number", [31, 34, 250, 99])
def test_other_datums_are_refused(tmp_path: Path, number: int) -> None:
    with pytest.raises(LogError, match=r"a\.sbf: the datum .*; convert the positions to WGS84"):
        pieces_of(tmp_path, pvt(EPOCH_UTC_S, EAST, LLH, datum=number), role="gnss")
    with pytest.raises(LogError, match=r"a\.sbf: the datum of the positions changes \(numbers 0, "):
        pieces_of(tmp_path, pvt(EPOCH_UTC_S, EAST, LLH) + pvt(EPOCH_UTC_S + 1, EAST, LLH, datum=number), role="gnss")


def test_a_rate_and_an_acceleration_of_one_instant_make_a_sample(tmp_path: Path) -> None:
    t = EPOCH_UTC_S
    content = (
        measurements(t, (3, TURN), (0, LEVEL), (1, TURN))
        + measurements(t + 1, (0, LEVEL)) + measurements(t + 1, (1, TURN))
        + measurements(t + 2, (0, LEVEL)) + measurements(t + 3, (0, LEVEL), (1, TURN), info=2)
        + measurements(t + 4, (0, LEVEL), (1, np.full(3, ABSENT))) + measurements(t + 5, (0, LEVEL), (1, TURN), info=1)
    )  # fmt: skip
    pieces = pieces_of(tmp_path, content)
    assert pieces.imu is not None
    np.testing.assert_allclose(pieces.imu.time - GPST_S, [0, 1, 5])
    np.testing.assert_allclose(pieces.imu.gyro, np.radians([TURN] * 3))
    np.testing.assert_array_equal(pieces.imu.accel, [LEVEL] * 3)
    assert [(e.count, e.detail) for e in pieces.events] == [
        (3, "3 measurements of ExtSensorMeas that are saturated, scrambled or absent."),
        (2, "2 measurements of ExtSensorMeas without the other kind of the same time, or repeated."),
    ]
    assert pieces.gnss is None


def test_several_sensors_are_offered(tmp_path: Path) -> None:
    pair = ((0, LEVEL), (1, TURN))
    content = b"".join(measurements(EPOCH_UTC_S + k, *pair, source=s) for k in range(5) for s in (0, 32) if s or k < 3)
    pieces = pieces_of(tmp_path, content)
    assert [(s.name, s.samples) for s in pieces.streams] == [("ExtSensorMeas-0", 3), ("ExtSensorMeas-32", 5)]
    assert pieces.imu is not None
    assert pieces.imu.time.size == 5
    with pytest.raises(LogError, match="has no IMU called 'x'; choose one of: ExtSensorMeas-0"):
        pieces_of(tmp_path, content, imu="x")


def test_a_block_that_says_more_than_it_holds_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    good = measurements(EPOCH_UTC_S, (0, LEVEL), (1, TURN)) + measurements(EPOCH_UTC_S + 1, (0, LEVEL), (1, TURN))
    for count, size in ((255, 28), (2, 255), (2, 0), (255, 1)):
        body = bytearray(measurements(EPOCH_UTC_S + 2, (0, LEVEL), (1, TURN))[8:])
        body[6:8] = bytes([count, size])
        pieces = pieces_of(tmp_path, good + septentrio_sbf.block(4050, bytes(body)))
        assert pieces.imu is not None
        assert pieces.imu.time.size == (3 if size == 28 else 2)


def test_nothing_of_use_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"holds neither GNSS .* Left out: 2 PVTGeodetic blocks without a solution\."):
        pieces_of(tmp_path, pvt(EPOCH_UTC_S, EAST, LLH, mode=0) * 2)


def test_a_file_of_false_headers_does_not_take_for_ever() -> None:
    # Each of 250,000 headers would have 65,532 bytes checked: 16 GB. With the bound it is 64 MB and short blocks.
    header = b"$@\x00\x00\xa7\x0f\xfc\xff"
    content = np.frombuffer(header * 125_000, dtype=np.uint8)
    started = time.process_time()
    start, _ = find_blocks(content, content.size)
    assert start.size == 0
    # Seconds, not minutes: a machine ten times slower passes too.
    assert time.process_time() - started < 10.0


def unchanged(log: Log, clean: Log) -> bool:
    return all(
        np.array_equal(getattr(log, name), getattr(clean, name), equal_nan=True)
        for name in ("gyro", "accel", "gnss_time", "velocity_ned", "velocity_std", "position_llh", "position_std")
    )


def test_a_cut_file_is_marked_or_refused(sample: Path, tmp_path: Path) -> None:
    content = sample.read_bytes()
    # The format has no end mark: a file cut between two blocks is whole for all that can be told.
    between = set(itertools.accumulate(len(b) for b in septentrio_sbf.blocks()))
    for length in cases.cuts(content, 100):
        path = tmp_path / "cut.sbf"
        path.write_bytes(content[:length])
        try:
            log = read(path)
        except LevelheadError:
            continue
        assert log.meta["completeness"] == "truncated" or length in between


def test_damage_is_marked_or_refused(sample: Path, tmp_path: Path) -> None:
    clean = read(sample)
    for k, content in enumerate(cases.mutations(sample.read_bytes())):
        path = tmp_path / "hurt.sbf"
        path.write_bytes(content)
        try:
            log = read(path)
        except LevelheadError:
            continue
        assert log.meta["completeness"] != "complete" or unchanged(log, clean), k


def test_nonsense_with_the_right_crc_is_read_or_refused(tmp_path: Path) -> None:
    rng, drive = np.random.default_rng(3), septentrio_sbf.blocks()
    for _ in range(100):
        content = drive[:100]
        for number in rng.choice([4007, 4050, 5906, 5908], 20).tolist():
            size = int(rng.choice([6, 8, 40, 64, 72, 88]))
            noise = rng.integers(0, 256, size, dtype=np.uint8).tobytes()
            content.insert(int(rng.integers(len(content))), septentrio_sbf.block(number, noise))
        try:
            pieces = pieces_of(tmp_path, b"".join(content))
        except LevelheadError:
            continue
        assert pieces.damaged == ""


@pytest.mark.parametrize("head", [b"", b"$@", b"$@\x00\x00\xa7\x0f\x08\x00", b"$@" * 9000, b"$GPGGA,1*2\r\n"])
def test_what_only_looks_like_it_is_left_to_others(head: bytes) -> None:
    assert not READER.sniff(Path(), head)
