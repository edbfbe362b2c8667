"""What docs/analysis.md tells the reader to type works as printed."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

PAGE = (Path(__file__).parent.parent / "docs" / "analysis.md").read_text(encoding="utf-8")


def test_every_command_runs_in_order(tmp_path: Path) -> None:
    lines = re.findall(r"^    (levelhead .*)$", PAGE, flags=re.MULTILINE)
    assert {shlex.split(line)[1] for line in lines} == {"simulate", "compare", "validate"}
    for line in lines:
        command = [sys.executable, "-m", "levelhead", *shlex.split(line)[1:]]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
        assert done.returncode == 0, f"{line}: {done.stderr}"
    for name in ("comparison", "validation", "montecarlo"):
        for suffix in ("json", "html"):
            assert list(tmp_path.glob(f"*/{name}.{suffix}")), name


def test_the_python_lines_run() -> None:
    code = re.search(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    assert code is not None
    done = subprocess.run([sys.executable, "-c", code.group(1)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_figures_named_are_those_of_the_code() -> None:
    from levelhead.analysis.injection import default_cases
    from levelhead.analysis.trials import chi_square_band

    assert f"{len(default_cases())} cases" in PAGE
    for runs, words in ((20, "0.48\nto 1.71"), (1000, "0.91 to 1.09")):
        low, high = chi_square_band(runs)
        assert words.replace("\n", " ") == f"{low:.2f} to {high:.2f}"
        assert words in PAGE


def test_the_outages_described_are_those_of_the_code() -> None:
    from levelhead.analysis import outages

    words = PAGE.replace("\n", " ")
    assert f"(seconds, {outages.SHORTEST_S:g} or more" in words
    assert f"the first after {outages.FIRST_S:g} s" in words
    assert f"at most {outages.MAX_WINDOWS}," in words
    assert outages.AIDED_LENGTHS == 3.0  # "at least three lengths of GNSS"
