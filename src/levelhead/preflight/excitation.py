"""What the driving can teach: how much of it turns, brakes and stands, and which biases the filter knows at its end."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from levelhead.analysis.estimation import estimate
from levelhead.conventions import AXES
from levelhead.errors import LogError
from levelhead.logs.log import Log
from levelhead.preflight.findings import Finding, Verdict
from levelhead.preflight.windows import Motion

TURN: Final = math.radians(3.0)
"""Yaw rates beyond this are turns, rad/s."""
PUSH: Final = 0.3
"""Changes of speed beyond this are braking or accelerating, m/s^2."""
STANDING: Final = 0.2
MIN_SPEED: Final = 1.0


def excitation(log: Log, motion: Motion) -> list[Finding]:
    """Return findings on what a log, already put right, can teach.

    Parameters
    ----------
    log : Log
        In SI, body axes and NED.
    motion : Motion
        Its GNSS velocities.
    """
    findings = [_driving(motion)]
    known = _known(log)
    return findings if known is None else [*findings, known]


def _driving(motion: Motion) -> Finding:
    """Return the shares of the time that the vehicle turns left and right, brakes or accelerates, and stands."""
    duration = np.diff(motion.time)
    held = np.minimum(duration, 2.0)
    speed = 0.5 * (motion.speed[1:] + motion.speed[:-1])
    course = np.arctan2(motion.velocity[:, 1], motion.velocity[:, 0])
    turn = np.diff(course)
    turn -= 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    width = min(duration.size, max(1, round(1.0 / float(np.median(duration)))))
    smooth = np.ones(width) / width
    rate = np.convolve(np.where(speed > MIN_SPEED, turn / duration, 0.0), smooth, mode="same")
    push = np.convolve(np.diff(motion.speed) / duration, smooth, mode="same")
    total = float(held.sum())
    shares = {
        "turning right": float(held[rate > TURN].sum()) / total,
        "turning left": float(held[rate < -TURN].sum()) / total,
        "braking or accelerating": float(held[np.abs(push) > PUSH].sum()) / total,
        "standing": float(held[speed < STANDING].sum()) / total,
    }
    shown = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares.items())
    few = min(shares["turning right"], shares["turning left"]) < 0.01
    text = f"Of the time {shown}."
    if few:
        text += " Accelerometer biases are told from tilt by turns to both sides: drive some."
    return Finding(name="driving", verdict=Verdict.WARNING if few else Verdict.FINE, text=text, values=dict(shares))


def _known(log: Log) -> Finding | None:
    """Return which biases a forward filter knows at the end of the drive, and how well."""
    try:
        result = estimate(log, "phasor")
    except LogError:
        return None
    known = result.summary()["known"]
    names = []
    values: dict[str, object] = {"known": known}
    for what, unit, scale in (("gyro", "deg/s", 180.0 / math.pi), ("accel", "m/s^2", 1.0)):
        sigma = getattr(result, f"{what}_bias_std")[-1] * scale
        values[f"{what}_std"] = [float(s) if np.isfinite(s) else None for s in sigma]
        flags = known[what] if isinstance(known, dict) else [False] * 3
        shown = ", ".join(
            f"{axis} {s:.2g}" if flag else f"{axis} no" for axis, s, flag in zip(AXES, sigma, flags, strict=True)
        )
        names.append(f"{what} {shown} {unit}")
    text = f"What this drive teaches, one sigma at its end: {'; '.join(names)}."
    whole = isinstance(known, dict) and all(known["gyro"]) and all(known["accel"][:2])
    return Finding(name="biases", verdict=Verdict.FINE if whole else Verdict.WARNING, text=text, values=values)
