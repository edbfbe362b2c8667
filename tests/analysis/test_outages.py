"""`outage_test` with a made-up estimator that drifts by a known law, so that every figure is known beforehand."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.analysis.drift import Window
from levelhead.analysis.outages import MAX_WINDOWS, outage_test, outage_windows, without_gnss
from levelhead.conventions import FloatArray
from levelhead.earth import ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS
from levelhead.errors import LogError, UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.params import FilterParams, MethodParams, Triple
from levelhead.estimators.reference import in_ned

SPEED = 10.0
LATITUDE = math.radians(48.0)
LEVER_ARM: Triple = (1.5, -0.5, -2.0)
ROLL, PITCH, HEADING = 0.1, -0.05, 1.7
DATE_LINE = 1500.3
"""How far from the start it is, m: between two samples of the IMU."""
DRIFT = np.array([0.3, -0.4, 0.1])
"""Of the made-up estimator, NED, m per second without GNSS: 0.5 m/s horizontally."""
OFFSET = np.array([0.02, 0.0, -0.01])
"""What it is off by where it sees GNSS, m."""


def to_llh(ned: FloatArray) -> FloatArray:
    """Return positions (n, 3) near the date line at these places, m."""
    root = 1.0 - ECCENTRICITY_SQUARED * math.sin(LATITUDE) ** 2
    meridian = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / root**1.5
    transverse = SEMI_MAJOR_AXIS / math.sqrt(root)
    latitude = LATITUDE + ned[:, 0] / meridian
    longitude = math.pi + (ned[:, 1] - DATE_LINE) / (transverse * math.cos(LATITUDE))
    return np.column_stack((latitude, np.mod(longitude + math.pi, 2.0 * math.pi) - math.pi, -ned[:, 2]))


def imu_ned(time: FloatArray) -> FloatArray:
    """Return where the IMU is: eastwards at 10 m/s, at the height of the ellipsoid, over the date line after 150 s."""
    zero = np.zeros(time.size)
    return np.column_stack((zero, SPEED * time, zero))


def arm_ned() -> FloatArray:
    """Return the lever arm in NED from the three elementary rotations."""
    (sr, sp, sh), (cr, cp, ch) = np.sin([ROLL, PITCH, HEADING]), np.cos([ROLL, PITCH, HEADING])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[ch, -sh, 0], [sh, ch, 0], [0, 0, 1]])
    arm: FloatArray = about_z @ about_y @ about_x @ np.array(LEVER_ARM)
    return arm


def make_log(duration: float = 600.0, *, velocities: bool = True, positions: bool = True) -> lh.Log:
    """Return a drive with an IMU at 10 Hz and GNSS every second."""
    n = round(10.0 * duration) + 1
    time, gnss_time = np.arange(n) / 10.0, np.arange(round(duration) + 1.0)
    return lh.Log(
        time=time,
        gyro=np.zeros((n, 3)),
        accel=np.broadcast_to([0.0, 0.0, -9.81], (n, 3)),
        gnss_time=gnss_time,
        velocity_ned=np.broadcast_to([0.0, SPEED, 0.0], (gnss_time.size, 3)) if velocities else None,
        position_llh=to_llh(imu_ned(gnss_time) + arm_ned()) if positions else None,
        position_std=np.full(gnss_time.size, 0.03) if positions else None,
    )


def drifting(log: lh.Log, method: str, params: MethodParams) -> lh.Result:
    """Drift by `DRIFT` since the last GNSS epoch; claim 0.4 m per second on every axis, and 4 cm with GNSS."""
    n = log.time.size
    since = log.time - log.gnss_time[np.searchsorted(log.gnss_time, log.time, side="right") - 1]
    nothing = np.zeros((n, 3))
    return lh.Result(
        time=log.time,
        gyro_bias=nothing,
        accel_bias=nothing,
        gyro_bias_std=nothing,
        accel_bias_std=nothing,
        roll=np.full(n, ROLL),
        pitch=np.full(n, PITCH),
        heading=np.full(n, HEADING),
        attitude_std=nothing,
        velocity_ned=nothing,
        velocity_std=nothing,
        position_llh=to_llh(imu_ned(log.time) + OFFSET + since[:, None] * DRIFT),
        position_std=np.broadcast_to((0.04 + 0.4 * since)[:, None], (n, 3)),
        status=np.zeros(n, dtype=np.uint32),
        method=method,
        params=params.as_dict(),
        known_gyro=(True, True, True),
        known_accel=(True, True, True),
        settled_at_s={},
    )


def test_the_drift_is_that_of_the_law() -> None:
    test = outage_test(make_log(), 15.0, methods=["phasor"], lever_arm=LEVER_ARM, run=drifting)
    run = next(run for run in test.runs if run.name == "phasor")
    # 600 s, from 120 s on, every 60 s, with 15 s of GNSS after the last: 120, 180 ... 540.
    assert [drift.window.start_s for drift in run.drifts] == [120.0 + 60.0 * k for k in range(8)]
    for drift in run.drifts:
        start = drift.window.start_s
        assert drift.compared_s == start + 14.0  # the last fix before the end, 15 s after the last one seen
        # One latitude for all radii, in `to_llh`, is 1e-6 of the metres from there; heights of metres are as little.
        assert drift.horizontal_m == pytest.approx(math.hypot(15.0 * 0.3 + 0.02, 15.0 * 0.4), abs=1e-5)
        assert drift.vertical_m == pytest.approx(15.0 * 0.1 - 0.01, abs=1e-5)
        claimed = math.hypot(0.04 + 0.4 * 15.0, 0.03)  # with the fix's own 3 cm
        assert drift.vertical_std_m == pytest.approx(claimed)
        assert drift.horizontal_std_m == pytest.approx(math.sqrt(2.0) * claimed)
        assert drift.in_sigma == pytest.approx(drift.horizontal_m / (math.sqrt(2.0) * claimed))
        assert drift.distance_m == pytest.approx(140.0)
        assert drift.percent == pytest.approx(100.0 * drift.horizontal_m / 140.0)
        assert drift.largest_m == drift.horizontal_m
    assert run.figures("horizontal_m") == pytest.approx([run.drifts[0].horizontal_m] * 3, abs=1e-5)


def test_with_gnss_it_agrees_within_both_sigmas() -> None:
    run = outage_test(make_log(), 15.0, methods=["phasor"], lever_arm=LEVER_ARM, run=drifting).runs[0]
    assert run.agreement is not None
    assert run.agreement.epochs == 600 - 120 + 1
    assert run.agreement.horizontal_m == pytest.approx(0.02, abs=1e-5)
    assert run.agreement.vertical_m == pytest.approx(0.01, abs=1e-5)
    # 4 cm claimed and 3 cm of the fix are 5 cm; of the two horizontal axes one is exact.
    assert run.agreement.horizontal_in_sigma == pytest.approx(0.02 / 0.05 / math.sqrt(2.0), abs=2e-4)
    assert run.agreement.vertical_in_sigma == pytest.approx(0.01 / 0.05, abs=2e-4)


def test_without_the_lever_arm_the_antenna_is_elsewhere() -> None:
    run = outage_test(make_log(), 15.0, methods=["phasor"], run=drifting).runs[0]
    assert run.agreement is not None
    assert run.agreement.horizontal_m == pytest.approx(np.hypot(*(OFFSET - arm_ned())[:2]), abs=1e-5)
    np.testing.assert_allclose(
        in_ned(np.array([ROLL]), np.array([PITCH]), np.array([HEADING]), LEVER_ARM)[0], arm_ned(), atol=1e-15
    )


def test_between_two_samples_the_date_line_is_crossed_the_short_way() -> None:
    log = make_log()
    later = log.gnss_time[:-1] + 0.05  # half an IMU interval; that at 150.05 s is where the date line lies between
    log = replace(
        log,
        gnss_time=later,
        velocity_ned=np.broadcast_to([0.0, SPEED, 0.0], (later.size, 3)),
        position_llh=to_llh(imu_ned(later) + arm_ned()),
        position_std=np.full(later.size, 0.03),
    )

    def exact(log: lh.Log, method: str, params: MethodParams) -> lh.Result:
        result = drifting(make_log(), method, params)
        turned = np.where(np.arange(log.time.size) % 2 == 0, 2.0 * math.pi, 0.0)  # a heading in another turn
        return replace(result, position_llh=to_llh(imu_ned(log.time)), heading=result.heading + turned)

    run = outage_test(log, 15.0, methods=["phasor"], lever_arm=LEVER_ARM, run=exact).runs[0]
    assert run.agreement is not None
    assert run.agreement.epochs == 480  # 120.05 to 599.05, with that of the date line
    assert run.agreement.horizontal_m < 1e-5  # as above


def test_the_figures_are_over_the_windows_and_the_largest_may_lie_inside() -> None:
    def smoothing(log: lh.Log, method: str, params: MethodParams) -> lh.Result:
        """Be off by a metre per window so far, and by ten metres 5 s after the start of each."""
        result = drifting(log, method, params)
        assert result.position_llh is not None
        gaps = np.flatnonzero(np.diff(log.gnss_time) > 1.5)
        error = np.zeros((log.time.size, 3))
        for k, gap in enumerate(gaps):
            error[log.time > log.gnss_time[gap], 0] = 1.0 + k
            error[np.abs(log.time - log.gnss_time[gap] - 5.0) < 0.01, 0] = 10.0
        return replace(result, position_llh=to_llh(imu_ned(log.time) + error))

    run = outage_test(make_log(400.0), 15.0, methods=["phasor"], lever_arm=LEVER_ARM, run=smoothing).runs[0]
    assert len(run.drifts) == 5  # from 100, a quarter of the drive, to 340
    assert [drift.horizontal_m for drift in run.drifts] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0], abs=1e-5)
    assert [drift.largest_m for drift in run.drifts] == pytest.approx([10.0] * 5, abs=1e-5)
    assert run.figures("horizontal_m") == pytest.approx((math.sqrt(11.0), 3.0, 5.0), abs=1e-5)


def test_velocities_and_positions_are_taken_out_and_nothing_else() -> None:
    log = make_log()
    holed = without_gnss(log, [Window(start_s=100.0, end_s=115.0), Window(start_s=200.5, end_s=205.5)])
    gone = sorted(set(log.gnss_time) - set(holed.gnss_time))
    assert gone == [*range(100, 115), *range(201, 206)]
    assert holed.velocity_ned is not None
    assert holed.position_std is not None
    assert len(holed.velocity_ned) == len(holed.position_std) == log.gnss_time.size - 20
    np.testing.assert_array_equal(holed.time, log.time)


@pytest.mark.parametrize("length", [5.0, 15.0, 40.0])
def test_windows_keep_their_distance(length: float) -> None:
    log = make_log(3600.0)
    windows = outage_windows(log, length)
    starts = np.array([window.start_s for window in windows])
    assert starts[0] == 120.0
    assert np.diff(starts).min() >= 4.0 * length
    assert len(windows) <= MAX_WINDOWS
    # Spread over all of it: what is left behind the last one has no room for another.
    assert 3600.0 - 2.0 * length - np.diff(starts).max() <= starts[-1] <= 3600.0 - 2.0 * length


def test_windows_shun_where_gnss_was_absent_anyway() -> None:
    log = make_log()
    windows = outage_windows(without_gnss(log, [Window(start_s=130.0, end_s=140.0)]), 15.0)
    # Fifteen seconds of GNSS come before the first; it is back at 140, with three intervals of grace.
    assert 152.0 <= windows[0].start_s <= 155.0
    # GNSS ends at 500 s: the next after 420 would be that of 480, without a length of GNSS behind it.
    ended = outage_windows(without_gnss(log, [Window(start_s=500.0, end_s=601.0)]), 15.0)
    assert ended[-1].start_s == 420.0
    # Positions every two seconds and a velocity in between, for ten minutes: the last fix is within 2 s of the end.
    assert log.position_llh is not None
    sparse = np.where(np.arange(log.gnss_time.size)[:, None] % 2 == 0, log.position_llh, np.nan)
    test = outage_test(replace(log, position_llh=sparse), 15.0, methods=["phasor"], run=drifting)
    assert all(drift.window.end_s - drift.compared_s <= 2.0 for drift in test.runs[0].drifts)


def test_what_cannot_be_tested_is_a_sentence() -> None:
    test = outage_test(make_log(positions=False), 15.0, run=drifting)
    assert "no GNSS positions" in test.reason
    assert test.as_dict()["runs"] == []
    assert "No outage of 60 s fits into this log of 100 s" in outage_test(make_log(100.0), 60.0, run=drifting).reason
    for length in (4.0, -15.0, math.nan, math.inf):
        with pytest.raises(UsageError, match="cannot be tested; give 5 s or more"):
            outage_test(make_log(), length, run=drifting)


def test_a_method_without_positions_or_that_refuses_is_said() -> None:
    def without(log: lh.Log, method: str, params: MethodParams) -> lh.Result:
        if method == "smoother":
            raise LogError("This method refuses every log; try another.")
        return replace(drifting(log, method, params), position_std=None)

    test = outage_test(make_log(), 15.0, methods=["observer", "smoother"], run=without)
    assert "The method observer does not estimate positions" in test.runs[0].refused
    assert test.runs[1].refused == "This method refuses every log; try another."
    assert test.windows == 0
    assert json.loads(json.dumps(test.as_dict(), allow_nan=False))["runs"][0]["drift"] is None


def test_a_position_that_is_not_known_is_null_and_a_standstill_has_no_percentage() -> None:
    def lost(log: lh.Log, method: str, params: MethodParams) -> lh.Result:
        result = drifting(log, method, params)
        return replace(result, position_llh=np.full((log.time.size, 3), np.nan))

    log = make_log()
    run = outage_test(log, 15.0, methods=["phasor"], run=lost).runs[0]
    content = json.loads(json.dumps(run.as_dict(), allow_nan=False))
    assert content["windows"][0]["horizontal_m"] is None
    assert content["agreement"]["epochs"] == 0
    still = replace(log, velocity_ned=np.zeros((log.gnss_time.size, 3)))
    drift = outage_test(still, 15.0, methods=["phasor"], run=drifting).runs[0].drifts[0]
    assert math.isnan(drift.percent)
    assert drift.as_dict()["percent_of_distance"] is None


def test_a_log_of_positions_has_its_distance_from_them() -> None:
    run = outage_test(make_log(velocities=False), 15.0, methods=["phasor"], lever_arm=LEVER_ARM, run=drifting).runs[0]
    assert run.drifts[0].distance_m == pytest.approx(140.0, rel=1e-5)


@dataclass(frozen=True, kw_only=True)
class AxleParams(FilterParams):
    """What the phasor's constants become once they know the axle that does not slide."""

    rear_axle: Triple | None = None


def test_the_axle_that_does_not_slide_is_a_further_variant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(METHODS, "navigator", replace(METHODS["phasor"], params=AxleParams))
    seen: list[Triple | None] = []

    def noting(log: lh.Log, method: str, params: MethodParams) -> lh.Result:
        assert isinstance(params, AxleParams)
        seen.append(params.rear_axle)
        return drifting(log, method, params)

    test = outage_test(make_log(), 15.0, methods=["navigator"], run=noting)
    assert [run.name for run in test.runs] == ["navigator", "navigator, rear axle"]
    assert seen == [None, None, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    given = AxleParams(rear_axle=(-1.0, 0.0, 0.0))
    assert len(outage_test(make_log(), 15.0, methods=["navigator"], params=given, run=noting).runs) == 1


def test_the_methods_themselves_run_through_it() -> None:
    log = lh.simulate("windrower", seed=3, duration=200.0)[0]
    test = outage_test(log, 10.0)
    assert [run.name for run in test.runs][:2] == ["phasor", "smoother"]
    for run in test.runs:
        assert bool(run.refused) != bool(run.drifts)
