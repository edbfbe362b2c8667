"""Calibrations from the command line, and the corrected log: what was written is what the estimate says."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import levelhead as lh
from levelhead.report.exports import EXPORTERS
from levelhead.report.exports.parameters import read_parameters

RESULTS = ["report.html", "result.parquet", "summary.json"]


def levelhead(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the command as a user does."""
    command = [sys.executable, "-m", "levelhead", *map(str, arguments)]
    environment = {**os.environ, "COLUMNS": "300", "PYTHONWARNINGS": "error"}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive whose biases a method learns."""
    path = tmp_path_factory.mktemp("drive") / "curves.parquet"
    lh.write(lh.simulate("windrower", seed=5, duration=300.0, earth_rotation=True)[0], path)
    return path


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive that teaches no accelerometer bias."""
    path = tmp_path_factory.mktemp("drive") / "straight.parquet"
    lh.write(lh.simulate("straight", seed=5, duration=120.0)[0], path)
    return path


def test_every_target_beside_the_results(drive: Path, tmp_path: Path) -> None:
    options = [part for target in EXPORTERS for part in ("--export", target)]
    done = levelhead("estimate", drive, "-o", tmp_path, *options, "--export", "px4")
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*RESULTS, *(e.file_name for e in EXPORTERS.values())])
    summary = json.loads((tmp_path / "summary.json").read_text())
    px4 = read_parameters(tmp_path / "calibration-px4.params")
    ardupilot = read_parameters(tmp_path / "calibration-ardupilot.param")
    for i, axis in enumerate("XYZ"):
        # Written to nine decimals.
        gyro, accel = np.radians(summary["gyro_bias_deg_s"][i]), summary["accel_bias_m_s2"][i]
        assert px4[f"CAL_GYRO0_{axis}OFF"] == pytest.approx(gyro, abs=6e-10)
        assert px4[f"CAL_ACC0_{axis}OFF"] == pytest.approx(accel, abs=6e-10)
        assert ardupilot[f"INS_GYROFFS_{axis}"] == pytest.approx(gyro, abs=6e-10)
        assert ardupilot[f"INS_ACCOFFS_{axis}"] == pytest.approx(accel, abs=6e-10)
    assert "Calibration for px4" in done.stdout
    assert "these offsets replace those of the vehicle" in done.stdout


def test_the_new_offsets_come_on_top_of_those_in_the_users_file(drive: Path, tmp_path: Path) -> None:
    old = {**{f"INS_GYROFFS_{a}": 0.5 for a in "XYZ"}, **{f"INS_ACCOFFS_{a}": -0.25 for a in "XYZ"}}
    old |= {f"INS_ACCSCAL_{a}": 1.0 for a in "XYZ"} | {"AHRS_ORIENTATION": 0.0}
    (tmp_path / "old.param").write_text("".join(f"{name},{value}\n" for name, value in old.items()))
    out = tmp_path / "out"
    done = levelhead("estimate", drive, "-o", out, "--export", "ardupilot", "--calibration", tmp_path / "old.param")
    assert done.returncode == 0, done.stderr
    summary = json.loads((out / "summary.json").read_text())
    new = read_parameters(out / "calibration-ardupilot.param")
    assert new["INS_GYROFFS_X"] == pytest.approx(0.5 + np.radians(summary["gyro_bias_deg_s"][0]), abs=6e-10)
    assert new["INS_ACCOFFS_Y"] == pytest.approx(-0.25 + summary["accel_bias_m_s2"][1], abs=6e-10)


def test_where_it_is_refused_the_results_are_there(straight: Path, tmp_path: Path) -> None:
    done = levelhead("estimate", straight, "-o", tmp_path, "--export", "json", "--export", "px4")
    assert done.returncode == 3
    assert "accelerometer" in done.stderr
    assert "never observable on straight.parquet" in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == RESULTS
    (tmp_path / "calibration-px4.params").write_text("of another drive")
    done = levelhead("estimate", straight, "-o", tmp_path, "--export", "px4")
    assert done.returncode == 3
    assert "calibration-px4.params in" in done.stderr
    assert "is of an earlier run" in done.stderr
    assert (tmp_path / "calibration-px4.params").read_text() == "of another drive"


def test_only_what_is_known(straight: Path, tmp_path: Path) -> None:
    done = levelhead("estimate", straight, "-o", tmp_path, "--export", "px4", "--only-known")
    known = json.loads((tmp_path / "summary.json").read_text())["known"]
    assert not all(known["accel"])
    assert any(known["gyro"])
    assert done.returncode == 0, done.stderr
    names = {name for name in read_parameters(tmp_path / "calibration-px4.params") if "OFF" in name}
    expected = {f"CAL_GYRO0_{a}OFF" for a, k in zip("XYZ", known["gyro"], strict=True) if k}
    assert names == expected | {f"CAL_ACC0_{a}OFF" for a, k in zip("XYZ", known["accel"], strict=True) if k}


def test_what_was_taken_off_before_survives_parquet(drive: Path, tmp_path: Path) -> None:
    log = lh.read(drive)
    path = tmp_path / "converted.parquet"
    lh.write(replace(log, meta={**log.meta, "compensated": "The autopilot took its offsets off."}), path)
    assert lh.read(path).meta["compensated"] == "The autopilot took its offsets off."
    done = levelhead("estimate", path, "-o", tmp_path / "out", "--export", "px4")
    assert done.returncode == 3
    assert "(The autopilot took its offsets off.)" in done.stderr
    assert "--calibration" in done.stderr
    assert not (tmp_path / "out").exists()  # before anything was estimated


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--export", "mavlink"), "There is no export target 'mavlink'; choose one of px4, ardupilot"),
        (("--export", "px4", "--calibration", "absent.params"), "The parameter file absent.params does not exist"),
        (("--slot", "1"), "go with --export"),
        (("--only-known",), "go with --export"),
        (("--export", "px4", "--slot", "7"), "The slot 7 does not exist"),
    ],
)
def test_wrong_usage(drive: Path, tmp_path: Path, options: tuple[str, ...], sentence: str) -> None:
    done = levelhead("estimate", drive, "-o", tmp_path, *options)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.glob("calibration*"))


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_the_corrected_log_is_the_log_without_the_biases(drive: Path, tmp_path: Path, suffix: str) -> None:
    done = levelhead("estimate", drive, "-o", tmp_path, "--corrected", suffix)
    assert done.returncode == 0, done.stderr
    log, back = lh.read(drive), lh.read(tmp_path / f"corrected.{suffix}")
    result = lh.estimate(log)
    # Read back to the bit: the same stamps, and each reading less its own sample's bias.
    np.testing.assert_array_equal(back.time, log.time)
    np.testing.assert_array_equal(back.gyro, log.gyro - result.gyro_bias)
    np.testing.assert_array_equal(back.accel, log.accel - result.accel_bias)
    np.testing.assert_array_equal(back.gnss_time, log.gnss_time)
    np.testing.assert_array_equal(back.velocity_ned, log.velocity_ned)
    if suffix == "parquet":  # CSV has no place for it
        assert back.meta["corrected_by"] == "smoother"
        with pytest.raises(lh.LogError, match="levelhead itself had taken biases off"):
            lh.export_calibration(lh.estimate(back), back, "px4", tmp_path / "a.params")


def test_a_conversion_to_csv_says_what_it_loses(drive: Path, tmp_path: Path) -> None:
    log = lh.read(drive)
    path = tmp_path / "compensated.parquet"
    lh.write(replace(log, meta={**log.meta, "compensated": "The autopilot took its offsets off."}), path)
    done = levelhead("convert", path, "-o", tmp_path / "a.csv")
    assert done.returncode == 0, done.stderr
    assert "does not keep that biases were taken off" in done.stdout
    assert "does not keep" not in levelhead("convert", path, "-o", tmp_path / "a.parquet").stdout
    assert "does not keep" not in levelhead("convert", drive, "-o", tmp_path / "b.csv").stdout
