"""What the preflight says: findings with their margins, in words for people and in numbers for programs."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Final


class Verdict(enum.StrEnum):
    """What a finding amounts to."""

    FINE = "fine"
    """Checked, and as the log says."""
    CORRECTED = "corrected"
    """Found with certainty, and put right in the log that is returned."""
    NOTED = "noted"
    """Worth knowing; nothing was changed."""
    WARNING = "warning"
    """May spoil the estimate; nothing was changed."""
    UNDECIDED = "undecided"
    """The drive cannot tell."""
    REFUSED = "refused"
    """Certain, or not knowable, and the log cannot be trusted as it is."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was looked at.

    Attributes
    ----------
    name : str
        What it is about: "gyro unit", "axes", "clock"...
    verdict : Verdict
    text : str
        One or two sentences for the user.
    code : str
        Event code where it is one, else empty.
    values : dict
        Numbers in SI, or in degrees with the suffix ``_deg``; with sigmas as ``..._std`` and the margin of a decision
        as ``margin``.
    """

    name: str
    verdict: Verdict
    text: str
    code: str = ""
    values: dict[str, object] = field(default_factory=dict)

    def as_dict(self) -> dict[str, object]:
        """Return the finding as JSON shows it."""
        return {
            "name": self.name,
            "verdict": str(self.verdict),
            "code": self.code or None,
            "text": self.text,
            **({"values": self.values} if self.values else {}),
        }


ORDER: Final = (
    Verdict.REFUSED,
    Verdict.CORRECTED,
    Verdict.WARNING,
    Verdict.UNDECIDED,
    Verdict.NOTED,
    Verdict.FINE,
)
"""Most urgent first."""
