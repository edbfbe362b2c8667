"""Fixtures for the whole suite."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of the recorded drives; tests that need it skip where it is absent."""
    folder = Path(os.environ.get("LEVELHEAD_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("recorded drives are absent; name their folder in LEVELHEAD_DATA")
    return folder
