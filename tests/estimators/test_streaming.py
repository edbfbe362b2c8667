"""What surrounds the kernel's run: positions at the IMU's stamps, first settled times, starting values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.estimators.base import Status
from levelhead.estimators.streaming import interpolated_position, std_rows
from levelhead.estimators.trust import first_settled


def test_positions_cross_the_date_line_and_end_with_the_data() -> None:
    log, _ = lh.simulate("straight", seed=1, duration=60.0)
    assert log.position_llh is not None
    position = log.position_llh.copy()
    east = np.radians(np.linspace(179.9, 180.1, position.shape[0]))
    position[:, 1] = (east + np.pi) % (2.0 * np.pi) - np.pi
    position[:100] = np.nan
    out = interpolated_position(replace(log, position_llh=position))
    assert out is not None
    seen = out[~np.isnan(out[:, 0])]
    assert np.isnan(out[log.time < 9.9]).all()
    assert (np.degrees(np.abs(seen[:, 1])) > 179.8).all()
    assert (seen[:, 1] >= -np.pi).all()
    assert (seen[:, 1] < np.pi).all()


def test_settled_means_settled_for_good() -> None:
    time = np.array([10.0, 11.0, 12.0, 13.0])
    flag = int(Status.GYRO_SETTLED)
    assert first_settled(time, np.array([0, flag, 0, 0], dtype=np.uint32), Status.GYRO_SETTLED) is None
    assert first_settled(time, np.array([flag, 0, flag, flag], dtype=np.uint32), Status.GYRO_SETTLED) == 2.0
    assert first_settled(time, np.full(4, flag, dtype=np.uint32), Status.GYRO_SETTLED) == 0.0


def test_every_epoch_has_three_sigmas() -> None:
    np.testing.assert_array_equal(std_rows(np.array([0.1, 0.2]), 2), [[0.1] * 3, [0.2] * 3])
    np.testing.assert_array_equal(std_rows(np.array([[3.0, 4.0, 99.0]]), 1), [[3.0, 4.0, 99.0]])
    assert np.isnan(std_rows(None, 3)).all()


@pytest.mark.parametrize("value", [(np.nan, 0.0, 0.0), (1.0, 2.0)])
def test_starting_values_are_checked(value: tuple[float, float, float]) -> None:
    with pytest.raises(lh.UsageError, match="pass three finite numbers"):
        lh.Initial(gyro_bias=value)
