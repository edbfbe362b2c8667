"""Short stretches of a drive in which the gyros carry the attitude alone: what all findings about frames stand on.

Within a window the readings are turned by the integrated gyros into a frame F that stands still (it is the sensor's
own at the window's start). There the accelerometer feels ``f_F = C_FN (a_N - g_N)``, with one unknown rotation per
window; so GNSS accelerations and readings can be compared without knowing how the sensor is mounted, how the road
tilts or where North is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray

BoolArray = NDArray[np.bool_]

LENGTH_S: Final = 20.0
"""Long enough for a turn, short enough for a consumer gyro to hold the level, s."""
MIN_EPOCHS: Final = 8
GRID_S: Final = 0.04
"""Step of the attitude, s; increments of angle and velocity over it are integrals, so nothing faster is lost."""
MAX_GAP_S: Final = 0.25
"""IMU gap that a window may not hold, s."""
MAX_WINDOWS: Final = 160
"""Windows that are used at most, those with the most acceleration: the cost does not grow with the log."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """GNSS epochs with a velocity: time (m,), velocity (m, 3) and its sigma (m, 3), m/s, as the log declares them."""

    time: FloatArray
    velocity: FloatArray
    sigma: FloatArray

    @property
    def speed(self) -> FloatArray:
        """Speed over ground, m/s."""
        return np.hypot(self.velocity[:, 0], self.velocity[:, 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Increments:
    """Integrals of the readings from the first: angle and velocity (n, 3), sensor axes, raw units, at `time` (n,)."""

    time: FloatArray
    angle: FloatArray
    velocity: FloatArray

    @classmethod
    def of(cls, time: FloatArray, gyro: FloatArray, accel: FloatArray) -> Increments:
        """Integrate readings by trapezoids."""
        return cls(time=time, angle=cumulative(time, gyro), velocity=cumulative(time, accel))

    def at(self, when: FloatArray, *, angle: bool) -> FloatArray:
        """Return one of the integrals at any times inside the data, shape of `when` + (3,)."""
        values = self.angle if angle else self.velocity
        flat = when.ravel()
        return np.stack([np.interp(flat, self.time, values[:, i]) for i in range(3)], axis=-1).reshape(*when.shape, 3)


def cumulative(time: FloatArray, rates: FloatArray) -> FloatArray:
    """Integrate rates (n, 3) over time by trapezoids, 0 at the first stamp."""
    steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(time)[:, None]
    return np.concatenate((np.zeros((1, rates.shape[1])), np.cumsum(steps, axis=0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows:
    """Stretches of the drive.

    Attributes
    ----------
    start : ndarray, shape (w,)
        Their starts, s.
    offsets : ndarray, shape (k + 1,)
        The grid in each, from its start, s.
    epochs : ndarray of int, shape (w, e)
        Indices of their GNSS epochs, -1 where there is none.
    swing : ndarray, shape (w,)
        RMS of the horizontal velocity about a straight line in time, m/s: what tells heading and clocks. A tilt that
        is not quite right looks like a steady acceleration, so that does not count.
    """

    start: FloatArray
    offsets: FloatArray
    epochs: NDArray[np.intp]
    swing: FloatArray

    @property
    def present(self) -> BoolArray:
        """Which entries of `epochs` are epochs."""
        found: BoolArray = self.epochs >= 0
        return found


def choose_windows(imu_time: FloatArray, motion: Motion, *, margin: float) -> Windows:
    """Cut the drive into windows without gaps and keep those in which the velocity changes most.

    Parameters
    ----------
    imu_time : ndarray, shape (n,)
        Stamps of the IMU, s.
    motion : Motion
        The epochs.
    margin : float
        How far the clocks may be apart, s: so much IMU data must lie around each window's epochs.
    """
    interval = float(np.median(np.diff(motion.time))) if motion.time.size > 1 else LENGTH_S
    length = max(LENGTH_S, 1.5 * MIN_EPOCHS * interval)
    total = length + 2.0 * margin
    starts = np.arange(imu_time[0], imu_time[-1] - total, length)
    gaps = np.flatnonzero(np.diff(imu_time) > MAX_GAP_S)
    # A window is whole if every gap that begins before its end is over at its start.
    over = np.searchsorted(imu_time[gaps + 1], starts, side="right")
    whole = over == np.searchsorted(imu_time[gaps], starts + total)
    starts = starts[whole]
    first = np.searchsorted(motion.time, starts + margin)
    last = np.searchsorted(motion.time, starts + margin + length)
    enough = last - first >= MIN_EPOCHS
    starts, first, last = starts[enough], first[enough], last[enough]
    swing = np.array([_swing(motion, a, b) for a, b in zip(first, last, strict=True)])
    best = np.sort(np.argsort(-swing, kind="stable")[:MAX_WINDOWS])
    starts, first, last, swing = starts[best], first[best], last[best], swing[best]
    most = int((last - first).max(initial=0))
    index = first[:, None] + np.arange(most)
    epochs = np.where(index < last[:, None], index, -1)
    return Windows(start=starts, offsets=np.arange(0.0, total + GRID_S, GRID_S), epochs=epochs, swing=swing)


def _swing(motion: Motion, first: int, last: int) -> float:
    """Return the RMS of the horizontal velocity of some epochs about a straight line in time, m/s."""
    time = motion.time[first:last] - motion.time[first:last].mean()
    velocity = motion.velocity[first:last, :2] - motion.velocity[first:last, :2].mean(axis=0)
    slope = time @ velocity / max(float(time @ time), 1e-12)
    return float(np.sqrt(((velocity - time[:, None] * slope) ** 2).sum(axis=1).mean()))


def turned(
    windows: Windows, increments: Increments, *, scale: float, bias: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return attitude and integrated specific force in every window, in its own still frame F.

    Parameters
    ----------
    windows, increments
        The stretches, and the readings' integrals.
    scale : float
        What turns the gyros' unit into rad/s; negative where their sign is taken to be wrong.
    bias : ndarray, shape (3,)
        Of the gyros, in their own unit.

    Returns
    -------
    attitude : ndarray, shape (w, k + 1, 3, 3)
        Rotation from the sensor's axes to F at the grid.
    velocity : ndarray, shape (w, k + 1, 3)
        Integral of the specific force in F, accelerometer's unit times s.
    """
    grid = np.minimum(windows.start[:, None] + windows.offsets, increments.time[-1])
    angles = (np.diff(increments.at(grid, angle=True), axis=1) - bias * np.diff(grid)[..., None]) * scale
    pushes = np.diff(increments.at(grid, angle=False), axis=1)
    # In the axes at the step's start; half the turn has passed for the mean push.
    pushes = pushes + 0.5 * np.cross(angles, pushes)
    attitude = running_product(rotations(angles))
    attitude = np.concatenate((np.broadcast_to(np.eye(3), (*attitude.shape[:1], 1, 3, 3)), attitude), axis=1)
    steps = np.einsum("wkij,wkj->wki", attitude[:, :-1], pushes)
    velocity = np.concatenate((np.zeros((*steps.shape[:1], 1, 3)), np.cumsum(steps, axis=1)), axis=1)
    return attitude, velocity


def rotations(vectors: FloatArray) -> FloatArray:
    """Return the matrices of rotation vectors (..., 3), rad (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x = skew(vectors)
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    matrices: FloatArray = np.eye(3) + a * x + b * (x @ x)
    return matrices


def skew(vectors: FloatArray) -> FloatArray:
    """Return the matrices [v x] of vectors (..., 3)."""
    matrices = np.zeros((*vectors.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrices[..., i, j] = -vectors[..., k]
        matrices[..., j, i] = vectors[..., k]
    return matrices


def running_product(matrices: FloatArray) -> FloatArray:
    """Return the products of the first 1, 2, ... matrices along the second axis, by doubling."""
    product = matrices.copy()
    shift = 1
    while shift < product.shape[1]:
        product[:, shift:] = product[:, :-shift] @ product[:, shift:]
        shift *= 2
    return product


def on_grid(values: FloatArray, windows: Windows, when: FloatArray) -> FloatArray:
    """Interpolate values (w, k + 1, ...) on the grid linearly at times (w, e), s; NaN outside it and for NaN."""
    step = windows.offsets[1]
    place = (when - windows.start[:, None]) / step
    known = (place >= 0.0) & (place <= windows.offsets.size - 1)
    left = np.clip(np.where(known, place, 0.0).astype(np.intp), 0, windows.offsets.size - 2)
    part = np.where(known, place - left, np.nan)
    rows = np.arange(values.shape[0])[:, None]
    shape = (*part.shape, *([1] * (values.ndim - 2)))
    part = part.reshape(shape)
    mixed: FloatArray = values[rows, left] * (1.0 - part) + values[rows, left + 1] * part
    return mixed


def smoothly_on_grid(values: FloatArray, windows: Windows, when: FloatArray) -> FloatArray:
    """Interpolate values (w, k + 1, 3) on the grid by quadratic B-splines at times (w, e), s; NaN outside it.

    Linear interpolation averages noise between the nodes and not at them, so that a shift by half a step would look
    like a better fit; here the noise is nearly the same everywhere.
    """
    place = (when - windows.start[:, None]) / windows.offsets[1]
    known = (place >= 1.0) & (place <= windows.offsets.size - 2)
    node = np.clip(np.rint(np.where(known, place, 1.0)).astype(np.intp), 1, windows.offsets.size - 2)
    off = np.where(known, place - node, np.nan)[..., None]
    rows = np.arange(values.shape[0])[:, None]
    before, here, after = values[rows, node - 1], values[rows, node], values[rows, node + 1]
    mixed: FloatArray = 0.5 * (0.5 - off) ** 2 * before + (0.75 - off**2) * here + 0.5 * (0.5 + off) ** 2 * after
    return mixed


def epoch_times(windows: Windows, motion: Motion) -> FloatArray:
    """Return the stamps of the windows' epochs (w, e), NaN where there is none."""
    return np.where(windows.present, motion.time[np.maximum(windows.epochs, 0)], np.nan)
