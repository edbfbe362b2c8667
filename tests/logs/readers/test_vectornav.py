"""VectorNav's CSV exports: the raw readings are taken, each fix once and at its own time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.logs.log import Log
from levelhead.logs.readers import read
from levelhead.logs.timescales import GPS_EPOCH_S
from samples import vectornav
from samples.drive import sample_drive


def check(log: Log) -> None:
    drive = sample_drive()
    assert log.velocity_ned is not None
    assert drive.velocity_ned is not None
    seen = log.gnss_time.size
    assert 0 <= drive.gnss_time.size - seen <= 1  # the last fix may come after the last message
    np.testing.assert_allclose(log.velocity_ned, drive.velocity_ned[:seen], atol=1e-9)  # ten decimals
    np.testing.assert_allclose(log.accel, drive.accel, atol=1e-9)  # nine decimals
    np.testing.assert_allclose(log.gyro, drive.gyro, atol=1e-9)


def test_the_drive_comes_back(tmp_path: Path) -> None:
    log, drive = read(vectornav.write(tmp_path)), sample_drive()
    assert log.meta["format"] == "vectornav"
    assert "compensated" not in log.meta
    assert "undeclared" not in log.meta
    check(log)
    # Stamps in seconds since 1970 as float64 have steps of 0.24 us.
    np.testing.assert_allclose(log.time - log.time[0], drive.time - drive.time[0], atol=1e-6)
    np.testing.assert_allclose(
        log.gnss_time - log.time[0], (drive.gnss_time - drive.time[0])[: log.gnss_time.size], atol=1e-6
    )
    assert isinstance(log.meta["epoch"], float)
    assert log.meta["epoch"] == pytest.approx(GPS_EPOCH_S + vectornav.START + drive.time[0], abs=1e-6)
    assert log.meta["gnss_time_scale"] == "GPST"
    assert log.meta["height"] == "ellipsoidal"
    assert log.position_llh is not None
    assert drive.position_llh is not None
    np.testing.assert_allclose(log.position_llh, drive.position_llh[: log.gnss_time.size], atol=1e-9)
    assert log.position_std is not None
    np.testing.assert_array_equal(log.position_std[0], [0.5, 0.5, 0.9])
    assert [s.name for s in log.meta["streams"]] == ["gnss1", "ins"]  # type: ignore[attr-defined]


def test_the_names_of_older_versions_mean_the_same(tmp_path: Path) -> None:
    path = vectornav.write(tmp_path)
    text = path.read_text()
    for new, old in (
        ("UncompAcc", "uncompAccel"),
        ("Gnss1VelN,Gnss1VelE,Gnss1VelD", "gnss1VelNedX,gnss1VelNedY,gnss1VelNedZ"),
        ("Gnss1Lat,Gnss1Lon,Gnss1Alt", "gnss1PosLat,gnss1PosLon,gnss1PosAlt"),
        ("GyroX,GyroY,GyroZ,Gps1Tow", "angularRateX,angularRateY,angularRateZ,gps1Tow"),
    ):
        assert new in text
        text = text.replace(new, old)
    path.write_text(text)
    check(read(path))


def test_without_gps_time_the_rows_are_stamped_by_the_time_since_start(tmp_path: Path) -> None:
    path = vectornav.write(tmp_path)
    path.write_text(path.read_text().replace("TimeGps", "Other", 1))
    log, drive = read(path), sample_drive()
    check(log)
    assert log.meta["undeclared"] == ("clock",)
    late = log.gnss_time - 7.0 - drive.gnss_time[: log.gnss_time.size]
    # A fix is stamped with the first of the messages, 0.02 s apart, that have it.
    assert (late >= vectornav.LATENCY - 1e-6).all()
    assert (late <= vectornav.LATENCY + 0.02 + 1e-6).all()


def test_compensated_readings_are_called_so(tmp_path: Path) -> None:
    path = vectornav.write(tmp_path)
    path.write_text(path.read_text().replace("UncompGyro", "Other"))
    log = read(path)
    assert "VectorNav's onboard filter" in str(log.meta["compensated"])
    np.testing.assert_allclose(log.gyro, sample_drive().gyro - 0.01, atol=1e-9)


def test_the_filters_velocity_is_taken_when_there_is_no_other(tmp_path: Path) -> None:
    path = vectornav.write(tmp_path)
    path.write_text(path.read_text().replace("Gnss1Vel", "Other"))
    log = read(path)
    assert log.velocity_ned is not None
    np.testing.assert_array_equal(log.velocity_ned[0], [1.0, 2.0, 3.0])
    assert np.median(np.diff(log.gnss_time)) == pytest.approx(0.2, abs=1e-6)


def test_a_file_without_a_clock_is_not_taken(tmp_path: Path) -> None:
    path = vectornav.write(tmp_path)
    path.write_text(path.read_text().replace("TimeStartup", "a").replace("TimeGps", "b").replace("Gps1Tow", "c"))
    with pytest.raises(LogError, match=r"the format is not known|no column is understood as time"):
        read(path)
