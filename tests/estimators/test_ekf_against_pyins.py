"""Our Kalman filter against an independent one: the feedback filter of `pyins` (N. Mayorov, MIT, PyPI: python-ins).

Both get the same readings, velocities and courses and the same true noise; pyins starts from our first levelled
attitude with uncorrelated errors, which is forgotten by the time the two are compared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import GRAVITY, FloatArray

# What pandas thinks of its use inside pyins is not ours to mend.
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]

# Where normal gravity on the ellipsoid is the simulation's 9.80665 m/s^2.
ORIGIN = (math.radians(45.4969), math.radians(10.0), 0.0)
NOISE = lh.EkfParams(
    accel_noise=math.hypot(150e-6 * GRAVITY, 0.1 / math.sqrt(50.0)), velocity_std=0.03, latitude=ORIGIN[0]
)
START, COMPARED_FROM = 1.0, 150.0


@dataclass(frozen=True)
class Course:
    """The course over ground as a measurement of the heading; pyins asks for these two names."""

    data: Any

    def compute_matrices(self, time: float, pva: Any, error_model: Any) -> Any:
        """Return innovation, its derivative by the error state, and its covariance."""
        if time not in self.data.index:
            return None
        course, sigma = self.data.loc[time, ["course", "sigma"]]
        z = (math.radians(pva["heading"]) - course + math.pi) % (2.0 * math.pi) - math.pi
        heading_deg = error_model.transform_to_output(pva)[8]
        return np.array([z]), np.radians(heading_deg)[None, :], np.array([[sigma**2]])


def pyins_result(log: lh.Log, ours: lh.Result) -> Any:
    """Run pyins over a log from one second on, as `run_feedback_filter` returns it."""
    absent = "pyins is absent: pip install 'levelhead[compare]'"
    filters = pytest.importorskip("pyins.filters", reason=absent)
    inertial_sensor, measurements, strapdown, pd = (
        pytest.importorskip(name, reason=absent)
        for name in ("pyins.inertial_sensor", "pyins.measurements", "pyins.strapdown", "pandas")
    )

    assert log.velocity_ned is not None
    assert log.position_llh is not None

    imu = pd.DataFrame(
        np.hstack([log.gyro, log.accel]),
        index=log.time,
        columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"],
    )
    increments = strapdown.compute_increments_from_imu(imu.loc[START:], "rate")
    velocity = pd.DataFrame(log.velocity_ned, index=log.gnss_time, columns=["VN", "VE", "VD"]).loc[START + 0.05 :]
    speed = np.hypot(velocity["VN"], velocity["VE"])
    course = pd.DataFrame({"course": np.arctan2(velocity["VE"], velocity["VN"]), "sigma": 0.03 / speed})
    first = int(np.searchsorted(log.time, START))
    initial = pd.Series(
        [
            *np.degrees(log.position_llh[0, :2]),
            log.position_llh[0, 2],
            *ours.velocity_ned[first],
            *np.degrees([ours.roll[first], ours.pitch[first], ours.heading[first]]),
        ],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        name=float(log.time[first]),
    )
    white = 1.0 / math.sqrt(2.0)  # a one-sided density d is d^2 / 2 per second
    return filters.run_feedback_filter(
        initial,
        1.0,
        0.03,
        math.degrees(NOISE.initial_accel_bias_std / GRAVITY),
        1.0,
        increments,
        inertial_sensor.EstimationModel(NOISE.initial_gyro_bias_std, NOISE.gyro_noise * white, NOISE.gyro_bias_walk),
        inertial_sensor.EstimationModel(NOISE.initial_accel_bias_std, NOISE.accel_noise * white, NOISE.accel_bias_walk),
        measurements=[measurements.NedVelocity(velocity, 0.03), Course(course)],
        time_step=0.1,
    )


def rms(values: FloatArray) -> float:
    """Root mean square over time and axes."""
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("scenario", ["field", "windrower"])
def test_as_accurate_as_pyins(scenario: str) -> None:
    log, truth = lh.simulate(scenario, seed=1, duration=300.0, earth_rotation=True, origin_llh=ORIGIN)
    ours = lh.estimate(log, "ekf", params=NOISE)
    theirs = pyins_result(log, ours)
    at = np.asarray(theirs.gyro.index)
    rows = np.searchsorted(log.time, at[at >= COMPARED_FROM] - 1e-6)
    late = at >= COMPARED_FROM
    attitude = np.radians(theirs.trajectory.loc[at[late], ["roll", "pitch"]].to_numpy())
    errors = {
        "tilt": (
            np.column_stack([ours.roll - truth.roll, ours.pitch - truth.pitch])[rows],
            attitude - np.column_stack([truth.roll, truth.pitch])[rows],
        ),
        "gyro": ((ours.gyro_bias - truth.gyro_bias)[rows], theirs.gyro.to_numpy()[late] - truth.gyro_bias[rows]),
        "accel": ((ours.accel_bias - truth.accel_bias)[rows], theirs.accel.to_numpy()[late] - truth.accel_bias[rows]),
    }
    for name, (our_error, their_error) in errors.items():
        # Two right implementations of one filter differ by their order of integration only; a tenth is allowed.
        assert rms(our_error) <= 1.1 * rms(their_error), name
        # And they agree with each other far better than with the truth.
        assert rms(our_error - their_error) <= 0.2 * rms(their_error), name
