"""Copies of a text file as they come out of accidents: cut short, and with bytes changed, lost and added."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from levelhead.errors import LevelheadError
from levelhead.logs.log import Log


def cut(content: bytes, count: int = 100) -> Iterator[bytes]:
    """Yield beginnings of the content, of lengths spread over it."""
    for length in np.unique(np.linspace(1, len(content) - 1, count).astype(int)):
        yield content[:length]


def mutated(content: bytes, count: int = 200) -> Iterator[bytes]:
    """Yield copies with one accident each."""
    rng = np.random.default_rng(5)
    for _ in range(count):
        at, length = int(rng.integers(len(content))), int(rng.integers(1, 9))
        noise = rng.integers(0, 256, length, dtype=np.uint8).tobytes()
        digits = bytes(rng.choice(list(b"0123456789.,-+eE \n\t"), length).astype(np.uint8))
        yield (
            content[:at] + noise + content[at + length :],
            content[:at] + content[at + length :],
            content[:at] + digits + content[at:],
            content[:at] + digits + content[at + length :],
        )[int(rng.integers(4))]


def survives(path: Path, read: Callable[[], Log]) -> None:
    """Assert that each mangled copy, put in the place of the file, is read or refused, and no cut one is called whole.

    A cut behind the end of a line cannot be told from a whole file.
    """
    whole = path.read_bytes()
    for content in cut(whole):
        path.write_bytes(content)
        try:
            log = read()
        except LevelheadError:
            continue
        boundary = whole[len(content.rstrip(b"\r\n")) :].startswith((b"\r", b"\n"))
        assert log.meta["completeness"] != "complete" or boundary, (len(content), content[-60:])
    for content in mutated(whole):
        path.write_bytes(content)
        try:
            read()
        except LevelheadError:
            continue
    path.write_bytes(whole)
