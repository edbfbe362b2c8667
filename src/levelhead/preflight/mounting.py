"""Where forward and down are in the sensor's axes: direction of travel and gravity, seen from the windows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.preflight.alignment import Alignment
from levelhead.preflight.windows import Motion, Windows, epoch_times

MIN_SPEED: Final = 1.5
"""Slower than this a direction of travel is not taken, m/s."""
SLIP_STD: Final = np.radians(0.5)
"""One sigma of a window's mean direction of travel about the vehicle's axis, besides what the fit leaves, rad."""
AXLE_STD: Final = 2.0
"""One sigma of the distance from the axle that does not steer to the antenna, m: in a turn the course leads by it."""
MIN_VOICES: Final = 2.0
"""Windows' worth of information below which nothing is decided."""
ONE_WAY: Final = 0.7
"""Share of the driving that must be in one direction, so that forward and backward can be told apart."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mounting:
    """Attitude of the sensor's axes in the vehicle.

    Attributes
    ----------
    dcm_sensor_to_vehicle : ndarray, shape (3, 3)
        To forward, right, down; forward and down as the drive shows them in its mean.
    yaw_std : float
        One sigma about the vertical, rad.
    one_way : float
        Share of the driving along the direction that is taken as forward.
    axle_m : float
        How far the antenna is ahead of the point that does not slip, m, as the course in turns shows.
    voices : float
        How many windows' worth of information there was.
    """

    dcm_sensor_to_vehicle: FloatArray
    yaw_std: float
    one_way: float
    axle_m: float
    voices: float

    @property
    def coherent(self) -> bool:
        """Whether the line of travel is known to a few degrees: it is not where the fit is a wrong one."""
        return self.voices >= MIN_VOICES and self.yaw_std < np.radians(4.0)

    @property
    def decided(self) -> bool:
        """Whether forward is known to a few degrees."""
        return self.coherent and self.one_way >= ONE_WAY


def find_mounting(windows: Windows, motion: Motion, alignment: Alignment) -> Mounting | None:
    """Find forward and down.

    Parameters
    ----------
    windows, motion
        The stretches and the GNSS velocities in NED.
    alignment : Alignment
        Of the readings with the right signs, so that it is a rotation to NED.

    Returns
    -------
    Mounting or None
        None where the vehicle never moved.
    """
    travel, down, rate = _directions(windows, motion, alignment)
    moving = np.isfinite(travel).all(axis=-1) & alignment.known[:, None]
    if moving.sum() < 10:
        return None
    weight = np.where(moving.any(axis=1), 1.0 / (alignment.attitude_std[:, 2] ** 2 + SLIP_STD**2), 0.0)
    weight = np.where(alignment.known, weight, 0.0)
    vertical = _unit((down[moving] * weight[np.nonzero(moving)[0], None]).sum(axis=0))
    first = _unit(np.cross([0.0, 1.0, 0.0] if abs(vertical[1]) < 0.9 else [0.0, 0.0, 1.0], vertical))
    second = np.cross(vertical, first)
    angle = np.where(moving, np.arctan2(travel @ second, travel @ first), np.nan)
    forward = _axis(angle, weight, moving)
    off = np.angle(np.exp(1j * (angle - forward)))
    reverse = np.abs(off) > 0.5 * np.pi
    per_epoch = weight[:, None] * moving
    one_way = 1.0 - float((per_epoch * reverse).sum() / per_epoch.sum())
    if one_way < 0.5:
        forward, one_way = forward + np.pi, 1.0 - one_way
        reverse = ~reverse
    off = np.angle(np.exp(1j * (angle - forward + np.pi * reverse)))
    lead = np.where(moving, rate @ vertical / np.maximum(motion.speed[np.maximum(windows.epochs, 0)], MIN_SPEED), 0.0)
    yaw, axle, yaw_std = _fit(np.nan_to_num(off), np.where(reverse, -lead, lead), weight, moving)
    share = weight / weight.sum()
    yaw_std = float(np.sqrt(yaw_std**2 + share @ alignment.heading_covariance @ share))
    forward += yaw
    ahead = np.cos(forward) * first + np.sin(forward) * second
    return Mounting(
        dcm_sensor_to_vehicle=np.stack((ahead, np.cross(vertical, ahead), vertical)),
        yaw_std=yaw_std,
        one_way=one_way,
        axle_m=axle,
        voices=float(weight.sum() * SLIP_STD**2),
    )


def _directions(windows: Windows, motion: Motion, alignment: Alignment) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return direction of travel, down and angular rate (rad/s) at the epochs, sensor axes (w, e, 3); NaN when slow."""
    when = epoch_times(windows, motion) - alignment.offset_s
    step = windows.offsets[1]
    place = (when - windows.start[:, None]) / step
    node = np.clip(np.rint(np.nan_to_num(place)).astype(np.intp), 1, windows.offsets.size - 2)
    rows = np.arange(windows.start.size)[:, None]
    to_ned = alignment.dcm_f_to_ned[:, None] @ alignment.attitude[rows, node]
    velocity = motion.velocity[np.maximum(windows.epochs, 0)]
    speed = np.linalg.norm(velocity, axis=-1)
    fast = windows.present & (speed > MIN_SPEED)
    unit = np.where(fast[..., None], velocity / np.maximum(speed, 1e-9)[..., None], np.nan)
    turn = alignment.attitude[rows, node - 1].swapaxes(-1, -2) @ alignment.attitude[rows, node + 1]
    rate = np.stack([turn[..., 2, 1], turn[..., 0, 2], turn[..., 1, 0]], axis=-1) / (2.0 * step)
    return np.einsum("weji,wej->wei", to_ned, unit), to_ned[..., 2, :], rate


def _axis(angle: FloatArray, weight: FloatArray, moving: NDArray[np.bool_]) -> float:
    """Return the line of travel, half a turn left open: the mean of doubled angles."""
    doubled = np.where(moving, np.exp(2j * np.nan_to_num(angle)), 0.0)
    return 0.5 * float(np.angle((weight[:, None] * doubled).sum()))


def _fit(
    off: FloatArray, lead: FloatArray, weight: FloatArray, moving: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """Fit ``off = yaw + axle lead``; the yaw's sigma from how windows agree and what they know of themselves."""
    count = np.maximum(moving.sum(axis=1), 1)[:, None]
    w = weight[:, None] * moving / count
    rows = np.stack((np.ones_like(lead), lead), axis=-1)
    normal = np.einsum("wei,we,wej->ij", rows, w, rows) + np.diag([0.0, 1.0 / AXLE_STD**2])
    inverse = np.linalg.inv(normal)
    solution = inverse @ np.einsum("wei,we,we->i", rows, w, off)
    left = off - rows @ solution
    scores = np.einsum("wei,we,we->wi", rows, w, left)
    sandwich = inverse @ (scores.T @ scores) @ inverse
    voices = float(weight.sum() ** 2 / max(float((weight**2).sum()), 1e-12))
    # Few windows agree by chance: Student's t for two degrees of freedom is 2.3 times as wide as the normal at 95 %.
    return (
        float(solution[0]),
        float(solution[1]),
        float(np.sqrt(max(sandwich[0, 0] * (1.0 + 4.0 / max(voices, 1.0)), inverse[0, 0]))),
    )


def _unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)
