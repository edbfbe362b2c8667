"""What an export is made of, and what all targets share: biases, the axes they are in, what was taken off before."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from levelhead.conventions import AXES, FloatArray
from levelhead.errors import LogError
from levelhead.estimators.base import Result
from levelhead.events import Event
from levelhead.logs.log import Log
from levelhead.version import __version__

NO_PART: Final = 1e-9
"""Below this an element of a rotation is rounding: the axis has no part in the other one."""
LONGEST_TEXT: Final = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class Biases:
    """Biases of one sensor triad: `value` and `std` (3,), rad/s or m/s^2, NaN where not known."""

    value: FloatArray
    std: FloatArray

    @property
    def known(self) -> list[bool]:
        """Whether each axis has a bias."""
        return [bool(known) for known in np.isfinite(self.value)]

    def turned(self, dcm: FloatArray) -> Biases:
        """Return them in other axes, ``v_new = dcm v``: unknown where an unknown axis has a part.

        The sigma takes the axes' errors as independent, for a result has no covariance between them.
        """
        weights = np.where(np.abs(dcm) > NO_PART, dcm, 0.0)

        def mix(weights: FloatArray, values: FloatArray) -> FloatArray:
            # 0 times NaN is NaN, but an axis without a part does not matter.
            return np.array([values[row != 0.0] @ row[row != 0.0] for row in weights])

        return Biases(value=mix(weights, self.value), std=np.sqrt(mix(weights**2, self.std**2)))


@dataclass(frozen=True, kw_only=True)
class OldOffsets:
    """What an autopilot took off the readings before they were recorded.

    Attributes
    ----------
    applied : bool
        Whether anything was taken off: then an estimate is what was left, and comes on top.
    by : str
        By what, as a sentence; empty where the readings are raw.
    parameters : mapping or None
        The autopilot's parameters at the time of the drive, by name; None where they are not known.
    """

    applied: bool
    by: str
    parameters: Mapping[str, float] | None


def old_offsets(log: Log, given: Mapping[str, float] | None = None) -> OldOffsets:
    """Return what is known of the offsets that the log's readings had taken off.

    Parameters
    ----------
    log : Log
        ``meta["compensated"]`` says that something was taken off, ``meta["calibration"]`` has the log's parameters.
    given : mapping, optional
        Parameters from the user's file. Those in the log win, for they were at work. Where the log has none and says
        nothing, giving them means that they were taken off.
    """
    own = log.meta.get("calibration")
    by = str(log.meta.get("compensated") or "")
    from_log = _numbers(own) if isinstance(own, Mapping) and own else None
    if from_log is None and given is None:
        return OldOffsets(applied=bool(by), by=by, parameters=None)
    applied = bool(by) or from_log is None
    return OldOffsets(applied=applied, by=by, parameters={**(given or {}), **(from_log or {})})


def _numbers(values: Mapping[object, object]) -> dict[str, float]:
    """Return the finite numbers among the values."""
    return {str(k): float(v) for k, v in values.items() if isinstance(v, int | float) and math.isfinite(v)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """What a target writes from.

    Attributes
    ----------
    gyro, accel : Biases
        At the end of the log, body axes forward, right, down, rad/s and m/s^2.
    dcm_file_to_body : ndarray (3, 3) or None
        Rotation from the axes of the log's file to the body; None where the log does not tell (taken as one).
    old : OldOffsets
        What was taken off before recording.
    slot : int or None
        Which of the autopilot's IMUs, as its parameters count them, where the user says.
    device_ids, imu_instance : mapping, int or None
        The same from the log: the sensors' IDs (``gyro``, ``accel``), or the IMU's number from 0.
    latency_s : float or None
        How late the stamps of the GNSS are against the IMU's, s.
    no_delay : str
        Why that is not the delay that an autopilot reckons with, as a sentence; empty where it is.
    mounting_deg : mapping or None
        Attitude of the IMU relative to the vehicle: ``yaw``, ``roll``, ``pitch``, deg.
    params : mapping
        Constants of the method.
    """

    gyro: Biases
    accel: Biases
    dcm_file_to_body: FloatArray | None
    old: OldOffsets
    slot: int | None
    device_ids: Mapping[str, int]
    imu_instance: int | None
    latency_s: float | None
    no_delay: str
    mounting_deg: Mapping[str, float] | None
    params: Mapping[str, object]
    log_info: Mapping[str, object]
    method: str
    events: tuple[Event, ...]

    @property
    def source(self) -> str:
        """Name of the log, safe to print."""
        return plain(str(self.log_info.get("source") or "a log in memory"))

    def recorded(self, sensor: str) -> Biases:
        """Return the biases of ``gyro`` or ``accel`` in the axes of the log's file."""
        biases: Biases = getattr(self, sensor)
        return biases if self.dcm_file_to_body is None else biases.turned(self.dcm_file_to_body.T)


@dataclass(frozen=True, kw_only=True)
class Document:
    """A file to be written, and what its user must know: sentences that stand in the file too, as comments."""

    text: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """A target: its name, what it is, what its file is called, and how the file is made."""

    name: str
    title: str
    file_name: str
    render: Callable[[Calibration], Document]
    has_biases: bool = True
    adds_to_old: bool = False


def calibration_of(
    result: Result, log: Log, *, given: Mapping[str, float] | None = None, slot: int | None = None
) -> Calibration:
    """Gather what there is to export.

    Raises
    ------
    LogError
        When the result is not of this log, or ``meta["dcm_file_to_body"]`` is no rotation.
    """
    if not np.array_equal(result.time, log.time):
        raise LogError(
            f"The result has {result.time.size} samples at other time stamps than the log's {log.time.size}; export "
            "with the log that the result was estimated from."
        )
    ids = log.meta.get("imu_device_ids")
    instance = log.meta.get("imu_instance")
    mounting = log.meta.get("mounting_deg")
    latency = log.meta.get("latency_s")
    return Calibration(
        gyro=_masked(result.gyro_bias[-1], result.gyro_bias_std[-1], result.known_gyro),
        accel=_masked(result.accel_bias[-1], result.accel_bias_std[-1], result.known_accel),
        dcm_file_to_body=_rotation(log.meta.get("dcm_file_to_body")),
        old=old_offsets(log, given),
        slot=slot,
        device_ids={k: int(v) for k, v in _numbers(ids).items()} if isinstance(ids, Mapping) else {},
        imu_instance=instance if isinstance(instance, int) else None,
        latency_s=float(latency) if isinstance(latency, int | float) and math.isfinite(latency) else None,
        no_delay=_no_delay(log),
        mounting_deg=_numbers(mounting) if isinstance(mounting, Mapping) else None,
        params=result.params,
        log_info=log.describe(),
        method=result.method,
        events=result.events,
    )


def _no_delay(log: Log) -> str:
    if log.meta.get("gnss_source"):
        return "The GNSS data was in a file of its own, whose delay is not the autopilot's; no delay is written."
    if log.meta.get("gnss_stamp") == "timestamp_sample":
        # PX4 takes its delay off the arrival only where the driver tells no time of the fix.
        return "The log has the times of the fixes, which PX4 takes as they are; no delay is written."
    return ""


def _masked(value: FloatArray, std: FloatArray, known: tuple[bool, bool, bool]) -> Biases:
    usable = np.array(known) & np.isfinite(value)
    return Biases(value=np.where(usable, value, np.nan), std=np.where(usable, std, np.nan))


def _rotation(value: object) -> FloatArray | None:
    """Return the rotation as an array; a mirror image is one that a file's axes may need."""
    if value is None:
        return None
    try:
        dcm = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        dcm = np.empty(0)
    # Readers build it from angles: products of sines are right to 1e-15, a typed matrix to six digits.
    if dcm.shape != (3, 3) or not np.allclose(dcm @ dcm.T, np.eye(3), atol=1e-5):
        raise LogError(f"The log's dcm_file_to_body is {value!r}, which is no rotation of three axes.")
    return dcm


def refuse_unknown(calibration: Calibration, *, only_known: bool) -> None:
    """Raise LogError where a bias was never observable, unless only the known ones are wanted."""
    triads = {"gyro": calibration.gyro.known, "accelerometer": calibration.accel.known}
    unknown = [f"{name} {axis}" for name, known in triads.items() for axis, k in zip(AXES, known, strict=True) if not k]
    if not unknown or (only_known and len(unknown) < 2 * len(AXES)):
        return
    what = f"{', '.join(unknown)} {'was' if len(unknown) == 1 else 'were'} never observable on {calibration.source}"
    if len(unknown) == 2 * len(AXES):
        raise LogError(f"No calibration is written: {what}. Drive longer, with turns both ways and changes of speed.")
    raise LogError(
        f"No calibration is written: {what}. Drive with turns both ways and changes of speed, choose another method, "
        "or pass --only-known to write the others."
    )


def plain(text: str) -> str:
    """Return text that cannot leave its comment: one line of printable ASCII, not too long."""
    printable = "".join(c if c.isprintable() else "?" for c in text)
    return printable.encode("ascii", "backslashreplace").decode()[:LONGEST_TEXT]


def heading(calibration: Calibration, title: str, *lines: str) -> list[str]:
    """Return the comment lines that every file begins with: where it comes from, and the estimate's warnings."""
    info = calibration.log_info
    rows = [
        f"{title}, by levelhead {__version__}",
        f"From {calibration.source}, {info['duration_s']:.0f} s, method {plain(calibration.method)}; as at the end of "
        "the log.",
    ]
    if info["completeness"] != "complete":
        rows.append(f"The log was read only in part ({plain(str(info['completeness']))}).")
    rows += [f"{e.code}: {plain(e.text)}" for e in calibration.events if e.code[:2] in ("W_", "E_")]
    return [f"# {row}" for row in (*rows, *lines)]
