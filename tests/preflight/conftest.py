"""Drives that all tests of the preflight share: what is in them is known, and nothing changes them."""

from __future__ import annotations

import pytest

import levelhead as lh
from levelhead.sim import SensorModel


def _simulated(scenario: str, sensors: SensorModel, *, duration: float = 400.0) -> lh.Log:
    return lh.simulate(scenario, seed=1, duration=duration, speed=7.0, sensors=sensors)[0]


@pytest.fixture(scope="session")
def drive() -> lh.Log:
    """Curves at 7 m/s with a low-cost IMU, as a `Log` made by hand: everything right, and declared so."""
    return _simulated("windrower", SensorModel(imu_rate=50.0, gnss_rate=5.0))


@pytest.fixture(scope="session")
def perfect() -> lh.Log:
    """The same curves without any noise or bias, velocities alone."""
    return _simulated("windrower", SensorModel.perfect())


@pytest.fixture(scope="session")
def straight() -> lh.Log:
    """A straight road."""
    return _simulated("straight", SensorModel(imu_rate=50.0, gnss_rate=5.0))


@pytest.fixture(scope="session")
def circle() -> lh.Log:
    """The same circle for ever."""
    return _simulated("circle", SensorModel(imu_rate=50.0, gnss_rate=5.0))


@pytest.fixture(scope="session")
def standing() -> lh.Log:
    """A vehicle that never sets off."""
    return lh.simulate("windrower", seed=1, duration=300.0, standstill_s=300.0)[0]
