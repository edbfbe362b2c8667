"""Made-up methods: what they do is known exactly, so that the analyses can be held to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.estimators import METHODS, Method
from levelhead.estimators.base import Result, SensorData
from levelhead.estimators.observer import ObserverParams, estimate_observer
from levelhead.estimators.params import Initial, MethodParams
from levelhead.estimators.streaming import Progress

Change = Callable[[Result, SensorData], Result]
Register = Callable[..., None]


@dataclass(frozen=True, kw_only=True)
class FakeParams(MethodParams):
    """One constant that does something."""

    scale: float = 1.0


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Register:
    """Add a method for one test: the observer's result, changed; or one that refuses every log."""

    def add(name: str, change: Change | None = None, *, params: type[MethodParams] = FakeParams) -> None:
        def run(
            data: SensorData, constants: MethodParams, initial: Initial | None, progress: Progress | None = None
        ) -> Result:
            if change is None:
                raise LogError("This method refuses every log; try another.")
            plain = estimate_observer(data, ObserverParams(), initial, progress)
            return change(replace(plain, method=name, params=constants.as_dict()), data)

        monkeypatch.setitem(METHODS, name, Method(params=params, run=run))

    return add


def mean_of_readings(result: Result, data: SensorData) -> Result:
    """Take the mean reading for the bias, all axes known: exactly linear in an added bias."""
    scale = float(str(result.params["scale"]))
    return replace(
        result,
        gyro_bias=np.broadcast_to(scale * data.gyro.mean(axis=0), data.gyro.shape),
        accel_bias=np.broadcast_to(scale * data.accel.mean(axis=0), data.accel.shape),
        known_gyro=(True, True, True),
        known_accel=(True, True, True),
    )


@pytest.fixture
def linear() -> Change:
    """A method whose bias is the mean reading times its constant."""
    return mean_of_readings
