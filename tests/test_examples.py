"""The examples run and say what they claim."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import levelhead as lh

EXAMPLES = Path(__file__).parent.parent / "examples"


def output(*command: str) -> str:
    """Run a command and return what it prints."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_quickstart() -> None:
    text = output(sys.executable, str(EXAMPLES / "quickstart.py"))
    assert "known: {'gyro': [True, True, True], 'accel': [True, True, False]}" in text


def test_live_gives_the_same_bits_as_the_batch_run() -> None:
    assert "same bits as the batch run: True" in output(sys.executable, str(EXAMPLES / "live.py"))


def test_the_header_alone(tmp_path: Path) -> None:
    compiler = shutil.which("c++")
    if compiler is None:
        pytest.skip("no C++ compiler on the path")
    program = tmp_path / "observer"
    source = str(EXAMPLES / "observer.cpp")
    output(compiler, "-std=c++17", "-Wall", "-Werror", f"-I{lh.get_include()}", source, "-o", str(program))
    # 0.1 deg/s put in; a straight teaches the gyro (status bit 16) and never the accelerometer (32).
    words = output(str(program)).replace(",", "").split()
    assert float(words[3]) == pytest.approx(0.1, abs=1e-4)
    assert int(words[-1]) & 16
    assert not int(words[-1]) & 32
