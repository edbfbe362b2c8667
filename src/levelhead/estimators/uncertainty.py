"""How sure the papers' fixed-gain estimators can be: their errors' covariance over the intervals that the log had.

The kernel carries the covariance from epoch to epoch with the estimators' own gains (`covariance.hpp`). Here its level
frame becomes body axes and IMU samples, and what the noise model does not know of is added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.estimators.params import NoiseParams

EPOCH_COLUMNS: Final = (
    *("time", "length", "turn", "learn", "level", "aligned", "heading_known", "steered", "speed", "velocity_std"),
    *("amiss_n", "amiss_e", "amiss_d", "down_x", "down_y", "down_z"),
)
"""What the kernel records of a closed interval: the row of `put_epoch` in the binding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Epochs:
    """The closed GNSS intervals of a run, each as long as the log had it; hardly anything depends on the constants.

    Attributes
    ----------
    rows : ndarray, shape (m, 16)
        Columns as in `EPOCH_COLUMNS`: end (s), length (s), turn (rad), share that the level biases learn, flags (loop
        closed, aligned, heading known, heading steered), speed and its sigma (m/s), GNSS less platform
        acceleration (NED, m/s^2), down in body axes.
    """

    rows: FloatArray

    def __getitem__(self, name: str) -> FloatArray:
        """Return one column (m,) by name."""
        return self.rows[:, EPOCH_COLUMNS.index(name)]

    @property
    def down(self) -> FloatArray:
        """Down in body axes (m, 3), from the mean attitude of each interval."""
        return self.rows[:, 13:16]

    @property
    def mean_down(self) -> FloatArray:
        """Down in body axes (3,) on average over the drive: how the IMU is mounted."""
        taught = self["level"] > 0.0
        mean: FloatArray = self.down[taught].mean(axis=0) if taught.any() else np.array([0.0, 0.0, 1.0])
        return mean / max(float(np.linalg.norm(mean)), 1e-3)

    @property
    def level_axes(self) -> FloatArray:
        """The horizontal axes (2, 3) ahead and to the right, in body axes as the IMU is mounted."""
        mounted = self.mean_down
        # Ahead is where x points, as for the heading; an IMU with x upright has none, and any axis will do.
        ahead = np.eye(3)[0 if abs(mounted[0]) < 0.9 else 1]
        ahead = ahead - mounted * (mounted @ ahead)
        ahead = ahead / np.linalg.norm(ahead)
        return np.stack([ahead, np.cross(mounted, ahead)])

    @property
    def vertical_accel_bias(self) -> float:
        """The accelerometer bias along down, m/s^2, which these estimators do not estimate; NaN where never seen."""
        taught = self["level"] > 0.0
        if not taught.any():
            return float("nan")
        length = self["length"][taught]
        return float(-(self["amiss_d"][taught] @ length) / length.sum())


@dataclass(kw_only=True)
class EpochRecorder:
    """Runs a compiled stream in the place of its `run` and keeps the intervals that it closes."""

    run_recorded: Callable[..., int]
    parts: list[FloatArray] = field(default_factory=list)

    def __call__(self, *arrays: Any) -> int:
        """Feed one chunk; the arguments are those of the stream's `run`."""
        buffer = np.empty((arrays[1][0].size + 1, len(EPOCH_COLUMNS)))
        count = self.run_recorded(*arrays, buffer)
        self.parts.append(buffer[:count])
        return count

    @property
    def epochs(self) -> Epochs:
        """All intervals so far."""
        return Epochs(rows=np.concatenate(self.parts) if self.parts else np.empty((0, len(EPOCH_COLUMNS))))


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelSigma:
    """One sigma after each epoch (m,), in the level frame; the order is that of the kernel.

    Attributes
    ----------
    tilt, gyro, accel : ndarray
        Per horizontal axis: roll and pitch (rad, NaN before start-up), biases (rad/s, m/s^2).
    heading, vertical_gyro : ndarray
        Heading (rad, NaN before the first course) and the gyro bias about the vertical (rad/s).
    tilt_growth, tilt_rate, heading_growth, heading_rate : ndarray
        How the angles drift when no GNSS corrects them: covariance with the rate left in them, sigma of that rate.
    tilt_control, control, heading_control, steer : ndarray
        How the control rate that follows the epoch moves them: covariance with it, its sigma.
    tilt_ahead, tilt_right, gyro_ahead, gyro_right, accel_ahead, accel_right : ndarray
        The part of tilt and bias errors that the vertical accelerometer bias makes (`leak`), which the sigmas hold as a
        mean of both axes.
    """

    tilt: FloatArray
    gyro: FloatArray
    accel: FloatArray
    heading: FloatArray
    vertical_gyro: FloatArray
    tilt_growth: FloatArray
    tilt_rate: FloatArray
    heading_growth: FloatArray
    heading_rate: FloatArray
    tilt_control: FloatArray
    control: FloatArray
    heading_control: FloatArray
    steer: FloatArray
    tilt_ahead: FloatArray
    tilt_right: FloatArray
    gyro_ahead: FloatArray
    gyro_right: FloatArray
    accel_ahead: FloatArray
    accel_right: FloatArray


def leak(epochs: Epochs) -> FloatArray:
    """Return the horizontal acceleration error (m, 2) that the vertical accelerometer bias makes on tilted ground.

    Nothing estimates that bias, but its size shows in the vertical velocity increments, and its direction in the
    attitude. Only the departure from the mean tilt counts: what is constant in the body is learnt with the rest.
    """
    mounted, down = epochs.mean_down, epochs.down
    bias = np.nan_to_num(epochs.vertical_accel_bias)
    across = mounted - down * (down @ mounted)[:, None]
    pairs: FloatArray = bias * across @ epochs.level_axes.T
    return pairs * (epochs["level"] > 0.0)[:, None]


def level_sigma(
    recursion: Callable[..., None], constants: dict[str, float | bool], epochs: Epochs, noise: NoiseParams
) -> LevelSigma:
    """Run a compiled recursion over recorded epochs."""
    out = np.empty((epochs.rows.shape[0], len(fields(LevelSigma))))
    recursion(
        epochs.rows, leak(epochs), out, **constants, **{f.name: getattr(noise, f.name) for f in fields(NoiseParams)}
    )
    return LevelSigma(**{f.name: out[:, i] for i, f in enumerate(fields(LevelSigma))})


@dataclass(frozen=True, kw_only=True, eq=False)
class Sigma:
    """One sigma at each IMU sample (n, 3): biases in body axes, attitude as roll, pitch, heading; and its source."""

    level: LevelSigma
    noise: NoiseParams
    gyro_bias: FloatArray
    accel_bias: FloatArray
    attitude: FloatArray


def at_samples(level: LevelSigma, epochs: Epochs, noise: NoiseParams, time: FloatArray, pitch: FloatArray) -> Sigma:
    """Return what the recursion says after each epoch at the IMU samples that follow it, in body axes."""
    after = np.searchsorted(epochs["time"], time, side="right")
    gyro, accel = _biases_in_body(level, epochs, noise)
    return Sigma(
        level=level,
        noise=noise,
        gyro_bias=gyro[after],
        accel_bias=accel[after],
        attitude=_attitude(level, epochs, noise, time, pitch, after),
    )


def _biases_in_body(level: LevelSigma, epochs: Epochs, noise: NoiseParams) -> tuple[FloatArray, FloatArray]:
    """Return gyro and accelerometer sigma in body axes before the first epoch and after each (m + 1, 3)."""
    # The body's axes share in the vertical as the IMU is mounted; the ground's tilt averages out while one learns.
    vertical, axes = epochs.mean_down**2, epochs.level_axes
    unlearnt = epochs.vertical_accel_bias
    unlearnt = unlearnt if np.isfinite(unlearnt) else noise.initial_accel_bias_std

    def body(sigma: FloatArray, upright: FloatArray, ahead: FloatArray, right: FloatArray, prior: float) -> FloatArray:
        # What the leak makes has a direction: it takes the place of its mean over both axes.
        own = np.outer(ahead, axes[0]) + np.outer(right, axes[1])
        directed = own**2 - 0.5 * np.outer((own**2).sum(axis=1), 1.0 - vertical)
        variance = np.outer(sigma**2, 1.0 - vertical) + np.outer(upright**2, vertical) + directed
        return np.concatenate([np.full((1, 3), prior), np.sqrt(np.maximum(variance, 0.0))])

    gyro = body(level.gyro, level.vertical_gyro, level.gyro_ahead, level.gyro_right, noise.initial_gyro_bias_std)
    constant = np.full(level.accel.size, unlearnt)
    accel = body(level.accel, constant, level.accel_ahead, level.accel_right, noise.initial_accel_bias_std)
    return gyro, accel


def _attitude(
    level: LevelSigma, epochs: Epochs, noise: NoiseParams, time: FloatArray, pitch: FloatArray, after: NDArray[np.intp]
) -> FloatArray:
    """Return one sigma of roll, pitch and heading (n, 3), rad.

    Between two epochs the control rate turns the platform from the noise of one GNSS velocity to that of the next, so
    that the angles are surer halfway. Once it has run out (an outage) they drift with the gyro bias that is left and
    the gyro noise.
    """

    def held(values: FloatArray, before: float) -> FloatArray:
        return np.concatenate([[before], values])[after]

    since = np.maximum(time - held(epochs["time"], np.inf), 0.0)
    acting = np.minimum(since, held(epochs["length"], 0.0))
    coasting = since - acting

    def moved(variance: FloatArray, time: FloatArray, rate: FloatArray, covariance: FloatArray) -> FloatArray:
        moved: FloatArray = variance + time * (2.0 * held(covariance, 0.0) + time * held(rate**2, 0.0))
        return moved

    def angle(
        sigma: FloatArray, control: FloatArray, with_control: FloatArray, rate: FloatArray, with_rate: FloatArray
    ) -> FloatArray:
        steered = np.maximum(moved(held(sigma**2, np.nan), acting, control, -with_control), 0.0)
        if not coasting.any():
            return steered
        drift = 0.5 * noise.gyro_noise**2 * coasting
        return np.maximum(moved(steered, coasting, rate, with_rate), steered) + drift

    tilt = angle(level.tilt, level.control, level.tilt_control, level.tilt_rate, level.tilt_growth)
    heading = angle(level.heading, level.steer, level.heading_control, level.heading_rate, level.heading_growth)
    # What the leak makes has a direction here as well.
    lean = held(0.5 * (level.tilt_ahead**2 - level.tilt_right**2), 0.0)
    roll, across = np.maximum(tilt + lean, 0.0), np.maximum(tilt - lean, 0.0)
    # A tilt about the horizontal axis ahead turns roll by 1 / cos(pitch), and heading by tan(pitch).
    secant2 = 1.0 / np.maximum(np.cos(pitch) ** 2, 1e-4)
    sigma: FloatArray = np.sqrt(np.column_stack([roll * secant2, across, heading + roll * (secant2 - 1.0)]))
    return sigma
