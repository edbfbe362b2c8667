"""What a path is made of: smooth steps (speed, turn rate), headings, undulating ground, and planes.

Everything along a path is a function of the *path time*: the distance travelled divided by the cruise speed, in
seconds. At cruise speed it runs with the clock, at rest it stands still, and in reverse it runs backwards, so that a
vehicle that stands does not rotate and one that reverses meets the ground that it has just left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.sim.signals import Signal, atan, chain, sin_cos

Heading = Callable[[Signal], Signal]
"""Heading (rad, continuous) as a function of the path time."""

Ground = Callable[[Signal, Signal], tuple[Signal, Signal]]
"""Roll and pitch (rad) as a function of the path time and the heading."""

TURN_RAMP_S = 2.0
"""Time in which a turn rate builds up or fades, s at cruise speed: a driver's hands on the wheel."""

_TAYLOR_SPACING_S = 0.25
_TAYLOR_ORDER = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class SmoothSteps:
    """A level that changes in raised-cosine steps, with its exact integral and rate.

    Parameters
    ----------
    initial : float
        Level before the first step.
    starts, widths : ndarray, shape (k,)
        Where each step begins and how long it takes; a step ends before the next one begins.
    levels : ndarray, shape (k,)
        Level after each step.
    """

    initial: float
    starts: FloatArray
    widths: FloatArray
    levels: FloatArray

    @classmethod
    def constant(cls, level: float) -> SmoothSteps:
        """Return a level that never changes."""
        return cls(initial=level, starts=np.zeros(1), widths=np.ones(1), levels=np.array([level]))

    def __call__(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the integral from 0 to `x`, the level and the slope at `x`, each of shape (n,)."""
        before = np.concatenate(([self.initial], self.levels[:-1]))
        change = self.levels - before
        # Area from the start of one step to the start of the next: half of the change is gained on the ramp.
        gap = np.diff(self.starts)
        area = before[:-1] * gap + change[:-1] * (gap - 0.5 * self.widths[:-1])
        # Every scenario starts its first step at or after 0, with the initial level before it.
        area = np.cumsum(np.concatenate(([self.initial * self.starts[0]], area)))

        k = np.maximum(np.searchsorted(self.starts, x, side="right") - 1, 0)
        since, width, step = x - self.starts[k], self.widths[k], change[k]
        phase = math.pi * np.clip(since / width, 0.0, 1.0)
        sine = np.sin(phase)
        ramp = width * (phase - sine) / (2.0 * math.pi) + np.maximum(since - width, 0.0)
        integral = area[k] + before[k] * since + step * ramp
        level = before[k] + step * 0.5 * (1.0 - np.cos(phase))
        slope = step * (0.5 * math.pi) * sine / width
        return integral, level, slope


@dataclass(frozen=True, kw_only=True, eq=False)
class TurnRateHeading:
    """A heading whose turn rate (rad/s at cruise speed) is a `SmoothSteps` of the path time."""

    initial: float
    turn_rate: SmoothSteps

    def __call__(self, path_time: Signal) -> Signal:
        """Return the heading along the path."""
        turned, rate, slope = self.turn_rate(path_time.value)
        return chain(path_time, self.initial + turned, rate, slope)


@dataclass(frozen=True, kw_only=True, eq=False)
class WavyHeading:
    """A heading whose turn rate is a sum of sines: (amplitude in rad/s, period in s, phase in rad) each."""

    initial: float
    waves: tuple[tuple[float, float, float], ...]

    def __call__(self, path_time: Signal) -> Signal:
        """Return the heading along the path."""
        heading = path_time * 0.0 + self.initial
        for amplitude, period, phase in self.waves:
            wavenumber = 2.0 * math.pi / period
            _, cosine = sin_cos(path_time * wavenumber + phase)
            heading = heading + (math.cos(phase) - cosine) * (amplitude / wavenumber)
        return heading


@dataclass(frozen=True, kw_only=True, eq=False)
class CrabbedHeading:
    """The heading of a vehicle that slides down a side slope and holds its course with the nose uphill.

    The angle between heading and course goes with the slope to the side: full across the slope, none straight up or
    down, and the other way round after a turn of 180 deg.

    Parameters
    ----------
    course : callable
        Direction of travel as a function of the path time, rad.
    uphill : float
        Azimuth of the direction that climbs the steepest, rad.
    angle : float
        Between heading and course when driving across the slope, rad.
    """

    course: Heading
    uphill: float
    angle: float

    def __call__(self, path_time: Signal) -> Signal:
        """Return the heading along the path."""
        course = self.course(path_time)
        return course + self._uphill_of(course)

    def slip(self, path_time: Signal) -> Signal:
        """Return the angle from the vehicle's x axis to its velocity, positive to the right: downhill of the nose."""
        return -self._uphill_of(self.course(path_time))

    def _uphill_of(self, course: Signal) -> Signal:
        return self.angle * sin_cos(self.uphill - course)[0]


def headland_turns(rng: np.random.Generator, until: float) -> SmoothSteps:
    """Return the turn rate of a field: straights of 60-120 s, 180 deg turns right and left in turn.

    Each turn has a random peak rate of 12-20 deg/s. The first turns are the same whatever `until` is.

    Parameters
    ----------
    rng : numpy.random.Generator
        Its last use: how much is drawn depends on `until`.
    until : float
        Path time up to which turns are needed, s.
    """
    count = math.ceil(until / 60.0) + 1
    draw = rng.random((count, 2))
    straight = 60.0 + 60.0 * draw[:, 0]
    peak = np.radians(12.0 + 8.0 * draw[:, 1])
    # Ramp up, hold, ramp down turn by peak * (ramp + hold), which shall be 180 deg.
    turn = math.pi / peak + TURN_RAMP_S
    starts = np.cumsum(straight + turn) - turn
    side = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    return SmoothSteps(
        initial=0.0,
        starts=np.stack((starts, starts + turn - TURN_RAMP_S), axis=1).ravel(),
        widths=np.full(2 * count, TURN_RAMP_S),
        levels=np.stack((side * peak, np.zeros(count)), axis=1).ravel(),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Undulation:
    """A smooth random angle along the path: a sum of sinusoids with a first-order spectrum.

    Parameters
    ----------
    amplitude : float
        Amplitude of every sinusoid, rad.
    wavenumber, phase : ndarray, shape (k,)
        Of each sinusoid, rad per second of path time, and rad.
    """

    amplitude: float
    wavenumber: FloatArray
    phase: FloatArray

    @classmethod
    def random(
        cls,
        rng: np.random.Generator,
        *,
        rms: float,
        correlation_s: float = 6.0,
        shortest_s: float = 2.0,
        longest_s: float = 400.0,
        count: int = 24,
    ) -> Undulation:
        """Draw an undulation of the given RMS (rad) and correlation time (s at cruise speed).

        The sinusoids share the power of the first-order spectrum between the shortest and the longest period
        equally, at random frequencies that never fall into step. The band ends at 2 s (6 m at 3 m/s) because a
        wheelbase averages out shorter bumps, and at 400 s so that a field does not turn into a mountain.
        """
        low, high = (math.atan(2.0 * math.pi * correlation_s / period) for period in (longest_s, shortest_s))
        share = (np.arange(count) + rng.random(count)) / count
        return cls(
            amplitude=rms * math.sqrt(2.0 / count),
            wavenumber=np.tan(low + (high - low) * share) / correlation_s,
            phase=rng.uniform(0.0, 2.0 * math.pi, count),
        )

    def __call__(self, path_time: Signal) -> Signal:
        """Return the angle along the path, rad.

        Summing every sinusoid at every sample would take most of a simulation's time. The sum is expanded in a
        Taylor series round nodes 0.25 s apart instead; what is cut off is below 1e-13 rad, and the rates are the
        exact derivatives of what is returned.
        """
        node = np.rint(path_time.value / _TAYLOR_SPACING_S)
        first = node.min()
        index = (node - first).astype(np.intp)
        offset = path_time.value - node * _TAYLOR_SPACING_S
        coefficients = self._taylor((first + np.arange(index.max() + 1)) * _TAYLOR_SPACING_S)

        value = coefficients[_TAYLOR_ORDER][index]
        slope, half_curvature = np.zeros_like(value), np.zeros_like(value)
        for row in coefficients[-2::-1]:
            half_curvature = half_curvature * offset + slope
            slope = slope * offset + value
            value = value * offset + row[index]
        return chain(path_time, value, slope, 2.0 * half_curvature)

    def _taylor(self, nodes: FloatArray) -> FloatArray:
        """Return the Taylor coefficients at the nodes, shape (order + 1, nodes)."""
        angle = np.outer(self.wavenumber, nodes) + self.phase[:, None]
        waves = (np.sin(angle), np.cos(angle))
        rows = []
        weight = np.full(self.wavenumber.size, self.amplitude)
        for order in range(_TAYLOR_ORDER + 1):
            sign = 1.0 if order % 4 < 2 else -1.0
            rows.append(sign * (weight @ waves[order % 2]))
            weight = weight * self.wavenumber / (order + 1)
        return np.stack(rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class SlopedGround:
    """A plane with undulations on it: the vehicle's floor is parallel to the plane at every heading.

    Parameters
    ----------
    slope : float
        Inclination of the plane, rad; 0 is level.
    uphill : float
        Azimuth of the direction that climbs the steepest, rad.
    roll, pitch : Undulation or None
        Added to the plane's roll and pitch; None for a smooth surface.
    """

    slope: float = 0.0
    uphill: float = 0.0
    roll: Undulation | None = None
    pitch: Undulation | None = None

    def __call__(self, path_time: Signal, heading: Signal) -> tuple[Signal, Signal]:
        """Return roll and pitch along the path, rad."""
        if self.slope == 0.0:
            roll = pitch = path_time * 0.0
        else:
            # The x axis climbs as the plane does along it, and the z axis is the plane's normal.
            gradient = math.tan(self.slope)
            across, along = sin_cos(heading - self.uphill)
            pitch = atan(along * gradient)
            roll = atan(across * gradient * sin_cos(pitch)[1])
        if self.roll is not None:
            roll = roll + self.roll(path_time)
        if self.pitch is not None:
            pitch = pitch + self.pitch(path_time)
        return roll, pitch
