"""What is read of a file that may be damaged."""

from __future__ import annotations

from levelhead.errors import LevelheadError
from levelhead.logs.log import Log
from levelhead.logs.readers import read


def read_or_refusal(path: object) -> Log | None:
    """Return the log, or None where it is refused with a sentence of ours; anything else is raised."""
    try:
        return read(str(path))
    except LevelheadError:
        return None
