"""What is done to a file: cuts, and mutations that a seed and a number tell."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator
from typing import Final, Literal

SEED: Final = 20250627

_EXTREME_TEXTS: Final = (
    b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"1e999", b"99999999999999999999", b"-0", b"0x10",
    b"", b"-", b"1_0", b"\xd9\xa1", b'"', b'""', b"#", b"%", b"=1+1", b"\x1b[2J", b"\xc2\x9b2J", b"9" * 400,
    b"\xef\xbb\xbf", b"\0",
)  # fmt: skip
_EXTREME_BYTES: Final = b"\x00\x01\x7f\x80\xfe\xff\n\r,;\"'-+.eE9 \t#%\xb5b$\x24"
_NUMBER: Final = re.compile(rb"[-+]?\d[\d.eE+-]*")
_ORDERS: Final[tuple[Literal["little"], Literal["big"]]] = ("little", "big")
_EDGE: Final = 2048
"""Half of all positions lie within so many bytes of the beginning or the end, where formats keep what decides."""


def cuts(content: bytes, number: int) -> list[int]:
    """Return lengths to cut a file to: `number` of them spread over it, with the first and the last bytes."""
    size = len(content)
    edge = min(number // 8, size)
    spread = {round(k * (size - 1) / max(number, 1)) for k in range(number)}
    return sorted({*range(edge), *range(size - edge, size), *spread} - {size})


def mutate(content: bytes, number: int, *, seed: int = SEED) -> tuple[bytes, int]:
    """Return the file with one to four mutations, the same for one number and seed, and how many bytes they hit."""
    chance = random.Random(f"{seed} {number}")  # noqa: S311  # nothing is secret here
    hit = 0
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        content, more = chance.choice(_MUTATIONS)(content, chance)
        hit += more
    return content, hit


def beginnings(content: bytes, number: int = 100) -> Iterator[bytes]:
    """Yield the file cut at `number` places, see `cuts`; never nothing."""
    for length in cuts(content, number):
        if length:
            yield content[:length]


def mutations(content: bytes, number: int = 200, *, seed: int = SEED) -> Iterator[bytes]:
    """Yield `number` mutated files, see `mutate`."""
    for k in range(number):
        yield mutate(content, k, seed=seed)[0]


def _position(content: bytes, chance: random.Random) -> int:
    size = len(content)
    if size == 0:
        return 0
    where = chance.random()
    if where < 0.35:
        return chance.randrange(min(size, _EDGE))
    if where < 0.5:
        return size - 1 - chance.randrange(min(size, _EDGE))
    return chance.randrange(size)


def _length(chance: random.Random) -> int:
    return chance.choice((1, 1, 2, 3, 4, 8, 16, 64, 256, chance.randrange(1, 4096)))


def _flip_bits(content: bytes, chance: random.Random) -> tuple[bytes, int]:
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 8))):
        if changed:
            changed[_position(content, chance)] ^= 1 << chance.randrange(8)
    return bytes(changed), 8


def _overwrite(content: bytes, chance: random.Random) -> tuple[bytes, int]:
    at = _position(content, chance)
    return content[:at] + bytes([chance.choice(_EXTREME_BYTES)]) + content[at + 1 :], 1


def _delete(content: bytes, chance: random.Random) -> tuple[bytes, int]:
    at, size = _position(content, chance), _length(chance)
    return content[:at] + content[at + size :], size


def _insert(content: bytes, chance: random.Random) -> tuple[bytes, int]:
    at, size = _position(content, chance), _length(chance)
    block = chance.choice((chance.randbytes(size), bytes(size), b"\xff" * size, content[at : at + size]))
    return content[:at] + block + content[at:], size


def _swap_blocks(content: bytes, chance: random.Random) -> tuple[bytes, int]:
    one, other = sorted((_position(content, chance), _position(content, chance)))
    size = min(_length(chance), other - one)
    a, b = content[one : one + size], content[other : other + size]
    return content[:one] + b + content[one + size : other] + a + content[other + len(b) :], 2 * size


def _fill(content: bytes, chance: random.Random) -> tuple[bytes, int]:
    at, size = _position(content, chance), _length(chance)
    block = content[at : at + size]
    return content[:at] + chance.choice((b"\0", b"\xff")) * len(block) + content[at + size :], size


def _extreme_integer(content: bytes, chance: random.Random) -> tuple[bytes, int]:
    """Put an extreme integer where a length or a count may stand: where there is a small one."""
    order = _ORDERS[chance.randrange(2)]
    width = chance.choice((1, 2, 4, 8))
    if len(content) < width:
        return content, 0
    at = 0
    for _ in range(32):
        at = min(_position(content, chance), len(content) - width)
        if 0 < int.from_bytes(content[at : at + width], order) <= len(content):
            break
    top = 1 << 8 * width
    value = chance.choice((0, 1, 2, top - 1, top - 2, top // 2, top // 2 - 1, len(content) % top, (1 << 31) % top))
    return content[:at] + value.to_bytes(width, order) + content[at + width :], width


def _extreme_text(content: bytes, chance: random.Random) -> tuple[bytes, int]:
    """Put something else in the place of a number that is written out."""
    at = _position(content, chance)
    found = _NUMBER.search(content, at, at + 256)
    if found is None:
        return _extreme_integer(content, chance)
    return content[: found.start()] + chance.choice(_EXTREME_TEXTS) + content[
        found.end() :
    ], found.end() - found.start()


_MUTATIONS: Final[tuple[Callable[[bytes, random.Random], tuple[bytes, int]], ...]] = (
    _flip_bits,
    _overwrite,
    _delete,
    _insert,
    _swap_blocks,
    _fill,
    _extreme_integer,
    _extreme_text,
)
