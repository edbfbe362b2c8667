"""Files as they should not be: cut at many places, or with bytes changed, taken out and put in."""

from __future__ import annotations

import random
from collections.abc import Iterator

from levelhead.errors import LevelheadError
from levelhead.logs.log import Log
from levelhead.logs.readers import read


def cuts(content: bytes, count: int) -> Iterator[bytes]:
    """Yield the file cut at places spread over it, its last byte among them."""
    for k in range(1, count + 1):
        yield content[: len(content) * k // (count + 1)]
    yield content[:-1]


def mutations(content: bytes, count: int, seed: int) -> Iterator[bytes]:
    """Yield the file with one to four places changed; the same ones for the same seed."""
    rng = random.Random(seed)  # noqa: S311 (not for secrets)
    for _ in range(count):
        changed = bytearray(content)
        for _ in range(rng.randint(1, 4)):
            at, some = rng.randrange(len(changed)), rng.randbytes(rng.randint(1, 8))
            kind = rng.randrange(4)
            if kind == 0:
                changed[at] ^= 1 << rng.randrange(8)
            elif kind == 1:
                changed[at : at + len(some)] = some
            elif kind == 2:
                del changed[at : at + rng.randint(1, 40)]
            else:
                changed[at:at] = some
        yield bytes(changed)


def read_or_refusal(path: object) -> Log | None:
    """Return the log, or None where it is refused with a sentence of ours; anything else is raised."""
    try:
        return read(str(path))
    except LevelheadError:
        return None
