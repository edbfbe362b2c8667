"""What levelhead raises: every message is a sentence that says what, where, what was found, what to do."""

from __future__ import annotations

from typing import Final

_LONGEST: Final = 900
"""Characters of a sentence at most."""


def printable(text: str) -> str:
    """Return a text in which what would not show is replaced: bytes of a hostile file must not command a terminal."""
    return text if text.isprintable() else "".join(c if c.isprintable() else "\ufffd" for c in text)


class LevelheadError(Exception):
    """Base of all errors that levelhead raises on purpose; ``exit_code`` is what the command line returns."""

    exit_code = 1

    def __str__(self) -> str:
        text = printable(super().__str__())
        # What is in a file may be quoted, or named by a library, at any length; the end says what to do.
        return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 3 :]}"


class UsageError(LevelheadError, ValueError):
    """The call or the command was wrong: an unknown method, a parameter out of range, a bad option."""

    exit_code = 2


class LogError(LevelheadError, ValueError):
    """A log could not be read or could not be trusted."""

    exit_code = 3


class OutputError(LevelheadError, OSError):
    """A result could not be written; nothing half-written is left behind."""

    exit_code = 1
