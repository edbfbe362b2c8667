"""Damaged copies of a file: cut short, and with bytes flipped, overwritten, deleted and inserted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def cuts(content: bytes, count: int = 100) -> Iterator[int]:
    """Yield lengths spread over the file, the ends included."""
    yield from sorted({*np.linspace(1, len(content) - 1, count).astype(int).tolist()})


def mutations(content: bytes, count: int = 200, *, seed: int = 7) -> Iterator[bytes]:
    """Yield copies with one damage each."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        at = int(rng.integers(len(content)))
        size = int(rng.integers(1, 40))
        noise = rng.integers(0, 256, size, dtype=np.uint8).tobytes()
        if k % 4 == 0:
            yield content[:at] + bytes([content[at] ^ (1 << int(rng.integers(8)))]) + content[at + 1 :]
        elif k % 4 == 1:
            yield content[:at] + noise + content[at + size :]
        elif k % 4 == 2:
            yield content[:at] + content[at + size :]
        else:
            yield content[:at] + noise + content[at:]
