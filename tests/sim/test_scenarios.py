"""Each named drive does what its line says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.sim import SCENARIOS, SensorModel, Truth, simulate
from levelhead.sim.paths import SlopedGround
from levelhead.sim.scenarios import CRAB_ANGLE, HILL_SLOPE
from levelhead.sim.sensors import Stream, generator
from levelhead.sim.signals import Signal
from levelhead.sim.vehicle import CRUISE_SPEED

PERFECT = SensorModel.perfect(imu_rate=20.0)


def drive(name: str, *, seed: int = 1, duration: float = 1800.0, standstill_s: float = 0.0) -> Truth:
    """Return the truth of a scenario at 20 Hz."""
    return simulate(name, seed=seed, duration=duration, standstill_s=standstill_s, sensors=PERFECT)[1]


def turn_rate(truth: Truth) -> FloatArray:
    """Return the rate of the heading between the samples, rad/s."""
    return np.diff(np.unwrap(truth.heading)) / np.diff(truth.time)


def forward_speed(truth: Truth) -> FloatArray:
    """Return the speed along the horizontal heading, m/s."""
    return truth.velocity_ned[:, 0] * np.cos(truth.heading) + truth.velocity_ned[:, 1] * np.sin(truth.heading)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_field_turns_right_and_left_in_turn_between_straights(seed: int) -> None:
    truth = drive("field", seed=seed)
    rate, h = turn_rate(truth), 1.0 / PERFECT.imu_rate
    edges = np.flatnonzero(np.diff(np.abs(rate) > 1e-9))
    begin, end = edges[0::2], edges[1::2]
    begin = begin[: end.size]
    assert begin.size >= 12  # 1800 s hold at least 13 passes of 120 s + 17 s
    # Each edge is known to one sample, and a raised cosine leaves zero too softly to see for another.
    straights = np.concatenate(([begin[0] * h], (begin[1:] - end[:-1]) * h))
    assert straights.min() > 60.0 - 2 * h
    assert straights.max() < 120.0 + 4 * h
    assert np.ptp(straights) > 20.0  # random: 13 draws from a range of 60 s stay within 20 s once in 50,000
    for k, (b, e) in enumerate(zip(begin, end, strict=True)):
        turned = np.degrees(rate[b : e + 2].sum() * h)
        assert turned == pytest.approx(180.0 if k % 2 == 0 else -180.0, abs=1e-6)  # closed form; the edges' samples
        assert 12.0 - 1e-6 < np.degrees(np.abs(rate[b:e]).max()) < 20.0 + 1e-6  # rounding


@pytest.mark.parametrize("name", ["field", "windrower", "straight"])
def test_the_ground_rolls_by_3_and_pitches_by_2_degrees(name: str) -> None:
    truths = [drive(name, seed=seed) for seed in range(6)]
    roll, pitch = (np.degrees([np.sqrt(np.mean(getattr(t, a) ** 2)) for t in truths]) for a in ("roll", "pitch"))
    # The slowest of 24 equal sinusoids has 4 periods in the log: the RMS of one run scatters by a few per cent.
    np.testing.assert_allclose(roll, 3.0, rtol=0.12)
    np.testing.assert_allclose(pitch, 2.0, rtol=0.12)
    # Two independent angles: 1800 s hold about 150 independent samples.
    assert np.mean([np.corrcoef(t.roll, t.pitch)[0, 1] for t in truths]) == pytest.approx(0.0, abs=0.1)


def test_the_ground_forgets_itself_in_6_seconds() -> None:
    lags = np.array([60, 120, 240])  # 3, 6 and 12 s
    found = []
    for seed in range(10):
        roll = drive("straight", seed=seed).roll
        found.append([np.mean(roll[lag:] * roll[:-lag]) / np.mean(roll**2) for lag in lags])
    # First order, less the ends of the spectrum: of a first-order process 3 % of the power is beyond 0.5 Hz and 6 %
    # below 1/400 Hz, and ten runs with 150 independent samples each leave 0.03.
    np.testing.assert_allclose(np.mean(found, axis=0), np.exp(-lags / 120.0), atol=0.1)


def test_the_ground_of_a_long_run_does_not_repeat() -> None:
    roll = drive("straight", duration=7200.0).roll[::10]
    roll = roll - roll.mean()
    spectrum = np.abs(np.fft.rfft(roll, 2 * roll.size)) ** 2
    same = np.fft.irfft(spectrum)[: roll.size // 2] / np.arange(roll.size, roll.size - roll.size // 2, -1)
    # A repetition would give 1. Sums of 24 incommensurate cosines stay below 4 sigma = 4 / sqrt(48).
    assert np.abs(same[200:]).max() / same[0] < 0.75


@pytest.mark.parametrize("name", ["windrower", "curvy"])
def test_the_windrower_turns_as_the_design_notes_say(name: str) -> None:
    truth = drive(name, duration=300.0)
    middle = truth.time[:-1] + 0.5 / PERFECT.imu_rate
    expected = 12.0 * np.sin(2 * np.pi * middle / 40.0) + 6.0 * np.sin(2 * np.pi * middle / 23.0 + 1.0)
    # The mean over 0.05 s against its middle: h^2 / 24 of the second derivative (0.75 deg/s^3) is 8e-5 deg/s.
    np.testing.assert_allclose(np.degrees(turn_rate(truth)), expected, atol=1e-4)


def test_the_circle_is_level_and_turns_at_10_degrees_per_second() -> None:
    truth = drive("circle", duration=100.0)
    np.testing.assert_allclose(np.degrees(turn_rate(truth)), 10.0, atol=1e-9)  # rounding, times 20 Hz
    assert not truth.roll.any()
    assert not truth.pitch.any()
    np.testing.assert_allclose(np.linalg.norm(truth.velocity_ned, axis=1), CRUISE_SPEED, rtol=1e-14)


def test_the_straight_line_is_straight() -> None:
    truth = drive("straight", duration=100.0)
    assert np.ptp(truth.heading) < 1e-14  # rounding
    assert np.abs(truth.velocity_ned[:, 2]).max() > 0.05  # and goes up and down


@pytest.mark.parametrize("standstill_s", [0.0, 30.0])
def test_reverse_drives_backwards_20_seconds_in_every_120(standstill_s: float) -> None:
    truth = drive("reverse", duration=960.0 + standstill_s, standstill_s=standstill_s)
    moving = forward_speed(truth)[round(standstill_s * PERFECT.imu_rate) :]
    backwards = (moving < -1e-12).reshape(-1, round(120.0 * PERFECT.imu_rate))
    # The wheels stand still at both ends of the spell, which the samples hit.
    np.testing.assert_array_equal(backwards.sum(axis=1), 20.0 * PERFECT.imu_rate - 1)
    edges = np.diff(backwards.astype(int), axis=1)
    assert np.abs(edges).sum(axis=1).tolist() == [2] * 8  # one spell each
    # cos(pitch) takes at most 1 % (8 deg) off the speed along the ground.
    assert moving.min() == pytest.approx(-1.5, rel=0.01)
    assert moving.max() == pytest.approx(3.0, rel=0.01)
    # The heading knows nothing of it: at most 20 deg/s, one sample apart, while the course jumps by 180 deg.
    assert np.degrees(np.abs(turn_rate(truth)).max()) < 20.0 + 1e-6


def test_the_hill_is_a_side_slope_of_10_degrees() -> None:
    truth = drive("hill")
    straight = np.abs(np.concatenate((turn_rate(truth), [1.0]))) < 1e-9
    # Across the slope the plane is all roll; the undulation adds 0.6 and 0.4 deg RMS, at most sqrt(2 * 24) of it.
    np.testing.assert_allclose(np.abs(np.degrees(truth.roll[straight])), 10.0, atol=0.6 * math.sqrt(48))
    np.testing.assert_allclose(np.degrees(truth.pitch[straight]), 0.0, atol=0.4 * math.sqrt(48))
    assert np.degrees(np.abs(truth.pitch).max()) > 9.0  # up and down in the turns
    assert {-1.0, 1.0} == set(np.sign(truth.roll[straight]))

    uphill = truth.heading[0] + 0.5 * math.pi
    llh = truth.position_llh - truth.position_llh[0]
    east = llh[:, 1] * math.cos(truth.position_llh[0, 0])
    climbed = 6.38e6 * (llh[:, 0] * math.cos(uphill) + east * math.sin(uphill)) * math.tan(HILL_SLOPE)
    # It climbs 0.18 * 14 m a turn for 19 turns. The undulation (0.4 deg RMS, times 3 m/s, times up to 64 s per rad)
    # lifts it by 1.3 m at most; 6.38e6 m stands for the Earth's radii within 0.2 %.
    np.testing.assert_allclose(llh[:, 2], climbed, atol=1.5, rtol=0.005)
    assert abs(climbed[-1]) > 20.0


def test_the_crab_slides_down_the_hill_it_drives_across() -> None:
    crab, hill = drive("crab"), drive("hill")
    straight = np.abs(np.concatenate((turn_rate(hill), [1.0]))) < 1e-9
    forward = np.stack((np.cos(crab.heading), np.sin(crab.heading)), axis=1)
    aside = forward[:, 0] * crab.velocity_ned[:, 1] - forward[:, 1] * crab.velocity_ned[:, 0]
    slip = np.arctan2(aside, np.sum(forward * crab.velocity_ned[:, :2], axis=1))
    # The slip is 4 deg in the vehicle's floor; seen from above, on floor that rolls by 10 deg (and undulates by 0.6),
    # 4 * cos(10 deg), and pitch times roll of up to 3 and 14 deg makes another 0.7 deg of it.
    np.testing.assert_allclose(np.abs(np.degrees(slip[straight])), 4.0 * math.cos(HILL_SLOPE), atol=0.8)
    # Uphill on the right the ground rolls to the left: the nose points to the right of the course, which lies left.
    np.testing.assert_array_equal(np.sign(slip[straight]), np.sign(crab.roll[straight]))
    assert {-1.0, 1.0} == set(np.sign(slip[straight]))
    # The passes are the hill's, whose heading is the course: this one points 4 deg uphill of it. Rounding.
    turned = np.degrees(np.angle(np.exp(1j * (crab.heading - hill.heading))))
    np.testing.assert_allclose(turned[straight], -4.0 * np.sign(crab.roll[straight]), atol=1e-9)
    # So it goes along the contour lines, within the same 0.8 deg and the 0.06 deg that cos(10 deg) makes of 4.
    course = np.arctan2(crab.velocity_ned[:, 1], crab.velocity_ned[:, 0])
    aslant = np.degrees(np.angle(np.exp(1j * (course - hill.heading))))
    np.testing.assert_allclose(aslant[straight], 0.0, atol=0.9)
    # In the turns the angle changes sides smoothly: by 2 * 4 deg over 180 deg, at most 4 deg * 20 deg/s more.
    assert np.degrees(np.abs(turn_rate(crab)).max()) < 20.0 * (1.0 + CRAB_ANGLE) + 1e-6


def test_the_crab_slips_in_its_own_floor_by_its_angle() -> None:
    vehicle = SCENARIOS["crab"].build(generator(1, Stream.PATH), 400.0, 0.0)
    motion = vehicle.motion(np.arange(0.0, 400.0, 0.1))
    body = np.einsum("nij,ni->nj", motion.dcm_body_to_ned, motion.velocity_ned)
    # Rounding, in all three.
    np.testing.assert_allclose(np.linalg.norm(body, axis=1), CRUISE_SPEED, rtol=1e-14)
    np.testing.assert_allclose(body[:, 2], 0.0, atol=1e-14)
    np.testing.assert_allclose(motion.forward_speed, body[:, 0], rtol=1e-14)
    slip = np.arctan2(body[:, 1], body[:, 0])
    assert (slip[0], np.abs(slip).max()) == pytest.approx((-CRAB_ANGLE, SCENARIOS["crab"].sideslip), abs=1e-14)


def test_a_vehicle_on_a_smooth_plane_keeps_its_floor_on_it() -> None:
    slope, uphill = math.radians(10.0), 0.7
    vehicle = SCENARIOS["hill"].build(generator(1, Stream.PATH), 200.0, 0.0)
    smooth = SlopedGround(slope=slope, uphill=uphill)
    time = np.arange(0.0, 200.0, 0.05)
    motion = type(vehicle)(speed=vehicle.speed, heading=vehicle.heading, ground=smooth).motion(time)
    normal = np.array([math.sin(slope) * math.cos(uphill), math.sin(slope) * math.sin(uphill), math.cos(slope)])
    # Closed form, rounding only.
    np.testing.assert_allclose(motion.velocity_ned @ normal, 0.0, atol=1e-14)
    np.testing.assert_allclose(motion.dcm_body_to_ned[:, :, 2], np.tile(normal, (time.size, 1)), atol=1e-14)
    np.testing.assert_allclose(motion.angular_rate[:, :2], 0.0, atol=1e-14)


def test_a_standing_vehicle_does_not_move_on_rough_ground_and_then_sets_off() -> None:
    truth = drive("field", duration=100.0, standstill_s=40.0)
    at_rest = truth.time <= 40.0
    assert not truth.velocity_ned[at_rest].any()
    assert not truth.angular_rate[at_rest].any()
    assert np.ptp(truth.roll[at_rest]) == 0.0
    assert truth.roll[0] != 0.0
    speed = np.linalg.norm(truth.velocity_ned, axis=1)
    np.testing.assert_allclose(speed[truth.time >= 46.0], CRUISE_SPEED, rtol=1e-14)  # rounding
    assert np.all(np.diff(speed[(truth.time > 40.0) & (truth.time < 46.0)]) > 0.0)


def test_a_standstill_delays_the_same_drive() -> None:
    plain, late = drive("field", duration=300.0), drive("field", duration=343.0, standstill_s=40.0)
    # While it speeds up for 6 s it covers half of what cruising covers: the drive is 43 s late. Rounding only.
    np.testing.assert_allclose(late.roll[-2000:], plain.roll[-2000:], atol=1e-12)
    np.testing.assert_allclose(late.angular_rate[-2000:], plain.angular_rate[-2000:], atol=1e-12)


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_twice_as_fast_is_the_same_drive_on_twice_the_radii(name: str) -> None:
    (log, plain), (fast_log, fast) = (
        simulate(name, seed=2, duration=150.0, standstill_s=10.0, sensors=PERFECT, speed=v) for v in (4.0, 8.0)
    )
    for angle in ("roll", "pitch", "heading"):
        np.testing.assert_array_equal(getattr(fast, angle), getattr(plain, angle))
    np.testing.assert_array_equal(fast_log.gyro, log.gyro)
    np.testing.assert_allclose(fast.velocity_ned, 2.0 * plain.velocity_ned, rtol=1e-14)  # rounding
    np.testing.assert_allclose(np.linalg.norm(fast.velocity_ned, axis=1).max(), 8.0, rtol=1e-14)
    # Twice the way from the start: both within 1e-4 m, and the Earth is round: 1.2 km * 1.2 km / 6.4e6 m of curvature,
    # tan(latitude) of it between the meridians.
    way, fast_way = (t.position_llh - t.position_llh[0] for t in (plain, fast))
    np.testing.assert_allclose(6.4e6 * fast_way[:, :2], 2.0 * 6.4e6 * way[:, :2], atol=0.3)
    np.testing.assert_allclose(fast_way[:, 2], 2.0 * way[:, 2], atol=1e-4)


def test_the_usual_speed_is_the_default() -> None:
    log, asked = simulate("field", duration=5.0)[0], simulate("field", duration=5.0, speed=CRUISE_SPEED)[0]
    np.testing.assert_array_equal(log.accel, asked.accel)


def test_the_registry_tells_what_it_has() -> None:
    assert set(SCENARIOS) == {"field", "windrower", "curvy", "circle", "straight", "hill", "crab", "reverse"}
    assert all(scenario.summary.endswith(".") for scenario in SCENARIOS.values())
    zero = Signal(np.zeros(1), np.ones(1))
    # Every path starts at a heading of its own, and none turns at path time 0 but the circle and the windrower.
    rates = {
        name: SCENARIOS[name].build(generator(0, Stream.PATH), 10.0, 0.0).heading(zero).rate[0] for name in SCENARIOS
    }
    assert {name for name, rate in rates.items() if rate != 0.0} == {"circle", "windrower", "curvy"}
