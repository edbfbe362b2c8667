"""The header stands alone: C++17 without STL, heap, exceptions or RTTI, warnings as errors, in float and double."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

import levelhead as lh

PROGRAM = """
#include <levelhead/levelhead.hpp>
template struct levelhead::Stream<levelhead::Observer<float>>;
template struct levelhead::Stream<levelhead::Observer<double>>;
template struct levelhead::Stream<levelhead::TwoStage<float>>;
template struct levelhead::Stream<levelhead::TwoStage<double>>;
template struct levelhead::Stream<levelhead::Ekf<float>>;
template struct levelhead::Stream<levelhead::Ekf<double>>;
template struct levelhead::Stream<levelhead::Mahony<float>>;
template struct levelhead::Stream<levelhead::Mahony<double>>;
template struct levelhead::Stream<levelhead::Phasor<float>>;
template struct levelhead::Stream<levelhead::Phasor<double>>;
template struct levelhead::FixedGainCovariance<float, false>;
template struct levelhead::FixedGainCovariance<float, true>;
template levelhead::Gains<float> levelhead::gains(
    const levelhead::ObserverParams<float>&, const levelhead::Interval<float>&);
template levelhead::Gains<float> levelhead::gains(
    const levelhead::TwoStageParams<float>&, const levelhead::Interval<float>&);
"""


@pytest.fixture(scope="module")
def compiler() -> str:
    """A C++ compiler."""
    found = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    if found is None:
        pytest.skip("no C++ compiler on the path")
    return found


def headers() -> list[Path]:
    return sorted((Path(lh.get_include()) / "levelhead").glob("*.hpp"))


def test_the_header_compiles_as_firmware_would(compiler: str, tmp_path: Path) -> None:
    source = tmp_path / "all.cpp"
    source.write_text(PROGRAM)
    flags = ["-std=c++17", "-O1", "-fno-exceptions", "-fno-rtti", "-ffreestanding", "-nostdinc++"]
    warnings = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wfloat-conversion", "-Werror"]
    command = [compiler, *flags, *warnings, f"-I{lh.get_include()}", "-c", str(source), "-o", str(tmp_path / "all.o")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_each_header_stands_alone(compiler: str, tmp_path: Path) -> None:
    for header in headers():
        source = tmp_path / f"{header.stem}.cpp"
        source.write_text(f"#include <levelhead/{header.name}>\n")
        command = [compiler, "-std=c++17", "-fsyntax-only", "-nostdinc++", f"-I{lh.get_include()}", str(source)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{header.name}: {done.stderr}"


def test_it_includes_nothing_but_c() -> None:
    names = [header.name for header in headers()]
    assert "levelhead.hpp" in names
    for header in headers():
        included = re.findall(r'#include [<"]([^>"]+)[>"]', header.read_text())
        assert set(included) <= {"math.h", "stdint.h", *names}, header.name
