"""Preflight: what a log is before anything is estimated: `check` finds units, axes, frames, clocks, mounting."""

from levelhead.preflight.checking import Preflight, check
from levelhead.preflight.corrections import Corrections, Told
from levelhead.preflight.findings import Finding, Verdict

__all__ = ["Corrections", "Finding", "Preflight", "Told", "Verdict", "check"]
