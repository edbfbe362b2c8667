"""What the user sets: starting values, the constants of the papers' platform, the noises of the filters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Final, Self

import numpy as np

from levelhead.conventions import GRAVITY
from levelhead.errors import UsageError

Triple = tuple[float, float, float]


LONGEST_LEVER: Final = 50.0
"""No vehicle is larger: a longer lever is one in other units, m."""


def lever(name: str, value: object) -> Triple:
    """Return a place on the vehicle as three floats, m; what is none raises UsageError."""
    arm = np.asarray(value, dtype=np.float64) if isinstance(value, list | tuple | np.ndarray) else np.empty(0)
    if arm.shape != (3,) or not np.all(np.isfinite(arm)) or np.abs(arm).max() > LONGEST_LEVER:
        raise UsageError(f"{name} is {value}; pass three lengths in metres, each within {LONGEST_LEVER:g} m.")
    x, y, z = (float(v) for v in arm)
    return x, y, z


@dataclass(frozen=True, kw_only=True)
class Initial:
    """What is known before the first sample.

    Attributes
    ----------
    gyro_bias, accel_bias : (3,)
        Biases to start from, rad/s and m/s^2, body frame.
    heading : float, optional
        Heading at the first sample, rad, where something tells it (two antennas, a compass, how it was parked). Only
        the phasor filter and the smoother use it, until the first course.
    heading_std : float
        Its one sigma, rad.
    """

    gyro_bias: Triple = (0.0, 0.0, 0.0)
    accel_bias: Triple = (0.0, 0.0, 0.0)
    heading: float | None = None
    heading_std: float = math.radians(5.0)

    def __post_init__(self) -> None:
        for name in ("gyro_bias", "accel_bias"):
            value = getattr(self, name)
            if len(value) != 3 or not np.all(np.isfinite(value)):
                raise UsageError(f"{name} of Initial is {value}; pass three finite numbers.")
        if self.heading is not None and not abs(self.heading) <= 2.0 * math.pi:
            raise UsageError(f"heading of Initial is {self.heading!r}; pass radians within a full turn.")
        if not (math.isfinite(self.heading_std) and self.heading_std > 0.0):
            raise UsageError(f"heading_std of Initial is {self.heading_std!r}; it must be a positive number.")


def check_latitude(latitude: float | None) -> None:
    """Raise UsageError where a latitude is none."""
    if latitude is not None and not abs(latitude) <= 0.5 * math.pi:
        raise UsageError(f"latitude is {latitude!r}; pass radians between -pi/2 and pi/2.")


@dataclass(frozen=True, kw_only=True)
class MethodParams:
    """What every method needs to know; each method adds its own.

    Attributes
    ----------
    min_course_speed : float
        Below this horizontal speed the course is not used, m/s.
    gravity : float
        Local gravity, m/s^2.
    lever_arm : (3,)
        From the IMU to the GNSS antenna, body axes, m.
    """

    CAN_BE_EXACT: ClassVar[frozenset[str]] = frozenset({"timing_std"})

    min_course_speed: float = 1.0
    gravity: float = GRAVITY
    lever_arm: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "lever_arm", lever("lever_arm", self.lever_arm))
        for field in fields(self):
            if not isinstance(field.default, float):
                continue
            value = getattr(self, field.name)
            number = isinstance(value, float | int | np.number) and not isinstance(value, bool)
            exact = field.name in self.CAN_BE_EXACT
            if not (number and np.isfinite(value) and (value > 0.0 or (exact and value == 0.0))):
                allowed = "must not be negative" if exact else "must be a positive number"
                raise UsageError(f"{field.name} is {value!r}; it {allowed}.")

    @classmethod
    def preset(cls, name: str) -> Self:
        """Return the constants for a grade of sensors, "consumer", "industrial" or "tactical", where it has any."""
        raise UsageError(f"{cls.__name__} knows no grades of sensors such as {name!r}; pass its constants instead.")

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the parameters with these values; an unknown name raises TypeError."""
        return cls(**values)

    def as_dict(self) -> dict[str, Any]:
        """Return the constants by name, for summaries and reports."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class PlatformParams(MethodParams):
    """Constants of the virtual platform, common to both papers' estimators.

    Attributes
    ----------
    tau : float
        Attitude correction time constant, s. Shorter follows GNSS acceleration closer and lets more of its noise into
        roll and pitch; longer trusts the gyros.
    tau_heading : float
        Time constant with which the GNSS course steers the heading, s. Shorter lets more course noise (velocity noise
        over speed) into the heading and the vertical gyro bias.
    """

    tau: float = 4.0
    tau_heading: float = 4.0


@dataclass(frozen=True, kw_only=True)
class PaperParams(PlatformParams):
    """What the papers' two estimators have in common.

    Attributes
    ----------
    latitude : float, optional
        Geodetic latitude, rad. Given, the Earth's rotation, Coriolis force and transport rate are compensated, which
        MEMS sensors may neglect (Tereshkov 2013, section 4).
    """

    TACTICAL: ClassVar[Mapping[str, float]] = {}

    latitude: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_latitude(self.latitude)

    @classmethod
    def preset(cls, name: str, **changes: Any) -> Self:
        """Return the constants for a grade of sensors; only "tactical" asks for others than the papers'."""
        check_grade(name)
        return cls(**{**(cls.TACTICAL if name == "tactical" else {}), **changes})


@dataclass(frozen=True, kw_only=True)
class NoiseParams:
    """What is random in the sensors; nothing here is a matrix, everything can be measured or read from a datasheet.

    Noise densities are one-sided, as in `SensorModel`: white noise of density d sampled at the rate f has the sigma
    d sqrt(f / 2).

    Attributes
    ----------
    gyro_noise : float
        Noise density of the gyros, rad/s/sqrt(Hz), vibration of the mounting included. Larger trusts GNSS more.
    accel_noise : float
        Noise density of the accelerometers, m/s^2/sqrt(Hz), the vehicle's vibration included.
    gyro_bias_walk, accel_bias_walk : float
        Random walk of the biases, rad/s/sqrt(s) and m/s^2/sqrt(s). Larger follows a bias that drifts, and is less sure
        of one that does not.
    velocity_std : float
        One sigma of the GNSS velocity, m/s per axis, where the log does not tell it per epoch.
    initial_gyro_bias_std, initial_accel_bias_std : float
        One sigma of the biases before the drive, rad/s and m/s^2.
    """

    gyro_noise: float = math.radians(0.01)
    accel_noise: float = 0.015
    gyro_bias_walk: float = 2e-6
    accel_bias_walk: float = 2e-4
    velocity_std: float = 0.05
    initial_gyro_bias_std: float = math.radians(0.5)
    initial_accel_bias_std: float = 0.3


NOISE_PRESETS: Final[dict[str, dict[str, float]]] = {
    "consumer": {
        "gyro_noise": math.radians(0.02),
        "accel_noise": 0.02,
        "gyro_bias_walk": 5e-6,
        "accel_bias_walk": 5e-4,
        "initial_gyro_bias_std": math.radians(1.0),
        "initial_accel_bias_std": 0.5,
    },
    "industrial": {},
    "tactical": {
        "gyro_noise": math.radians(0.002),
        "accel_noise": 0.01,
        "gyro_bias_walk": 2e-7,
        "accel_bias_walk": 2e-5,
        "initial_gyro_bias_std": math.radians(0.05),
        "initial_accel_bias_std": 0.05,
    },
}
"""Grades of sensors by name: what differs from the defaults, which are the industrial grade on a working vehicle."""


def check_grade(name: str) -> None:
    """Raise UsageError where there is no such grade of sensors."""
    if name not in NOISE_PRESETS:
        raise UsageError(f"There is no grade {name!r}; choose one of {', '.join(NOISE_PRESETS)}.")


@dataclass(frozen=True, kw_only=True)
class FilterParams(NoiseParams, MethodParams):
    """What the Kalman-type methods take: physical noises, and where on Earth the drive is.

    Attributes
    ----------
    latitude : float, optional
        Geodetic latitude, rad, for the Earth's rotation. None: taken from the log's positions; without them the
        rotation is not compensated and adds to the gyro biases (4e-3 deg/s at most).
    position_std : float
        One sigma of a GNSS position, m per axis, where the log does not tell it per epoch.
    timing_std : float
        One sigma of a fix's stamp against the IMU's clock, s: along the way a position is off by so much driving. 0 for
        clocks that are one.
    use_positions : bool
        False: the velocities alone are used, whatever the log has.
    earth_rotation : bool
        False: neither the Earth's rotation nor local gravity are compensated, whatever is known of the place.
    """

    latitude: float | None = None
    position_std: float = 1.5
    timing_std: float = 0.05
    use_positions: bool = True
    earth_rotation: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_latitude(self.latitude)

    @classmethod
    def preset(cls, name: str, **changes: Any) -> Self:
        """Return the constants of a grade of sensors: "consumer", "industrial" or "tactical"; `changes` go on top."""
        check_grade(name)
        return cls(**{**NOISE_PRESETS[name], **changes})
