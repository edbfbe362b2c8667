"""The heading: taken from a course that can be trusted, and until then no reason to tilt the platform."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from levelhead.conventions import GRAVITY
from levelhead.estimators.base import Status
from levelhead.estimators.observer import Observer, ObserverParams
from levelhead.estimators.streaming import run
from levelhead.logs.log import Log
from levelhead.sim import SensorModel, simulate


def test_a_course_too_uncertain_says_nothing() -> None:
    log, truth = simulate("windrower", seed=1, duration=120.0)
    # 3 m/s with a stated sigma of 1 m/s: the course is uncertain by 19 deg, more than the 15 that are accepted.
    doubtful = replace(log, velocity_std=np.full(log.gnss_time.size, 1.0))
    trace = run(Observer(), doubtful)
    assert np.isnan(trace.attitude[:, 2]).all()
    assert trace.status[-1] & Status.ALIGNING
    # 0.7 m/s is 13 deg: accepted.
    accepted = run(Observer(), replace(log, velocity_std=np.full(log.gnss_time.size, 0.7)))
    assert abs(math.degrees(accepted.attitude[-1, 2] - truth.heading[-1])) < 2.0


def test_a_slow_vehicle_has_no_course() -> None:
    log, _ = simulate("straight", seed=1, duration=60.0)
    assert log.velocity_ned is not None
    assert np.isnan(run(Observer(ObserverParams(min_course_speed=3.5)), log).attitude[:, 2]).all()
    assert np.isfinite(run(Observer(ObserverParams(min_course_speed=2.5)), log).attitude[-1, 2])


def test_rocking_to_and_fro_before_the_first_course_does_not_tilt_the_platform() -> None:
    # Facing south, 10 s at rest, then up to 0.8 m/s forwards and back: too slow for a course. With the unknown heading
    # taken for north, each push would tilt the platform by 2 * 0.8/(g tau) = 2.3 deg.
    t = np.arange(0.0, 60.0, 0.01)
    moving = np.clip(t - 10.0, 0.0, None)
    speed = 0.8 * np.sin(2.0 * moving)
    acceleration = np.where(t > 10.0, 1.6 * np.cos(2.0 * moving), 0.0)
    n = t.size
    accel = np.column_stack([acceleration, np.zeros(n), np.full(n, -GRAVITY)])
    velocity = np.column_stack([-speed, np.zeros(n), np.zeros(n)])
    log = Log(time=t, gyro=np.zeros((n, 3)), accel=accel, gnss_time=t[::10], velocity_ned=velocity[::10])
    trace = run(Observer(), log)
    known = ~np.isnan(trace.attitude[:, 0])
    assert known[200:].all()
    # Only below 0.15 m/s does the platform level. Epochs are 0.16 m/s apart at the turning points, so up to 0.46 m/s of
    # change are seen the wrong way round: 2 * 0.46/(g tau) = 1.35 deg, forgotten within tau.
    assert np.degrees(np.abs(trace.attitude[known, :2])).max() < 1.35


def test_the_heading_follows_the_gyro_between_courses() -> None:
    log, truth = simulate("windrower", seed=1, duration=300.0, sensors=SensorModel(gyro_bias=(0.0, 0.0, 0.0)))
    trace = run(Observer(), log)
    late = log.time > 60.0
    error = (trace.attitude[late, 2] - truth.heading[late] + np.pi) % (2.0 * np.pi) - np.pi
    # Course noise 0.03/3 rad = 0.57 deg per epoch, averaged over tau_heading at 10 Hz: 0.57 sqrt(0.1/8) = 0.07 deg.
    assert np.degrees(np.sqrt(np.mean(error**2))) < 0.14
