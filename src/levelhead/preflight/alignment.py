"""GNSS velocities against integrated readings, window by window: how far the clocks are apart.

In a window, with the sensor's frame F at its start standing still (see `levelhead.preflight.windows`),

    v(t + tau) = v0 + C_NF (integral of C_FS (f - b_a)) + g t + C_NS (omega x lever)

is linear in what is unknown once C_NF is nearly known: v0 and three small angles in every window, and for the whole
drive the offset tau of the clocks, the biases and the lever arm. Least squares with the windows' own unknowns
eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.preflight.frames import WINDOW_WORTH
from levelhead.preflight.windows import (
    BoolArray,
    Increments,
    Motion,
    Windows,
    epoch_times,
    on_grid,
    rotations,
    skew,
    smoothly_on_grid,
    turned,
)

ACCEL_BIAS_STD: Final = 0.5
"""One sigma of an accelerometer's bias before the drive, m/s^2."""
GYRO_BIAS_STD: Final = np.radians(0.5)
"""One sigma of what is left of a gyro's bias after its mean over the drive was taken off, rad/s."""
OFFSET_STD: Final = 1.0
"""One sigma of how far the clocks are from where the turns put them, s."""
MAX_TURN: Final = 0.3
"""No heading is changed by more in a round, rad: the fit is linear."""
ROUNDS: Final = 20
"""Of the linear fit at most: from Wahba's rotations two do, but along a valley, where a lever arm looks like an offset
of the clocks, it takes many..."""
SETTLED: Final = 0.05
"""...and it has settled when nothing moves by more than this share of its sigma."""
FROZEN: Final = 4
"""Rounds after which windows that were left out stay out."""
MAX_HEADING_STD: Final = np.radians(3.0)
LINK_STD: Final = np.radians(0.1)
"""One sigma of the heading that the gyros carry from a window to the next, rad: noise of a consumer gyro over 20 s."""
SCALE_STD: Final = 0.003
"""One sigma of a gyro's scale."""
OUTLIER: Final = 4.0
"""Windows whose residual is so many times the median's do not count: GNSS jumped, or the gyros did."""

SLOPE_STEPS: Final = 10
"""Steps of the grid to both sides over which accelerations are taken: vibration in them would tell of a lever arm."""
MIN_SWING: Final = 0.15
"""Windows whose horizontal velocity swings less tell nothing of heading and clocks, m/s (see `Windows.swing`)."""
SIGNAL: Final = 4.0
"""Nor do those in which it swings by less than so many sigmas of the velocity: vibration would pass for motion."""

OFFSET: Final = 0
LEVER: Final = slice(1, 4)
ACCEL: Final = slice(4, 7)
GYRO: Final = slice(7, 10)
COMMON: Final = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """What the fit leaves.

    Attributes
    ----------
    offset_s, offset_std : float
        How much later than the IMU's the GNSS stamps are, s.
    lever_arm, lever_std : ndarray, shape (3,)
        From the IMU to the antenna, sensor axes, m.
    dcm_f_to_ned : ndarray, shape (w, 3, 3)
        Rotation of each window's frame F.
    attitude_std : ndarray, shape (w, 3)
        One sigma of it about North, East, Down, rad.
    heading_covariance : ndarray, shape (w, w)
        Of the windows' headings: biases and clocks are common to all, and the gyros tie neighbours together, rad^2.
    attitude : ndarray, shape (w, k + 1, 3, 3)
        Rotation from the sensor's axes to F on the windows' grid.
    residual_std : float
        Of the velocities, in their own sigmas.
    used : ndarray of bool, shape (w,)
        Windows that counted.
    known : ndarray of bool, shape (w,)
        Windows whose heading is known, by themselves or carried by the gyros from one that swings.
    offsets_s, offsets_std : ndarray, shape (w,)
        The clock offset that each window alone would have, s.
    offset_per_lever : ndarray, shape (3,)
        By how much the clock offset is found too large for every metre of a lever arm that was left out, s/m, sensor
        axes.
    settled : bool
        Whether the fit has come to rest; where not, nothing in it counts.
    misfit : ndarray, shape (w,)
        Minus the log-likelihood of each window that swings, its noise as it is found; 0 for the others.
    """

    offset_s: float
    offset_std: float
    lever_arm: FloatArray
    lever_std: FloatArray
    dcm_f_to_ned: FloatArray
    attitude_std: FloatArray
    heading_covariance: FloatArray
    attitude: FloatArray
    residual_std: float
    used: BoolArray
    known: BoolArray
    offsets_s: FloatArray
    offsets_std: FloatArray
    offset_per_lever: FloatArray
    settled: bool
    misfit: FloatArray

    def leads(self, other: Alignment) -> float:
        """Return the log-likelihood by which this fit leads another; no window may add more than `WINDOW_WORTH`."""
        return float(np.clip(other.misfit - self.misfit, -WINDOW_WORTH, WINDOW_WORTH).sum())


@dataclass(frozen=True, kw_only=True)
class Noise:
    """One-sided noise densities with vibration: gyros, rad/s/sqrt(Hz), accelerometers, m/s^2/sqrt(Hz)."""

    gyro: float
    accel: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """Where the fit begins: rotation of each window's F, clock offset, gyro bias in the gyros' unit, units and signs.

    ``accel_noise`` is the one-sided density of the accelerometers with their vibration, m/s^2/sqrt(Hz): it adds up in
    the velocity.
    """

    dcm_f_to_ned: FloatArray
    offset_s: float
    gyro_scale: float
    gyro_bias: FloatArray
    accel_scale: float
    noise: Noise


def align(
    windows: Windows,
    increments: Increments,
    motion: Motion,
    start: Start,
    *,
    lever_arm: FloatArray | None = None,
    lever_std: float = 1e-6,
    lever_start: FloatArray | None = None,
) -> Alignment | None:
    """Fit the velocities of all windows.

    Parameters
    ----------
    windows, increments, motion
        The stretches, the readings' integrals (raw), and the GNSS velocities in NED.
    start : Start
        A solution that is right within some degrees and a second.
    lever_arm : ndarray, shape (3,), optional
        From the IMU to the antenna, sensor axes, m; none where it is not known.
    lever_std : float
        One sigma of it, m.
    lever_start : ndarray, shape (3,), optional
        Where the search for it begins, m.

    Returns
    -------
    Alignment or None
        None where no window swings enough to tell anything.
    """
    common = np.zeros(COMMON)
    if lever_arm is not None:
        common[LEVER] = lever_arm
    expected = common.copy()
    if lever_start is not None:
        common[LEVER] = lever_start
    prior_std = np.full(COMMON, OFFSET_STD)
    prior_std[LEVER], prior_std[ACCEL], prior_std[GYRO] = lever_std, ACCEL_BIAS_STD, GYRO_BIAS_STD
    common[OFFSET] = start.offset_s
    lively = windows.swing > np.maximum(MIN_SWING, SIGNAL * float(np.median(motion.sigma[:, :2])))
    used = lively
    if not used.any():
        return None
    expected[OFFSET] = start.offset_s
    dcm, carried = _carried(windows, increments, start, lively)
    settled = False
    for k in range(ROUNDS):
        problem = _linearised(windows, increments, motion, replace(start, dcm_f_to_ned=dcm), common)
        step = _solve(problem, expected - common, prior_std, used)
        common = common + step.common
        dcm = rotations(step.turn) @ dcm
        std = np.sqrt(np.diag(step.covariance))
        moved = np.concatenate((step.common / std, step.turn[used, 2] / step.attitude_std[used, 2]))
        kept = lively & (step.residual < OUTLIER * np.median(step.residual[used]))
        if k >= FROZEN:
            kept &= used
        settled = bool(np.abs(moved).max() < SETTLED) and np.array_equal(kept, used)
        used = kept
        if settled:
            break
    return Alignment(
        offset_s=float(common[OFFSET]),
        offset_std=float(std[OFFSET]),
        lever_arm=common[LEVER],
        lever_std=std[LEVER],
        dcm_f_to_ned=dcm,
        attitude_std=step.attitude_std,
        heading_covariance=step.heading_covariance,
        attitude=problem.attitude,
        residual_std=float(np.sqrt(np.median(step.residual[used] ** 2))),
        used=used,
        known=(used | carried) & (step.attitude_std[:, 2] < MAX_HEADING_STD),
        offsets_s=common[OFFSET] + step.offsets,
        offsets_std=step.offsets_std,
        offset_per_lever=np.asarray(-np.linalg.solve(step.model[LEVER, LEVER], step.model[LEVER, OFFSET]), np.float64),
        settled=settled,
        misfit=np.where(lively, step.freedom * np.log(step.residual + 1e-9), 0.0),
    )


def _carried(windows: Windows, increments: Increments, start: Start, lively: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the windows' rotations with those that do not swing carried over from neighbours, and which were."""
    attitude, _ = turned(windows, increments, scale=start.gyro_scale, bias=start.gyro_bias)
    dcm = start.dcm_f_to_ned.copy()
    reached = lively.copy()
    apart = np.diff(windows.start)
    node = np.minimum(np.rint(apart / windows.offsets[1]).astype(np.intp), windows.offsets.size - 1)
    over = attitude[np.arange(apart.size), node]
    near = apart <= windows.offsets[-1]
    for k in np.flatnonzero(near):
        if reached[k] and not reached[k + 1]:
            dcm[k + 1], reached[k + 1] = dcm[k] @ over[k], True
    for k in np.flatnonzero(near)[::-1]:
        if reached[k + 1] and not reached[k]:
            dcm[k], reached[k] = dcm[k + 1] @ over[k].T, True
    return dcm, reached & ~lively


@dataclass(frozen=True, kw_only=True, eq=False)
class _Problem:
    """Rows in sigmas: of each window's own unknowns, of the common ones, and what is to be explained."""

    local: FloatArray
    common: FloatArray
    target: FloatArray
    attitude: FloatArray
    links: _Links


@dataclass(frozen=True, kw_only=True, eq=False)
class _Links:
    """What the gyros say of the headings of windows that follow on each other, and the gyro biases' part in it."""

    earlier: NDArray[np.intp]
    later: NDArray[np.intp]
    mismatch: FloatArray
    sigma: FloatArray
    bias: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Step:
    common: FloatArray
    covariance: FloatArray
    model: FloatArray
    turn: FloatArray
    attitude_std: FloatArray
    heading_covariance: FloatArray
    residual: FloatArray
    freedom: FloatArray
    offsets: FloatArray
    offsets_std: FloatArray


def _linearised(windows: Windows, increments: Increments, motion: Motion, start: Start, common: FloatArray) -> _Problem:
    attitude, push = turned(
        windows, increments, scale=start.gyro_scale, bias=start.gyro_bias + common[GYRO] / start.gyro_scale
    )
    push = push * start.accel_scale
    step = windows.offsets[1]
    middle = 0.5 * (attitude[:, 1:] + attitude[:, :-1])
    lain = _summed(middle * step)  # integral of C_FS
    push = push - lain @ common[ACCEL]
    force = np.diff(push, axis=1) / step
    swept = _summed(skew(force) @ (0.5 * (lain[:, 1:] + lain[:, :-1])) * step)
    grid = np.minimum(windows.start[:, None] + windows.offsets, increments.time[-1])
    rate = np.diff(increments.at(grid, angle=True), axis=1) / step * start.gyro_scale
    when = epoch_times(windows, motion) - common[OFFSET]
    elapsed = when - windows.start[:, None]
    to_ned = start.dcm_f_to_ned[:, None]
    gravity = np.array([0.0, 0.0, GRAVITY])

    def ned(vectors: FloatArray) -> FloatArray:
        turned_vectors: FloatArray = np.einsum("wij,wej->wei", start.dcm_f_to_ned, vectors)
        return turned_vectors

    velocity = ned(smoothly_on_grid(push, windows, when))
    sensor = to_ned @ on_grid(attitude, windows, when)
    swing = sensor @ skew(on_grid(_at_nodes(rate), windows, when))
    # At the end of a lever arm velocity and acceleration are others: all that tells it from an offset of the clocks.
    arm = np.einsum("wkij,wkj->wki", attitude, np.cross(_at_nodes(rate), common[LEVER]))
    acceleration = ned(on_grid(_slopes(push + arm, step), windows, when)) + gravity
    turning = velocity + ned(on_grid(arm, windows, when))
    local = np.concatenate((np.broadcast_to(np.eye(3), (*when.shape, 3, 3)), -skew(turning)), axis=-1)
    columns = (
        -acceleration[..., None],
        swing,
        -(to_ned @ on_grid(lain, windows, when)),
        to_ned @ on_grid(swept, windows, when),
    )
    index = np.maximum(windows.epochs, 0)
    expected = velocity + gravity * elapsed[..., None] + np.einsum("weij,j->wei", swing, common[LEVER])
    known = windows.present & np.isfinite(expected).all(axis=-1)
    target = motion.velocity[index] - expected
    rows = np.concatenate((local, *columns, target[..., None]), axis=-1)
    rows = _whitened(np.nan_to_num(rows), known, elapsed, motion.sigma[index], start.noise)
    return _Problem(
        local=rows[..., :6],
        common=rows[..., 6:-1],
        target=rows[..., -1],
        attitude=attitude,
        links=_links(windows, attitude, lain, start),
    )


def _links(windows: Windows, attitude: FloatArray, lain: FloatArray, start: Start) -> _Links:
    """Compare the headings of windows that follow on each other with what the gyros turned in between."""
    apart = np.diff(windows.start)
    earlier = np.flatnonzero(apart <= windows.offsets[-1])
    node = np.rint(apart[earlier] / windows.offsets[1]).astype(np.intp)
    carried = start.dcm_f_to_ned[earlier] @ attitude[earlier, node]
    missed = start.dcm_f_to_ned[earlier + 1] @ carried.swapaxes(-1, -2)
    turned_by = np.arccos(np.clip(0.5 * (np.trace(attitude[earlier, node], axis1=1, axis2=2) - 1.0), -1.0, 1.0))
    return _Links(
        earlier=earlier,
        later=earlier + 1,
        mismatch=0.5 * (missed[:, 1, 0] - missed[:, 0, 1]),
        sigma=np.hypot(LINK_STD, SCALE_STD * turned_by),
        bias=(start.dcm_f_to_ned[earlier] @ lain[earlier, node])[:, 2],
    )


def _whitened(rows: FloatArray, known: BoolArray, elapsed: FloatArray, sigma: FloatArray, noise: Noise) -> FloatArray:
    """Turn rows (w, e, 3, c) whose errors are noise of all sensors into rows with independent unit errors.

    In the velocities there are the GNSS's white noise, the accelerometers' noise added up, and, horizontally, gravity
    along a tilt that is the gyros' noise added up. What a Kalman filter of these is surprised by, in its sigmas, is
    white (Kailath's innovations).
    """
    white = np.zeros_like(rows)
    velocity, push = np.zeros_like(rows[:, 0]), np.zeros_like(rows[:, 0])
    p_vv, p_vp, p_pp = (np.zeros((rows.shape[0], 3)) for _ in range(3))
    q_v = 0.5 * noise.accel**2
    q_p = 0.5 * (GRAVITY * noise.gyro) ** 2 * np.array([1.0, 1.0, 0.0])
    before = np.zeros(rows.shape[0])
    for k in range(rows.shape[1]):
        here = known[:, k]
        dt = np.where(here, np.maximum(elapsed[:, k] - before, 0.0), 0.0)[:, None]
        before = np.where(here, elapsed[:, k], before)
        velocity = velocity + dt[..., None] * push
        p_vv = p_vv + dt * (2.0 * p_vp + dt * p_pp) + q_v * dt + q_p * dt**3 / 3.0
        p_vp = p_vp + dt * p_pp + q_p * dt**2 / 2.0
        p_pp = p_pp + q_p * dt
        total = p_vv + sigma[:, k] ** 2
        surprise = np.where(here[:, None, None], rows[:, k] - velocity, 0.0)
        white[:, k] = surprise / np.sqrt(total)[..., None]
        gain_v, gain_p = (np.where(here[:, None], p / total, 0.0) for p in (p_vv, p_vp))
        velocity = velocity + gain_v[..., None] * surprise
        push = push + gain_p[..., None] * surprise
        p_pp = p_pp - gain_p * p_vp
        p_vp = p_vp * (1.0 - gain_v)
        p_vv = p_vv * (1.0 - gain_v)
    return white


def _solve(problem: _Problem, to_prior: FloatArray, prior_std: FloatArray, used: BoolArray) -> _Step:
    """Solve for the common unknowns and the windows' headings, all others eliminated window by window."""
    count = problem.local.shape[0]
    a = problem.local[..., :5].reshape(count, -1, 5)
    b = np.concatenate((problem.common, problem.local[..., 5:]), axis=-1).reshape(count, -1, COMMON + 1)
    y = problem.target.reshape(count, -1)
    at = a.transpose(0, 2, 1)
    own = np.linalg.inv(at @ a + 1e-9 * np.eye(5))
    # What is left of the columns and of the target once the window's own unknowns have taken their part.
    b_left = b - a @ (own @ (at @ b))
    y_left = y - (a @ (own @ (at @ y[..., None])))[..., 0]
    freedom = np.maximum((y != 0.0).sum(axis=1) - 6, 1)
    normals = b_left.transpose(0, 2, 1) @ b_left
    scores = (b_left.transpose(0, 2, 1) @ y_left[..., None])[..., 0]
    prior = np.diag(1.0 / prior_std**2)
    total, right = _assembled(normals, scores, used)
    total[:COMMON, :COMMON] += prior
    right[:COMMON] += prior @ to_prior
    rows, missed = _link_rows(problem.links, total.shape[0])
    inverse = np.linalg.inv(total + rows.T @ rows)
    solution = inverse @ (right + rows.T @ missed)
    step, turn = solution[:COMMON], np.clip(solution[COMMON:], -MAX_TURN, MAX_TURN)
    both = np.concatenate((np.broadcast_to(step, (count, COMMON)), turn[:, None]), axis=1)
    left = y_left - (b_left @ both[..., None])[..., 0]
    residual = np.sqrt((left**2).sum(axis=1) / freedom)
    variance = float(np.median(residual[used] ** 2))
    # Residuals of a window hang together, whatever is modelled: the windows' own scores tell how much.
    each = (b_left.transpose(0, 2, 1) @ left[..., None])[..., 0] * used[:, None]
    spread = np.zeros((count, total.shape[0]))
    spread[:, :COMMON] = each[:, :COMMON]
    spread[np.arange(count), COMMON + np.arange(count)] = each[:, COMMON]
    voices = max(float(used.sum()), 1.0)
    few = 1.0 + 4.0 / voices  # few windows agree by chance
    covariance = inverse @ (few * (spread.T @ spread) + _padded(prior, total.shape[0])) @ inverse
    covariance += variance * inverse
    own_step = (own @ (at @ (y - (b @ both[..., None])[..., 0])[..., None]))[..., 0]
    tilt_std = np.sqrt(np.diagonal(own, axis1=1, axis2=2)[:, 3:])
    heading_std = np.sqrt(np.diag(covariance)[COMMON:])
    alone = normals[:, OFFSET, OFFSET] - normals[:, OFFSET, COMMON] ** 2 / (normals[:, COMMON, COMMON] + 1e-9) + 1e-9
    mixed = (
        b_left[..., OFFSET]
        - b_left[..., COMMON] * (normals[:, OFFSET, COMMON] / (normals[:, COMMON, COMMON] + 1e-9))[:, None]
    )
    return _Step(
        common=step,
        covariance=covariance[:COMMON, :COMMON],
        model=np.asarray(inverse[:COMMON, :COMMON], np.float64),
        turn=np.column_stack((own_step[:, 3:], turn)),
        attitude_std=np.column_stack((tilt_std * np.maximum(residual, 1.0)[:, None], heading_std)),
        heading_covariance=covariance[COMMON:, COMMON:],
        residual=residual,
        freedom=freedom.astype(np.float64),
        offsets=(mixed * left).sum(axis=1) / alone,
        offsets_std=np.maximum(residual, 1.0) / np.sqrt(alone),
    )


def _assembled(normals: FloatArray, scores: FloatArray, used: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations of the common unknowns and one heading per window, from the windows' own."""
    count = used.size
    total = np.zeros((COMMON + count, COMMON + count))
    right = np.zeros(COMMON + count)
    total[:COMMON, :COMMON] = normals[used, :COMMON, :COMMON].sum(axis=0)
    right[:COMMON] = scores[used, :COMMON].sum(axis=0)
    mixed = normals[:, :COMMON, COMMON] * used[:, None]
    total[:COMMON, COMMON:] = mixed.T
    total[COMMON:, :COMMON] = mixed
    # A window that does not count keeps its heading, loosely.
    total[COMMON:, COMMON:] = np.diag(np.where(used, normals[:, COMMON, COMMON], 0.0) + 1e-3)
    right[COMMON:] = np.where(used, scores[:, COMMON], 0.0)
    return total, right


def _link_rows(links: _Links, size: int) -> tuple[FloatArray, FloatArray]:
    """Return the rows, in sigmas, that tie the headings of neighbouring windows together, and what they miss."""
    rows = np.zeros((links.sigma.size, size))
    index = np.arange(links.sigma.size)
    rows[index, COMMON + links.later] = 1.0 / links.sigma
    rows[index, COMMON + links.earlier] = -1.0 / links.sigma
    rows[:, GYRO] = links.bias / links.sigma[:, None]
    return rows, -links.mismatch / links.sigma


def _padded(prior: FloatArray, size: int) -> FloatArray:
    """Return the prior of the common unknowns as a matrix of all."""
    padded = np.zeros((size, size))
    padded[:COMMON, :COMMON] = prior
    return padded


def _summed(steps: FloatArray) -> FloatArray:
    """Return the running sum of steps along the second axis, 0 at first."""
    return np.concatenate((np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)), axis=1)


def _slopes(values: FloatArray, step: float) -> FloatArray:
    """Return the slope of values on the grid, over times in which the noise of the rates averages out."""
    ahead, behind = (np.repeat(values[:, edge], SLOPE_STEPS, axis=1) for edge in (slice(-1, None), slice(1)))
    wide = np.concatenate((behind, values, ahead), axis=1)
    slopes: FloatArray = (wide[:, 2 * SLOPE_STEPS :] - wide[:, : -2 * SLOPE_STEPS]) / (2.0 * SLOPE_STEPS * step)
    return slopes


def _at_nodes(steps: FloatArray) -> FloatArray:
    """Return the means of neighbouring steps: values at the grid of what is known between its nodes."""
    inner = 0.5 * (steps[:, 1:] + steps[:, :-1])
    return np.concatenate((steps[:, :1], inner, steps[:, -1:]), axis=1)
