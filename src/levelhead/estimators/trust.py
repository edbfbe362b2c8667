"""How far a run can be trusted: what was observable, how sure the estimates are, what still wandered all the same."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.conventions import AXES, FloatArray, StatusArray
from levelhead.estimators.base import Status
from levelhead.events import Event

Flags = tuple[bool, bool, bool]

WATCHED: Final = 120.0
"""The end of the run that is watched: three of the papers' slow time constants, s."""
GYRO_BAND: Final = float(np.radians(0.02))
"""An estimate that moves within plus and minus this counts as steady, rad/s."""
ACCEL_BAND: Final = 0.04
"""The same for the accelerometer, m/s^2."""
MODELLED_WANDER: Final = 3.0
"""The wander, in sigmas, up to which the noise model explains it. On simulated drives with exactly the modelled noise
it is 1.2 (accelerometer) and 2.1 (gyro) in the median, and within 3.2 in 99 of 100 windows."""
WANDER_PER_SIGMA: Final = 2.0
"""The wander of an error of one sigma: about the gyro's median."""
LOST_BANDS: Final = 2.0
"""One that moves by more than this many bands is not known, whatever the driving could have taught."""


def first_settled(time: FloatArray, status: StatusArray, flag: Status) -> float | None:
    """Return the time since the start at which a flag was set for good, or None."""
    set_ = (status & int(flag)) != 0
    if not set_[-1]:
        return None
    unset = np.flatnonzero(~set_)
    return float(time[unset[-1] + 1] - time[0]) if unset.size else 0.0


def observable(last: Status, vertical: int) -> tuple[Flags, Flags]:
    """Return which gyro and accelerometer axes the driving has taught; `vertical` is the axis nearest to it."""
    gyro, accel = Status.GYRO_SETTLED in last, Status.ACCEL_SETTLED in last
    course = Status.HEADING_SETTLED in last
    gyro_flags = [course if axis == vertical else gyro for axis in range(3)]
    accel_flags = [accel and axis != vertical for axis in range(3)]
    return (gyro_flags[0], gyro_flags[1], gyro_flags[2]), (accel_flags[0], accel_flags[1], accel_flags[2])


def wander(time: FloatArray, estimate: FloatArray) -> FloatArray:
    """Return half of the peak-to-peak change (3,) of an estimate (n, 3) over the watched end of the run."""
    end = estimate[np.searchsorted(time, time[-1] - WATCHED) :]
    half: FloatArray = 0.5 * (end.max(axis=0) - end.min(axis=0))
    return half


def _sliding(extreme: np.ufunc, values: FloatArray, window: int) -> FloatArray:
    """Return the extreme of every `window` rows in a row, from those of 1, 2, 4... rows."""
    count, width, out = values.shape[0] - window + 1, 1, values
    while 2 * width <= window:
        out = extreme(out[:-width], out[width:])
        width *= 2
    both: FloatArray = extreme(out[:count], out[window - width : window - width + count])
    return both


def widened(time: FloatArray, estimate: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the sigmas (n, 3), not smaller than the estimates' own later movements allow.

    The covariance knows white noise and random walks. What else a drive may hold (a slipping vehicle, a receiver that
    smooths, biases that follow the temperature) it cannot foresee, but it shows: an estimate that is right within sigma
    now cannot move by many sigmas in the two minutes that follow. What goes beyond `MODELLED_WANDER` is added in
    squares: a modelled error is left alone, nothing jumps where the rule begins to act, and where the model explains
    next to nothing sigma is half of the wander, which is what such a wander is a sign of. The look is ahead and not
    back: the way to convergence, all of it within the sigma of its beginning, must not count against its end. The last
    two minutes share one window.
    """
    seconds = np.searchsorted(time, np.arange(time[0], time[-1], 1.0))
    coarse = estimate[seconds]
    window = min(int(WATCHED), coarse.shape[0])
    half = 0.5 * (_sliding(np.maximum, coarse, window) - _sliding(np.minimum, coarse, window))
    row = np.minimum((time - time[0]).astype(np.int64), half.shape[0] - 1)
    out = np.empty_like(sigma)
    for axis in range(sigma.shape[1]):
        beyond = half[row, axis] ** 2 - (MODELLED_WANDER * sigma[:, axis]) ** 2
        out[:, axis] = np.sqrt(sigma[:, axis] ** 2 + np.fmax(beyond, 0.0) / WANDER_PER_SIGMA**2)
    return out


def certain(known: Flags, learnt: FloatArray, sigma: FloatArray, band: float, prior: float) -> Flags:
    """Return the known axes without those that are too uncertain at the end.

    Parameters
    ----------
    known : (3,)
        The axes that the driving could have taught.
    learnt : ndarray, shape (3,)
        Sigma of what the loop has learnt for each axis: within a band, and half of what it was before the drive.
    sigma : ndarray, shape (3,)
        Sigma of each axis with all that it shares in, as a tilted IMU does in the vertical, which may not be known:
        within `LOST_BANDS`, as for `steady`.
    band, prior : float
        Limit, and sigma before the drive.
    """
    limit = min(band, 0.5 * prior)
    x, y, z = (
        bool(k and own < limit and total < LOST_BANDS * band)
        for k, own, total in zip(known, learnt, sigma, strict=True)
    )
    return x, y, z


def steady(known: Flags, moved: FloatArray, band: float) -> Flags:
    """Return the known axes without those that moved by more than `LOST_BANDS` bands."""
    x, y, z = (bool(k and m <= LOST_BANDS * band) for k, m in zip(known, moved, strict=True))
    return x, y, z


def wander_event(gyro: FloatArray, accel: FloatArray, known_gyro: Flags, known_accel: Flags) -> tuple[Event, ...]:
    """Return a warning where estimates that should be known still moved by more than a band."""
    moving = []
    for name, moved, known, band, scale, unit in (
        ("gyro", gyro, known_gyro, GYRO_BAND, np.degrees(1.0), "deg/s"),
        ("accel", accel, known_accel, ACCEL_BAND, 1.0, "m/s^2"),
    ):
        for i, axis in enumerate(AXES):
            if known[i] and moved[i] > band:
                moving.append(f"{name} {axis} by +-{moved[i] * scale:.2g} {unit}")
    if not moving:
        return ()
    return (Event(code="W_UNSTEADY", count=len(moving), detail=f"{', '.join(moving)}."),)


def mostly_backwards(status: StatusArray) -> tuple[Event, ...]:
    """Return a warning where the vehicle seems to have driven backwards for most of the time.

    Nobody does: the first course was taken in reverse, or the IMU faces backwards. Either way the accelerations were
    compared the wrong way round, and nothing that was learnt can be trusted.
    """
    heading_known = (status & int(Status.INITIALIZING | Status.ALIGNING)) == 0
    reverse = (status & int(Status.REVERSE)) != 0
    if int(reverse.sum()) <= 0.5 * max(1, int(heading_known.sum())):
        return ()
    return (Event(code="W_MOSTLY_REVERSE", count=1),)
