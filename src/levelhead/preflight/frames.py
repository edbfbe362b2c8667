"""Signs and frames: which reading of the data fits Newton's law best, by windows that know no mounting and no slope.

Whatever the axes of an IMU are called, its readings are a rotation away from forward, right, down, unless they are
mirrored or a sign is wrong. With the rotation free in every window (Wahba's problem), what is left to find is one of
a few combinations: the sign of the specific force, the sign of the gyros, and the frame of the GNSS velocity.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.logs.ecef import ned_from_ecef
from levelhead.preflight.windows import Increments, Motion, Windows, epoch_times, on_grid, turned

VELOCITY_FRAMES: Final[dict[str, FloatArray]] = {
    "NED": np.eye(3),
    "ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NEU": np.diag([1.0, 1.0, -1.0]),
}
"""Frames that velocities come in, and what turns them into NED."""

ECEF: Final = "ECEF"
"""A frame that turns with the place, so that positions are needed to leave it."""

PLAIN_LAG_S: Final = 1.0
"""Accelerations are taken over about this time, s."""
DECIDED: Final = 20.0
"""Log-likelihood by which one reading of the data must lead all others: e^20 to 1 if the errors were as modelled;
they are not, and that is why it is not 5."""
DOUBTFUL: Final = 8.0
"""Log-likelihood by which other axes of the gyros than the accelerometers' may lead and still be chance."""
WINDOW_WORTH: Final = 8.0
"""Log-likelihood that one window may add at most: no single stretch of the drive decides alone."""
PLAINER: Final = 2.0
"""By how much odder a reading that fits as well must be to be left out (see `Hypothesis.oddity`)."""
STEP_WORTH: Final = 9.0
"""Squared misfit, in sigmas, that one step between positions may count at most."""
INDEPENDENT_S: Final = 2.0
"""Residuals further apart than this are taken as independent, s: tilt and vibration hang together for about so long."""


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """One reading of the data: signs of specific force and gyros, and the frame of the velocity."""

    force_sign: int
    rate_sign: int
    velocity_frame: str

    @property
    def oddity(self) -> float:
        """How much would have to be wrong in the log, so that of two readings that fit alike the plainer one counts.

        Mirrored axes are common (two columns swapped), so are velocities in ENU; a sign of the force that is turned
        round and velocities in NEU are rarer, gyros that turn the wrong way alone are hardly ever seen.
        """
        signs = {(1, 1): 0.0, (-1, -1): 1.0, (-1, 1): 1.5, (1, -1): 3.0}[self.force_sign, self.rate_sign]
        return signs + {"NED": 0.0, "ENU": 1.0, "NEU": 1.5}[self.velocity_frame]


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """The reading that fits best.

    Attributes
    ----------
    hypothesis : Hypothesis
    margin : float
        Log-likelihood by which it leads the best of those that say something else; `DECIDED` is enough.
    alternatives : tuple of Hypothesis
        Others that the data cannot tell from it and that are not much odder: not decided if there is one.
    dcm_f_to_ned : ndarray, shape (w, 3, 3)
        The rotation of each window's frame F to NED.
    windows : int
        How many windows spoke for it.
    force, change : ndarray, shape (w, e, 3)
        Specific force in F and change of the velocity in NED, m/s^2, as they were compared.
    gyro_axes : ndarray, shape (3, 3)
        Signed axes in which the gyros fit the accelerometers best; the unit matrix where they share theirs.
    gyro_margin : float
        Log-likelihood by which those lead, 0 for the unit matrix.
    """

    hypothesis: Hypothesis
    margin: float
    alternatives: tuple[Hypothesis, ...]
    dcm_f_to_ned: FloatArray
    windows: int
    force: FloatArray
    change: FloatArray
    gyro_axes: FloatArray
    gyro_margin: float

    @property
    def decided(self) -> bool:
        """Whether this is certain."""
        return self.margin >= DECIDED and not self.alternatives and self.gyro_margin < DOUBTFUL


@dataclass(frozen=True, kw_only=True, eq=False)
class Units:
    """What turns raw readings into SI, and what is known of the gyros and the clocks before the signs are."""

    gyro: float
    accel: float
    gyro_bias: FloatArray
    offset_s: float


def find_frames(
    windows: Windows,
    increments: Increments,
    motion: Motion,
    units: Units,
    *,
    up: FloatArray,
    velocity_frames: Mapping[str, float],
) -> Frames | None:
    """Compare all combinations of signs and frames, and then of gyro axes that differ from the accelerometers'.

    Parameters
    ----------
    windows, increments, motion
        The stretches, the readings' integrals (raw), and the GNSS velocities as declared.
    units : Units
        Units, gyro bias and clock offset as far as they are known.
    up : ndarray, shape (3,)
        Direction of the specific force, sensor axes.
    velocity_frames : mapping
        Those of `VELOCITY_FRAMES` that are possible, and how far each is behind in log-likelihood by other evidence.

    Returns
    -------
    Frames or None
        None where there is no window.
    """
    if windows.start.size == 0:
        return None
    when = epoch_times(windows, motion)
    interval = float(np.median(np.diff(motion.time)))
    lag = max(1, round(PLAIN_LAG_S / interval))
    duration = when[:, lag:] - when[:, :-lag]
    velocity = np.where(windows.present[..., None], motion.velocity[np.maximum(windows.epochs, 0)], np.nan)
    change = (velocity[:, lag:] - velocity[:, :-lag]) / duration[..., None]
    gravity = np.array([0.0, 0.0, GRAVITY])

    def felt(gyro_axes: FloatArray) -> FloatArray:
        turning = replace(increments, angle=increments.angle @ gyro_axes.T)
        _, push = turned(windows, turning, scale=units.gyro, bias=gyro_axes @ units.gyro_bias)
        push = on_grid(push * units.accel, windows, when - units.offset_s)
        return np.asarray((push[:, lag:] - push[:, :-lag]) / duration[..., None])

    def fit(h: Hypothesis, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        expected = change @ VELOCITY_FRAMES[h.velocity_frame].T - gravity
        known = np.isfinite(force + expected).all(axis=-1)[..., None]
        return wahba(np.where(known, h.force_sign * force, 0.0), np.where(known, expected, 0.0))

    forces = {sign: felt(sign * np.eye(3)) for sign in (1, -1)}
    fits = {
        h: fit(h, forces[h.rate_sign])
        for h in (
            Hypothesis(force_sign=force_sign, rate_sign=rate_sign, velocity_frame=frame)
            for rate_sign in (1, -1)
            for frame in velocity_frames
            for force_sign in (1, -1)
        )
    }
    independent = (np.isfinite(duration).sum(axis=1) * min(interval / INDEPENDENT_S, 1.0)).astype(np.float64)
    chosen, margin, alternatives, voices = _judge(fits, independent, velocity_frames)
    gyro_axes, gyro_margin = np.eye(3), 0.0
    for axes in about(int(np.abs(up).argmax())):
        _, rss = fit(chosen, felt(chosen.rate_sign * axes))
        gain = 1.5 * independent * np.log((fits[chosen][1] + 1e-12) / (rss + 1e-12))
        lead = float(np.clip(gain, -WINDOW_WORTH, WINDOW_WORTH).sum())
        if lead > gyro_margin:
            gyro_axes, gyro_margin = axes, lead
    return Frames(
        hypothesis=chosen,
        margin=margin,
        alternatives=alternatives,
        dcm_f_to_ned=fits[chosen][0].transpose(0, 2, 1),
        windows=voices,
        force=chosen.force_sign * forces[chosen.rate_sign],
        change=change @ VELOCITY_FRAMES[chosen.velocity_frame].T,
        gyro_axes=gyro_axes,
        gyro_margin=gyro_margin,
    )


def about(axis: int) -> Iterator[FloatArray]:
    """Yield the other ways to name and sign two axes when the third, vertical one is as it is: turns tell that one."""
    first, second = (k for k in range(3) if k != axis)
    for swapped in (False, True):
        for signs in itertools.product((1.0, -1.0), repeat=2):
            matrix = np.zeros((3, 3))
            matrix[axis, axis] = 1.0
            matrix[first, second if swapped else first] = signs[0]
            matrix[second, first if swapped else second] = signs[1]
            if not np.array_equal(matrix, np.eye(3)):
                yield matrix


def _judge(
    fits: dict[Hypothesis, tuple[FloatArray, FloatArray]], independent: FloatArray, behind: Mapping[str, float]
) -> tuple[Hypothesis, float, tuple[Hypothesis, ...], int]:
    """Return the best of the hypotheses, how far it leads those that the windows can tell from it, and the others."""
    logs = {h: 1.5 * independent * np.log(rss + 1e-12) for h, (_, rss) in fits.items()}

    def score(h: Hypothesis) -> float:
        return round(float(logs[h].sum()) - behind[h.velocity_frame], 3)

    best = min(fits, key=lambda h: (score(h), h.oddity))
    gains = {h: np.clip(logs[h] - logs[best], -WINDOW_WORTH, WINDOW_WORTH) for h in fits}
    lead = {h: float(gains[h].sum()) + behind[best.velocity_frame] - behind[h.velocity_frame] for h in fits}
    same = [h for h in fits if np.abs(gains[h]).max() < 1e-3 and lead[h] < DECIDED]
    others = [h for h in fits if h not in same]
    chosen = min(same, key=lambda h: h.oddity)
    alternatives = tuple(h for h in same if h is not chosen and h.oddity < chosen.oddity + PLAINER)
    runner = min(others, key=lambda h: lead[h], default=None)
    voices = 0 if runner is None else int((gains[runner] > 1.0).sum())
    return chosen, 0.0 if runner is None else lead[runner], alternatives, voices


def wahba(felt: FloatArray, expected: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return per window the rotation (w, 3, 3) with ``felt = rotation expected``, and the sum of squares that is left.

    Both are (w, e, 3), 0 where there is no measurement; mirror images are not allowed (Wahba 1965, by singular values).
    """
    u, s, vt = np.linalg.svd(np.einsum("wei,wej->wij", felt, expected))
    proper = np.sign(np.linalg.det(u @ vt))
    flip = np.ones((proper.size, 3))
    flip[:, 2] = proper
    rotation = (u * flip[:, None, :]) @ vt
    rss = (felt**2).sum(axis=(1, 2)) + (expected**2).sum(axis=(1, 2)) - 2.0 * (s * flip).sum(axis=1)
    return rotation, np.maximum(rss, 0.0)


def frames_by_positions(
    time: FloatArray, steps_ned: FloatArray, velocity: FloatArray, position_llh: FloatArray
) -> dict[str, float]:
    """Return how far the log-likelihood of every frame of the velocities is behind the best one's, by the positions.

    Parameters
    ----------
    time : ndarray, shape (m,)
        Stamps of the epochs, s.
    steps_ned : ndarray, shape (m - 1, 3)
        From each position to the next, m.
    velocity : ndarray, shape (m, 3)
        As declared, m/s.
    position_llh : ndarray, shape (m, 3)
        Latitude, longitude (rad), height (m).

    Returns
    -------
    dict
        By frame, `ECEF` among them: 0 for the best, negative for others; empty where the vehicle hardly moved or no
        frame fits.
    """
    duration = np.diff(time)
    mean = 0.5 * (velocity[1:] + velocity[:-1])
    moved = steps_ned / duration[:, None]
    whole = np.isfinite(mean).all(axis=1) & np.isfinite(moved).all(axis=1) & (duration < 3.0)
    mean, moved = mean[whole], moved[whole]
    if mean.shape[0] < 20 or np.hypot(*moved[:, :2].T).max() < 1.0:
        return {}
    as_ned = {name: mean @ turn.T for name, turn in VELOCITY_FRAMES.items()}
    as_ned[ECEF] = ned_from_ecef(mean, position_llh[1:][whole])
    misfit = {name: found - moved for name, found in as_ned.items()}
    best = min(misfit, key=lambda name: float(np.median(np.linalg.norm(misfit[name], axis=1))))
    usual = 0.3 * float(np.median(np.linalg.norm(moved, axis=1))) + 0.2
    if float(np.median(np.linalg.norm(misfit[best], axis=1))) > usual:
        return {}
    sigma = 1.4826 * np.median(np.abs(misfit[best]), axis=0) + 0.02
    square = {name: np.minimum((misses / sigma) ** 2, STEP_WORTH) for name, misses in misfit.items()}
    # A half for the likelihood, and a half because neighbouring steps share a position.
    behind = {name: -0.25 * float((found - square[best]).sum()) for name, found in square.items()}
    top = max(behind.values())
    return {name: value - top for name, value in behind.items()}
