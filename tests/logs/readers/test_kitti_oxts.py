"""KITTI's oxts folders: axes, thinned epochs, files that lack or are broken, stamps that were lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hostile import cases
from levelhead.errors import LevelheadError, LogError
from levelhead.logs.log import Log
from levelhead.logs.pieces import FLU_TO_FRD
from levelhead.logs.readers import read
from samples import kitti_oxts as sample
from samples.drive import EPOCH_UTC_S, sample_drive


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return sample.write(tmp_path)


def codes(log: Log) -> dict[str, int]:
    return {event.code: event.count for event in log.events}


def test_the_drive_comes_back_turned_into_forward_right_down(drive: Path) -> None:
    log, truth = read(drive), sample_drive()
    # Fourteen digits are written.
    np.testing.assert_allclose(log.gyro, truth.gyro, rtol=1e-13)
    np.testing.assert_allclose(log.accel, truth.accel, rtol=1e-13)
    # Seconds since 1970 as float64 resolve 2.4e-7 s.
    np.testing.assert_allclose(log.time, truth.time, atol=5e-7)
    assert log.meta["epoch"] == EPOCH_UTC_S
    assert log.meta["format"] == "kitti"
    assert log.meta["completeness"] == "complete"
    velocity, position = sample.velocity_and_position(log.gnss_time)
    assert log.velocity_ned is not None
    np.testing.assert_allclose(log.velocity_ned, velocity, atol=1e-5)  # 5e-7 s of acceleration
    # Degrees with 14 digits: 1e-12 deg; 5e-7 s at 10 m/s are 1e-12 rad.
    assert log.position_llh is not None
    np.testing.assert_allclose(log.position_llh[:, :2], position[:, :2], atol=2e-12)
    np.testing.assert_allclose(log.position_llh[:, 2], position[:, 2], atol=1e-5)


def test_of_the_velocities_at_the_rate_of_the_imu_ten_in_a_second_are_epochs(drive: Path) -> None:
    log = read(drive)
    np.testing.assert_allclose(np.diff(log.gnss_time), 0.1, atol=1e-6)  # 50 Hz: every fifth
    assert codes(log)["I_DECIMATED"] == log.time.size - log.gnss_time.size
    assert log.velocity_std is not None
    assert log.position_std is not None
    np.testing.assert_array_equal(log.velocity_std[:, :2], 0.02)
    np.testing.assert_array_equal(log.position_std[:, :2], 0.05)
    # KITTI tells how sure north and east are, not down.
    assert np.isnan(log.velocity_std[:, 2]).all()
    assert np.isnan(log.position_std[:, 2]).all()


def test_that_biases_were_taken_off_is_said(drive: Path) -> None:
    log = read(drive)
    assert log.meta["dcm_file_to_body"] == FLU_TO_FRD
    assert "OxTS system took its own estimates of the biases off" in str(log.meta["compensated"])
    assert codes(log)["W_COMPENSATED"] == 1


def test_the_folder_oxts_will_do(drive: Path) -> None:
    np.testing.assert_array_equal(read(drive / "oxts").accel, read(drive).accel)
    with pytest.raises(LogError, match="is a directory, and no log in a known layout"):
        read(drive / "oxts" / "data")
    with pytest.raises(LogError, match=r"has no oxts/timestamps\.txt and oxts/data"):
        read(drive / "oxts" / "data", format="kitti")


def test_files_that_lack_at_the_end_are_counted(drive: Path) -> None:
    names = sorted((drive / "oxts" / "data").iterdir())
    for path in names[-100:]:
        path.unlink()
    log = read(drive)
    assert log.time.size == len(names) - 100
    assert log.meta["completeness"] == "truncated"
    assert codes(log)["W_TRUNCATED"] == 100


def test_stamps_that_lack_at_the_end_are_counted(drive: Path) -> None:
    stamps = drive / "oxts" / "timestamps.txt"
    lines = stamps.read_bytes().splitlines(keepends=True)
    stamps.write_bytes(b"".join(lines[:-51]) + lines[-51][:20])
    log = read(drive)
    assert log.time.size == len(lines) - 51
    assert codes(log)["W_TRUNCATED"] == 51


@pytest.mark.parametrize("content", [b"", b"1 2 3\n", b"49.0 8.4 nan" + b" 0" * 27, b"91 8.4" + b" 0" * 28, b"x " * 30])
def test_a_broken_file_in_the_middle_is_named(drive: Path, content: bytes) -> None:
    (drive / "oxts" / "data" / "0000000123.txt").write_bytes(content)
    log = read(drive)
    assert log.time.size == sample_drive().time.size - 1
    assert log.meta["completeness"] == "malformed_record"
    damaged = next(event for event in log.events if event.code == "W_DAMAGED")
    assert "1 of 1500 samples have no stamp or no file of 30 numbers, the first of them is number 123" in damaged.text


def test_a_sample_that_kitti_lost_has_an_empty_stamp_and_is_counted(drive: Path) -> None:
    stamps = drive / "oxts" / "timestamps.txt"
    lines = stamps.read_bytes().splitlines()
    lines[200] = lines[201] = b""
    stamps.write_bytes(b"\n".join(lines) + b"\n")
    log = read(drive)
    assert log.time.size == sample_drive().time.size - 2
    assert log.meta["completeness"] == "complete"
    assert codes(log)["W_DROPPED"] == 2


def test_what_the_ins_says_before_it_knows_its_state_is_no_epoch(drive: Path) -> None:
    for path in sorted((drive / "oxts" / "data").iterdir())[:500]:
        words = path.read_text(encoding="ascii").split()
        words[25] = "2"
        path.write_text(" ".join(words), encoding="ascii")
    log = read(drive)
    assert log.gnss_time[0] == pytest.approx(10.0, abs=1e-6)
    assert log.time[0] == 0.0
    assert codes(log)["W_DROPPED"] == 500


def test_nothing_readable_is_refused(drive: Path) -> None:
    (drive / "oxts" / "timestamps.txt").write_bytes(b"\n")
    with pytest.raises(LogError, match="not one of the 1500 samples in oxts/data has 30 numbers"):
        read(drive)


def test_damaged_stamps_are_marked_or_refused(drive: Path) -> None:
    # A drive of 60 samples will do.
    for path in sorted((drive / "oxts" / "data").iterdir())[60:]:
        path.unlink()
    stamps = drive / "oxts" / "timestamps.txt"
    content = b"".join(stamps.read_bytes().splitlines(keepends=True)[:60])
    stamps.write_bytes(content)
    assert read(drive).meta["completeness"] == "complete"
    for cut in cases.beginnings(content):
        stamps.write_bytes(cut)
        # Without the last line's end alone nothing is lost.
        assert cut == content[:-1] or outcome(drive) != "complete"
    for mutated in cases.mutations(content):
        stamps.write_bytes(mutated)
        outcome(drive)


def test_a_damaged_sample_is_marked_or_refused(drive: Path) -> None:
    for path in sorted((drive / "oxts" / "data").iterdir())[60:]:
        path.unlink()
    stamps = drive / "oxts" / "timestamps.txt"
    stamps.write_bytes(b"".join(stamps.read_bytes().splitlines(keepends=True)[:60]))
    for number in (0, 30, 59):
        path = drive / "oxts" / "data" / f"{number:010d}.txt"
        content = path.read_bytes()
        for cut in cases.beginnings(content):
            path.write_bytes(cut)
            # A cut within the last of the 30 numbers, which is not used, does no harm.
            assert len(cut.split()) == 30 or outcome(drive) != "complete"
        for mutated in cases.mutations(content):
            path.write_bytes(mutated)
            outcome(drive)
        path.write_bytes(content)


def test_hostile_names_are_passed_over(drive: Path) -> None:
    data = drive / "oxts" / "data"
    (data / "99999999999999999999.txt").write_text("1 2 3", encoding="ascii")
    (data / "9999999999.txt").write_text(" ".join(["1"] * 30), encoding="ascii")
    (data / "0000009000.txt").mkdir()
    log = read(drive)
    # A number beyond the stamps takes no memory up to it.
    assert log.time.size == sample_drive().time.size
    assert codes(log)["W_TRUNCATED"] == 1


def outcome(path: Path) -> str:
    """Return how complete a drive is read, or "refused"."""
    try:
        return str(read(path).meta["completeness"])
    except LevelheadError:
        return "refused"
