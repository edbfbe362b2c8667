"""How well a log was recorded: rates, gaps, readings at their limits or stuck, what the sensors read at rest, noise."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.analysis.noise import densities
from levelhead.conventions import AXES, GRAVITY, FloatArray
from levelhead.errors import LogError
from levelhead.logs.log import Log
from levelhead.preflight.findings import Finding, Verdict
from levelhead.preflight.windows import Motion

GAP_S: Final = 0.2
"""A longer pause between IMU samples is a gap, s."""
SLOW_IMU_HZ: Final = 20.0
SLOW_GNSS_HZ: Final = 0.5
CLIP_RUN: Final = 3
"""Samples in a row at the largest reading of the log that are no coincidence."""
STUCK_S: Final = 1.1
STUCK_SPEED: Final = 2.0
"""Above this speed no axis of a sensor is still, m/s: a constant reading is a stuck one, not a quantised rest."""
REST_SPEED: Final = 0.2
REST_S: Final = 5.0
REST_RATE: Final = math.radians(1.0)
"""At rest the gyros' mean over a second stays within this of its median, rad/s."""

BoolArray = NDArray[np.bool_]


def health(log: Log, motion: Motion) -> list[Finding]:
    """Return the findings on how a log, already in SI and in body axes, was recorded."""
    return [
        finding
        for finding in (
            _rates(log),
            _gaps(log),
            _clipping(log),
            _stuck(log, motion),
            _rest(log, motion),
            _noise(log),
            _compensated(log),
        )
        if finding is not None
    ]


def _rates(log: Log) -> Finding:
    imu, gnss = (1.0 / float(np.median(np.diff(t))) if t.size > 1 else 0.0 for t in (log.time, log.gnss_time))
    jitter = float(np.percentile(np.abs(np.diff(log.time) * imu - 1.0), 95.0))
    values: dict[str, object] = {"imu_rate_hz": imu, "gnss_rate_hz": gnss, "imu_jitter": jitter}
    text = f"IMU {imu:.1f} Hz (95 % of the intervals within {100.0 * jitter:.0f} % of that), GNSS {gnss:.1f} Hz."
    slow = imu < SLOW_IMU_HZ or gnss < SLOW_GNSS_HZ
    if slow:
        text += f" Record at {SLOW_IMU_HZ:g} Hz and {SLOW_GNSS_HZ:g} Hz at least."
    return Finding(name="rates", verdict=Verdict.WARNING if slow else Verdict.FINE, text=text, values=values)


def _gaps(log: Log) -> Finding:
    steps = np.diff(log.time)
    gaps = steps[steps > max(GAP_S, 3.0 * float(np.median(steps)))]
    values: dict[str, object] = {"count": int(gaps.size), "longest_s": float(gaps.max(initial=0.0))}
    if gaps.size == 0:
        return Finding(name="gaps", verdict=Verdict.FINE, text="The IMU data has no gaps.", values=values)
    text = f"The IMU data has {gaps.size} gaps, the longest of {gaps.max():.2f} s: no bias is learnt across them."
    return Finding(name="gaps", verdict=Verdict.WARNING, text=text, code="W_GAP", values=values)


def _clipping(log: Log) -> Finding | None:
    shares = {}
    for name in ("gyro", "accel"):
        readings = np.abs(getattr(log, name))
        for i, axis in enumerate(AXES):
            limit = float(readings[:, i].max())
            clipped = _in_runs(readings[:, i] >= limit * (1.0 - 1e-9), CLIP_RUN) if limit > 0.0 else np.zeros(1, bool)
            if clipped.any() and not _mostly_constant(readings[:, i]):
                shares[f"{name} {axis}"] = float(clipped.mean())
    if not shares:
        return None
    shown = ", ".join(f"{name} {100.0 * share:.2g} %" for name, share in shares.items())
    text = f"Readings stay at their largest value, as if the sensor's range ended there: {shown} of the samples."
    return Finding(name="clipping", verdict=Verdict.WARNING, text=text, code="W_CLIP", values=dict(shares))


def _mostly_constant(readings: FloatArray) -> bool:
    """Return whether an axis hardly changes at all: that is stuck, not clipped."""
    return bool((np.diff(readings) == 0.0).mean() > 0.5)


def _in_runs(flags: BoolArray, length: int) -> BoolArray:
    """Return the flags that stand in runs of at least this length."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    kept = np.zeros_like(flags)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - start >= length:
            kept[start:stop] = True
    return kept


def _stuck(log: Log, motion: Motion) -> Finding | None:
    speed = np.interp(log.time, motion.time, motion.speed, left=0.0, right=0.0)
    length = max(2, math.ceil(STUCK_S / float(np.median(np.diff(log.time)))))
    stuck = {}
    for name in ("gyro", "accel"):
        same = np.concatenate((np.diff(getattr(log, name), axis=0) == 0.0, np.zeros((1, 3), dtype=np.bool_)))
        for i, axis in enumerate(AXES):
            rows = _in_runs(same[:, i] & (speed > STUCK_SPEED), length)
            if rows.any():
                stuck[f"{name} {axis}"] = float(log.time[rows.argmax()])
    if not stuck:
        return None
    shown = ", ".join(f"{name} from {start:.1f} s" for name, start in stuck.items())
    text = f"Readings do not change for more than {STUCK_S:g} s while the vehicle drives: {shown}. The sensor is stuck."
    return Finding(name="stuck sensor", verdict=Verdict.WARNING, text=text, code="E_STUCK", values=dict(stuck))


def _rest(log: Log, motion: Motion) -> Finding:
    """Return what the sensors read while the vehicle stands: a bias in itself."""
    speed = np.interp(log.time, motion.time, motion.speed, left=np.inf, right=np.inf)
    per_block = max(1, round(1.0 / float(np.median(np.diff(log.time)))))
    blocks = log.time.size // per_block
    if blocks < REST_S:
        return Finding(name="rest", verdict=Verdict.NOTED, text="The log is too short to find it standing.")

    def blocked(values: FloatArray) -> FloatArray:
        return values[: blocks * per_block].reshape(blocks, per_block, -1)

    gyro, accel = blocked(log.gyro).mean(axis=1), blocked(log.accel).mean(axis=1)
    slow = blocked(speed[:, None]).max(axis=(1, 2)) < REST_SPEED
    still = _in_runs(slow, int(REST_S))
    if still.any():
        still &= (np.abs(gyro - np.median(gyro[still], axis=0)) < REST_RATE).all(axis=1)
    seconds = float(still.sum() * per_block * np.median(np.diff(log.time)))
    if seconds < REST_S:
        text = "The vehicle never stands for five seconds; a standstill would tell the gyro biases by itself."
        return Finding(name="rest", verdict=Verdict.NOTED, text=text)
    rate = np.degrees(gyro[still].mean(axis=0))
    excess = float(np.linalg.norm(accel[still], axis=1).mean()) - GRAVITY
    shown = ", ".join(f"{v:.3f}" for v in rate)
    text = f"At rest for {seconds:.0f} s: gyros ({shown}) deg/s, size of the specific force {excess:+.3f} m/s^2 off."
    values: dict[str, object] = {
        "seconds": seconds,
        "gyro_deg_s": [float(v) for v in rate],
        "norm_excess_m_s2": excess,
    }
    return Finding(name="rest", verdict=Verdict.NOTED, text=text, values=values)


def _noise(log: Log) -> Finding | None:
    try:
        gyro, accel = densities(log.time, log.gyro), densities(log.time, log.accel)
    except LogError:
        return None
    shown_gyro = ", ".join(f"{math.degrees(v):.2g}" for v in gyro)
    shown_accel = ", ".join(f"{v:.2g}" for v in accel)
    text = (
        f"Noise with vibration: gyros ({shown_gyro}) deg/s/sqrt(Hz), accelerometers ({shown_accel}) m/s^2/sqrt(Hz); "
        "the least density over 0.02, 0.05 and 0.1 s."
    )
    values: dict[str, object] = {
        "gyro_deg_s_sqrt_hz": [math.degrees(v) for v in gyro],
        "accel_m_s2_sqrt_hz": [float(v) for v in accel],
    }
    return Finding(name="noise", verdict=Verdict.NOTED, text=text, values=values)


def _compensated(log: Log) -> Finding | None:
    by = log.meta.get("compensated")
    if not isinstance(by, str):
        return None
    return Finding(name="compensated readings", verdict=Verdict.WARNING, text=by, code="W_COMPENSATED")
