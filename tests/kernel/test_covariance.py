"""The covariance recursion against a twin: real vectors in NED, every interval integrated in small steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from levelhead import ObserverParams, TwoStageParams
from levelhead.conventions import GRAVITY, FloatArray
from levelhead.estimators.observer import predict_observer
from levelhead.estimators.params import NoiseParams
from levelhead.estimators.two_stage import predict_two_stage
from levelhead.estimators.uncertainty import EPOCH_COLUMNS, Epochs, leak

NOISE = NoiseParams(gyro_noise=2e-3, accel_noise=0.05, gyro_bias_walk=1e-4, accel_bias_walk=3e-3, velocity_std=0.05)
STEPS = 400


def drive(seed: int, count: int = 300) -> Epochs:
    """Make up epochs: turns right and left, gaps without a closed loop, standstill, a level IMU on wavy ground."""
    rng = np.random.default_rng(seed)
    length = rng.uniform(0.1, 0.4, count)
    rows = np.zeros((count, len(EPOCH_COLUMNS)))
    column = dict(zip(EPOCH_COLUMNS, rows.T, strict=True))
    column["time"][:] = np.cumsum(length)
    column["length"][:] = length
    rate = np.repeat(rng.uniform(-0.6, 0.6, count // 20), 20)
    rate[rng.uniform(size=count) < 0.3] *= 0.05
    column["turn"][:] = rate * length
    column["aligned"][5:] = 1.0
    column["heading_known"][5:] = 1.0
    lost = rng.uniform(size=count) < 0.05
    column["level"][6:] = np.where(lost, 0.0, 1.0)[6:]
    column["learn"][:] = column["level"] * rng.choice([1.0, 1.0, 0.5], count)
    column["steered"][:] = column["level"] * (rng.uniform(size=count) < 0.8)
    column["speed"][:] = 3.0
    column["velocity_std"][:] = rng.choice([0.03, 0.1, np.nan], count)
    column["amiss_d"][:] = -0.2
    tilt = 0.1 * np.column_stack([np.sin(np.arange(count) / 9.0), np.cos(np.arange(count) / 7.0)])
    column["down_x"][:], column["down_y"][:] = tilt.T
    column["down_z"][:] = np.sqrt(1.0 - (tilt**2).sum(axis=1))
    return Epochs(rows=rows)


def turned(angle: float) -> FloatArray:
    """Return the rotation of a horizontal vector by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


ACROSS = turned(np.pi / 2.0)  # "times i"


@dataclass(kw_only=True)
class Twin:
    """Tilt, both biases, control rate, GNSS noise, and for the black box both estimates' errors: 2-vectors."""

    p: FloatArray
    mean: FloatArray

    @classmethod
    def start(cls) -> Twin:
        twin = cls(p=np.zeros((14, 14)), mean=np.zeros(14))
        for first, sigma in ((2, NOISE.initial_gyro_bias_std), (4, NOISE.initial_accel_bias_std)):
            for a in (first, first + 8):
                for b in (first, first + 8):
                    twin.p[a : a + 2, b : b + 2] = np.eye(2) * sigma**2
        return twin

    def move(self, f: FloatArray, noise: FloatArray, drive: FloatArray) -> None:
        self.p = f @ self.p @ f.T + noise
        self.mean = f @ self.mean + drive

    def sigma(self, first: int) -> float:
        square = np.diag(self.p)[first : first + 2] + self.mean[first : first + 2] ** 2
        return float(np.sqrt(square.mean()))


THETA, GYRO, ACCEL, CONTROL, GNSS, GYRO_LEFT, ACCEL_LEFT = (slice(i, i + 2) for i in range(0, 14, 2))


def twin_sigma(epochs: Epochs, params: ObserverParams | TwoStageParams) -> FloatArray:
    """Return tilt, gyro, accel sigma after each epoch (m, 3)."""
    box = isinstance(params, TwoStageParams) and not params.feedback
    twin, leaks, heading, hold, was_aligned = Twin.start(), leak(epochs), 0.0, 0.0, False
    out = np.full((epochs.rows.shape[0], 3), np.nan)
    previous = epochs["time"][0]
    for j, row in enumerate(epochs.rows):
        e = dict(zip(EPOCH_COLUMNS, row, strict=True))
        length, level, aligned = e["length"], e["level"] > 0.0, e["aligned"] > 0.0
        sigma2 = np.nan_to_num(e["velocity_std"], nan=NOISE.velocity_std) ** 2
        walk = np.zeros((14, 14))
        for first, intensity in ((2, NOISE.gyro_bias_walk), (4, NOISE.accel_bias_walk)):
            for a in (first, first + 8):
                for b in (first, first + 8):
                    walk[a : a + 2, b : b + 2] = np.eye(2) * intensity**2 * (e["time"] - previous)
        twin.move(np.eye(14), walk, np.zeros(14))
        previous = e["time"]

        # Columns: how tilt at the end, its mean, and the mean bias force follow from what was there at the beginning.
        end, mean, force = np.zeros((2, 14)), np.zeros((2, 14)), np.zeros((2, 14))
        end[:, THETA] = np.eye(2)
        for i in range(STEPS):
            dt = length / STEPS
            body = turned(heading + e["turn"] * (i + 0.5) / STEPS)
            held = float(np.clip((hold - i * dt) / dt, 0.0, 1.0))
            before = end.copy()
            end[:, GYRO] += body * dt
            end[:, CONTROL] -= np.eye(2) * held * dt
            mean += 0.5 * (before + end) / STEPS
            # A control that ends within a step leaves its triangle behind.
            mean[:, CONTROL] -= np.eye(2) * 0.5 * dt * held * (1.0 - held) / STEPS
            force[:, ACCEL] += body / STEPS
        heading += e["turn"]
        now = turned(heading)

        # Sources: gyro sum, gyro mean, accelerometer mean, new GNSS noise, and that of the beginning for the levelling.
        gyro, accel = 0.5 * NOISE.gyro_noise**2, 0.5 * NOISE.accel_noise**2
        source = np.zeros((10, 10))
        source[0:4, 0:4] = np.kron(gyro * length * np.array([[1.0, 0.5], [0.5, 1.0 / 3.0]]), np.eye(2))
        source[4:6, 4:6] = np.eye(2) * accel / length
        source[6:8, 6:8] = source[8:10, 8:10] = np.eye(2) * sigma2
        f, g, drive = np.eye(14), np.zeros((14, 10)), np.zeros(14)
        leaked = now @ leaks[j]
        if aligned and not was_aligned:
            # g x tilt + bias force = velocity noise; then the gyro turns on from the mean to the end.
            f[THETA] = ACROSS @ force / GRAVITY + end - mean
            f[THETA, THETA] = 0.0
            f[THETA, CONTROL] = 0.0
            g[THETA, 0:2], g[THETA, 2:4] = np.eye(2), -np.eye(2)
            g[THETA, 4:6] = ACROSS / GRAVITY
            g[THETA, 6:8], g[THETA, 8:10] = -ACROSS / (GRAVITY * length), ACROSS / (GRAVITY * length)
            drive[THETA] = ACROSS @ leaked / GRAVITY
        elif aligned:
            f[THETA] = end
            g[THETA, 0:2] = np.eye(2)
        f[CONTROL], f[GNSS] = 0.0, 0.0
        g[GNSS, 6:8] = np.eye(2)
        if aligned and was_aligned and level:
            k = min(1.0 / params.tau, 1.0 / length) / GRAVITY
            f[CONTROL] = k * ACROSS @ (-GRAVITY * ACROSS @ mean - force)
            f[CONTROL, GNSS] = -k / length * ACROSS
            g[CONTROL, 2:4] = k * GRAVITY * np.eye(2)
            g[CONTROL, 4:6], g[CONTROL, 6:8] = -k * ACROSS, k / length * ACROSS
            drive[CONTROL] = -k * ACROSS @ leaked
        if aligned:
            twin.move(f, g @ source @ g.T, drive)
        if aligned and was_aligned and level:
            # The body sees the control rate from the mean of its attitudes at both ends.
            view = 0.5 * (turned(heading) + turned(heading - e["turn"])).T
            twin.move(learning(params, e, view, box), np.zeros((14, 14)), np.zeros(14))
        hold, was_aligned = length, aligned
        out[j] = twin.sigma(0) if aligned else np.nan, twin.sigma(10 if box else 2), twin.sigma(12 if box else 4)
    return out


def learning(params: ObserverParams | TwoStageParams, e: dict[str, float], view: FloatArray, box: bool) -> FloatArray:
    """Return the map of the errors that the bias updates of one interval make."""
    step, length = np.eye(14), e["length"]
    rate = e["turn"] / length
    if isinstance(params, ObserverParams):
        time = length * e["learn"]
        step[GYRO, CONTROL] = -view * time / params.tau_gyro
        step[ACCEL, CONTROL] = -view * GRAVITY * rate * time / params.omega_accel
        return step
    if abs(rate) < params.straight_rate:
        a = e["learn"] * length / params.tau_gyro_lowpass
        if box:  # b_hat += a (u - b_hat), with b_hat = b - left
            step[GYRO_LEFT, GYRO_LEFT] = np.eye(2) * (1.0 - a)
            step[GYRO_LEFT, GYRO] = np.eye(2) * a
            step[GYRO_LEFT, CONTROL] = -a * view
        else:
            step[GYRO, CONTROL] = -a * view
    if abs(rate) > params.turn_rate:
        a = e["learn"] * length / params.tau_accel_lowpass
        form = GRAVITY * (np.eye(2) / rate + params.tau * ACROSS) @ view
        if box:  # the gyro bias taken off u is the estimate, b - left
            step[ACCEL_LEFT, ACCEL_LEFT] = np.eye(2) * (1.0 - a)
            step[ACCEL_LEFT, ACCEL] = np.eye(2) * a
            step[ACCEL_LEFT, CONTROL] = -a * form
            step[ACCEL_LEFT, GYRO] = a * GRAVITY / rate * np.eye(2)
            step[ACCEL_LEFT, GYRO_LEFT] = -a * GRAVITY / rate * np.eye(2)
        else:
            step[ACCEL, CONTROL] = -a * form
    return step


@pytest.mark.parametrize(
    "params",
    [
        ObserverParams(tau=2.0, tau_gyro=10.0, omega_accel=0.3),
        TwoStageParams(tau=2.0, tau_gyro_lowpass=10.0, tau_accel_lowpass=8.0),
        TwoStageParams(tau=2.0, tau_gyro_lowpass=10.0, tau_accel_lowpass=8.0, feedback=False),
    ],
    ids=["observer", "two-stage", "black-box"],
)
def test_the_recursion_is_that_of_the_twin(params: ObserverParams | TwoStageParams) -> None:
    epochs = drive(seed=4)
    if isinstance(params, ObserverParams):
        level = predict_observer(epochs, params, NOISE)
    else:
        level = predict_two_stage(epochs, params, NOISE)
    got = np.column_stack([level.tilt, level.gyro, level.accel])
    wanted = twin_sigma(epochs, params)
    # The twin's small steps are wrong by (turn / steps)^2 / 24 = 2e-8 at most, and where the control ends within a step
    # by less than 1 / steps^2 = 6e-6 of its share.
    np.testing.assert_allclose(got, wanted, rtol=1e-5)
    assert level.accel[-1] < 0.9 * NOISE.initial_accel_bias_std


def heading_sigma(epochs: Epochs, params: ObserverParams) -> FloatArray:
    """Return heading and vertical gyro sigma after each epoch (m, 2): heading error, gyro bias, control rate."""
    p = np.diag([0.0, NOISE.initial_gyro_bias_std**2, 0.0])
    out, hold, known, previous = [], 0.0, False, epochs["time"][0]
    for row in epochs.rows:
        e = dict(zip(EPOCH_COLUMNS, row, strict=True))
        t, elapsed = e["length"], e["time"] - previous
        course2 = (np.nan_to_num(e["velocity_std"], nan=NOISE.velocity_std) / e["speed"]) ** 2
        p[1, 1] += NOISE.gyro_bias_walk**2 * elapsed
        previous = e["time"]
        if e["heading_known"] > 0.0 and not known:
            p[0], p[:, 0], p[2], p[:, 2] = 0.0, 0.0, 0.0, 0.0
            p[0, 0] = course2
        else:
            f = np.array([[1.0, elapsed, -min(hold, elapsed)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
            p = f @ p @ f.T + np.diag([0.5 * NOISE.gyro_noise**2 * elapsed, 0.0, 0.0])
            gain = e["steered"] * min(1.0 / params.tau_heading, 1.0 / t)
            learn = e["steered"] * t / params.tau_gyro
            f = np.array([[1.0, 0.0, 0.0], [-learn * gain, 1.0, 0.0], [gain, 0.0, 0.0]])
            n = np.array([0.0, learn * gain, -gain])
            p = f @ p @ f.T + course2 * np.outer(n, n)
        hold, known = t, e["heading_known"] > 0.0
        out.append([np.sqrt(p[0, 0]) if known else np.nan, np.sqrt(p[1, 1])])
    return np.array(out)


def test_the_heading_s_recursion_is_that_of_its_twin() -> None:
    epochs, params = drive(seed=5), ObserverParams(tau_gyro=20.0, tau_heading=3.0)
    level = predict_observer(epochs, params, NOISE)
    # Rounding over 300 epochs.
    np.testing.assert_allclose(
        np.column_stack([level.heading, level.vertical_gyro]), heading_sigma(epochs, params), rtol=1e-9
    )
