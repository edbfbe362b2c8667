"""The drive as canonical CSV."""

from __future__ import annotations

from pathlib import Path

from levelhead.logs.writers import write as write_log
from samples.cuts import last_cell
from samples.drive import sample_drive

CUT_UNSEEN = last_cell


def write(folder: Path) -> Path:
    """Write the drive, with every digit of its numbers."""
    path = folder / "drive.csv"
    write_log(sample_drive(), path)
    return path
