"""VectorNav's ASCII messages: without a stamp a reading has no time, and a wrong checksum is no reading."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.logs.readers import read
from samples import vectornav_ascii
from samples.drive import EPOCH_UTC_S, sample_drive


def test_the_drive_comes_back(tmp_path: Path) -> None:
    log, drive = read(vectornav_ascii.write(tmp_path)), sample_drive()
    assert log.meta["format"] == "vectornav-ascii"
    assert log.meta["undeclared"] == ("clock",)
    np.testing.assert_allclose(log.time - log.time[0], drive.time - drive.time[0], atol=2e-6)  # six decimals
    np.testing.assert_allclose(log.accel, drive.accel, atol=5.1e-4)  # half of 0.001
    np.testing.assert_allclose(log.gyro, drive.gyro, atol=5.1e-7)  # half of 1e-6
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    np.testing.assert_allclose(log.velocity_ned, drive.velocity_ned, atol=5.1e-4)  # half of 0.001
    np.testing.assert_allclose(log.position_llh[:, :2], drive.position_llh[:, :2], atol=1e-10)  # half of 1e-8 deg
    assert isinstance(log.meta["epoch"], float)
    assert log.meta["epoch"] == pytest.approx(EPOCH_UTC_S + drive.time[0], abs=1e-6)


def test_messages_without_a_stamp_are_refused(tmp_path: Path) -> None:
    path = vectornav_ascii.write(tmp_path)
    path.write_text(re.sub(r"(?m)^\S+ \$", "$", path.read_text()))
    with pytest.raises(LogError, match=r"vn\.log: the messages carry no time, and no stamp stands before them"):
        read(path)


def test_answers_to_requests_and_compensated_messages_are_read_too(tmp_path: Path) -> None:
    path = vectornav_ascii.write(tmp_path)
    text = path.read_text()
    answers = re.sub(r"\$VNIMU(.*)\*..", lambda m: vectornav_ascii.message(f"VNRRG,54{m.group(1)}"), text)
    path.write_text(answers)
    np.testing.assert_allclose(read(path).accel, sample_drive().accel, atol=5.1e-4)
    path.write_text(
        re.sub(r"\$VNIMU,(.*),[^,]*,[^,]*\*..", lambda m: vectornav_ascii.message(f"VNMAR,{m.group(1)}"), text)
    )
    log = read(path)
    np.testing.assert_allclose(log.gyro, sample_drive().gyro, atol=5.1e-7)
    assert "onboard filter" in str(log.meta["compensated"])


def test_a_wrong_checksum_is_damage(tmp_path: Path) -> None:
    path = vectornav_ascii.write(tmp_path)
    text = path.read_text()
    path.write_text(text.replace("+20.7", "+20.8", 3))
    log = read(path)
    assert log.time.size == sample_drive().time.size - 3
    assert log.meta["completeness"] == "malformed_record"
    assert any("3 messages have a wrong checksum" in e.detail for e in log.events)
