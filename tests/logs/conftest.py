"""Small logs for the tests of reading and writing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from levelhead.logs.log import Log

Writer = Callable[[str, str], Path]


@pytest.fixture
def drive() -> Log:
    """Ten seconds at 20 Hz with GNSS at 2 Hz, half of its stamps between those of the IMU; every column filled."""
    rng = np.random.default_rng(7)
    time = np.arange(200.0) / 20.0
    gnss_time = np.arange(20.0) / 2.0
    gnss_time[1::2] += 0.01
    position = np.column_stack((np.full(20, 0.7), -1.8 + 1e-6 * gnss_time, 100.0 + gnss_time))
    return Log(
        time=time,
        gyro=rng.normal(0.0, 0.1, (200, 3)),
        accel=rng.normal(0.0, 1.0, (200, 3)) - [0.0, 0.0, 9.8],
        gnss_time=gnss_time,
        velocity_ned=rng.normal(0.0, 5.0, (20, 3)),
        velocity_std=rng.uniform(0.01, 0.1, 20),
        position_llh=position,
        position_std=rng.uniform(0.01, 0.1, 20),
        wheel_speed=np.where(np.arange(200) % 5 == 0, rng.normal(0.0, 5.0, 200), np.nan),
    )


@pytest.fixture
def put(tmp_path: Path) -> Writer:
    """Write a text file and return its path."""

    def put(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_bytes(text.encode())
        return path

    return put
