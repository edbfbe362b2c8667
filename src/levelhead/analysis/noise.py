"""The sensors' noise as it shows in the readings: fourth differences of short means, which motion hardly reaches."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError

BLOCKS: Final = (0.02, 0.05, 0.1)
"""Sensor noise is measured on means over these times, s. White noise has one density in all of them; a car's springs
add to the longest, an engine to the shortest, so the least is nearest. Shorter ones meet the sensor's own filter."""
WINDOW: Final = 300
"""Blocks over which one value of the noise is taken; the median over the drive counts."""
FOURTH: Final = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
"""Fourth difference: leaves 1 % of a motion of 0.5 Hz between means over 0.1 s, and 70 times the variance of noise."""


def density(time: FloatArray, readings: FloatArray) -> float:
    """Return the one-sided noise density of a sensor, its vibration included.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Stamps, s.
    readings : ndarray, shape (n, 3)
        Its readings; the quietest axis counts, since motion can only add, and the median over the drive.

    Raises
    ------
    LogError
        When the log is too short.
    """
    return min(float(_densities(time, readings, block).min()) for block in BLOCKS)


def densities(time: FloatArray, readings: FloatArray) -> FloatArray:
    """Return the noise density of every axis, shape (3,); otherwise as `density`."""
    found: FloatArray = np.min([_densities(time, readings, block) for block in BLOCKS], axis=0)
    return found


def _densities(time: FloatArray, readings: FloatArray, block: float) -> FloatArray:
    """Return the one-sided noise density of every axis in means over a block (s)."""
    interval = float(np.median(np.diff(time)))
    samples = max(1, round(block / interval))
    blocks = time.size // samples
    whole = readings[: blocks * samples].reshape(blocks, samples, -1)
    finite = np.isfinite(whole).all(axis=(1, 2))
    # A block that spans a gap in time is no mean over it.
    stamps = time[: blocks * samples].reshape(blocks, samples)
    steady = finite & (np.abs(np.ptp(stamps, axis=1) - (samples - 1) * interval) < 0.5 * interval)
    means = np.where(steady[:, None], whole.mean(axis=1), np.nan)
    differences = sum(w * means[i : blocks - 4 + i] for i, w in enumerate(FOURTH))
    square = np.asarray(differences) ** 2 / float(FOURTH @ FOURTH)
    windows = [w[np.isfinite(w).all(axis=1)].mean(axis=0) for w in _windows(square)]
    if not windows:
        raise LogError("The log is too short to measure its noise: it needs half a minute of readings without a gap.")
    variance = np.median(windows, axis=0)
    # White noise of density d has the variance d^2 / (2 time) after averaging over a time.
    found: FloatArray = np.sqrt(2.0 * samples * interval * variance)
    return found


def _windows(rows: FloatArray) -> list[FloatArray]:
    """Cut rows into windows of `WINDOW`, and leave out those that are mostly absent."""
    cuts = [rows[i : i + WINDOW] for i in range(0, rows.shape[0] - WINDOW + 1, WINDOW)]
    return [w for w in cuts if np.isfinite(w).all(axis=1).mean() > 0.5]
