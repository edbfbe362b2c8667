"""What the README tells a newcomer to type works as printed."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import levelhead as lh

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's folder with the files that the README's commands name."""
    place = tmp_path_factory.mktemp("user")
    log, _ = lh.simulate("windrower", seed=1, duration=200.0)
    lh.write(log, place / "drive.csv")
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    np.savetxt(place / "imu.csv", np.column_stack([log.time * 1000.0, log.accel, np.degrees(log.gyro)]), delimiter=",")
    (place / "my-imu.toml").write_text(
        "[imu]\nheader = false\n"
        "columns = { time = 1, accel_x = 2, accel_y = 3, accel_z = 4, gyro_x = 5, gyro_y = 6, gyro_z = 7 }\n"
        'units = { time = "ms", gyro = "deg/s" }\ntime_zero = "2026-05-01T10:00:00"\n'
    )
    zero = datetime(2026, 5, 1, 10, tzinfo=UTC)
    lines = [
        "%  GPST  latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) "
    ]
    lines[0] += "ratio vn(m/s) ve(m/s) vu(m/s)"
    for t, v, p in zip(log.gnss_time, log.velocity_ned, log.position_llh, strict=True):
        stamp = (zero + timedelta(seconds=float(t))).strftime("%Y/%m/%d %H:%M:%S.%f")[:-3]
        place_text = f"{np.degrees(p[0]):.9f} {np.degrees(p[1]):.9f} {p[2]:.4f}"
        lines.append(f"{stamp} {place_text} 1 20 .01 .01 .02 0 0 0 0 99 {v[0]:.4f} {v[1]:.4f} {-v[2]:.4f}")
    (place / "solution.pos").write_text("\n".join(lines) + "\n")
    return place


def commands() -> list[str]:
    """Every line of the README that begins with the command."""
    return re.findall(r"^    (levelhead .*)$", README, flags=re.MULTILINE)


def test_every_command_runs(folder: Path) -> None:
    lines = commands()
    assert len(lines) >= 5
    for line in lines:
        arguments = shlex.split(line)[1:]
        done = subprocess.run(
            [sys.executable, "-m", "levelhead", *arguments], capture_output=True, text=True, check=False, cwd=folder
        )
        assert done.returncode == 0, f"{line}: {done.stderr}"
    assert {"summary.json", "result.parquet", "report.html"} <= {p.name for p in (folder / "out").iterdir()}


def test_the_first_python_lines_run() -> None:
    code = re.search(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert code is not None
    done = subprocess.run([sys.executable, "-c", code.group(1)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_links_and_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"make (\w+)", README):
        if target != "and":
            assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target
    for name in ("README.md", "CONTRIBUTING.md", "docs/estimators.md", "docs/logs.md"):
        text = (ROOT / name).read_text(encoding="utf-8")
        for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
            if not link.startswith("http"):
                assert (ROOT / name).parent.joinpath(link).exists(), f"{name}: {link}"
