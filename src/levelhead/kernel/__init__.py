"""The compiled kernel, its header, and the NumPy twin that the tests hold it against."""

from __future__ import annotations

from pathlib import Path


def get_include() -> str:
    """Return the folder to put on a C++ compiler's include path: ``#include <levelhead/levelhead.hpp>``."""
    return str(Path(__file__).parent / "include")
