"""A result with known biases, and the log it is of, whose `meta` each test sets."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from levelhead.estimators.base import Result
from levelhead.logs.log import Log

GYRO_BIAS = np.array([0.0031, -0.0044, 0.0012])
ACCEL_BIAS = np.array([0.12, -0.31, 0.07])
GYRO_STD = np.array([1e-5, 2e-5, 4e-5])
ACCEL_STD = np.array([0.001, 0.002, 0.004])
KNOWN = (True, True, True)

Case = tuple[Result, Log]
MakeCase = Callable[..., Case]


@pytest.fixture(scope="session")
def make_case() -> MakeCase:
    """Make a result and its log; `gyro`, `accel` (3,), known flags, `params` and the log's `meta` may be set."""

    def make(
        *,
        gyro: object = GYRO_BIAS,
        accel: object = ACCEL_BIAS,
        known_gyro: tuple[bool, bool, bool] = KNOWN,
        known_accel: tuple[bool, bool, bool] = KNOWN,
        method: str = "smoother",
        params: dict[str, object] | None = None,
        **meta: object,
    ) -> Case:
        n = 40
        time = np.arange(n) / 10.0
        rows = np.zeros((n, 3))
        log = Log(
            time=time,
            gyro=rows,
            accel=rows - [0.0, 0.0, 9.8],
            gnss_time=time[::10],
            velocity_ned=np.ones((4, 3)),
            meta={"source": "drive.ulg", **meta},
        )

        def last(values: object) -> np.ndarray:
            # Only the end of the log counts: what was before is something else.
            table = np.full((n, 3), 7.0)
            table[-1] = values
            return table

        result = Result(
            time=log.time,
            gyro_bias=last(gyro),
            accel_bias=last(accel),
            gyro_bias_std=last(GYRO_STD),
            accel_bias_std=last(ACCEL_STD),
            roll=np.zeros(n),
            pitch=np.zeros(n),
            heading=np.zeros(n),
            attitude_std=rows,
            velocity_ned=rows,
            velocity_std=rows,
            position_llh=None,
            position_std=None,
            status=np.zeros(n, dtype=np.uint32),
            method=method,
            params=params or {},
            known_gyro=known_gyro,
            known_accel=known_accel,
            settled_at_s={},
            log_info=log.describe(),
        )
        return result, log

    return make
