"""How well a log was recorded: every fault is found where it is, and a healthy log trips nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.preflight import Finding, Verdict
from levelhead.preflight.excitation import excitation
from levelhead.preflight.health import health
from levelhead.preflight.look import motion_of
from levelhead.sim import SensorModel
from samples.strange_logs import finding


def found(log: lh.Log) -> dict[str, Finding]:
    return {f.name: f for f in health(log, motion_of(log))}


def changed(log: lh.Log, sensor: str, axis: int, values: object, rows: slice) -> lh.Log:
    """Return a log with some readings of one axis replaced."""
    readings = getattr(log, sensor).copy()
    readings[rows, axis] = values
    return replace(log, **{sensor: readings})


def test_a_healthy_log_trips_nothing(drive: lh.Log) -> None:
    for log in (drive, lh.simulate("field", seed=2, duration=300.0, standstill_s=60.0)[0]):
        findings = found(log)
        assert {f.name for f in findings.values() if f.verdict not in (Verdict.FINE, Verdict.NOTED)} == set()
        assert not {"clipping", "stuck sensor", "compensated readings"} & findings.keys()


def test_rates_are_counted(drive: lh.Log) -> None:
    rates = found(drive)["rates"]
    assert rates.values["imu_rate_hz"] == pytest.approx(50.0)
    assert rates.values["gnss_rate_hz"] == pytest.approx(5.0)
    assert rates.values["imu_jitter"] == pytest.approx(0.0, abs=1e-9)
    slow = replace(drive, time=drive.time[::5], gyro=drive.gyro[::5], accel=drive.accel[::5])
    assert found(slow)["rates"].verdict is Verdict.WARNING
    assert "Record at 20 Hz" in found(slow)["rates"].text


def test_jitter_is_told() -> None:
    sensors = SensorModel(imu_rate=50.0, imu_time_jitter=0.002)
    log = lh.simulate("windrower", seed=1, duration=100.0, sensors=sensors)[0]
    # Two stamps' errors of 2 ms, 1.96 sigma of a 20 ms interval.
    assert found(log)["rates"].values["imu_jitter"] == pytest.approx(1.96 * math.sqrt(2.0) * 0.1, rel=0.1)


def test_gaps_are_counted(drive: lh.Log) -> None:
    assert found(drive)["gaps"].verdict is Verdict.FINE
    keep = ~(((drive.time > 50.0) & (drive.time < 50.5)) | ((drive.time > 200.0) & (drive.time < 203.0)))
    gaps = found(replace(drive, time=drive.time[keep], gyro=drive.gyro[keep], accel=drive.accel[keep]))["gaps"]
    assert (gaps.verdict, gaps.code) == (Verdict.WARNING, "W_GAP")
    assert gaps.values["count"] == 2
    assert gaps.values["longest_s"] == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize(("sensor", "axis", "share"), [("gyro", 2, 0.7), ("accel", 1, 0.5)])
def test_readings_at_the_end_of_the_range_are_found(sensor: str, axis: int, share: float, drive: lh.Log) -> None:
    limit = share * float(np.abs(getattr(drive, sensor)[:, axis]).max())
    clipped = replace(drive, **{sensor: np.clip(getattr(drive, sensor), -limit, limit)})
    if sensor == "accel":  # keep gravity
        readings = drive.accel.copy()
        readings[:, axis] = np.clip(readings[:, axis], -limit, limit)
        clipped = replace(drive, accel=readings)
    clipping = found(clipped)["clipping"]
    assert (clipping.verdict, clipping.code) == (Verdict.WARNING, "W_CLIP")
    name = f"{sensor} {'xyz'[axis]}"
    truly = float((np.abs(getattr(drive, sensor)[:, axis]) >= limit).mean())
    # Of those at the limit only runs of three and more count.
    assert 0.3 * truly < float(str(clipping.values[name])) <= truly
    assert name in clipping.text


def test_two_largest_readings_are_a_coincidence(drive: lh.Log) -> None:
    most = float(np.abs(drive.gyro[:, 2]).max()) * 1.5
    assert "clipping" not in found(changed(drive, "gyro", 2, most, slice(700, 702)))
    assert "clipping" in found(changed(drive, "gyro", 2, most, slice(700, 703)))


@pytest.mark.parametrize(("sensor", "axis"), [("gyro", 0), ("accel", 2)])
def test_an_axis_that_stands_still_while_the_vehicle_drives_is_stuck(sensor: str, axis: int, drive: lh.Log) -> None:
    value = float(getattr(drive, sensor)[5000, axis])
    rows = slice(5000, 5000 + round(1.5 * 50.0))  # E_STUCK within 1.1 s: faults.md
    stuck = found(changed(drive, sensor, axis, value, rows))["stuck sensor"]
    assert (stuck.verdict, stuck.code) == (Verdict.WARNING, "E_STUCK")
    assert stuck.values == {f"{sensor} {'xyz'[axis]}": pytest.approx(100.0, abs=0.05)}
    short = slice(5000, 5000 + round(0.9 * 50.0))
    assert "stuck sensor" not in found(changed(drive, sensor, axis, value, short))


def test_an_axis_that_is_stuck_for_good_is_not_called_clipped(drive: lh.Log) -> None:
    findings = found(changed(drive, "gyro", 1, 0.25, slice(None)))
    assert "stuck sensor" in findings
    assert "clipping" not in findings


def test_a_quantised_standstill_is_not_stuck() -> None:
    """Coarse readings at rest are constant for minutes: no fault (faults.md: 0 false in 24 h; here ten minutes)."""
    sensors = SensorModel(
        gyro_step=math.radians(0.5), accel_step=0.3, vibration=0.0, gyro_noise=0.0, accel_noise=1e-4, gyro_bias_walk=0.0
    )
    log = lh.simulate("windrower", seed=1, duration=600.0, standstill_s=600.0, sensors=sensors)[0]
    assert (np.diff(log.gyro, axis=0) == 0.0).all()
    findings = found(log)
    assert "stuck sensor" not in findings
    assert "clipping" not in findings


def test_a_standstill_tells_the_gyro_biases() -> None:
    sensors = SensorModel(
        gyro_bias=tuple(np.radians([0.3, -0.2, 0.1])), gyro_bias_walk=0.0, accel_bias=(0.0, 0.0, -0.15)
    )
    log = lh.simulate("windrower", seed=1, duration=200.0, standstill_s=60.0, sensors=sensors)[0]
    rest = found(log)["rest"]
    assert rest.verdict is Verdict.NOTED
    assert rest.values["seconds"] == pytest.approx(60.0, abs=5.0)  # it sets off slowly
    # 0.01 deg/s/sqrt(Hz), one-sided, over 55 s: 0.001 deg/s; five sigma.
    np.testing.assert_allclose(np.asarray(rest.values["gyro_deg_s"]), [0.3, -0.2, 0.1], atol=0.005)
    # The slope of the ground has part of the bias in the level axes: second order.
    assert rest.values["norm_excess_m_s2"] == pytest.approx(0.15, abs=0.01)


def test_a_drive_without_a_standstill_says_so(drive: lh.Log) -> None:
    rest = found(drive)["rest"]
    assert rest.values == {}
    assert "never stands" in rest.text
    assert "too short" in found(drive.slice(0.0, 4.0))["rest"].text


def test_noise_is_that_of_the_sensors(drive: lh.Log) -> None:
    noise = found(drive)["noise"]
    # 0.01 deg/s/sqrt(Hz); 150 ug/sqrt(Hz) and vibration of 0.1 m/s^2 RMS white over 25 Hz. Turns add a little.
    np.testing.assert_allclose(np.asarray(noise.values["gyro_deg_s_sqrt_hz"]), 0.01, rtol=0.1)
    expected = math.hypot(150e-6 * 9.80665, 0.1 / math.sqrt(25.0))
    np.testing.assert_allclose(np.asarray(noise.values["accel_m_s2_sqrt_hz"]), expected, rtol=0.1)


def test_readings_that_had_biases_taken_off_are_said_to(drive: lh.Log) -> None:
    sentence = "The autopilot took its biases off: what is estimated is left of them."
    log = replace(drive, meta={"compensated": sentence})
    compensated = found(log)["compensated readings"]
    assert (compensated.verdict, compensated.code, compensated.text) == (Verdict.WARNING, "W_COMPENSATED", sentence)
    # The reader has made the event; it is not counted again.
    assert "W_COMPENSATED" not in {event.code for event in lh.check(log).log.events}


def test_faults_become_events_of_the_checked_log(drive: lh.Log) -> None:
    stuck = changed(drive, "gyro", 0, 0.01, slice(5000, 5100))
    events = {event.code: event for event in lh.check(stuck).log.events}
    assert events.keys() == {"E_STUCK"}
    assert "gyro x from 100.0 s" in events["E_STUCK"].text


def shares(log: lh.Log) -> dict[str, float]:
    driving = next(f for f in excitation(log, motion_of(log)) if f.name == "driving")
    return {name: float(str(value)) for name, value in driving.values.items()}


def test_shares_of_driving_are_those_of_the_drive(drive: lh.Log, straight: lh.Log, standing: lh.Log) -> None:
    curves = shares(drive)
    assert curves["turning right"] > 0.2
    assert curves["turning left"] > 0.2
    assert curves["standing"] == 0.0
    assert max(shares(straight).values()) < 0.01
    assert shares(standing)["standing"] == pytest.approx(1.0, abs=0.01)
    half = lh.simulate("windrower", seed=1, duration=200.0, standstill_s=100.0)[0]
    assert shares(half)["standing"] == pytest.approx(0.5, abs=0.05)  # it sets off slowly


def test_a_drive_without_turns_is_warned_about(straight: lh.Log, circle: lh.Log, drive: lh.Log) -> None:
    for log in (straight, circle):
        findings = {f.name: f for f in excitation(log, motion_of(log))}
        assert findings["driving"].verdict is Verdict.WARNING
        assert "turns to both sides" in findings["driving"].text
        assert findings["biases"].verdict is Verdict.WARNING
    findings = {f.name: f for f in excitation(drive, motion_of(drive))}
    assert findings["driving"].verdict is Verdict.FINE
    assert findings["biases"].verdict is Verdict.FINE
    result = lh.estimate(drive, "phasor")
    assert findings["biases"].values["known"] == result.summary()["known"]
    np.testing.assert_allclose(
        np.asarray(findings["biases"].values["gyro_std"], dtype=float), np.degrees(result.gyro_bias_std[-1])
    )


def test_a_checked_log_tells_all_of_it(drive: lh.Log) -> None:
    names = {f.name for f in lh.check(drive).findings}
    assert names >= {"rates", "gaps", "rest", "noise", "driving", "biases"}
    assert finding(lh.check(drive), "gaps").as_dict() == {
        "name": "gaps",
        "verdict": "fine",
        "code": None,
        "text": "The IMU data has no gaps.",
        "values": {"count": 0, "longest_s": 0.0},
    }
