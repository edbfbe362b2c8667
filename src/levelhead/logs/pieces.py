"""What a reader takes out of one file, IMU data or GNSS data or both, and how pieces are joined into a `Log`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event, merge_events
from levelhead.logs.log import Log
from levelhead.logs.tidy import tidy
from levelhead.logs.timescales import between

ABSOLUTE_CLOCK_S: Final = 1e6
"""A log that starts later than this is stamped by an absolute clock (seconds of the GPS week stay below), s."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImuData:
    """IMU samples: time (n,) s, gyro (n, 3) rad/s and accel (n, 3) m/s^2 readings, body FRD; wheel speed (n,) m/s.

    Stamps may repeat or step back and readings may be NaN: `join` puts them in order and counts what it leaves out.
    ``time_scale`` is "GPST" or "UTC" where the stamps are known to count seconds since 1970 in it.
    """

    time: FloatArray
    gyro: FloatArray
    accel: FloatArray
    wheel_speed: FloatArray | None = None
    time_scale: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class GnssData:
    """GNSS epochs: time (m,) s, and the columns of `Log` with the same names, in the same units; else as `ImuData`."""

    time: FloatArray
    velocity_ned: FloatArray | None = None
    velocity_std: FloatArray | None = None
    position_llh: FloatArray | None = None
    position_std: FloatArray | None = None
    time_scale: str | None = None


@dataclass(frozen=True, kw_only=True)
class Stream:
    """One of the IMUs or receivers in a file: what ``imu=`` and ``gnss=`` call it, and what there is to say of it."""

    kind: Literal["imu", "gnss"]
    name: str
    samples: int
    note: str = ""


FLU_TO_FRD: Final = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
"""Entry ``dcm_file_to_body`` of a log's meta where the reader turned forward, left, up into our axes."""

Fact = Literal["gyro_unit", "accel_unit", "axes", "velocity_frame", "clock"]
"""What a format may leave undeclared, so that it must be found in the data (see `levelhead.preflight`)."""
FACTS: Final[tuple[Fact, ...]] = ("gyro_unit", "accel_unit", "axes", "velocity_frame", "clock")


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """What one file holds.

    Attributes
    ----------
    imu, gnss : optional
        The data, each with the stamps of the file's own clock.
    left_out : int
        Cut lines or records at the start or the end of the file that were not used.
    damaged : str
        Where and how the file is damaged in its middle, as a sentence; empty where it is not.
    host_clock : bool
        The stamps are those of a computer or a phone, which may be seconds off: the clock of another file is another.
    from_zero : bool
        The stamps are those of a foreign clock: the log's time starts at the first IMU sample.
    meta : mapping
        What else is known, for `Log.meta`.
    events : tuple of Event
        What was dropped and why.
    streams : tuple of Stream
        All IMUs and receivers in the file, where it can have several; `imu` and `gnss` are two of them.
    compensated : str
        Where the IMU's readings already have biases taken off: by what, and what an estimate then means. A sentence.
    undeclared : tuple of Fact
        What neither the format nor the file says of its data.
    assumed : tuple of Fact
        What only the rules of the canonical log say: who writes one may have missed them.
    """

    imu: ImuData | None = None
    gnss: GnssData | None = None
    left_out: int = 0
    from_zero: bool = False
    meta: Mapping[str, object] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    streams: tuple[Stream, ...] = ()
    compensated: str = ""
    undeclared: tuple[Fact, ...] = ()
    assumed: tuple[Fact, ...] = ()
    damaged: str = ""
    host_clock: bool = False


def join(
    imu: ImuData,
    gnss: GnssData,
    *,
    from_zero: bool = False,
    meta: Mapping[str, object] | None = None,
    events: tuple[Event, ...] = (),
) -> Log:
    """Join IMU and GNSS data that are stamped by one clock, or by two whose time scales are known.

    Samples without a number are dropped, those out of order sorted, and of equal stamps the first is kept, each counted
    as an event (see `levelhead.logs.tidy`).

    Parameters
    ----------
    imu, gnss : ImuData, GnssData
        The pieces; their stamps share one zero.
    from_zero : bool
        Count time from the first IMU sample; ``meta["epoch"]`` then holds that sample's stamp, s. Done
        in any case when the first stamp is beyond `ABSOLUTE_CLOCK_S`; other stamps are kept to the bit.
    meta, events : optional
        For the log.

    Returns
    -------
    Log

    Raises
    ------
    LogError
        When no GNSS epoch lies within the IMU data, or `Log` refuses the data.
    """
    imu, of_imu = tidy(imu, "IMU", ("gyro", "accel"))
    gnss, of_gnss = tidy(gnss, "GNSS", ())
    if imu.time_scale and gnss.time_scale and gnss.time.size:
        shift = between(gnss.time_scale, imu.time_scale, float(gnss.time[0]))
        gnss = replace(gnss, time=gnss.time + shift, time_scale=imu.time_scale)
    events = merge_events((*events, *of_imu, *of_gnss))
    if imu.time.size and gnss.time.size:
        inside = (gnss.time >= imu.time[0]) & (gnss.time <= imu.time[-1])
        if not inside.any():
            raise LogError(
                f"No GNSS epoch lies within the IMU data: the IMU's stamps run from {imu.time[0]:.3f} to "
                f"{imu.time[-1]:.3f} s, the GNSS stamps from {gnss.time[0]:.3f} to {gnss.time[-1]:.3f} s. Both must "
                "count from one zero: check that the files belong together, and time_zero in the mapping."
            )
    time, gnss_time = imu.time, gnss.time
    known = dict(meta or {})
    if gnss.time_scale:
        known["gnss_time_scale"] = gnss.time_scale
    if time.size and (from_zero or abs(time[0]) > ABSOLUTE_CLOCK_S):
        epoch = float(time[0])
        time, gnss_time = time - epoch, gnss_time - epoch
        known["epoch"] = epoch
    return Log(
        time=time,
        gyro=imu.gyro,
        accel=imu.accel,
        gnss_time=gnss_time,
        velocity_ned=gnss.velocity_ned,
        velocity_std=gnss.velocity_std,
        position_llh=gnss.position_llh,
        position_std=gnss.position_std,
        wheel_speed=imu.wheel_speed,
        meta=known,
        events=events,
    )


def none_if_absent(values: FloatArray) -> FloatArray | None:
    """Return None for an array of nothing but NaN."""
    return values if np.isfinite(values).any() else None
