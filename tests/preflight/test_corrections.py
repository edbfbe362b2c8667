"""What corrections do to a log, and the names of axes."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.errors import UsageError
from levelhead.logs.mapping import rotation_321
from levelhead.preflight import Corrections, Told
from levelhead.preflight.corrections import angles_321, axes_matrix, axes_name, nearest_axes, told_corrections
from levelhead.preflight.windows import rotations
from samples.strange_logs import FLU, SIGNED_AXES, in_axes, in_degrees, in_frame, in_g, velocities, without_positions


def test_all_48_names_of_axes_are_48_matrices() -> None:
    names = [
        ",".join(s + a for s, a in zip(signs, order, strict=True))
        for order in itertools.permutations("xyz")
        for signs in itertools.product(("", "-"), repeat=3)
    ]
    matrices = [axes_matrix(name) for name in names]
    assert len({m.tobytes() for m in matrices}) == 48
    assert sum(np.linalg.det(m) > 0.0 for m in matrices) == 24
    assert [axes_name(m) for m in matrices] == names


def test_axes_are_named_as_those_of_the_file() -> None:
    # Forward is the file's -y, right is its x, down is its z.
    body = axes_matrix("-y,x,z") @ [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(body, [-2.0, 1.0, 3.0])
    np.testing.assert_array_equal(axes_matrix(" +x, y , -z"), np.diag([1.0, 1.0, -1.0]))


@pytest.mark.parametrize("text", ["", "x,y", "x,y,z,x", "x,x,z", "x,y,-x", "a,b,c", "--x,y,z", "x y z", "x,y,zz"])
def test_what_is_no_axes_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--axes is"):
        axes_matrix(text)


def test_the_nearest_axes_are_those_before_a_mounting_of_forty_degrees() -> None:
    rng = np.random.default_rng(0)
    for axes in SIGNED_AXES:
        if np.linalg.det(axes) > 0.0:
            direction = rng.normal(0.0, 1.0, 3)
            tilt = rotations(math.radians(40.0) * direction / np.linalg.norm(direction))
            np.testing.assert_array_equal(nearest_axes(tilt @ axes), axes)


def test_angles_are_those_of_the_rotation() -> None:
    for yaw, pitch, roll in np.random.default_rng(1).uniform(-1.5, 1.5, (20, 3)):
        found = angles_321(rotation_321(roll=roll, pitch=pitch, yaw=yaw))
        np.testing.assert_allclose(found, (yaw, pitch, roll), atol=1e-12)  # rounding


def test_nothing_to_correct_returns_the_very_log(drive: lh.Log) -> None:
    assert Corrections().apply(drive) is drive


def test_every_correction_undoes_its_fault(drive: lh.Log) -> None:
    faulty = in_frame(in_g(in_degrees(in_axes(drive, FLU))), "ENU")
    faulty = replace(faulty, gnss_time=faulty.gnss_time + 0.25)
    fix = Corrections(
        gyro_factor=math.pi / 180.0,
        accel_factor=9.80665,
        gyro_dcm=FLU.T,
        accel_dcm=FLU.T,
        velocity_frame="ENU",
        latency_s=0.25,
    )
    log = fix.apply(faulty)
    for name in ("gyro", "accel", "velocity_ned", "gnss_time"):
        np.testing.assert_allclose(getattr(log, name), getattr(drive, name), rtol=1e-12, atol=1e-13)  # rounding
    for name in ("time", "position_llh"):
        np.testing.assert_array_equal(getattr(log, name), getattr(drive, name))


def test_sigmas_go_with_their_axes(drive: lh.Log) -> None:
    m = drive.gnss_time.size
    sigma = np.broadcast_to([0.1, 0.2, 0.3], (m, 3))
    log = replace(in_frame(drive, "ENU"), velocity_std=sigma)
    np.testing.assert_array_equal(Corrections(velocity_frame="ENU").apply(log).velocity_std, sigma[:, [1, 0, 2]])
    log = replace(in_frame(drive, "ECEF"), velocity_std=sigma)
    found = Corrections(velocity_frame="ECEF").apply(log)
    assert found.velocity_std is not None
    np.testing.assert_allclose(found.velocity_std, math.sqrt((0.01 + 0.04 + 0.09) / 3.0))
    one = np.full(m, 0.1)
    log = replace(in_frame(drive, "ECEF"), velocity_std=one)
    np.testing.assert_array_equal(Corrections(velocity_frame="ECEF").apply(log).velocity_std, one)


def test_ecef_needs_positions_and_bridges_those_that_are_missing(drive: lh.Log) -> None:
    earth = in_frame(drive, "ECEF")
    assert earth.position_llh is not None
    with pytest.raises(UsageError, match="need positions"):
        Corrections(velocity_frame="ECEF").apply(without_positions(earth))
    sparse = earth.position_llh.copy()
    sparse[np.arange(sparse.shape[0]) % 50 != 0] = np.nan
    log = Corrections(velocity_frame="ECEF").apply(replace(earth, position_llh=sparse, position_std=None))
    # Ten seconds between positions, 70 m of curves: the interpolated place is off by 1.1e-5 rad at most, of 7 m/s.
    np.testing.assert_allclose(velocities(log), velocities(drive), atol=8e-5)


def test_what_is_told_becomes_corrections() -> None:
    fix = told_corrections(
        Told(axes="-x,y,-z", gyro_unit="deg/s", accel_unit="mg", velocity_frame="NEU", latency_s=0.2)
    )
    assert fix.gyro_factor == pytest.approx(math.pi / 180.0)
    assert fix.accel_factor == pytest.approx(9.80665e-3)
    assert (fix.velocity_frame, fix.latency_s) == ("NEU", 0.2)
    np.testing.assert_array_equal(fix.gyro_dcm, np.diag([-1.0, 1.0, -1.0]))
    np.testing.assert_array_equal(fix.accel_dcm, fix.gyro_dcm)
    # The IMU's forward axis points 90 deg to the right of the vehicle's: what it feels is to the right.
    turned = told_corrections(Told(mounting_yaw=0.5 * math.pi)).accel_dcm
    np.testing.assert_allclose(turned @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"gyro_unit": "rpm"}, "gyro unit 'rpm'"),
        ({"accel_unit": "feet"}, "accel unit 'feet'"),
        ({"gyro_unit": "g"}, "gyro unit 'g'"),
        ({"velocity_frame": "ned"}, "velocity frame 'ned'"),
        ({"latency_s": math.nan}, "latency is nan"),
        ({"latency_s": math.inf}, "latency is inf"),
        ({"mounting_yaw": math.nan}, "mounting yaw is nan"),
        ({"lever_arm": (0.0, math.nan, 0.0)}, "lever arm is 0.0, nan, 0.0"),
    ],
)
def test_what_makes_no_sense_is_refused_when_it_is_told(told: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        Told(**told)  # type: ignore[arg-type]
