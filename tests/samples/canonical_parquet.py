"""The drive as canonical Parquet."""

from __future__ import annotations

from pathlib import Path

from levelhead.logs.writers import write as write_log
from samples.drive import sample_drive

KEEPS_PREFIX = False
"""Parquet's index is its end."""


def write(folder: Path) -> Path:
    """Write the drive, with every digit of its numbers."""
    path = folder / "drive.parquet"
    write_log(sample_drive(), path)
    return path
