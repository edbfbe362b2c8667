"""The drive as canonical Parquet."""

from __future__ import annotations

from pathlib import Path

from levelhead.logs.log import Log
from levelhead.logs.writers import write as write_log
from samples.drive import sample_drive

KEEPS_PREFIX = False
"""Parquet's index is its end."""


def write(folder: Path, log: Log | None = None) -> Path:
    """Write the log; with every digit of its numbers."""
    path = folder / "drive.parquet"
    write_log(sample_drive() if log is None else log, path)
    return path
