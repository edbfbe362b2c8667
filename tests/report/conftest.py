"""A synthetic drive for the report: rows on a field with headland turns, biases that converge, one GNSS outage."""

from __future__ import annotations

import dataclasses
import os
import shutil
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.estimators.base import ReferencePoint, Result, Status
from levelhead.events import Event

if TYPE_CHECKING:
    from playwright.sync_api import Browser

Make = Callable[..., Result]

GYRO_BIAS = np.radians([0.31, -0.12, 0.05])
ACCEL_BIAS = np.array([0.083, -0.041, 0.02])


def _heading_of_rows(time: FloatArray) -> FloatArray:
    """Rows of 100 s, then half a turn in 8 s, left and right in turn; rad, unwrapped."""
    row, phase = np.divmod(time, 108.0)
    turned = np.clip((phase - 100.0) / 8.0, 0.0, 1.0)
    even = row % 2 == 0
    heading: FloatArray = np.radians(20.0) + np.pi * np.where(even, turned, 1.0 - turned)
    return heading


def _drive(duration: float, rate: float, noise: np.random.Generator) -> Result:
    n = round(duration * rate) + 1
    time = np.arange(n) / rate
    heading = _heading_of_rows(time)
    speed = 2.2 * np.clip(time / 5.0, 0.0, 1.0)
    velocity = np.column_stack((speed * np.cos(heading), speed * np.sin(heading), np.zeros(n)))
    left = np.exp(-time / 60.0)[:, None]
    nan = np.full((n, 3), np.nan)
    status = np.zeros(n, dtype=np.uint32)
    status[time < 0.01 * duration] |= np.uint32(Status.INITIALIZING)
    status[(time > 0.5 * duration) & (time < 0.55 * duration)] |= np.uint32(Status.COASTING)
    status[(time > 0.7 * duration) & (time < 0.72 * duration)] |= np.uint32(Status.REVERSE)
    shown_heading = np.mod(heading, 2.0 * np.pi)
    shown_heading[time < 0.01 * duration] = np.nan
    accel_std = np.broadcast_to(0.02 * left + 0.0013, (n, 3)).copy()
    accel_std[:, 2] = np.nan
    return Result(
        time=time,
        gyro_bias=GYRO_BIAS * (1.0 - left) + noise.normal(0.0, np.radians(0.004), (n, 3)),
        accel_bias=ACCEL_BIAS * (1.0 - left) + noise.normal(0.0, 0.0015, (n, 3)),
        gyro_bias_std=np.broadcast_to(np.radians(0.1 * left + 0.0024), (n, 3)).copy(),
        accel_bias_std=accel_std,
        roll=np.radians(2.0 * np.sin(time / 37.0)) + noise.normal(0.0, np.radians(0.15), n),
        pitch=np.radians(1.2 * np.cos(time / 23.0)) + noise.normal(0.0, np.radians(0.15), n),
        heading=shown_heading,
        attitude_std=nan,
        velocity_ned=velocity,
        velocity_std=nan,
        position_llh=None,
        position_std=None,
        status=status,
        method="observer",
        params={"tau": 4.0, "tau_gyro": 40.0, "omega_accel": np.radians(45.0), "min_course_speed": 0.5},
        known_gyro=(True, True, True),
        known_accel=(True, True, True),
        settled_at_s={"gyro": 72.4, "accel": 251.0},
        log_info={
            "source": "field-07.csv",
            "format": "canonical CSV",
            "completeness": "complete",
            "duration_s": duration,
            "imu_rate_hz": rate,
            "gnss_rate_hz": 5.0,
            "distance_m": 2.2 * duration,
        },
        events=(
            Event(code="S_COAST", count=1, first_s=0.5 * duration, last_s=0.55 * duration),
            Event(code="W_GAP", count=3, first_s=12.0, last_s=81.5, detail="The longest lasted 0.8 s."),
        ),
        runtime_s={"read": 0.21, "estimate": 0.08},
    )


@pytest.fixture(scope="session")
def make_result() -> Make:
    """Make a drive of ``duration`` s at ``rate`` Hz; further keywords replace fields of the result."""

    def make(*, duration: float = 900.0, rate: float = 20.0, **changes: object) -> Result:
        result = _drive(duration, rate, np.random.default_rng(7))
        unknown = set(changes) - {field.name for field in dataclasses.fields(Result)}
        assert not unknown
        values = {field.name: getattr(result, field.name) for field in dataclasses.fields(Result)}
        return Result(**{**values, **changes})

    return make


OUTAGES = (0.5, 0.55), (0.8, 0.81)
"""Stretches without GNSS of a navigated drive, as shares of its duration."""
METRES_PER_RADIAN = 6371008.8


def _drift(share: FloatArray, duration: float) -> FloatArray:
    """Horizontal sigma, m: 2 cm with GNSS, and 1 cm/s^2 times half the square of the time without it."""
    sigma = np.full(share.shape, 0.02)
    for first, last in OUTAGES:
        inside = (share >= first) & (share < last)
        sigma[inside] += 0.005 * ((share[inside] - first) * duration) ** 2
    return sigma


@pytest.fixture(scope="session")
def make_navigated(make_result: Make) -> Make:
    """Make a drive like `make_result`, with estimated positions from 48 deg north, two outages, and a point behind."""

    def make(*, point: bool = True, duration: float = 900.0, rate: float = 20.0, **changes: object) -> Result:
        result = make_result(duration=duration, rate=rate)
        time, n = result.time, result.time.size
        moved = np.cumsum(result.velocity_ned, axis=0) / rate
        llh = np.radians([48.0, 11.0, 0.0]) + moved / [
            METRES_PER_RADIAN,
            METRES_PER_RADIAN * np.cos(np.radians(48.0)),
            -1.0,
        ]
        llh[:, 2] += 512.0
        share = time / duration
        sigma = _drift(share, duration)
        status = np.full(n, int(Status.COURSE), dtype=np.uint32)
        status[share < 0.01] = np.uint32(Status.INITIALIZING)
        for first, last in OUTAGES:
            status[(share >= first) & (share < last)] = np.uint32(Status.COASTING)
        status[(share >= 0.6) & (share < 0.65)] = np.uint32(Status.STATIONARY)
        status[(share >= 0.7) & (share < 0.72)] |= np.uint32(Status.REVERSE)
        position_std = np.column_stack((sigma, 0.9 * sigma, 1.5 * sigma))
        navigated = dataclasses.replace(
            result,
            method="phasor",
            position_llh=llh,
            position_std=position_std,
            velocity_std=np.broadcast_to([0.01, 0.01, 0.02], (n, 3)).copy(),
            status=status,
            reference=ReferencePoint(
                point=(-1.2, 0.0, 0.4),
                position_llh=llh - np.array([0.0, 0.0, 0.4]),
                position_std=position_std + 0.005,
                velocity_ned=result.velocity_ned,
                velocity_std=np.broadcast_to([0.01, 0.01, 0.02], (n, 3)).copy(),
                cross_track=2.5 * np.sin(result.roll),
                height=-2.5 * (1.0 - np.cos(result.roll)),
            )
            if point
            else None,
        )
        values = {field.name: getattr(navigated, field.name) for field in dataclasses.fields(Result)}
        assert not set(changes) - set(values)
        return Result(**{**values, **changes})

    return make


@pytest.fixture(scope="session")
def make_reference() -> Callable[[Result], dict[str, FloatArray]]:
    """Give the truth of a drive made by `make_result`, at a tenth of its rate."""

    def make(result: Result) -> dict[str, FloatArray]:
        time = result.time[::10]
        return {
            "time": time,
            "gyro_bias": np.broadcast_to(GYRO_BIAS, (time.size, 3)),
            "accel_bias": np.broadcast_to(ACCEL_BIAS, (time.size, 3)),
            "roll": np.radians(2.0 * np.sin(time / 37.0)),
            "pitch": np.radians(1.2 * np.cos(time / 23.0)),
            "heading": _heading_of_rows(time),
        }

    return make


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Start one real Chromium for the session, or skip where there is none."""
    executable = os.environ.get("LEVELHEAD_CHROMIUM") or shutil.which("chromium")
    if executable is None:
        pytest.skip("no Chromium here; install it or point LEVELHEAD_CHROMIUM at it")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    quiet = ["--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"]
    downloads = tmp_path_factory.mktemp("chromium")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=executable,
            args=["--no-sandbox", "--disable-gpu", "--disable-quic", *quiet],
            downloads_path=downloads,
        )
        yield chromium
        chromium.close()
