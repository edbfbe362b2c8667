"""`levelhead check`, and the preflight in the commands that estimate, as a user meets them."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import levelhead as lh
from levelhead.cli import check as check_command
from levelhead.cli.main import main
from levelhead.events import Event
from levelhead.logs.pieces import Stream
from levelhead.logs.writers import write
from levelhead.sim import SensorModel
from samples.strange_logs import BACK_RIGHT_UP, FLU, in_axes, in_degrees, in_frame, in_g, late, unsaid


@dataclass(frozen=True)
class Done:
    """What a command left."""

    code: int
    stdout: str
    stderr: str


class Terminal:
    """Runs commands in this process, on a terminal of 200 columns."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, *arguments: object) -> Done:
        self.capsys.readouterr()
        with pytest.raises(SystemExit) as caught:
            main([str(argument) for argument in arguments])
        shown = self.capsys.readouterr()
        code = caught.value.code
        return Done(code if isinstance(code, int) else 0, shown.out, shown.err)


@pytest.fixture
def levelhead(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Terminal:
    monkeypatch.setenv("COLUMNS", "200")
    return Terminal(capsys)


@pytest.fixture(scope="module")
def drive() -> lh.Log:
    """Four minutes of curves."""
    sensors = SensorModel(imu_rate=50.0, gnss_rate=5.0)
    return lh.simulate("windrower", seed=1, duration=240.0, speed=7.0, sensors=sensors)[0]


@pytest.fixture(scope="module")
def folder(drive: lh.Log, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs by who said what: `.csv` says nothing in its header, so our rules speak; `.parquet` declares it all."""
    path = tmp_path_factory.mktemp("logs")
    strange = late(in_frame(in_g(in_degrees(in_axes(drive, BACK_RIGHT_UP))), "ENU"), 0.2)
    write(drive, path / "right.parquet")
    write(strange, path / "assumed.csv")
    write(strange, path / "declared.parquet")
    straight = lh.simulate("straight", seed=1, duration=120.0, speed=7.0, sensors=SensorModel(imu_rate=50.0))[0]
    write(straight, path / "straight.csv")
    return path


def test_a_log_that_is_right_passes(levelhead: Terminal, folder: Path) -> None:
    done = levelhead("check", folder / "right.parquet")
    assert (done.code, done.stderr) == (0, "")
    first, *_ = done.stdout.splitlines()
    assert first.startswith("right.parquet: parquet, 240 s, ")
    for name in ("accelerometer unit", "gyro unit", "velocity frame", "axes", "mounting yaw", "clock", "rates", "gaps"):
        (line,) = (line for line in done.stdout.splitlines() if line.startswith(f"{name} "))
        assert " fine " in line
    assert "corrected" not in done.stdout


def test_what_is_assumed_is_put_right_and_said(
    levelhead: Terminal, folder: Path, tmp_path: Path, drive: lh.Log
) -> None:
    fixed, findings = tmp_path / "fixed.parquet", tmp_path / "findings.json"
    done = levelhead("check", folder / "assumed.csv", "-o", fixed, "--json", findings)
    assert (done.code, done.stderr) == (0, "")
    assert f"Wrote {fixed}: the log put right." in done.stdout.replace("\n", "")
    content = json.loads(findings.read_text())
    verdicts = {f["name"]: f["verdict"] for f in content["findings"]}
    for name in ("accelerometer unit", "gyro unit", "velocity frame", "axes", "clock"):
        assert verdicts[name] == "corrected"
    assert content["log"]["source"] == "assumed.csv"
    assert content["log"]["latency_s"] == pytest.approx(0.2, abs=0.01)  # faults.md
    back = lh.read(fixed)
    # Decimal numbers in the CSV, units and degrees back and forth: rounding.
    np.testing.assert_allclose(back.gyro, drive.gyro, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(back.accel, drive.accel, rtol=1e-9)
    np.testing.assert_allclose(back.velocity_ned, drive.velocity_ned, rtol=1e-9)  # type: ignore[arg-type]
    again = levelhead("check", fixed, "--json", findings)
    assert (again.code, again.stderr) == (0, "")
    verdicts = {f["name"]: f["verdict"] for f in json.loads(findings.read_text())["findings"]}
    assert "corrected" not in verdicts.values()
    assert "refused" not in verdicts.values()


def test_what_is_declared_is_refused_and_nothing_written(levelhead: Terminal, folder: Path, tmp_path: Path) -> None:
    fixed = tmp_path / "fixed.parquet"
    done = levelhead("check", folder / "declared.parquet", "-o", fixed)
    assert done.code == 3
    assert done.stderr == (
        "levelhead: declared.parquet cannot be trusted as it is: accelerometer unit, gyro unit, velocity frame, axes.\n"
    )
    assert not fixed.exists()
    words = " ".join(done.stdout.split())
    for option in ("--accel-unit g.", "--gyro-unit deg/s.", "--velocity-frame ENU.", "--axes=-x,y,-z."):
        assert f"Pass {option}" in words


TOLD = ("--axes=-x,y,-z", "--gyro-unit", "deg/s", "--accel-unit", "g", "--velocity-frame", "ENU")


def test_what_the_sentences_say_to_pass_is_enough(
    levelhead: Terminal, folder: Path, tmp_path: Path, drive: lh.Log
) -> None:
    fixed = tmp_path / "fixed.csv"
    done = levelhead("check", folder / "declared.parquet", *TOLD, "--latency", 0.2, "-o", fixed)
    assert (done.code, done.stderr) == (0, "")
    back = lh.read(fixed)
    np.testing.assert_allclose(back.gyro, drive.gyro, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(back.gnss_time, drive.gnss_time, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--axes", "x,y"], 2, "--axes is 'x,y'"),
        (["--gyro-unit", "rpm"], 2, "gyro unit 'rpm'"),
        (["--accel-unit", "lb"], 2, "accel unit 'lb'"),
        (["--velocity-frame", "UVW"], 2, "velocity frame 'UVW'"),
        (["--latency", "nan"], 2, "latency is nan"),
        (["--mounting-yaw", "inf"], 2, "mounting yaw is inf"),
        (["--lever-arm", "1,2"], 2, "--lever-arm"),
        (["--lever-arm", "nan,0,0"], 2, "lever arm is nan"),
        (["--imu", "left"], 2, "left"),
        (["--axes=-x,y,-z"], 3, "axes"),
    ],
)
def test_every_mistake_is_one_sentence(
    options: list[str], code: int, words: str, levelhead: Terminal, folder: Path
) -> None:
    done = levelhead("check", folder / "right.parquet", *options)
    assert done.code == code, done.stderr
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_a_log_that_is_absent_or_none_exits_in_a_sentence(levelhead: Terminal, tmp_path: Path) -> None:
    assert levelhead("check", tmp_path / "missing.csv").code == 2
    (tmp_path / "text.csv").write_text("once upon a time\n")
    assert levelhead("check", tmp_path / "text.csv").code == 3
    header = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,vel_n,vel_e,vel_d\n"
    rows = [f"{0.01 * k},0,0,0,0,0,-9.8,{'1,0,0' if k == 50 else ',,'}\n" for k in range(200)]
    (tmp_path / "one.csv").write_text(header + "".join(rows))
    done = levelhead("check", tmp_path / "one.csv")
    assert done.code == 3
    assert len(done.stderr.splitlines()) == 1


def test_a_cut_log_is_checked_and_exits_with_3(levelhead: Terminal, folder: Path, tmp_path: Path) -> None:
    text = (folder / "assumed.csv").read_bytes()
    cut = tmp_path / "cut.csv"
    cut.write_bytes(text[: len(text) * 2 // 3])
    done = levelhead("check", cut)
    assert done.code == 3
    assert "read only in part" in done.stderr
    assert "W_TRUNCATED" in done.stdout


HOSTILE = "[bold red]x[/] \x1b]0;owned\x07\x1b[2J <script>alert(1)</script>"


def test_streams_are_named_and_hostile_names_are_shown_as_they_are(
    levelhead: Terminal, drive: lh.Log, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    streams = (
        Stream(kind="imu", name="imu0", samples=12000, note="as measured"),
        Stream(kind="imu", name=HOSTILE, samples=17, note=HOSTILE),
        Stream(kind="gnss", name="/gps/fix", samples=1200),
    )
    event = Event(code="W_DROPPED", count=3, detail=HOSTILE)
    meta = {**drive.meta, "streams": streams, "compensated": f"Biases taken off by {HOSTILE}."}
    log = replace(drive, meta=meta, events=(event,))
    monkeypatch.setattr(check_command, "read_log", lambda *_args, **_more: log)
    done = levelhead("check", tmp_path / f"a{HOSTILE.replace('/', '')}.csv", "--json", tmp_path / "found.json")
    assert done.code == 0
    assert "  IMU imu0: 12000 samples (as measured)\n" in done.stdout
    assert "  GNSS /gps/fix: 1200 samples\n" in done.stdout
    assert done.stdout.count("[bold red]x[/]") >= 4  # not taken as markup
    assert "\x1b" not in done.stdout
    assert "\x07" not in done.stdout
    assert "\\x1b[2J" in done.stdout  # but shown
    json.loads((tmp_path / "found.json").read_text())


def test_hostile_names_do_not_steer_the_terminal_by_way_of_errors(levelhead: Terminal, tmp_path: Path) -> None:
    done = levelhead("check", tmp_path / "a\x1b[2Jb.csv")
    assert done.code == 2
    assert "\x1b" not in done.stderr


def summary_of(folder: Path) -> dict[str, object]:
    content = json.loads((folder / "summary.json").read_text())
    assert isinstance(content, dict)
    return content


def test_estimate_checks_first_and_puts_right(levelhead: Terminal, folder: Path, tmp_path: Path, drive: lh.Log) -> None:
    done = levelhead("estimate", folder / "assumed.csv", "-o", tmp_path / "out")
    assert done.code == 0, done.stderr
    summary = summary_of(tmp_path / "out")
    assert summary["latency_s"] == pytest.approx(0.2, abs=0.01)  # faults.md
    codes = {event["code"] for event in summary["events"]}  # type: ignore[attr-defined]
    assert {"E_UNIT_GYRO", "E_UNIT_ACCEL", "E_AXES", "E_VEL_FRAME", "W_LATENCY"} <= codes
    preflight = summary["preflight"]
    assert isinstance(preflight, dict)
    assert {f["name"] for f in preflight["findings"]} >= {"axes", "clock", "biases"}
    right = lh.estimate(drive).summary()
    # faults.md: 0.02 deg/s and 0.04 m/s^2 after a fault; here nothing but 2 ms of the clocks is left of it.
    for key, tolerance in (("gyro_bias_deg_s", 0.005), ("accel_bias_m_s2", 0.01)):
        for ours, theirs in zip(summary[key], right[key], strict=True):  # type: ignore[call-overload]
            assert (ours is None) == (theirs is None)
            assert ours is None or ours == pytest.approx(theirs, abs=tolerance)
    page = (tmp_path / "out" / "report.html").read_text()
    assert 'id="preflight"' in page
    assert "5 things were put right" in page


def test_estimate_refuses_what_it_cannot_trust_and_writes_nothing(
    levelhead: Terminal, folder: Path, tmp_path: Path
) -> None:
    done = levelhead("estimate", folder / "declared.parquet", "-o", tmp_path / "out")
    assert done.code == 3
    (sentence,) = done.stderr.splitlines()
    assert "declared.parquet cannot be trusted as it is" in sentence
    assert "--accel-unit g" in sentence
    assert not (tmp_path / "out").exists()


def test_estimate_takes_what_it_is_told(levelhead: Terminal, folder: Path, tmp_path: Path) -> None:
    options = (*TOLD, "--latency", 0.21, "--mounting-yaw", -3)
    done = levelhead("estimate", folder / "declared.parquet", "-o", tmp_path / "out", *options)
    assert done.code == 0, done.stderr
    summary = summary_of(tmp_path / "out")
    assert summary["latency_s"] == 0.21
    assert summary["mounting"]["yaw_deg"] == pytest.approx(-3.0)  # type: ignore[index]
    verdicts = {f["name"]: f for f in summary["preflight"]["findings"]}  # type: ignore[index]
    assert verdicts["mounting yaw"]["verdict"] == "warning"  # nobody turned it
    assert "besides what --mounting-yaw says" in verdicts["mounting yaw"]["text"]


def test_no_preflight_takes_the_log_as_it_is(levelhead: Terminal, folder: Path, tmp_path: Path) -> None:
    done = levelhead(
        "estimate", folder / "declared.parquet", "-o", tmp_path / "out", "--no-preflight", "--corrected", "parquet"
    )
    assert done.code == 0, done.stderr
    summary = summary_of(tmp_path / "out")
    assert summary["preflight"] is None
    assert summary["latency_s"] is None
    assert 'id="preflight"' not in (tmp_path / "out" / "report.html").read_text()
    expected = lh.estimate(lh.read(folder / "declared.parquet"))
    corrected = lh.read(tmp_path / "out" / "corrected.parquet")
    # To the bit: nothing but the biases was taken off.
    np.testing.assert_array_equal(corrected.gyro, lh.read(folder / "declared.parquet").corrected(expected).gyro)


@pytest.mark.parametrize(
    "option", [["--axes", "x,y,z"], ["--latency", "0.0"], ["--gyro-unit", "rad/s"], ["--mounting-yaw", "0"]]
)
def test_no_preflight_and_what_it_would_need_do_not_go_together(
    option: list[str], levelhead: Terminal, folder: Path, tmp_path: Path
) -> None:
    done = levelhead("estimate", folder / "right.parquet", "-o", tmp_path, "--no-preflight", *option)
    assert done.code == 2
    assert "--no-preflight takes the log as it is" in done.stderr


@pytest.mark.parametrize(
    "command", [["compare", "--methods", "observer"], ["validate", "--method", "observer"], ["tune"]]
)
def test_the_other_commands_check_too(command: list[str], levelhead: Terminal, folder: Path, tmp_path: Path) -> None:
    verb, *options = command
    target = tmp_path / ("out.toml" if verb == "tune" else "out")
    refused = levelhead(verb, folder / "declared.parquet", *options, "-o", target)
    assert refused.code == 3
    assert "cannot be trusted as it is" in refused.stderr
    assert not target.exists()
    taken = levelhead(verb, folder / "assumed.csv", *options, "-o", target)
    assert taken.code == 0, taken.stderr
    assert target.exists()


def test_compare_as_it_is_and_put_right_are_not_the_same(levelhead: Terminal, folder: Path, tmp_path: Path) -> None:
    biases = []
    for name, options in (("checked", []), ("raw", ["--no-preflight"])):
        options = ["--methods", "observer", *options]
        done = levelhead("compare", folder / "assumed.csv", "-o", tmp_path / name, *options)
        assert done.code == 0, done.stderr
        content = json.loads((tmp_path / name / "comparison.json").read_text())
        biases.append(content["methods"]["observer"]["gyro_bias_deg_s"])
    assert biases[0] != biases[1]


def test_a_drive_that_cannot_tell_is_said_to(levelhead: Terminal, folder: Path, tmp_path: Path) -> None:
    done = levelhead("check", folder / "straight.csv", "--json", tmp_path / "found.json")
    assert done.code == 0
    found = {f["name"]: f for f in json.loads((tmp_path / "found.json").read_text())["findings"]}
    for name in ("gyro unit", "axes", "clock"):
        assert found[name]["verdict"] == "undecided"
    assert found["driving"]["verdict"] == "warning"


def test_what_nobody_says_and_the_drive_does_not_tell_is_refused(
    levelhead: Terminal, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    straight = lh.read(folder / "straight.csv")
    log = unsaid(replace(straight, position_llh=None, position_std=None))
    monkeypatch.setattr(check_command, "read_log", lambda *_args, **_more: log)
    done = levelhead("check", folder / "straight.csv")
    assert done.code == 3
    words = " ".join(done.stdout.split())
    for option in ("--gyro-unit rad/s or deg/s", "--velocity-frame", "--axes", "--latency"):
        assert f"Pass {option}." in words
    told = ("--axes", "x,y,z", "--gyro-unit", "rad/s", "--velocity-frame", "NED", "--latency", 0)
    assert levelhead("check", folder / "straight.csv", *told).code == 0


def test_the_reason_of_a_refusal_goes_with_each_of_several_logs(
    levelhead: Terminal, folder: Path, tmp_path: Path
) -> None:
    done = levelhead("estimate", folder / "right.parquet", folder / "declared.parquet", "-o", tmp_path / "out")
    assert done.code == 3
    assert "declared.parquet cannot be trusted" in done.stderr
    assert summary_of(tmp_path / "out" / "right")["preflight"] is not None
    assert not (tmp_path / "out" / "declared").exists()


def test_axes_put_right_are_turned_back_for_the_sensor(drive: lh.Log) -> None:
    found = lh.check(unsaid(in_axes(drive, FLU)))
    turned = np.array(found.log.meta["dcm_file_to_body"])
    np.testing.assert_allclose(turned @ FLU, np.eye(3), atol=math.radians(0.5))
