"""`compare`, `validate` and `simulate --compare` as a user meets them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import levelhead as lh
from levelhead.cli.main import main
from levelhead.errors import LogError
from levelhead.estimators import METHODS, Method
from levelhead.estimators.base import Result
from levelhead.report.files import read_truth


def levelhead(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command as a user does."""
    command = [sys.executable, "-m", "levelhead", *map(str, arguments)]
    environment = {**os.environ, "COLUMNS": "80", "PYTHONWARNINGS": "error"}
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=environment)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated drive of five minutes, as the simulate command writes it."""
    path = tmp_path_factory.mktemp("drive") / "curves.parquet"
    done = levelhead("simulate", "windrower", "-o", path, "--seed", 5, "--duration", 300)
    assert done.returncode == 0, done.stderr
    return path


def test_compare_shows_every_method_and_writes_both_files(drive: Path, tmp_path: Path) -> None:
    done = levelhead("compare", drive, "-o", tmp_path / "new" / "out")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert sorted(p.name for p in (tmp_path / "new" / "out").iterdir()) == ["comparison.html", "comparison.json"]
    content = json.loads((tmp_path / "new" / "out" / "comparison.json").read_text())
    assert list(content["methods"]) == list(METHODS)
    assert content["log"]["completeness"] == "complete"
    expected = lh.estimate(lh.read(drive), "two-stage").summary()
    assert content["methods"]["two-stage"]["accel_bias_m_s2"] == expected["accel_bias_m_s2"]
    assert all(method in done.stdout for method in METHODS)
    assert max(len(line) for line in done.stdout.splitlines()) <= 80
    assert content["methods"]["observer"]["error_rms"] is None


def test_compare_measures_against_the_truth_of_a_simulated_drive(drive: Path, tmp_path: Path) -> None:
    truth = drive.with_name("curves.truth.parquet")
    done = levelhead("compare", drive, "-o", tmp_path, "--truth", truth, "--methods", "two-stage, observer")
    assert done.returncode == 0, done.stderr
    methods = json.loads((tmp_path / "comparison.json").read_text())["methods"]
    assert list(methods) == ["two-stage", "observer"]
    # Curves, five minutes: the observer has settled; demanded are 0.06 deg and 0.003 deg/s after 15 minutes.
    assert max(methods["observer"]["error_rms"]["attitude_deg"][:2]) < 0.2
    exact = read_truth(truth)
    assert exact.time.size == lh.read(drive).time.size
    _, same = lh.simulate("windrower", seed=5, duration=2.0, earth_rotation=True)  # as the command does
    assert exact.columns().keys() == same.columns().keys()


def test_a_method_that_fails_is_said_and_the_others_are_shown(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object) -> Result:
        raise LogError("The stubborn method refuses <b>every</b> log.")

    monkeypatch.setitem(METHODS, "stubborn", Method(params=lh.ObserverParams, run=refuse))
    with pytest.raises(SystemExit) as ended:
        main(["compare", str(drive), "-o", str(tmp_path), "--methods", "stubborn,observer"])
    assert ended.value.code == 3
    shown = capsys.readouterr()
    assert shown.err == "levelhead: stubborn failed: The stubborn method refuses <b>every</b> log.\n"
    assert "failed" in shown.out
    methods = json.loads((tmp_path / "comparison.json").read_text())["methods"]
    assert methods["stubborn"] == {"failed": "The stubborn method refuses <b>every</b> log."}
    assert methods["observer"]["failed"] is None
    assert "refuses &lt;b&gt;every&lt;/b&gt; log" in (tmp_path / "comparison.html").read_text()


def test_validate_gives_the_added_biases_back(drive: Path, tmp_path: Path) -> None:
    settings = tmp_path / "my.toml"
    settings.write_text("tau_gyro = 41.0\n")
    options = ("--method", "observer", "--params", settings, "--lever-arm", "0.1,0,0")
    done = levelhead("validate", drive, "-o", tmp_path / "out", *options)
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["validation.html", "validation.json"]
    content = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert content["method"] == "observer"
    assert content["params"]["tau_gyro"] == 41.0
    assert content["params"]["lever_arm"] == [0.1, 0.0, 0.0]
    # The bands within which a bias counts as settled (estimators/trust.py); after five minutes it has.
    assert content["worst"]["gyro_deg_s"] < 0.02
    assert content["worst"]["accel_m_s2"] < 0.04
    assert len(content["cases"]) > 20
    assert {change["constant"] for change in content["sensitivity"]["changes"]} >= {"tau", "tau_gyro", "omega_accel"}
    assert max(len(line) for line in done.stdout.splitlines()) <= 80


def _with_position_sigma(method: Method) -> Method:
    """Return a method whose positions, interpolated or estimated, are said to be good to half a metre."""

    def run(data: lh.Log, *arguments: object) -> Result:
        result = method.run(data, *arguments)
        return replace(result, position_std=np.full((data.time.size, 3), 0.5))

    return replace(method, run=run)


def test_validate_takes_gnss_away_where_asked(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("phasor", "smoother"):
        monkeypatch.setitem(METHODS, name, _with_position_sigma(METHODS[name]))
    for options, key in ((["--outages", "15"], "shown"), ([], "absent")):
        with pytest.raises(SystemExit) as ended:
            main(["validate", str(drive), "-o", str(tmp_path / key), "--method", "two-stage", *options])
        assert ended.value.code == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert max(len(line) for line in said.out.splitlines()) <= 80
    assert said.out.count("outages of 15 s") == 1
    outages = json.loads((tmp_path / "shown" / "validation.json").read_text())["outages"]
    assert [run["run"] for run in outages["runs"]][:2] == ["phasor", "smoother"]
    # Five minutes: from 75 s on every minute, with 15 s behind the last.
    assert [window["start_s"] for window in outages["runs"][0]["windows"]] == [75.0, 135.0, 195.0, 255.0]
    assert 'id="outages"' in (tmp_path / "shown" / "validation.html").read_text()
    assert json.loads((tmp_path / "absent" / "validation.json").read_text())["outages"] is None
    assert 'id="outages"' not in (tmp_path / "absent" / "validation.html").read_text()


def test_a_log_without_positions_is_validated_all_the_same(drive: Path, tmp_path: Path) -> None:
    log = lh.read(drive).slice(0.0, 60.0)
    bare = tmp_path / "bare.parquet"
    lh.write(replace(log, position_llh=None, position_std=None), bare)
    done = levelhead("validate", bare, "-o", tmp_path / "out", "--method", "observer", "--outages", "15")
    assert done.returncode == 0, done.stderr
    assert "Outages: The log has no GNSS positions" in done.stdout
    content = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert content["cases"]
    assert "no GNSS positions" in content["outages"]["reason"]


def test_tuned_constants_are_taken_by_estimate(drive: Path, tmp_path: Path) -> None:
    settings = tmp_path / "my.toml"
    done = levelhead("tune", drive, "-o", settings)
    assert done.returncode == 0, done.stderr
    tables = tomllib.loads(settings.read_text())
    assert set(tables) == {"observer", "two-stage", "phasor", "smoother", "ekf"}
    # What was minimised is not where it started.
    assert tables["observer"]["tau_gyro"] != 40.0
    assert max(len(line) for line in done.stdout.splitlines() if " = " not in line) <= 80
    for method in ("observer", "smoother"):
        again = levelhead("estimate", drive, "-o", tmp_path / method, "--method", method, "--params", settings)
        assert again.returncode == 0, again.stderr
        params = json.loads((tmp_path / method / "summary.json").read_text())["params"]
        for name, value in tables[method].items():
            assert params[name] == value, name


def test_many_drives_are_compared(tmp_path: Path) -> None:
    arguments = ("simulate", "windrower", "--runs", 2, "--compare", "--duration", 60, "--seed", 7)
    done = levelhead(*arguments, "--methods", "observer,two-stage", "--workers", 2, "-o", tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["montecarlo.html", "montecarlo.json"]
    content = json.loads((tmp_path / "montecarlo.json").read_text())
    assert (content["runs"], content["first_seed"], content["duration_s"]) == (2, 7, 60.0)
    assert list(content["methods"]) == ["observer", "two-stage"]
    assert "seeds 7 to 8" in done.stdout
    assert max(len(line) for line in done.stdout.splitlines()) <= 80
    only_shown = levelhead(*arguments, "--methods", "observer", "--workers", 1, cwd=tmp_path)
    assert only_shown.returncode == 0, only_shown.stderr
    assert len(list(tmp_path.iterdir())) == 2


def test_ctrl_c_ends_many_drives_quietly(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "levelhead", "simulate", "field", "--runs", "2000", "--compare", "--workers", "2"]
    process = subprocess.Popen(
        [*command, "-o", str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A suite that runs in the background of a script has Ctrl-C ignored, and its children would inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    time.sleep(2.0)
    assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to every process of the group
    # One drive of ten minutes takes each worker a fraction of a second; the rest is a busy machine.
    out, err = process.communicate(timeout=30.0)
    assert process.returncode == 130
    assert (out, err) == ("", "")
    assert not (tmp_path / "out").exists()


BAD = [
    (["compare", "missing.csv", "-o", "out"], 2, "missing.csv"),
    (["compare", "empty.csv", "-o", "out"], 3, "empty.csv"),
    (["compare", "good.csv", "-o", "out", "--methods", "observer,magic"], 2, "'magic'"),
    (["compare", "good.csv", "-o", "out", "--methods", ""], 2, "''"),
    (["compare", "good.csv", "-o", "out", "--lever-arm", "1,2"], 2, "--lever-arm"),
    (["compare", "good.csv", "-o", "out", "--truth", "missing.parquet"], 2, "missing.parquet"),
    (["compare", "good.csv", "-o", "out", "--truth", "good.csv"], 2, "good.csv"),
    (["compare", "good.csv", "-o", "out", "--truth", "log.parquet"], 2, "no column"),
    (["compare", "good.csv", "-o", "good.csv"], 1, "good.csv"),
    (["validate", "empty.csv", "-o", "out"], 3, "empty.csv"),
    (["validate", "good.csv", "-o", "out", "--method", "magic"], 2, "'magic'"),
    (["validate", "good.csv", "-o", "out", "--lever-arm", "1,2,900"], 2, "within 50 m"),
    (["validate", "good.csv", "-o", "out", "--outages", "3"], 2, "give 5 s or more"),
    (["validate", "good.csv", "-o", "out", "--outages", "nan"], 2, "give 5 s or more"),
    (["simulate", "field"], 2, "-o FILE"),
    (["simulate", "field", "--compare"], 2, "--runs"),
    (["simulate", "field", "-o", "out.csv", "--runs", "3"], 2, "--compare"),
    (["simulate", "field", "-o", "out.csv", "--workers", "3"], 2, "--compare"),
    (["simulate", "moon", "--compare", "--runs", "3"], 2, "moon"),
    (["simulate", "field", "--compare", "--runs", "0"], 2, "runs is 0"),
    (["simulate", "field", "--compare", "--runs", "3", "--workers", "0"], 2, "workers is 0"),
    (["simulate", "field", "--compare", "--runs", "3", "--duration", "-5"], 2, "-5"),
    (["simulate", "field", "--compare", "--runs", "2", "--duration", "1e12"], 2, "1000000000000"),
]


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a good log and things that are none."""
    folder = tmp_path_factory.mktemp("bad")
    header = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,vel_n,vel_e,vel_d\n"
    rows = [f"{0.01 * i:.2f},0,0,0.001,0,0,-9.8,{'1,0,0' if i % 10 == 0 else ',,'}\n" for i in range(400)]
    (folder / "good.csv").write_text(header + "".join(rows))
    (folder / "empty.csv").write_text("")
    lh.write(lh.read(folder / "good.csv"), folder / "log.parquet")
    return folder


@pytest.mark.parametrize(("arguments", "code", "words"), BAD)
def test_every_mistake_is_one_sentence_and_leaves_nothing(
    arguments: list[str],
    code: int,
    words: str,
    bad_files: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = sorted(p.name for p in bad_files.rglob("*"))
    monkeypatch.chdir(bad_files)
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    said = capsys.readouterr().err
    assert ended.value.code == code, said
    assert words in said
    lines = said.strip().splitlines()
    assert len(lines) == 1, said
    assert lines[0].startswith("levelhead: ")
    assert lines[0].endswith((".", ")"))
    assert sorted(p.name for p in bad_files.rglob("*")) == before


def test_a_cut_log_is_used_marked_and_exits_with_3(drive: Path, tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.csv", tmp_path / "cut.csv"
    assert levelhead("convert", drive, "-o", whole).returncode == 0
    text = whole.read_bytes()
    cut.write_bytes(text[: len(text) // 3])
    for verb, name in (("compare", "comparison"), ("validate", "validation")):
        done = levelhead(verb, cut, "-o", tmp_path / "out")
        assert done.returncode == 3, done.stderr
        assert "read only in part" in done.stderr
        assert json.loads((tmp_path / "out" / f"{name}.json").read_text())["log"]["completeness"] == "truncated"
        assert "Read only in part" in (tmp_path / "out" / f"{name}.html").read_text()


def test_help_says_what_they_do() -> None:
    for verb, word in (("compare", "comparison.json"), ("validate", "validation.json"), ("simulate", "--runs")):
        done = levelhead(verb, "--help")
        assert done.returncode == 0
        assert word in done.stdout
