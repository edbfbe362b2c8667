"""The phone app Sensor Logger: which of its streams are read, in which sign, and zips that were made to burst."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hostile import cases
from levelhead.errors import LevelheadError, LogError
from levelhead.logs.log import Log
from levelhead.logs.readers import read
from levelhead.logs.readers import sensor_logger as reader
from samples import sensor_logger
from samples.drive import EPOCH_UTC_S, sample_drive
from samples.sensor_logger import FRD_TO_PHONE, members, pack


def check(log: Log) -> None:
    drive = sample_drive()
    # The first gyroscope sample comes before the first accelerometer sample and has none.
    np.testing.assert_allclose(log.time - log.time[0], drive.time[1:] - drive.time[1], atol=1e-6)
    np.testing.assert_allclose(log.gyro, drive.gyro[1:] @ FRD_TO_PHONE.T, atol=1e-9)  # nine decimals
    # Interpolated to stamps 3 ms away from 20 ms apart and back: the noise of 0.05 m/s^2 shrinks by up to a third.
    error = log.accel - drive.accel[1:] @ FRD_TO_PHONE.T
    assert np.abs(error.mean(axis=0)).max() < 0.01
    assert error.std() < 0.1
    assert log.accel[:, 2].mean() == pytest.approx(9.8, abs=0.2)  # a phone on its back reads +g on z


def test_the_drive_comes_back_in_the_phones_axes(tmp_path: Path) -> None:
    log, drive = read(sensor_logger.write(tmp_path)), sample_drive()
    assert log.meta["format"] == "sensor-logger"
    assert log.meta["undeclared"] == ("axes",)
    assert log.meta["gnss_time_scale"] == "UTC"
    assert "compensated" not in log.meta
    check(log)
    assert isinstance(log.meta["epoch"], float)
    assert log.meta["epoch"] == pytest.approx(EPOCH_UTC_S + drive.time[1], abs=1e-6)
    assert log.velocity_ned is not None
    assert log.velocity_std is not None
    assert log.position_llh is not None
    assert log.position_std is not None
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    np.testing.assert_allclose(log.velocity_ned[:, :2], drive.velocity_ned[:, :2], atol=1e-8)  # nine decimals
    np.testing.assert_array_equal(log.velocity_ned[:, 2], 0.0)
    assert (log.velocity_std[:, 2] >= 0.5).all()
    np.testing.assert_allclose(log.position_llh, drive.position_llh, atol=1e-6)  # six decimals of the height
    np.testing.assert_array_equal(log.position_std[0], [3.0, 3.0, 1.5])
    assert ("I_VELOCITY_2D", drive.gnss_time.size) in [(e.code, e.count) for e in log.events]


@pytest.mark.parametrize(("platform", "standard"), [("android", None), ("ios", None), ("ios", False), ("ios", True)])
def test_every_phone_gives_the_same_signs(tmp_path: Path, platform: str, standard: bool | None) -> None:
    check(read(pack(tmp_path, members(platform, standard=standard))))


def test_without_metadata_the_uncalibrated_stream_tells_its_sign(tmp_path: Path) -> None:
    for platform in ("android", "ios"):
        files = members(platform)
        del files["Metadata.csv"]
        check(read(pack(tmp_path, files)))
        del files["AccelerometerUncalibrated.csv"]
        with pytest.raises(LogError, match=r"Metadata\.csv does not tell the platform.*the sign"):
            read(pack(tmp_path, files))


def test_calibrated_streams_are_read_and_called_so(tmp_path: Path) -> None:
    files = members("ios", standard=False)
    files["GyroscopeUncalibrated.csv"] = ""  # the app leaves it empty where the phone has none
    del files["AccelerometerUncalibrated.csv"]
    log = read(pack(tmp_path, files))
    assert "The phone's own calibration" in str(log.meta["compensated"])
    np.testing.assert_allclose(log.gyro, (sample_drive().gyro[1:] - 0.01) @ FRD_TO_PHONE.T, atol=1e-9)
    assert log.accel[:, 2].mean() == pytest.approx(9.8, abs=0.2)


def test_acceleration_and_gravity_are_put_together(tmp_path: Path) -> None:
    files = members("ios", standard=False)
    del files["AccelerometerUncalibrated.csv"]
    total = files.pop("TotalAcceleration.csv").splitlines()
    parts: dict[str, list[str]] = {"Accelerometer.csv": total[:1], "Gravity.csv": total[:1]}
    for line in total[1:]:
        time, elapsed, z, y, x = line.split(",")
        parts["Gravity.csv"].append(f"{time},{elapsed},-9.8,0,0")
        parts["Accelerometer.csv"].append(f"{time},{elapsed},{float(z) + 9.8:.9f},{y},{x}")
    check(read(pack(tmp_path, files | {name: "\n".join(lines) for name, lines in parts.items()})))
    del files["Location.csv"]
    with pytest.raises(LogError, match="no acceleration with gravity in it"):
        read(pack(tmp_path, files | {"Accelerometer.csv": "\n".join(parts["Accelerometer.csv"])}), gnss="none.csv")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (("ios", "android"), "median length of 1.0.* does not go with Android"),
        (("1.30,", "1.30,true"), "median length of 1.0.* does not go with an iPhone"),
    ],
)
def test_metadata_that_do_not_go_with_the_data_are_refused(
    tmp_path: Path, change: tuple[str, str], sentence: str
) -> None:
    files = members("ios")
    files["Metadata.csv"] = files["Metadata.csv"].replace(*change)
    with pytest.raises(LogError, match=sentence):
        read(pack(tmp_path, files))


def test_a_folder_and_a_zip_of_a_folder_are_the_same(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    for name, text in members().items():
        (folder / name).write_text(text)
    check(read(folder))
    check(read(pack(tmp_path, {f"../../drive/{name}": text for name, text in members().items()})))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["drive", "drive-2025-06-27.zip"]


def test_fixes_that_the_phone_does_not_know_are_not_used(tmp_path: Path) -> None:
    files = members()
    lines = files["Location.csv"].splitlines()
    for k, (speed, bearing, accuracy) in enumerate(
        [("-1", "-1", "-1"), ("5", "-1", "-1"), ("0", "-1", "-1"), ("5", "0", "0")], 1
    ):
        cells = lines[k].split(",")
        cells[2], cells[6], cells[7] = accuracy, speed, bearing
        lines[k] = ",".join(cells)
    lines[5] = ",".join([*lines[5].split(",")[:9], "", ""])
    log = read(pack(tmp_path, files | {"Location.csv": "\n".join(lines)}))
    assert log.velocity_ned is not None
    np.testing.assert_array_equal(np.isnan(log.velocity_ned[:5, 0]), [True, True, False, True, False])
    np.testing.assert_array_equal(log.velocity_ned[2], 0.0)
    assert log.gnss_time.size == sample_drive().gnss_time.size - 1
    assert any(e.code == "W_DROPPED" and "1 rows of Location.csv without a place" in e.detail for e in log.events)


def test_a_gap_of_the_accelerometer_is_not_bridged(tmp_path: Path) -> None:
    files = members()
    lines = files["AccelerometerUncalibrated.csv"].splitlines()
    files["AccelerometerUncalibrated.csv"] = "\n".join(lines[:500] + lines[600:])
    log = read(pack(tmp_path, files))
    # The 100 samples of the gap and the one at the beginning.
    assert log.time.size == sample_drive().time.size - 102
    assert any(e.code == "W_DROPPED" and "turn rates without accelerations" in e.detail for e in log.events)


def test_a_bomb_is_refused_before_it_bursts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = members() | {"GyroscopeUncalibrated.csv": "time,seconds_elapsed,z,y,x\n" + "0,0,0,0,0\n" * 200000}
    path = pack(tmp_path, files)

    def refuse(*_arguments: object) -> bytes:
        raise AssertionError("decompressed")

    whole = zipfile.ZipFile.read
    monkeypatch.setattr(zipfile.ZipFile, "read", lambda s, m: refuse() if "Gyro" in m.filename else whole(s, m))
    with pytest.raises(LogError, match=r"GyroscopeUncalibrated\.csv: 2000027 bytes out of \d+ are no recording"):
        read(path)
    monkeypatch.setattr(reader, "MAX_RATIO", 10**9)
    monkeypatch.setattr(reader, "MAX_MEMBER_BYTES", 10**6)
    with pytest.raises(LogError, match="are no recording of a sensor"):
        read(path)


def test_a_zip_that_was_cut_is_a_sentence(tmp_path: Path) -> None:
    path = sensor_logger.write(tmp_path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(LogError, match="is a damaged zip, or was cut short"):
        read(path)


def test_two_recordings_in_one_zip_are_refused(tmp_path: Path) -> None:
    files = members()
    with pytest.raises(LogError, match="holds several recordings; unpack it"):
        read(pack(tmp_path, {f"{d}/{name}": text for d in "ab" for name, text in files.items()}))


@pytest.mark.parametrize("name", ["AccelerometerUncalibrated.csv", "Location.csv", "Metadata.csv"])
def test_mangled_members_are_read_or_refused(tmp_path: Path, name: str) -> None:
    files = members()
    folder = tmp_path / "drive"
    folder.mkdir()
    for member, text in files.items():
        (folder / member).write_text(text)
    for content in cases.mutations(files[name].encode(), 100):
        (folder / name).write_bytes(content)
        try:
            read(folder)
        except LevelheadError as error:
            assert re.search(r"\.$", str(error))  # noqa: PT017 - one test for all outcomes
