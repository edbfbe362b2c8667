"""Chunks are unpacked to what they are, never to more than they say."""

from __future__ import annotations

import bz2
import io

import numpy as np
import pyarrow as pa
import pytest

from levelhead.logs.readers.ros_files import MAX_CHUNK, find, unpacked

CONTENT = np.random.default_rng(1).integers(0, 50, 200_000, dtype=np.uint8).tobytes()
PACKED = {
    "lz4": pa.compress(CONTENT, codec="lz4", asbytes=True),
    "zstd": pa.compress(CONTENT, codec="zstd", asbytes=True),
    "bz2": bz2.compress(CONTENT),
}
ALL = pytest.mark.parametrize("compression", PACKED)


@ALL
def test_what_is_packed_comes_out(compression: str) -> None:
    assert unpacked(PACKED[compression], compression, len(CONTENT)) == (CONTENT, "")


@ALL
@pytest.mark.parametrize("more", [-7, 7, 100_000])
def test_another_length_than_declared_is_told(compression: str, more: int) -> None:
    content, wrong = unpacked(PACKED[compression], compression, len(CONTENT) + more)
    assert content == CONTENT[: len(CONTENT) + more]
    assert f"another length than the {len(CONTENT) + more} bytes" in wrong


@ALL
def test_of_a_cut_chunk_the_beginning_comes_out(compression: str) -> None:
    content, wrong = unpacked(PACKED[compression][:-20], compression, len(CONTENT))
    assert "could not be unpacked" in wrong
    assert CONTENT.startswith(content)


@pytest.mark.parametrize(("packed", "declared"), [(10**4, MAX_CHUNK + 1), (10, 2**23), (10**4, 2**62)])
def test_what_would_grow_too_much_is_left_packed(packed: int, declared: int) -> None:
    content, wrong = unpacked(bytes(packed), "zstd", declared)
    assert content == b""
    assert "which is too much" in wrong


def test_an_unknown_compression_is_named() -> None:
    assert unpacked(b"", "rar", 10) == (b"", "a chunk has the unknown compression 'rar'")


@pytest.mark.parametrize("at", [0, 100, (1 << 20) - 3, 1 << 20, (1 << 20) + 5, (2 << 20) - 1])
def test_a_mark_is_found_wherever_it_lies(at: int) -> None:
    content = bytearray(3 << 20)
    content[at : at + 5] = b"mark!"
    file = io.BytesIO(content)
    assert find(file, b"mark!", 0, len(content)) == at
    assert find(file, b"mark!", at, at + 1) == at
    assert find(file, b"mark!", at + 1, len(content)) is None
    assert find(file, b"mark!", 0, at) is None
