"""`Signal`: a quantity sampled in time together with its exact rate of change (forward-mode dual numbers).

A path that is written with signals gives angular rate and specific force without any numeric differentiation:
every operation below carries the rate along by the rules of calculus.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from levelhead.conventions import FloatArray


@dataclass(frozen=True, eq=False)
class Signal:
    """A quantity and its derivative with respect to time, sample by sample.

    Parameters
    ----------
    value : ndarray, shape (n,)
        The quantity.
    rate : ndarray, shape (n,)
        Its time derivative, in the quantity's unit per second.
    """

    value: FloatArray
    rate: FloatArray

    # NumPy then leaves `array * signal` to `Signal.__rmul__` instead of making an array of objects.
    __array_ufunc__ = None

    def __add__(self, other: Signal | float) -> Signal:
        if isinstance(other, Signal):
            return Signal(self.value + other.value, self.rate + other.rate)
        return Signal(self.value + other, self.rate)

    __radd__ = __add__

    def __neg__(self) -> Signal:
        return Signal(-self.value, -self.rate)

    def __sub__(self, other: Signal | float) -> Signal:
        return self + (-other)

    def __rsub__(self, other: float) -> Signal:
        return -self + other

    def __mul__(self, other: Signal | float) -> Signal:
        if isinstance(other, Signal):
            return Signal(self.value * other.value, self.rate * other.value + self.value * other.rate)
        return Signal(self.value * other, self.rate * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Signal | float) -> Signal:
        if isinstance(other, Signal):
            quotient = self.value / other.value
            return Signal(quotient, (self.rate - quotient * other.rate) / other.value)
        return Signal(self.value / other, self.rate / other)


def sin_cos(angle: Signal) -> tuple[Signal, Signal]:
    """Return sine and cosine of an angle in rad, each with its rate."""
    sine, cosine = np.sin(angle.value), np.cos(angle.value)
    return Signal(sine, cosine * angle.rate), Signal(cosine, -sine * angle.rate)


def atan(ratio: Signal) -> Signal:
    """Return the arc tangent in rad, with its rate."""
    return Signal(np.arctan(ratio.value), ratio.rate / (1.0 + ratio.value * ratio.value))
