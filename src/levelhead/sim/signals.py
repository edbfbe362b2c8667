"""`Signal`: a quantity sampled in time together with its exact rate of change (forward-mode dual numbers).

A path that is written with signals gives angular rate and specific force without any numeric differentiation:
every operation below carries the rate along by the rules of calculus, and the second derivative where it is known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from levelhead.conventions import FloatArray


@dataclass(frozen=True, eq=False)
class Signal:
    """A quantity and its derivatives with respect to time, sample by sample.

    Parameters
    ----------
    value : ndarray, shape (n,)
        The quantity.
    rate : ndarray, shape (n,)
        Its time derivative, in the quantity's unit per second.
    second : ndarray, shape (n,), optional
        Its second time derivative; what is made of signals has one where all of them do.
    """

    value: FloatArray
    rate: FloatArray
    second: FloatArray | None = None

    # NumPy then leaves `array * signal` to `Signal.__rmul__` instead of making an array of objects.
    __array_ufunc__ = None

    def derivative(self) -> Signal:
        """Return the rate as a signal of its own; only of a signal whose second derivative is known."""
        if self.second is None:
            raise ValueError("This signal does not carry a second derivative.")
        return Signal(self.rate, self.second)

    def __add__(self, other: Signal | float) -> Signal:
        if isinstance(other, Signal):
            second = _both(self, other, lambda a, b: a + b)
            return Signal(self.value + other.value, self.rate + other.rate, second)
        return Signal(self.value + other, self.rate, self.second)

    __radd__ = __add__

    def __neg__(self) -> Signal:
        return Signal(-self.value, -self.rate, None if self.second is None else -self.second)

    def __sub__(self, other: Signal | float) -> Signal:
        return self + (-other)

    def __rsub__(self, other: float) -> Signal:
        return -self + other

    def __mul__(self, other: Signal | float) -> Signal:
        if isinstance(other, Signal):
            second = _both(self, other, lambda a, b: a * other.value + 2.0 * self.rate * other.rate + self.value * b)
            return Signal(self.value * other.value, self.rate * other.value + self.value * other.rate, second)
        return Signal(self.value * other, self.rate * other, None if self.second is None else self.second * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Signal | float) -> Signal:
        if isinstance(other, Signal):
            quotient = self.value / other.value
            rate = (self.rate - quotient * other.rate) / other.value
            second = _both(self, other, lambda a, b: (a - 2.0 * rate * other.rate - quotient * b) / other.value)
            return Signal(quotient, rate, second)
        return Signal(self.value / other, self.rate / other, None if self.second is None else self.second / other)


def _both(one: Signal, other: Signal, combine: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray | None:
    """Combine two second derivatives, where there are two."""
    if one.second is None or other.second is None:
        return None
    return combine(one.second, other.second)


def chain(inner: Signal, value: FloatArray, slope: FloatArray, curvature: FloatArray) -> Signal:
    """Return f(inner) by the chain rule, from f, f' and f'' at the inner signal's value, each of shape (n,)."""
    second = None if inner.second is None else curvature * inner.rate**2 + slope * inner.second
    return Signal(value, slope * inner.rate, second)


def sin_cos(angle: Signal) -> tuple[Signal, Signal]:
    """Return sine and cosine of an angle in rad, each with its derivatives."""
    sine, cosine = np.sin(angle.value), np.cos(angle.value)
    return chain(angle, sine, cosine, -sine), chain(angle, cosine, -sine, -cosine)


def atan(ratio: Signal) -> Signal:
    """Return the arc tangent in rad, with its derivatives."""
    square = 1.0 + ratio.value * ratio.value
    rate = ratio.rate / square
    second = None if ratio.second is None else ratio.second / square - 2.0 * ratio.value * rate**2
    return Signal(np.arctan(ratio.value), rate, second)
