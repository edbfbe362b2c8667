"""Signs and frames in closed form: Wahba's problem, the frames that positions tell, the readings that are one."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.earth import steps_ned
from levelhead.preflight.frames import (
    DECIDED,
    VELOCITY_FRAMES,
    Hypothesis,
    frames_by_positions,
    wahba,
)
from levelhead.preflight.look import look_at
from levelhead.preflight.windows import rotations
from samples.strange_logs import in_frame, unsaid, without_positions

RNG = np.random.default_rng(3)


def test_wahba_gives_exact_rotations_back() -> None:
    truth = rotations(RNG.normal(0.0, 2.0, (20, 3)))
    expected = RNG.normal(0.0, 3.0, (20, 12, 3))
    expected[3:6, 5:] = 0.0  # where there is no measurement
    felt = np.einsum("wij,wej->wei", truth, expected)
    rotation, rss = wahba(felt, expected)
    np.testing.assert_allclose(rotation, truth, atol=1e-12)  # rounding
    assert rss.max() < 1e-9  # rounding of sums of 12 * 9 * 3 (m/s^2)^2


def test_wahba_allows_no_mirror_image() -> None:
    truth = rotations(RNG.normal(0.0, 2.0, (10, 3))) @ np.diag([1.0, -1.0, 1.0])
    expected = RNG.normal(0.0, 3.0, (10, 12, 3))
    rotation, rss = wahba(np.einsum("wij,wej->wei", truth, expected), expected)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-12)
    # What is left is four times what the direction with the least in it holds: it points the wrong way.
    least = np.linalg.eigvalsh(np.einsum("wei,wej->wij", expected, expected))[:, 0]
    np.testing.assert_allclose(rss, 4.0 * least, rtol=1e-9)


def test_wahba_with_noise_is_as_good_as_its_noise() -> None:
    truth = rotations(RNG.normal(0.0, 2.0, (200, 3)))
    expected = RNG.normal(0.0, 3.0, (200, 50, 3))
    felt = np.einsum("wij,wej->wei", truth, expected) + RNG.normal(0.0, 0.1, (200, 50, 3))
    rotation, rss = wahba(felt, expected)
    turned = 0.5 * (np.trace(rotation @ truth.swapaxes(-1, -2), axis1=1, axis2=2) - 1.0)
    # 0.1 over sqrt(2 * 50 * 9) about each axis; 5 sigma of a Rayleigh-like angle.
    assert np.degrees(np.arccos(np.minimum(turned, 1.0))).max() < 5.0 * math.degrees(0.1 / math.sqrt(900.0)) * 1.5
    # chi squared with 150 - 3 degrees of freedom, over 200 windows: 5 sigma of the mean.
    assert abs(rss.mean() / 0.01 - 147.0) < 5.0 * math.sqrt(2.0 * 147.0 / 200.0)


def test_the_frames_are_what_they_are_called() -> None:
    north, east, down = 1.0, 2.0, 3.0
    np.testing.assert_array_equal(VELOCITY_FRAMES["NED"] @ [north, east, down], [north, east, down])
    np.testing.assert_array_equal(VELOCITY_FRAMES["ENU"] @ [east, north, -down], [north, east, down])
    np.testing.assert_array_equal(VELOCITY_FRAMES["NEU"] @ [north, east, -down], [north, east, down])


def by_positions(log: lh.Log) -> dict[str, float]:
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    rows = slice(
        None, None, round(1.0 / float(np.median(np.diff(log.gnss_time))))
    )  # steps of a second, as the preflight takes them
    position = log.position_llh[rows]
    return frames_by_positions(log.gnss_time[rows], steps_ned(position), log.velocity_ned[rows], position)


@pytest.mark.parametrize("frame", ["NED", "ENU", "NEU", "ECEF"])
def test_positions_tell_every_frame(frame: str, drive: lh.Log) -> None:
    told = by_positions(drive if frame == "NED" else in_frame(drive, frame))
    assert set(told) == {"NED", "ENU", "NEU", "ECEF"}
    assert told[frame] == 0.0
    behind = sorted(told.values())[-2]
    if frame in ("NED", "NEU"):  # on flat ground they differ by the vertical velocity alone
        assert behind < -DECIDED
    else:
        assert behind < -10.0 * DECIDED


def test_positions_of_a_vehicle_that_stands_tell_nothing(standing: lh.Log) -> None:
    assert by_positions(standing) == {}


def test_positions_that_fit_no_frame_tell_nothing(drive: lh.Log) -> None:
    assert drive.velocity_ned is not None
    turned = drive.velocity_ned @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert by_positions(lh.Log(**{**fields(drive), "velocity_ned": turned})) == {}


def fields(log: lh.Log) -> dict[str, object]:
    return {name: getattr(log, name) for name in ("time", "gyro", "accel", "gnss_time", "velocity_ned", "position_llh")}


def test_no_two_combinations_are_equally_odd_where_one_is_told_from_them() -> None:
    plain = Hypothesis(force_sign=1, rate_sign=1, velocity_frame="NED")
    combinations = [
        Hypothesis(force_sign=f, rate_sign=r, velocity_frame=v)
        for f, r, v in itertools.product((1, -1), (1, -1), VELOCITY_FRAMES)
    ]
    assert plain.oddity == 0.0
    assert all(h.oddity > 0.0 for h in combinations if h != plain)


@pytest.mark.parametrize("rate_sign", [1, -1])
def test_enu_is_neu_with_the_forces_turned_round(rate_sign: int) -> None:
    """The pair that no accelerations tell apart: both are one rotation away from the other (docs/preflight.md)."""
    a = RNG.normal(0.0, 2.0, (4, 30, 3))
    gravity = np.array([0.0, 0.0, 9.8])
    felt = rate_sign * RNG.normal(0.0, 3.0, a.shape)
    for f in (1.0, -1.0):
        enu = wahba(f * felt, a @ VELOCITY_FRAMES["ENU"].T - gravity)[1]
        neu = wahba(-f * felt, a @ VELOCITY_FRAMES["NEU"].T - gravity)[1]
        np.testing.assert_allclose(enu, neu, rtol=1e-9)  # rounding


def test_the_reading_that_leads_says_by_how_much(drive: lh.Log) -> None:
    frames = look_at(unsaid(without_positions(drive))).frames
    assert frames is not None
    assert frames.hypothesis == Hypothesis(force_sign=1, rate_sign=1, velocity_frame="NED")
    assert frames.decided
    assert frames.margin > DECIDED
    assert frames.alternatives == ()
    # No window may add more than eight: so many have spoken at least.
    assert frames.windows >= frames.margin / 8.0
    assert proper(frames.dcm_f_to_ned)


def test_half_the_drive_gives_about_half_the_margin(drive: lh.Log) -> None:
    log = without_positions(drive)
    whole, half = look_at(log).frames, look_at(log.slice(0.0, 200.0)).frames
    assert whole is not None
    assert half is not None
    assert half.margin == pytest.approx(0.5 * whole.margin, rel=0.3)  # windows are not all equally lively


def proper(matrices: FloatArray) -> bool:
    return bool(np.allclose(matrices @ matrices.swapaxes(-1, -2), np.eye(3)) and (np.linalg.det(matrices) > 0.0).all())
