"""The named drives: each builds a `Vehicle` from a seed; `SCENARIOS` is the registry."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from levelhead.sim.paths import (
    CrabbedHeading,
    SlopedGround,
    SmoothSteps,
    TurnRateHeading,
    Undulation,
    WavyHeading,
    headland_turns,
)
from levelhead.sim.vehicle import CRUISE_SPEED, Vehicle

ROLL_RMS: Final = math.radians(3.0)
PITCH_RMS: Final = math.radians(2.0)
HILL_SLOPE: Final = math.radians(10.0)
HILL_ROUGHNESS: Final = 0.2
"""Undulation of the hill as a fraction of the field's."""
CRAB_ANGLE: Final = math.radians(4.0)
"""Between the heading and the course of a vehicle that slides down the hill while it drives across it."""
CIRCLE_RATE: Final = math.radians(10.0)
REVERSE_PERIOD_S: Final = 120.0
REVERSE_SPELL_S: Final = 20.0
REVERSE_SPEED: Final = -1.5
START_RAMP_S: Final = 6.0

Build = Callable[[np.random.Generator, float, float], Vehicle]
"""(generator of the path, end of the run in s, standstill at its start in s) -> the vehicle."""


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A named drive: one line for lists, and the function that builds its vehicle.

    The vehicle must be the same whatever the end of the run is, so that a long run can be simulated in chunks: random
    numbers whose count depends on the end are drawn last.

    Attributes
    ----------
    summary : str
        One line.
    build : callable
        Makes the vehicle, at the usual cruise speed.
    sideslip : float
        Angle from the vehicle's x axis to the velocity of its axle, rad: how large it gets.
    """

    summary: str
    build: Build
    sideslip: float = 0.0


def _speed(standstill_s: float) -> SmoothSteps:
    """Return cruise speed, from the start or after a standstill."""
    if standstill_s == 0.0:
        return SmoothSteps.constant(CRUISE_SPEED)
    return SmoothSteps(
        initial=0.0,
        starts=np.array([standstill_s]),
        widths=np.array([START_RAMP_S]),
        levels=np.array([CRUISE_SPEED]),
    )


def _reversing_speed(end: float, standstill_s: float) -> SmoothSteps:
    """Return cruise speed with a spell of 20 s in reverse at the end of every 120 s."""
    forward_ramp, reverse_ramp = 4.0, 3.0
    cycles = math.ceil(max(end - standstill_s, 0.0) / REVERSE_PERIOD_S) + 1
    spell = REVERSE_PERIOD_S - REVERSE_SPELL_S - forward_ramp  # the wheels stand still here for an instant
    offsets = np.array([spell - forward_ramp, spell, spell + REVERSE_SPELL_S - reverse_ramp, spell + REVERSE_SPELL_S])
    starts = standstill_s + (np.arange(cycles) * REVERSE_PERIOD_S)[:, None] + offsets
    speed = SmoothSteps(
        initial=CRUISE_SPEED,
        starts=starts.ravel(),
        widths=np.tile([forward_ramp, reverse_ramp, reverse_ramp, forward_ramp], cycles),
        levels=np.tile([0.0, REVERSE_SPEED, 0.0, CRUISE_SPEED], cycles),
    )
    if standstill_s == 0.0:
        return speed
    return SmoothSteps(
        initial=0.0,
        starts=np.concatenate(([standstill_s], speed.starts)),
        widths=np.concatenate(([START_RAMP_S], speed.widths)),
        levels=np.concatenate(([CRUISE_SPEED], speed.levels)),
    )


def _course(rng: np.random.Generator) -> float:
    """Return a random heading to start with, rad."""
    return float(rng.uniform(-math.pi, math.pi))


def _ground(
    rng: np.random.Generator, *, roughness: float = 1.0, slope: float = 0.0, uphill: float = 0.0
) -> SlopedGround:
    """Return ground that rolls by 3 deg and pitches by 2 deg RMS, times the roughness."""
    return SlopedGround(
        slope=slope,
        uphill=uphill,
        roll=Undulation.random(rng, rms=ROLL_RMS * roughness),
        pitch=Undulation.random(rng, rms=PITCH_RMS * roughness),
    )


def _field(rng: np.random.Generator, end: float, standstill_s: float) -> Vehicle:
    course, ground = _course(rng), _ground(rng)
    heading = TurnRateHeading(initial=course, turn_rate=headland_turns(rng, end))
    return Vehicle(speed=_speed(standstill_s), heading=heading, ground=ground)


def _passes_on_a_hill(rng: np.random.Generator, end: float) -> tuple[TurnRateHeading, SlopedGround]:
    """Return the field's passes along the contour lines, as a farmer drives, and the slope they are on.

    Seen from the vehicle the slope is all roll, and pitch only in the turns.
    """
    course = _course(rng)
    ground = _ground(rng, roughness=HILL_ROUGHNESS, slope=HILL_SLOPE, uphill=course + 0.5 * math.pi)
    return TurnRateHeading(initial=course, turn_rate=headland_turns(rng, end)), ground


def _hill(rng: np.random.Generator, end: float, standstill_s: float) -> Vehicle:
    heading, ground = _passes_on_a_hill(rng, end)
    return Vehicle(speed=_speed(standstill_s), heading=heading, ground=ground)


def _crab(rng: np.random.Generator, end: float, standstill_s: float) -> Vehicle:
    course, ground = _passes_on_a_hill(rng, end)
    heading = CrabbedHeading(course=course, uphill=ground.uphill, angle=CRAB_ANGLE)
    return Vehicle(speed=_speed(standstill_s), heading=heading, ground=ground, slip=heading.slip)


def _reverse(rng: np.random.Generator, end: float, standstill_s: float) -> Vehicle:
    course, ground = _course(rng), _ground(rng)
    heading = TurnRateHeading(initial=course, turn_rate=headland_turns(rng, end))
    return Vehicle(speed=_reversing_speed(end, standstill_s), heading=heading, ground=ground)


def _windrower(rng: np.random.Generator, _end: float, standstill_s: float) -> Vehicle:
    waves = ((math.radians(12.0), 40.0, 0.0), (math.radians(6.0), 23.0, 1.0))
    heading = WavyHeading(initial=_course(rng), waves=waves)
    return Vehicle(speed=_speed(standstill_s), heading=heading, ground=_ground(rng))


def _circle(rng: np.random.Generator, _end: float, standstill_s: float) -> Vehicle:
    heading = TurnRateHeading(initial=_course(rng), turn_rate=SmoothSteps.constant(CIRCLE_RATE))
    return Vehicle(speed=_speed(standstill_s), heading=heading, ground=SlopedGround())


def _straight(rng: np.random.Generator, _end: float, standstill_s: float) -> Vehicle:
    heading = TurnRateHeading(initial=_course(rng), turn_rate=SmoothSteps.constant(0.0))
    return Vehicle(speed=_speed(standstill_s), heading=heading, ground=_ground(rng))


_WINDROWER = Scenario(
    summary="A windrower along curved swaths: it turns all the time, now left, now right, at up to 18 deg/s.",
    build=_windrower,
)

SCENARIOS: Final[dict[str, Scenario]] = {
    "field": Scenario(
        summary="A tractor in a field: straights of 60-120 s, headland turns of 180 deg right and left in turn.",
        build=_field,
    ),
    "windrower": _WINDROWER,
    "curvy": _WINDROWER,
    "hill": Scenario(summary="The field's passes across a side slope of 10 deg.", build=_hill),
    "crab": Scenario(
        summary="The hill's passes with the nose 4 deg uphill of the course: the vehicle slides as it drives.",
        build=_crab,
        sideslip=CRAB_ANGLE,
    ),
    "reverse": Scenario(
        summary="The field's passes, with a spell of 20 s in reverse at the end of every 120 s.", build=_reverse
    ),
    "circle": Scenario(
        summary="A circle at 10 deg/s on level ground: gyro and accelerometer biases cannot be told apart.",
        build=_circle,
    ),
    "straight": Scenario(
        summary="A straight line over the field's ground: the accelerometer biases cannot be told from tilt.",
        build=_straight,
    ),
}
"""The scenarios by name."""
