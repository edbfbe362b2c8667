"""SBG's text exports: three files are one log, a counter that begins anew is one clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.logs.readers import read
from samples import sbg
from samples.drive import sample_drive


@pytest.mark.parametrize("as_folder", [False, True])
def test_the_drive_comes_back(tmp_path: Path, as_folder: bool) -> None:
    path = sbg.write(tmp_path)
    log, drive = read(tmp_path if as_folder else path), sample_drive()
    assert log.meta["format"] == "sbg"
    assert log.meta["completeness"] == "complete"
    assert "undeclared" not in log.meta
    assert log.meta["height"] == "mean sea level"
    np.testing.assert_allclose(log.time - log.time[0], drive.time - drive.time[0], atol=1e-6)  # whole microseconds
    np.testing.assert_allclose(log.accel, drive.accel, atol=5e-10)  # nine decimals
    np.testing.assert_allclose(log.gyro, drive.gyro, atol=1e-11)
    # The first velocity is without a solution, but there is a position.
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    assert np.isnan(log.velocity_ned[0]).all()
    np.testing.assert_allclose(log.velocity_ned[1:], drive.velocity_ned[1:], atol=5e-10)
    np.testing.assert_allclose(log.position_llh[:, :2], drive.position_llh[:, :2], atol=1e-11)
    # Stamped with the velocities: both clocks begin anew within the drive, and stay one.
    lag = log.gnss_time - log.time[0] - (drive.gnss_time - drive.time[0])
    np.testing.assert_allclose(lag[1:], 0.0, atol=1e-6)
    assert log.velocity_std is not None
    assert log.position_std is not None
    np.testing.assert_array_equal(log.velocity_std[1], [0.05, 0.05, 0.1])
    np.testing.assert_array_equal(log.position_std[1], [0.5, 0.5, 0.9])
    assert {e.code: e.count for e in log.events} == {"I_SIBLING": 2, "W_DROPPED": 1}


def test_dates_are_refused(tmp_path: Path) -> None:
    path = sbg.write(tmp_path)
    path.write_text(path.read_text().replace("timestamp", "iso8601Time", 1))
    with pytest.raises(LogError, match=r"imuData\.txt is stamped with dates.*--time-mode=timestamp"):
        read(path)


def test_other_units_are_refused(tmp_path: Path) -> None:
    path = sbg.write(tmp_path)
    path.write_text(path.read_text().replace("(deg.s^-1)", "(rad.s^-1)"))
    with pytest.raises(
        LogError, match=r"imuData\.txt: gyroX is in 'rad.s\^-1' where sbgBasicLogger writes 'deg.s\^-1'"
    ):
        read(path)


def test_an_empty_file_of_a_receiver_was_cut(tmp_path: Path) -> None:
    path = sbg.write(tmp_path)
    (tmp_path / "gnss1Pos.txt").write_bytes(b"")
    log = read(path)
    assert log.position_llh is None
    assert log.meta["completeness"] == "truncated"
