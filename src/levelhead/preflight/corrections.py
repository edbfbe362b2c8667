"""What is put right in a log: units, axes, signs, frames, clocks, mounting; and what the user told of them."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np

from levelhead.conventions import UNIT_FACTORS, FloatArray
from levelhead.errors import UsageError
from levelhead.estimators.params import Triple
from levelhead.logs.ecef import ned_from_ecef
from levelhead.logs.log import Log
from levelhead.logs.mapping import rotation_321
from levelhead.preflight.frames import ECEF, VELOCITY_FRAMES


@dataclass(frozen=True, kw_only=True)
class Told:
    """What the user says of a log; the preflight takes it as given.

    Attributes
    ----------
    axes : str, optional
        Forward, right, down as axes of the file: "-x,y,-z".
    gyro_unit, accel_unit : str, optional
        Of the readings: "deg/s", "g"...
    velocity_frame : str, optional
        "NED", "ENU", "NEU" (up) or "ECEF".
    latency_s : float, optional
        How much later than the IMU's the GNSS stamps are, s.
    mounting_yaw : float, optional
        How far the IMU's forward axis points to the right of the vehicle's, rad.
    lever_arm : (3,), optional
        From the IMU to the antenna, vehicle axes, m.
    """

    axes: str | None = None
    gyro_unit: str | None = None
    accel_unit: str | None = None
    velocity_frame: str | None = None
    latency_s: float | None = None
    mounting_yaw: float | None = None
    lever_arm: Triple | None = None

    def __post_init__(self) -> None:
        for name, unit, canonical in (("gyro", self.gyro_unit, "rad/s"), ("accel", self.accel_unit, "m/s^2")):
            if unit is not None and unit not in UNIT_FACTORS[canonical]:
                known = ", ".join(UNIT_FACTORS[canonical])
                raise UsageError(f"The {name} unit {unit!r} is not known; use one of {known}.")
        if self.velocity_frame is not None and self.velocity_frame not in (*VELOCITY_FRAMES, ECEF):
            known = ", ".join((*VELOCITY_FRAMES, ECEF))
            raise UsageError(f"The velocity frame {self.velocity_frame!r} is not known; use one of {known}.")
        arm = self.lever_arm or ()
        for what, numbers in (
            ("latency", (self.latency_s,)),
            ("mounting yaw", (self.mounting_yaw,)),
            ("lever arm", arm),
        ):
            if not all(number is None or math.isfinite(number) for number in numbers):
                shown = ", ".join(str(number) for number in numbers)
                raise UsageError(f"The {what} is {shown}; pass finite numbers.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrections:
    """What turns the log as read into the log as it should be.

    Attributes
    ----------
    gyro_factor, accel_factor : float
        Of the units.
    gyro_dcm, accel_dcm : ndarray, shape (3, 3)
        From the file's axes to the body's; they differ where one of the sensors has a wrong sign.
    velocity_frame : str
        That of the velocities as read: one of `VELOCITY_FRAMES`, or `ECEF`.
    latency_s : float
        Taken off the GNSS stamps at the log's middle.
    clock_drift : float
        By how much `latency_s` grows per second of the log.
    """

    gyro_factor: float = 1.0
    accel_factor: float = 1.0
    gyro_dcm: FloatArray = field(default_factory=lambda: np.eye(3))
    accel_dcm: FloatArray = field(default_factory=lambda: np.eye(3))
    velocity_frame: str = "NED"
    latency_s: float = 0.0
    clock_drift: float = 0.0

    def apply(self, log: Log) -> Log:
        """Return the log with everything put right; what is as it should be stays so to the bit."""
        changes: dict[str, object] = {}
        for name, factor, dcm in (
            ("gyro", self.gyro_factor, self.gyro_dcm),
            ("accel", self.accel_factor, self.accel_dcm),
        ):
            if factor != 1.0 or not np.array_equal(dcm, np.eye(3)):
                changes[name] = (getattr(log, name) * factor) @ dcm.T
        if log.velocity_ned is not None and self.velocity_frame != "NED":
            changes |= _velocity_in_ned(log, self.velocity_frame)
        if self.latency_s or self.clock_drift:
            middle = 0.5 * (log.time[0] + log.time[-1])
            late = self.latency_s + self.clock_drift * (log.gnss_time - middle)
            changes["gnss_time"] = log.gnss_time - late
        return replace(log, **changes) if changes else log  # type: ignore[arg-type]


def _velocity_in_ned(log: Log, frame: str) -> dict[str, object]:
    """Return the velocity columns of a log turned into NED."""
    assert log.velocity_ned is not None  # noqa: S101 - for the type checker: asked by the caller
    if frame != ECEF:
        dcm = VELOCITY_FRAMES[frame]
        changes: dict[str, object] = {"velocity_ned": log.velocity_ned @ dcm.T}
        if log.velocity_std is not None and log.velocity_std.ndim == 2:
            changes["velocity_std"] = log.velocity_std @ np.abs(dcm).T
        return changes
    if log.position_llh is None:
        raise UsageError("Velocities in ECEF need positions beside them to be turned into NED; the log has none.")
    known = np.isfinite(log.position_llh).all(axis=1)
    places = [np.interp(log.gnss_time, log.gnss_time[known], log.position_llh[known, i]) for i in range(3)]
    changes = {"velocity_ned": ned_from_ecef(log.velocity_ned, np.column_stack(places))}
    if log.velocity_std is not None and log.velocity_std.ndim == 2:
        # Which axis is which is lost: their mean, for all three.
        changes["velocity_std"] = np.sqrt((log.velocity_std**2).mean(axis=1))
    return changes


def axes_matrix(text: str) -> FloatArray:
    """Return the matrix from the file's axes to forward, right, down that "-x,y,-z" names; mirrored ones too.

    Raises
    ------
    UsageError
        When it is not three different axes.
    """
    names = [part.strip() for part in text.split(",")]
    matrix = np.zeros((3, 3))
    for row, name in enumerate(names[:3]):
        letter = name.lstrip("+-")
        if letter not in ("x", "y", "z") or len(name) > 2:
            raise UsageError(f"--axes is {text!r}; pass forward, right, down as axes of the file, such as -x,y,-z.")
        matrix[row, "xyz".index(letter)] = -1.0 if name.startswith("-") else 1.0
    if len(names) != 3 or not (np.abs(matrix).sum(axis=0) == 1.0).all():
        raise UsageError(f"--axes is {text!r}; pass three different axes such as -x,y,-z.")
    return matrix


def axes_name(matrix: FloatArray) -> str:
    """Return a signed permutation as "-x,y,-z"."""
    columns = np.abs(matrix).argmax(axis=1)
    return ",".join(("-" if matrix[i, c] < 0 else "") + "xyz"[c] for i, c in enumerate(columns))


def nearest_axes(dcm: FloatArray) -> FloatArray:
    """Return the one of the 24 rotations that only swap and turn axes that lies nearest to a rotation."""
    candidates = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.eye(3)[list(order)] * np.array(signs)[:, None]
            if np.linalg.det(matrix) > 0.0:
                candidates.append(matrix)
    return max(candidates, key=lambda m: float((m * dcm).sum()))


def angles_321(dcm: FloatArray) -> tuple[float, float, float]:
    """Return yaw, pitch, roll of a rotation (3-2-1), rad."""
    return (
        float(np.arctan2(dcm[1, 0], dcm[0, 0])),
        float(-np.arcsin(np.clip(dcm[2, 0], -1.0, 1.0))),
        float(np.arctan2(dcm[2, 1], dcm[2, 2])),
    )


def told_corrections(told: Told) -> Corrections:
    """Return the corrections that follow from what the user says."""
    axes = np.eye(3) if told.axes is None else axes_matrix(told.axes)
    if told.mounting_yaw is not None:
        axes = rotation_321(roll=0.0, pitch=0.0, yaw=told.mounting_yaw) @ axes
    return Corrections(
        gyro_factor=1.0 if told.gyro_unit is None else UNIT_FACTORS["rad/s"][told.gyro_unit],
        accel_factor=1.0 if told.accel_unit is None else UNIT_FACTORS["m/s^2"][told.accel_unit],
        gyro_dcm=axes,
        accel_dcm=axes,
        velocity_frame=told.velocity_frame or "NED",
        latency_s=told.latency_s or 0.0,
    )
