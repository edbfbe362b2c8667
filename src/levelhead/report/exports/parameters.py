"""Parameter files of autopilots: QGroundControl's ``.params`` and Mission Planner's ``.param``."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Final

from levelhead.errors import UsageError

MAX_BYTES: Final = 4_000_000
"""An autopilot has some thousand parameters, of 40 bytes each."""
_NAME: Final = re.compile(r"[A-Z][A-Z0-9_]{0,15}")
"""MAVLink's names: 16 characters at most."""
QGC_FIELDS: Final = 5


def read_parameters(path: str | os.PathLike[str]) -> dict[str, float]:
    """Read an autopilot's parameter file.

    Parameters
    ----------
    path : path
        QGroundControl's ``.params`` (vehicle, component, name, value and type, separated by tabs; of several components
        the first is used), or ``NAME,VALUE`` lines, also separated by blanks or tabs, as Mission Planner and MAVProxy
        write. Lines that begin with ``#`` are comments.

    Returns
    -------
    dict
        Values by name.

    Raises
    ------
    UsageError
        When the file cannot be read, is none, or has two values for a name.
    """
    file = Path(path)
    try:
        if not file.is_file():
            raise UsageError(f"The parameter file {file} does not exist; check the path.")
        if file.stat().st_size > MAX_BYTES:
            raise UsageError(f"The parameter file {file} has {file.stat().st_size} bytes; no autopilot has so many.")
        text = file.read_bytes().decode("utf-8", errors="replace")
    except OSError as error:
        raise UsageError(f"The parameter file {file} cannot be read: {error.strerror}.") from None
    values: dict[str, float] = {}
    component: str | None = None
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        row = line.split("#", 1)[0].strip()
        if not row:
            continue
        fields = re.split(r"[,\s]+", row)
        if len(fields) == QGC_FIELDS and fields[0].isdigit() and fields[1].isdigit():
            component = component or fields[1]
            if fields[1] != component:
                continue
            fields = fields[2:4]
        name, value = _pair(file, number, row, fields)
        if values.get(name, value) != value:
            raise UsageError(f"{file.name}, line {number}: {name} has two values; pass a file of one vehicle.")
        values[name] = value
    if not values:
        raise UsageError(f"{file.name} holds no parameters; pass the vehicle's .params or .param file.")
    return values


def _pair(file: Path, number: int, row: str, fields: list[str]) -> tuple[str, float]:
    try:
        # A third field is Mission Planner's default or MAVProxy's comment.
        name, value = fields[0], float(fields[1])
    except (IndexError, ValueError):
        name, value = "", math.nan
    if not _NAME.fullmatch(name) or not math.isfinite(value):
        raise UsageError(
            f"{file.name}, line {number}: {row[:60]!r} is no parameter; expected NAME,VALUE or QGroundControl's five "
            "columns."
        )
    return name, value
