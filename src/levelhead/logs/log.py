"""`Log`: the readings of one drive, in the package's frames and units, checked once on construction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from levelhead.conventions import FloatArray
from levelhead.earth import steps_ned
from levelhead.errors import LogError
from levelhead.estimators.base import Result
from levelhead.events import Event
from levelhead.logs.datum import DATUM_KEY, HEIGHT_KEY, WGS84, declared

MAX_DISTANCE_GAP_S: Final = 2.0
"""Time between GNSS epochs over which the driven distance is not counted, s."""


def _array(name: str, values: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Return a read-only contiguous float64 array of the wanted shape, or raise a sentence."""
    array = np.array(values, dtype=np.float64, order="C")
    wanted = ", ".join("n" if s is None else str(s) for s in shape)
    if array.ndim != len(shape) or any(s is not None and s != have for s, have in zip(shape, array.shape, strict=True)):
        raise LogError(f"{name} has the shape {array.shape}; pass an array of shape ({wanted}).")
    array.flags.writeable = False
    return array


def _check_time(name: str, time: FloatArray) -> None:
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        raise LogError(f"{name} is not a number at row {bad[0] + 1}; every sample needs a time stamp.")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        k = int(back[0])
        raise LogError(
            f"{name} does not advance at row {k + 2}: {time[k + 1]:.6f} s comes after {time[k]:.6f} s "
            f"({back.size} such rows in all). Sort the log and drop repeated stamps."
        )


def _refuse(name: str, bad: NDArray[np.bool_], what: str, remedy: str) -> None:
    """Raise a sentence that names the first of the rows for which `bad` is true."""
    rows = np.flatnonzero(bad if bad.ndim == 1 else bad.any(axis=1))
    if rows.size:
        raise LogError(f"{name} {what} at row {rows[0] + 1} ({rows.size} such rows in all); {remedy}.")


def _check_positions(position_llh: FloatArray | None, position_std: FloatArray | None) -> None:
    """Refuse positions that are no place, and sigmas without a position or without a size."""
    if position_llh is not None:
        _refuse("position_llh", np.isinf(position_llh), "is infinite", "pass NaN where there is no position")
        degrees = "pass radians, np.radians(degrees)"
        latitude, longitude = np.abs(position_llh[:, 0]), np.abs(position_llh[:, 1])
        _refuse("position_llh", latitude > np.pi / 2.0, "has a latitude beyond pi/2 rad (90 degrees)", degrees)
        _refuse("position_llh", longitude > 2.0 * np.pi, "has a longitude beyond 2 pi rad (360 degrees)", degrees)
        no_lat, no_lon, no_height = np.isnan(position_llh).T
        alone = no_lat & no_lon & ~no_height
        _refuse("position_llh", alone, "has a height without latitude and longitude", "pass NaN for the height too")
        half = (no_lat | no_lon | no_height) & ~(no_lat & no_lon & no_height)
        _refuse("position_llh", half, "has part of a position", "pass NaN for all three, or none")
    if position_std is None:
        return
    if position_llh is None:
        raise LogError("position_std is given without positions; pass position_llh too, or leave position_std out.")
    no_size = (position_std <= 0.0) | np.isinf(position_std)
    _refuse("position_std", no_size, "is not positive and finite", "pass NaN where it is not known")


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """An IMU + GNSS log: body frame FRD, navigation frame NED, SI units and radians.

    Parameters
    ----------
    time : array_like, shape (n,)
        Time stamps of the IMU samples, seconds from the start of the log, strictly increasing.
    gyro, accel : array_like, shape (n, 3)
        Angular rate (rad/s) and specific force (m/s^2) readings, body FRD. Level and at rest the
        accelerometer reads (0, 0, -g).
    gnss_time : array_like, shape (m,)
        Time stamps of the GNSS epochs, on the IMU's clock, strictly increasing.
    velocity_ned : array_like, shape (m, 3), optional
        GNSS velocity, m/s, NED. A log without it needs `position_llh`.
    velocity_std : array_like, shape (m,) or (m, 3), optional
        One sigma of the velocity, m/s.
    position_llh : array_like, shape (m, 3), optional
        Latitude (rad), longitude (rad) and height (m) in WGS84 or a datum within a metre of it; a row is whole, or
        NaN altogether.
    position_std : array_like, shape (m,) or (m, 3), optional
        One sigma of the position, m; NaN where it is not known.
    wheel_speed : array_like, shape (n,), optional
        Speed over ground that the wheels tell at the IMU's stamps, m/s along the vehicle's forward axis, negative in
        reverse; NaN where there is none.
    meta : mapping, optional
        What is known about the log's origin: ``source``, ``format``, ``completeness``
        (``complete | truncated | malformed_record``), ``epoch``, ``datum`` ("WGS84" unless it says otherwise),
        ``height`` (what heights count from: "ellipsoidal" or "mean sea level")...
    events : tuple of Event, optional
        What happened while the log was read.

    Raises
    ------
    LogError
        When shapes disagree, time does not advance, a reading is not finite, a position is not on the globe or only
        half there, a sigma of a position is none, or the datum is not one that lies within a metre of WGS84.
    """

    time: FloatArray
    gyro: FloatArray
    accel: FloatArray
    gnss_time: FloatArray
    velocity_ned: FloatArray | None = None
    velocity_std: FloatArray | None = None
    position_llh: FloatArray | None = None
    position_std: FloatArray | None = None
    wheel_speed: FloatArray | None = None
    meta: Mapping[str, object] = field(default_factory=dict)
    events: tuple[Event, ...] = ()

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        time = _array("time", self.time, (None,))
        gnss_time = _array("gnss_time", self.gnss_time, (None,))
        n, m = time.size, gnss_time.size
        if n < 2:
            raise LogError(f"The log has {n} IMU samples; at least 2 are needed.")
        _check_time("time", time)
        _check_time("gnss_time", gnss_time)
        put("time", time)
        put("gnss_time", gnss_time)
        for name in ("gyro", "accel"):
            array = _array(name, getattr(self, name), (n, 3))
            bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
            if bad.size:
                raise LogError(
                    f"{name} is not finite at row {bad[0] + 1} ({bad.size} such rows in all); remove those rows."
                )
            put(name, array)
        for name in ("velocity_ned", "position_llh"):
            if getattr(self, name) is not None:
                put(name, _array(name, getattr(self, name), (m, 3)))
        for name in ("velocity_std", "position_std"):
            value = getattr(self, name)
            if value is not None:
                put(name, _array(name, value, (m,) if np.ndim(value) == 1 else (m, 3)))
        if self.wheel_speed is not None:
            put("wheel_speed", _array("wheel_speed", self.wheel_speed, (n,)))
            _refuse("wheel_speed", np.isinf(self.wheel_speed), "is infinite", "pass NaN where there is none")
        if self.velocity_ned is None and self.position_llh is None:
            raise LogError("The log has neither GNSS velocities nor positions; pass velocity_ned or position_llh.")
        _check_positions(self.position_llh, self.position_std)
        datum, height = (self.meta.get(key, default) for key, default in ((DATUM_KEY, WGS84), (HEIGHT_KEY, None)))
        known = declared("The log's meta", datum=str(datum), height=None if height is None else str(height))
        put("meta", MappingProxyType({**self.meta, **known}))

    @property
    def duration(self) -> float:
        """Time from the first to the last IMU sample, s."""
        return float(self.time[-1] - self.time[0])

    def slice(self, start: float, stop: float) -> Log:
        """Return the part of the log with ``start <= time < stop``; the clock is kept.

        Parameters
        ----------
        start, stop : float
            Seconds on the log's clock.

        Raises
        ------
        LogError
            When fewer than two IMU samples lie in the span.
        """
        imu = (self.time >= start) & (self.time < stop)
        gnss = (self.gnss_time >= start) & (self.gnss_time < stop)
        if imu.sum() < 2:
            raise LogError(
                f"Between {start:g} and {stop:g} s the log has {int(imu.sum())} IMU samples; at least 2 are needed. "
                f"The log runs from {self.time[0]:g} to {self.time[-1]:g} s."
            )

        def pick(values: FloatArray | None) -> FloatArray | None:
            return None if values is None else values[gnss]

        return replace(
            self,
            time=self.time[imu],
            gyro=self.gyro[imu],
            accel=self.accel[imu],
            gnss_time=self.gnss_time[gnss],
            velocity_ned=pick(self.velocity_ned),
            velocity_std=pick(self.velocity_std),
            position_llh=pick(self.position_llh),
            position_std=pick(self.position_std),
            wheel_speed=None if self.wheel_speed is None else self.wheel_speed[imu],
        )

    def corrected(self, result: Result) -> Log:
        """Return the log with the biases of `result` subtracted from the readings, sample by sample.

        Parameters
        ----------
        result : Result
            Estimates for this log. A bias that the method does not estimate (NaN) counts as zero.

        Returns
        -------
        Log
            The same stamps; ``meta["corrected_by"]`` names the method.

        Raises
        ------
        LogError
            When the estimates are not at this log's time stamps.
        """
        if not np.array_equal(result.time, self.time):
            raise LogError(
                f"The result has {result.time.size} samples at other time stamps than the log's {self.time.size}; "
                "correct the log that the result was estimated from."
            )
        return replace(
            self,
            gyro=self.gyro - np.nan_to_num(result.gyro_bias, nan=0.0),
            accel=self.accel - np.nan_to_num(result.accel_bias, nan=0.0),
            meta={**self.meta, "corrected_by": result.method},
        )

    def describe(self) -> dict[str, object]:
        """Return the ``log`` part of `summary.json`.

        Returns
        -------
        dict
            ``source``, ``format``, ``completeness``, ``duration_s``, ``imu_rate_hz``, ``gnss_rate_hz``
            (medians; None where there are fewer than two epochs) and ``distance_m``; and what of ``epoch``,
            ``gnss_time_scale``, ``datum`` and ``height`` is known; and ``latency_s``, ``mounting_deg`` and
            ``preflight`` where they are, which `Result.summary` shows beside it.
        """
        facts = ("epoch", "gnss_time_scale", "datum", "height", "latency_s", "mounting_deg", "preflight")
        known = {name: self.meta[name] for name in facts if name in self.meta}
        return {
            "source": self.meta.get("source"),
            "format": self.meta.get("format"),
            "completeness": self.meta.get("completeness", "complete"),
            "duration_s": self.duration,
            "imu_rate_hz": _rate(self.time),
            "gnss_rate_hz": _rate(self.gnss_time),
            "distance_m": self._distance(),
            **known,
        }

    def _distance(self) -> float:
        """Integrate the horizontal GNSS speed (or add up the steps of a log without velocities), m."""
        source = self.position_llh if self.velocity_ned is None else self.velocity_ned
        if source is None:
            return 0.0
        present = np.isfinite(source).all(axis=1)
        period = np.diff(self.gnss_time[present])
        if self.velocity_ned is None:
            steps = np.hypot(*steps_ned(source[present])[:, :2].T)
        else:
            speed = np.hypot(*source[present, :2].T)
            steps = 0.5 * (speed[1:] + speed[:-1]) * period
        return float(steps[period <= MAX_DISTANCE_GAP_S].sum())


def _rate(time: FloatArray) -> float | None:
    """Return the median rate of time stamps, Hz."""
    return float(1.0 / np.median(np.diff(time))) if time.size > 1 else None
