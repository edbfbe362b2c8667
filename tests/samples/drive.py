"""The drive that is in every sample: half a minute of curves, so that what a reader returns can be held against it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from levelhead.logs.log import Log
from levelhead.sim import SensorModel, simulate

EPOCH_UTC_S = 1_751_003_243.0
"""When the drive began where a format wants an instant: 2025-06-27 05:47:23 UTC, 05:47:41 GPST."""


_others: list[Log] = []


def sample_drive() -> Log:
    """Return the drive: 30 s at 50 Hz, GNSS velocity and position at 5 Hz, body FRD and NED, SI."""
    return _others[-1] if _others else _simulated()


@contextmanager
def driving(log: Log) -> Iterator[None]:
    """Let every writer of samples write another log: a short one to damage, a long one to measure."""
    _others.append(log)
    try:
        yield
    finally:
        _others.pop()


@cache
def _simulated() -> Log:
    sensors = SensorModel(imu_rate=50.0, gnss_rate=5.0)
    return simulate("windrower", seed=5, duration=30.0, sensors=sensors, earth_rotation=True, speed=8.0)[0]
