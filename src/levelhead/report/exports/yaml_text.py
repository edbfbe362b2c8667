"""The few lines of YAML that the exports need: numbers, lists of numbers, null."""

from __future__ import annotations

import math
from collections.abc import Iterable


def scalar(value: float) -> str:
    """Return a number that every YAML takes for one: with a point and a signed exponent; ``null`` where there is none.

    YAML 1.1 reads ``1e-05`` as text.
    """
    return f"{value + 0.0:.9e}" if math.isfinite(value) else "null"


def row(values: Iterable[float]) -> str:
    """Return a list of numbers on one line."""
    return f"[{', '.join(scalar(float(v)) for v in values)}]"
