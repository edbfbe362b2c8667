"""What happens to files: their end is cut off, bytes in them change, go missing or come in."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def cuts(content: bytes, count: int = 100) -> Iterator[bytes]:
    """Yield the beginnings of a file, spread over it; never nothing, never all."""
    for size in np.unique(np.linspace(1, len(content) - 1, count).astype(int)):
        yield content[:size]


def mutations(content: bytes, count: int = 200, *, seed: int = 1) -> Iterator[bytes]:
    """Yield a file with one to eight places flipped, overwritten, deleted or inserted."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        data = bytearray(content)
        for _ in range(int(rng.integers(1, 9))):
            at = int(rng.integers(len(data)))
            length = int(rng.integers(1, 9))
            kind = int(rng.integers(4))
            if kind == 0:
                data[at] ^= 1 << int(rng.integers(8))
            elif kind == 1:
                data[at : at + length] = rng.bytes(len(data[at : at + length]))
            elif kind == 2:
                del data[at : at + min(length, len(data) - 1)]
            else:
                data[at:at] = rng.bytes(length)
        yield bytes(data)
