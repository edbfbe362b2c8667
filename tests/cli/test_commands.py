"""The command line as a user meets it: outputs, exit codes, one sentence per error, nothing half-written."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import levelhead as lh
from levelhead.report.files import read_truth

RESULT_COLUMNS = {
    "time",
    *(f"{name}_{axis}" for name in ("gyro_bias", "accel_bias", "gyro_bias_std", "accel_bias_std") for axis in "xyz"),
    *("roll", "pitch", "heading", "roll_std", "pitch_std", "heading_std"),
    *("velocity_n", "velocity_e", "velocity_d", "status"),
    *("velocity_std_n", "velocity_std_e", "velocity_std_d", "heading_source"),
    *("position_std_n", "position_std_e", "position_std_d"),
}


def levelhead(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command as a user does."""
    command = [sys.executable, "-m", "levelhead", *map(str, arguments)]
    environment = {**os.environ, "COLUMNS": "200", "PYTHONWARNINGS": "error"}
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=environment)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated drive of five minutes, as the simulate command writes it."""
    path = tmp_path_factory.mktemp("drive") / "curves.parquet"
    done = levelhead("simulate", "windrower", "-o", path, "--seed", 5, "--duration", 300)
    assert done.returncode == 0, done.stderr
    return path


def test_the_demo_is_the_main_job(tmp_path: Path) -> None:
    done = levelhead("demo", "-o", tmp_path / "new" / "folder")
    assert done.returncode == 0, done.stderr
    assert "truth" in done.stdout
    folder = tmp_path / "new" / "folder"
    assert sorted(p.name for p in folder.iterdir()) == ["report.html", "result.parquet", "summary.json"]
    summary = json.loads((folder / "summary.json").read_text())
    # The truth of seed 1 at the end, within the accuracy demanded on this drive (three sigma).
    _, truth = lh.simulate("field", seed=1, duration=1800.0)
    np.testing.assert_allclose(summary["gyro_bias_deg_s"], np.degrees(truth.gyro_bias[-1]), atol=0.009)
    np.testing.assert_allclose(summary["accel_bias_m_s2"][:2], truth.accel_bias[-1, :2], atol=0.015)


def test_simulate_writes_the_truth_beside_the_log(drive: Path) -> None:
    truth = pq.read_table(drive.with_name("curves.truth.parquet"))
    assert truth.num_rows == lh.read(drive).time.size
    assert {"time", "gyro_bias_x", "accel_bias_y", "roll", "latitude"} <= set(truth.column_names)
    units = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in truth.schema}
    assert units["gyro_bias_x"] == "rad/s"
    assert units["specific_force_z"] == "m/s^2"
    assert all(units.values())


def test_simulate_takes_the_drive_the_user_describes(tmp_path: Path) -> None:
    path = tmp_path / "fast.parquet"
    options = ["--speed", 12, "--lever-arm", "1,0.5,-2", "--latitude-deg", -33, "--outage", "5,3", "--outage", "15,60"]
    done = levelhead("simulate", "crab", "-o", path, "--duration", 20, "--seed", 2, "--wheel-speed", *options)
    assert done.returncode == 0, done.stderr
    truth, log = read_truth(tmp_path / "fast.truth.parquet"), lh.read(path)
    np.testing.assert_allclose(np.linalg.norm(truth.velocity_ned, axis=1), 12.0, rtol=1e-13)  # rounding
    assert math.degrees(truth.position_llh[0, 0]) == pytest.approx(-33.0, abs=1e-12)
    assert log.gnss_time.size == 200 - 30 - 50
    assert not np.any((log.gnss_time >= 5.0) & (log.gnss_time < 8.0))
    # The antenna is where the truth has it, 2 cm of noise aside: six sigma, and 6.4e6 m for the Earth's radius.
    assert log.position_llh is not None
    assert 6.4e6 * abs(log.position_llh[0, 0] - truth.at((1.0, 0.5, -2.0)).position_llh[0, 0]) < 0.12


def test_estimate_writes_what_the_contract_says(drive: Path, tmp_path: Path) -> None:
    done = levelhead("estimate", drive, "-o", tmp_path, "--corrected", "csv")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    names = sorted(p.name for p in tmp_path.iterdir())
    assert names == ["corrected.csv", "report.html", "result.parquet", "summary.json"]
    table = pq.read_table(tmp_path / "result.parquet")
    assert set(table.column_names) == RESULT_COLUMNS | {"latitude", "longitude", "height"}
    assert all((field.metadata or {}).get(b"unit") for field in table.schema)
    expected = lh.estimate(lh.check(lh.read(drive)).trusted())
    np.testing.assert_array_equal(table["gyro_bias_x"].to_numpy(), expected.gyro_bias[:, 0])
    np.testing.assert_array_equal(table["status"].to_numpy(), expected.status)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert set(summary) == {
        *(
            "levelhead",
            "log",
            "method",
            "params",
            "known",
            "settled_at_s",
            "mounting",
            "latency_s",
            "events",
            "runtime_s",
            "navigation",
            "preflight",
        ),
        *("gyro_bias_deg_s", "gyro_bias_std_deg_s", "accel_bias_m_s2", "accel_bias_std_m_s2"),
    }
    assert summary["log"]["completeness"] == "complete"
    assert summary["log"]["imu_rate_hz"] == pytest.approx(100.0)
    assert summary["known"] == {"gyro": [True, True, True], "accel": [True, True, True]}
    assert set(summary["runtime_s"]) == {"read", "preflight", "estimate", "report"}
    in_memory = expected.summary()
    assert {k: v for k, v in summary.items() if k != "runtime_s"} == {
        k: v for k, v in json.loads(json.dumps(in_memory)).items() if k != "runtime_s"
    }


def test_the_corrected_log_has_no_biases_left(drive: Path, tmp_path: Path) -> None:
    assert levelhead("estimate", drive, "-o", tmp_path, "--corrected", "parquet").returncode == 0
    again = lh.estimate(lh.read(tmp_path / "corrected.parquet"))
    # What the first run took off is gone: what is left is what it had not yet learnt, and noise.
    late = again.time > 200.0
    assert np.degrees(np.abs(again.gyro_bias[late])).max() < 0.03
    assert np.abs(again.accel_bias[late, :2]).max() < 0.05


def test_methods_and_parameters_are_chosen_by_the_user(drive: Path, tmp_path: Path) -> None:
    settings = tmp_path / "my.toml"
    settings.write_text(
        "[two-stage]\ntau = 5\nstraight_rate_deg_s = 3.0\nfeedback = false\n[observer]\ntau_gyro = 50.0\n"
    )
    done = levelhead("estimate", drive, "-o", tmp_path / "out", "--method", "two-stage", "--params", settings)
    assert done.returncode == 0, done.stderr
    params = json.loads((tmp_path / "out" / "summary.json").read_text())["params"]
    assert params["tau"] == 5.0
    assert params["straight_rate"] == pytest.approx(np.radians(3.0))
    assert params["feedback"] is False
    assert params["tau_gyro_lowpass"] == 40.0


def test_what_is_open_by_default_may_be_set_in_a_file(drive: Path, tmp_path: Path) -> None:
    settings = tmp_path / "my.toml"
    settings.write_text("[ekf]\nlatitude_deg = 52.5\n")
    done = levelhead("estimate", drive, "-o", tmp_path / "out", "--method", "ekf", "--params", settings)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["params"]["latitude"] == pytest.approx(np.radians(52.5))
    assert all(sigma > 0.0 for sigma in summary["gyro_bias_std_deg_s"] if sigma is not None)
    settings.write_text("[ekf]\nlatitude = 'north'\n")
    done = levelhead("estimate", drive, "-o", tmp_path / "out", "--method", "ekf", "--params", settings)
    assert done.returncode == 2
    assert "latitude" in done.stderr


def test_several_logs_get_a_folder_each(drive: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    assert levelhead("convert", drive, "-o", other).returncode == 0
    bad = tmp_path / "bad.csv"
    bad.write_text("time,gyro_x\n")
    done = levelhead("estimate", drive, other, bad, "-o", tmp_path / "out")
    assert done.returncode == 3
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["curves", "other"]
    assert "bad.csv" in done.stderr
    a = json.loads((tmp_path / "out" / "curves" / "summary.json").read_text())
    b = json.loads((tmp_path / "out" / "other" / "summary.json").read_text())
    # The converted log's latitudes went to degrees once more, which may cost the last bit: a nanometre.
    assert a["gyro_bias_deg_s"] == pytest.approx(b["gyro_bias_deg_s"], rel=1e-8)


def test_imu_and_gnss_in_two_files(drive: Path, tmp_path: Path) -> None:
    log = lh.read(drive)
    assert log.velocity_ned is not None
    imu, gnss = tmp_path / "imu.csv", tmp_path / "gnss.csv"
    rows = np.column_stack([log.time, np.degrees(log.gyro), log.accel])
    header = "time,gyro_x[deg/s],gyro_y[deg/s],gyro_z[deg/s],accel_x,accel_y,accel_z"
    np.savetxt(imu, rows, fmt="%.17g", delimiter=",", header=header, comments="")
    epochs = np.column_stack([log.gnss_time, log.velocity_ned])
    np.savetxt(gnss, epochs, fmt="%.17g", delimiter=",", header="time,vel_n,vel_e,vel_d", comments="")
    done = levelhead("estimate", imu, "--gnss", gnss, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    # The two files hold neither positions nor sigmas.
    bare = replace(log, velocity_std=None, position_llh=None, position_std=None)
    expected = lh.estimate(bare).summary()
    # Degrees and back cost rounding alone.
    np.testing.assert_allclose(
        np.array(summary["gyro_bias_deg_s"]), np.array(expected["gyro_bias_deg_s"], dtype=float), rtol=1e-9
    )


BAD = [
    (["estimate", "missing.csv", "-o", "out"], 2, "missing.csv"),
    (["estimate", "empty.csv", "-o", "out"], 3, "empty.csv"),
    (["estimate", "folder", "-o", "out"], 3, "folder is a directory"),
    (["estimate", "text.csv", "-o", "out"], 3, "'abc'"),
    (["estimate", "column.csv", "-o", "out"], 3, "gyro_z"),
    (["estimate", "good.csv", "-o", "out", "--method", "magic"], 2, "'magic'"),
    (["estimate", "good.csv", "-o", "out", "--params", "typo.toml"], 2, "'tua'"),
    (["estimate", "good.csv", "-o", "out", "--params", "negative.toml"], 2, "velocity_std is -1"),
    (["estimate", "good.csv", "-o", "out", "--params", "text.toml"], 2, "velocity_std in text.toml"),
    (["estimate", "good.csv", "-o", "out", "--lever-arm", "1,2"], 2, "--lever-arm"),
    (["estimate", "good.csv", "-o", "out", "--lever-arm", "1,2,900"], 2, "within 50 m"),
    (["estimate", "good.csv", "-o", "out", "--format", "nonsense"], 2, "nonsense"),
    (["estimate", "good.csv", "-o", "good.csv"], 1, "good.csv"),
    (["simulate", "moon", "-o", "out.parquet"], 2, "moon"),
    (["simulate", "field", "-o", "out.xyz"], 2, ".xyz"),
    (["simulate", "field", "-o", "out.csv", "--duration", "-5"], 2, "-5"),
    (["simulate", "field", "-o", "out.csv", "--speed", "90"], 2, "from 0.1 to 60"),
    (["simulate", "field", "-o", "out.csv", "--lever-arm", "1;2"], 2, "three lengths"),
    (["simulate", "field", "-o", "out.csv", "--latitude-deg", "90"], 2, "below 89 deg"),
    (["simulate", "field", "-o", "out.csv", "--outage", "10"], 2, "300,60"),
    (["simulate", "field", "-o", "out.csv", "--duration", "9", "--outage", "10,5"], 2, "not in the log"),
    (["simulate", "field", "-o", "out", "--compare", "--runs", "2", "--speed", "9"], 2, "--speed is for one drive"),
    (["convert", "good.csv", "-o", "out.doc"], 2, ".doc"),
]


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of files with one thing wrong in each."""
    folder = tmp_path_factory.mktemp("bad")
    header = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,vel_n,vel_e,vel_d\n"
    rows = [f"{0.01 * i:.2f},0,0,0.001,0,0,-9.8,{'1,0,0' if i % 10 == 0 else ',,'}\n" for i in range(400)]
    (folder / "good.csv").write_text(header + "".join(rows))
    (folder / "empty.csv").write_text("")
    (folder / "folder").mkdir()
    (folder / "text.csv").write_text(header + "".join([*rows[:50], "0.50,0,abc,0,0,0,-9.8,,,\n", *rows[51:]]))
    (folder / "column.csv").write_text("".join([header, *rows]).replace("gyro_z", "gyro_zz"))
    (folder / "typo.toml").write_text("tua = 4.0\n")
    (folder / "negative.toml").write_text("velocity_std = -1.0\n")
    (folder / "text.toml").write_text("velocity_std = 'fast'\n")
    return folder


@pytest.mark.parametrize(("arguments", "code", "words"), BAD)
def test_every_mistake_is_one_sentence_and_leaves_nothing(
    arguments: list[str], code: int, words: str, bad_files: Path
) -> None:
    before = sorted(p.name for p in bad_files.rglob("*"))
    done = levelhead(*arguments, cwd=bad_files)
    assert done.returncode == code, done.stderr
    assert words in done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("levelhead: ")
    assert lines[0].endswith((".", ")"))
    assert "Traceback" not in done.stderr
    assert sorted(p.name for p in bad_files.rglob("*")) == before


def test_usage_mistakes_exit_with_2(tmp_path: Path) -> None:
    for arguments in (["estimate"], ["fly"], ["estimate", "x.csv"], ["demo", "--unknown"]):
        done = levelhead(*arguments, cwd=tmp_path)
        assert done.returncode == 2, arguments
        assert "Traceback" not in done.stderr


def test_a_cut_log_is_used_marked_and_exits_with_3(drive: Path, tmp_path: Path) -> None:
    whole = tmp_path / "whole.csv"
    assert levelhead("convert", drive, "-o", whole).returncode == 0
    cut = tmp_path / "cut.csv"
    text = whole.read_bytes()
    cut.write_bytes(text[: len(text) * 2 // 3])
    done = levelhead("estimate", cut, "-o", tmp_path / "out")
    assert done.returncode == 3, done.stderr
    assert "read only in part" in done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["log"]["completeness"] == "truncated"
    assert "W_TRUNCATED" in {event["code"] for event in summary["events"]}
    assert 190.0 < summary["log"]["duration_s"] < 210.0


def test_a_folder_that_cannot_be_written_is_said(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.html").mkdir()  # a folder where a file must go
    done = levelhead("estimate", drive, "-o", tmp_path / "out")
    assert done.returncode == 1
    assert "report.html" in done.stderr
    left = {p.name for p in (tmp_path / "out").iterdir()}
    assert left == {"report.html", "result.parquet"}  # no temporary files, no summary of an unfinished run


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    done = levelhead("--debug", "estimate", tmp_path / "missing.csv", "-o", tmp_path / "out")
    assert done.returncode == 1
    assert "Traceback" in done.stderr


def test_help_and_version_say_what_they_should() -> None:
    assert levelhead("--version").stdout.strip() == f"levelhead {lh.__version__}"
    for verb in ("demo", "estimate", "simulate", "convert"):
        done = levelhead(verb, "--help")
        assert done.returncode == 0
        assert verb in done.stdout
