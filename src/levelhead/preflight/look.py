"""All that can be found in a log without believing what it says of its units, axes, frames and clocks: numbers only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from levelhead.analysis.noise import density
from levelhead.conventions import GRAVITY, UNIT_FACTORS, FloatArray
from levelhead.earth import steps_ned
from levelhead.errors import LogError
from levelhead.estimators.params import NoiseParams, Triple
from levelhead.logs.derive import velocity_from_position
from levelhead.logs.log import Log
from levelhead.preflight.alignment import Alignment, Noise, Start, align
from levelhead.preflight.corrections import Corrections
from levelhead.preflight.frames import (
    DECIDED,
    VELOCITY_FRAMES,
    Frames,
    Units,
    find_frames,
    frames_by_positions,
)
from levelhead.preflight.mounting import MIN_SPEED, Mounting, find_mounting
from levelhead.preflight.speeds import Speeds, speeds_by_forces, speeds_by_positions
from levelhead.preflight.turns import Turns, compare_turns
from levelhead.preflight.windows import BoolArray, Increments, Motion, Windows, choose_windows

UNIT_TOLERANCE: Final = 0.2
"""A unit is found where what it should give is met within this (natural logarithm): scale errors are far smaller, units
differ by far more."""
MAX_TURNED: Final = math.radians(15.0)
"""Velocities that are turned further against the steps between positions are in none of the frames that are known: what
a map's north or the magnet's is off is less."""
BLOCK_S: Final = 1.0
MARGIN_S: Final = 1.6
"""IMU data that must lie around a window, s: as far as clocks may be apart."""
MIN_SIGMA: Final = 0.02
"""No velocity is believed to better than this, m/s."""
CLEAN: Final = 0.05
"""Noise of derived velocities, as a share of the speed, above which they are taken over longer steps..."""
MAX_STEP_S: Final = 2.0
"""...but not over longer ones than this, s."""
JUMP_EPOCHS: Final = 5
JUMP_SIGMAS: Final = 8.0
MAX_ACCELERATION: Final = 5.0
"""A velocity that is off the median of the five epochs round it by so many usual deviations, and by more than this
acceleration reaches from one to the next, is an outlier, m/s^2."""
VERTICAL: Final = 3.0
"""By how much less vertical velocities are trusted than they say."""
QUIET: Final = NoiseParams()
LEVER_STD: Final = 3.0
"""One sigma of a lever arm that nobody told, m."""
SURE_LEVER: Final = 4.0
MIN_LEVER_M: Final = 0.1
"""A lever arm that nobody told counts for the clocks where it is so many sigmas and so many metres from zero..."""
DOUBTFUL_LEVER: Final = 50.0
SURE_LEVER_LEAD: Final = 100.0
"""And its log-likelihood must lead by as much: strong vibration and coarse gyros feign leads of up to the lower one."""
CLEAR_LEVER: Final = 6.0
CLEAR_LEVER_M: Final = 0.5
"""...and is told to the user where it is so many."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What the data shows; None where it cannot.

    Attributes
    ----------
    accel_norm : float
        Median size of the specific force over blocks of a second, the file's unit.
    coherence : float
        How steady its direction is, 1 for a vehicle that drives level: gravity is in it.
    accel_unit, gyro_unit : str or None
        Units that fit.
    up : ndarray, shape (3,)
        Mean direction of the specific force, the file's axes.
    turns : Turns or None
        Yaw rate against course.
    by_positions : str or None
        Frame in which alone the velocities agree with the positions; `positions_margin` is the log-likelihood by which.
    speeds : Speeds or None
        How large the velocities are, by positions or accelerations.
    frames, alignment, mounting
        Of the windows; `mounting` in the axes that `frames` has put right.
    lever_found, lever_told : bool
        Whether the velocities show a large lever arm that nobody told; whether the user told one.
    velocity_derived : bool
        Whether the velocities come from the positions.
    """

    motion: Motion
    windows: Windows
    accel_norm: float
    coherence: float
    accel_unit: str | None
    gyro_unit: str | None
    up: FloatArray
    turns: Turns | None
    by_positions: str | None
    positions_margin: float
    speeds: Speeds | None
    frames: Frames | None
    alignment: Alignment | None
    mounting: Mounting | None
    lever_found: bool
    lever_told: bool
    velocity_derived: bool

    @property
    def coherent(self) -> bool:
        """Whether clocks, headings and line of travel fit together: in wrong frames and axes they do not."""
        return bool(self.alignment and self.alignment.settled and self.mounting and self.mounting.coherent)


def look_at(log: Log, *, lever_arm: Triple | None = None, frame_told: bool = False, frame_open: bool = False) -> Look:
    """Look at a log.

    Parameters
    ----------
    log : Log
        As it was read.
    lever_arm : (3,), optional
        From the IMU to the antenna, vehicle axes, m, where the user told it.
    frame_told : bool
        Whether the user told the frame of the velocity, so that it is NED by now.
    frame_open : bool
        Whether nothing tells that frame: else velocities without a vertical part are speed and course.

    Raises
    ------
    LogError
        When the log has neither velocities nor positions that velocities can be derived from.
    """
    steps = _steps(log)
    behind = {} if steps is None else frames_by_positions(*steps)
    flat = log.velocity_ned is not None and not np.any(np.nan_to_num(log.velocity_ned[:, 2]))
    if flat:
        behind.pop("NEU", None)  # without a vertical velocity it is NED
    speeds = None if steps is None else speeds_by_positions(*steps)
    ranked = sorted(behind, key=lambda name: -behind[name])
    positions_margin = -behind[ranked[1]] if ranked else 0.0
    by_positions = ranked[0] if positions_margin >= DECIDED else None
    motion = motion_of(Corrections(velocity_frame=by_positions or "NED").apply(log))
    increments = Increments.of(log.time, log.gyro, log.accel)
    norm, coherence, up = _gravity(increments)
    accel_unit = nearest_unit(GRAVITY / norm, UNIT_FACTORS["m/s^2"]) if norm > 0.0 else None
    turns = compare_turns(increments, motion, up)
    gyro_unit = None if turns is None else nearest_unit(abs(turns.scale), UNIT_FACTORS["rad/s"])
    windows = choose_windows(log.time, motion, margin=MARGIN_S)
    frames, alignment, mounting, lever_found = None, None, None, False
    if windows.start.size and accel_unit is not None and coherence > 0.5:
        units = Units(
            gyro=UNIT_FACTORS["rad/s"][gyro_unit or "rad/s"],
            accel=UNIT_FACTORS["m/s^2"][accel_unit],
            gyro_bias=_gyro_bias(increments, up, turns),
            offset_s=0.0 if turns is None else turns.offset_s,
        )
        course = flat and not frame_open  # speed and course: a frame that nobody can have got wrong
        known = by_positions or frame_told or course or log.velocity_ned is None
        names = {"NED"} if known else {"NED", "ENU"} if flat else set(VELOCITY_FRAMES)
        possible = {name: 0.0 if known else behind.get(name, 0.0) for name in VELOCITY_FRAMES if name in names}
        frames = find_frames(windows, increments, motion, units, up=up, velocity_frames=possible)
        if frames is not None and speeds is None and log.velocity_ned is not None:
            speeds = speeds_by_forces(frames.dcm_f_to_ned, frames.force, frames.change)
    if frames is not None and (speeds is None or right_speeds(speeds)):
        alignment, mounting, lever_found = _aligned(
            windows, increments, motion, units, frames, _noise(log, units), lever_arm
        )
    return Look(
        motion=motion,
        windows=windows,
        accel_norm=norm,
        coherence=coherence,
        accel_unit=accel_unit,
        gyro_unit=gyro_unit,
        up=up,
        turns=turns,
        by_positions=by_positions,
        positions_margin=positions_margin,
        speeds=speeds,
        frames=frames,
        alignment=alignment,
        mounting=mounting,
        lever_found=lever_found,
        lever_told=lever_arm is not None,
        velocity_derived=log.velocity_ned is None,
    )


def motion_of(log: Log) -> Motion:
    """Return the GNSS velocities; derived from the positions where the log has none."""
    if log.velocity_ned is None:
        return _derived(log)
    whole: BoolArray = np.asarray(np.isfinite(log.velocity_ned).all(axis=1))
    if whole.sum() < 2:
        raise LogError("The log has fewer than two GNSS velocities; nothing can be found in it.")
    whole[whole] = ~_jumps(log.gnss_time[whole], log.velocity_ned[whole])
    velocity = log.velocity_ned[whole]
    told = log.velocity_std
    rows = np.full((log.gnss_time.size, 3), np.nan)
    if told is not None:
        rows = np.repeat(told[:, None], 3, axis=1) if told.ndim == 1 else told
    sigma = np.where(np.isfinite(rows[whole]) & (rows[whole] > 0.0), rows[whole], _velocity_noise(velocity))
    return Motion(time=log.gnss_time[whole], velocity=velocity, sigma=np.maximum(sigma, MIN_SIGMA))


def _derived(log: Log) -> Motion:
    """Return velocities from the steps between positions, over so long a time that they stand out of the noise.

    Positions wander together, so that their steps are far better than their own sigmas say: the noise is measured.
    """
    data = velocity_from_position(log)
    assert data.velocity_ned is not None  # noqa: S101 - for the type checker: derived
    noise = _velocity_noise(data.velocity_ned)
    speed = float(np.median(np.hypot(*data.velocity_ned[:, :2].T)))
    interval = float(np.median(np.diff(data.gnss_time))) if data.gnss_time.size > 1 else 1.0
    stride = min(math.ceil(noise / (CLEAN * speed + 1e-3)), math.floor(MAX_STEP_S / interval))
    if stride > 1:
        rows = slice(None, None, stride)
        position, std = (None if v is None else v[rows] for v in (log.position_llh, log.position_std))
        data = velocity_from_position(
            replace(log, gnss_time=log.gnss_time[rows], position_llh=position, position_std=std)
        )
    assert data.velocity_ned is not None  # noqa: S101 - for the type checker: derived
    if data.gnss_time.size < 2:
        raise LogError("The log has too few positions for two velocities; nothing can be found in it.")
    sigma = max(_velocity_noise(data.velocity_ned), MIN_SIGMA)
    return Motion(time=data.gnss_time, velocity=data.velocity_ned, sigma=np.full_like(data.velocity_ned, sigma))


def _jumps(time: FloatArray, velocity: FloatArray) -> BoolArray:
    """Return the epochs whose velocity stands alone: far from the median of the five round it."""
    if time.size < JUMP_EPOCHS:
        return np.zeros(time.size, dtype=np.bool_)
    padded = np.pad(velocity, ((JUMP_EPOCHS // 2, JUMP_EPOCHS // 2), (0, 0)), mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, JUMP_EPOCHS, axis=0), axis=-1)
    off = np.abs(velocity - middle)
    usual = 1.4826 * np.median(off, axis=0) + MIN_SIGMA
    possible = MAX_ACCELERATION * float(np.median(np.diff(time)))
    return np.asarray((off > np.maximum(JUMP_SIGMAS * usual, possible)).any(axis=1))


def _velocity_noise(velocity: FloatArray) -> float:
    """Return the noise of the horizontal velocity from third differences, which motion hardly reaches, m/s."""
    third = np.diff(velocity[:, :2], n=3, axis=0)
    if third.size == 0:
        return 0.1
    return max(0.03, 1.4826 * float(np.median(np.abs(third))) / math.sqrt(20.0))


def right_speeds(speeds: Speeds) -> bool:
    """Return whether the velocities are in m/s and not turned against the positions."""
    return abs(math.log(speeds.ratio)) < UNIT_TOLERANCE and abs(speeds.turned or 0.0) < MAX_TURNED


def _steps(log: Log) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
    """Return stamps, steps between positions (m, NED), velocities and positions, about a second apart."""
    if log.velocity_ned is None or log.position_llh is None:
        return None
    both = np.isfinite(log.velocity_ned).all(axis=1) & np.isfinite(log.position_llh).all(axis=1)
    if both.sum() < 3:
        return None
    position, velocity, time = log.position_llh[both], log.velocity_ned[both], log.gnss_time[both]
    # Steps over about a second stand out of the noise of the positions.
    stride = max(1, round(1.0 / float(np.median(np.diff(time)))))
    time, position, velocity = time[::stride], position[::stride], velocity[::stride]
    return time, steps_ned(position), velocity, position


def _noise(log: Log, units: Units) -> Noise:
    """Return the noise densities with vibration, SI; of a log too short to tell, those of a quiet sensor."""
    try:
        return Noise(gyro=density(log.time, log.gyro) * units.gyro, accel=density(log.time, log.accel) * units.accel)
    except LogError:
        return Noise(gyro=QUIET.gyro_noise, accel=QUIET.accel_noise)


def _gravity(increments: Increments) -> tuple[float, float, FloatArray]:
    """Return median size, steadiness and mean direction of the specific force over blocks of a second."""
    edges = np.arange(increments.time[0], increments.time[-1], BLOCK_S)
    if edges.size < 2:
        edges = increments.time[[0, -1]]
    blocks = np.diff(increments.at(edges, angle=False), axis=0) / np.diff(edges)[:, None]
    norms = np.linalg.norm(blocks, axis=1)
    middle = float(np.median(norms))
    sane = norms < 3.0 * middle
    mean = blocks[sane].mean(axis=0) if sane.any() else np.array([0.0, 0.0, -1.0])
    size = float(np.linalg.norm(mean))
    return middle, size / middle if middle > 0.0 else 0.0, mean / size if size > 0.0 else np.array([0.0, 0.0, -1.0])


def nearest_unit(factor: float, units: Mapping[str, float]) -> str | None:
    """Return the unit whose factor is met within `UNIT_TOLERANCE`, None where none is."""
    best = min(units, key=lambda name: abs(math.log(factor / units[name])))
    return best if abs(math.log(factor / units[best])) < UNIT_TOLERANCE else None


def _gyro_bias(increments: Increments, up: FloatArray, turns: Turns | None) -> FloatArray:
    """Return the gyros' bias, raw unit: a vehicle does not roll away, and the course tells the vertical one.

    What stands out of the up axis is fitted by a bias and a share of the turning, since up is not quite the axis.
    """
    edges = np.arange(increments.time[0], increments.time[-1], 2.0 * BLOCK_S)
    if edges.size < 4:
        return np.zeros(3)
    rates = np.diff(increments.at(edges, angle=True), axis=0) / np.diff(edges)[:, None]
    vertical = rates @ up
    design = np.column_stack((np.ones_like(vertical), vertical))
    level: FloatArray = np.linalg.lstsq(design, rates, rcond=None)[0][0]
    level = level - up * float(level @ up)
    return level + up * turns.bias if turns is not None else level


def _aligned(
    windows: Windows,
    increments: Increments,
    motion: Motion,
    units: Units,
    frames: Frames,
    noise: Noise,
    lever_arm: Triple | None,
) -> tuple[Alignment | None, Mounting | None, bool]:
    """Fit clocks and lever arm with the signs and frames that were found."""
    best = frames.hypothesis
    turn = VELOCITY_FRAMES[best.velocity_frame]
    # Vertical velocities are often smoothed, or taken from a barometer: their delay is not that of the clocks.
    sigma = motion.sigma @ np.abs(turn.T) * [1.0, 1.0, VERTICAL]
    ned = Motion(time=motion.time, velocity=motion.velocity @ turn.T, sigma=sigma)
    start = Start(
        dcm_f_to_ned=frames.dcm_f_to_ned,
        offset_s=units.offset_s,
        gyro_scale=best.rate_sign * units.gyro,
        gyro_bias=units.gyro_bias,
        accel_scale=best.force_sign * units.accel,
        noise=noise,
    )
    plain = align(windows, increments, ned, start)
    if plain is None:
        return None, None, False
    mounting = find_mounting(windows, ned, plain)
    if lever_arm is not None:
        if mounting is None or not mounting.decided:
            return plain, mounting, False
        lever = mounting.dcm_sensor_to_vehicle.T @ np.array(lever_arm)
        told = align(windows, increments, ned, start, lever_arm=lever)
        if told is None:
            return None, None, False
        return replace(told, offset_per_lever=np.zeros(3)), find_mounting(windows, ned, told), False
    free = _with_lever(windows, increments, ned, replace(start, dcm_f_to_ned=plain.dcm_f_to_ned), plain)
    if free is None or not free.settled:
        return plain, mounting, False
    size = np.abs(free.lever_arm)
    sure = ((size > SURE_LEVER * free.lever_std) & (size > MIN_LEVER_M)).any()
    lead = float((plain.misfit - free.misfit).sum())
    if not sure or free.leads(plain) < DECIDED or lead < DOUBTFUL_LEVER:
        return plain, mounting, False
    if lead < SURE_LEVER_LEAD:
        # Perhaps a lever arm, perhaps vibration: the clocks lie somewhere between.
        apart = math.hypot(plain.offset_std, free.offset_s - plain.offset_s)
        return replace(plain, offset_std=apart), mounting, False
    clear = (size > CLEAR_LEVER * free.lever_std) & (size > CLEAR_LEVER_M)
    found = replace(free, offset_per_lever=np.zeros(3))
    return found, find_mounting(windows, ned, free), bool(clear.any())


def _with_lever(
    windows: Windows, increments: Increments, ned: Motion, start: Start, plain: Alignment
) -> Alignment | None:
    """Fit clocks and lever arm together.

    At one speed an antenna ahead of the IMU looks almost like clocks that are apart, and what tells the two apart is
    quadratic: there are two answers, and the one that fits better is found from where the search begins.
    """

    def search(lever: FloatArray, offset_s: float) -> Alignment | None:
        begun = replace(start, offset_s=offset_s)
        return align(windows, increments, ned, begun, lever_std=LEVER_STD, lever_start=lever)

    first = search(np.zeros(3), plain.offset_s)
    if first is None or not (np.abs(first.lever_arm) > SURE_LEVER * first.lever_std).any():
        return first
    per_metre = float(np.linalg.norm(first.offset_per_lever))
    ahead = LEVER_STD * first.offset_per_lever / max(per_metre, 1e-9)
    # One metre ahead is the time in which the vehicle drives it; a fit that is lost may say less.
    shift = LEVER_STD * max(per_metre, 1.0 / max(float(np.median(ned.speed)), MIN_SPEED))
    best = first if first.settled else None
    for side in (1.0, -1.0):
        other = search(side * ahead, plain.offset_s - side * shift)
        if other is not None and other.settled and (best is None or other.leads(best) > 0.0):
            best = other
    return best
