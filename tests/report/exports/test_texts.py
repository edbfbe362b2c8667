"""The other targets: units, axes and signs as their readers mean them, numbers that any YAML takes for numbers."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

import levelhead as lh
from levelhead.errors import LogError
from levelhead.estimators.phasor import PhasorParams
from levelhead.report.exports import EXPORTERS, export_calibration

from .conftest import ACCEL_BIAS, ACCEL_STD, GYRO_BIAS, GYRO_STD, MakeCase

FILE_TO_BODY = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
ROUNDING = 1e-9
"""YAML has ten digits."""
NOISE = {"gyro_noise": 2e-4, "accel_noise": 0.015, "gyro_bias_walk": 2e-6, "accel_bias_walk": 2e-4}


def yaml_of(path: Path) -> Any:
    text = path.read_text()
    # YAML 1.1 takes 1e-05 for text: a point in the mantissa and a sign in the exponent make it a number everywhere.
    assert not re.search(r"(?<![.\d])\d+e|e\d", re.sub(r"#.*", "", text))
    return YAML(typ="safe").load(text)


def test_ros_has_its_own_axes(make_case: MakeCase, tmp_path: Path) -> None:
    result, log = make_case(latency_s=0.15)
    export_calibration(result, log, "ros", tmp_path / "a.yaml")
    content = yaml_of(tmp_path / "a.yaml")
    assert content["frame"] == "body_flu"
    np.testing.assert_allclose(content["gyro_bias"], GYRO_BIAS * [1, -1, -1], rtol=ROUNDING)
    np.testing.assert_allclose(content["accel_bias"], ACCEL_BIAS * [1, -1, -1], rtol=ROUNDING)
    np.testing.assert_allclose(content["gyro_bias_std"], GYRO_STD, rtol=ROUNDING)
    np.testing.assert_allclose(content["accel_bias_std"], ACCEL_STD, rtol=ROUNDING)
    assert content["gnss_latency"] == 0.15
    assert "as_recorded" not in content
    assert "# reading = truth + bias: take these off the readings" in (tmp_path / "a.yaml").read_text()


def test_ros_also_has_the_axes_of_the_messages(make_case: MakeCase, tmp_path: Path) -> None:
    result, log = make_case(dcm_file_to_body=tuple(map(tuple, FILE_TO_BODY)), compensated="The driver took 1 off.")
    export_calibration(result, log, "ros", tmp_path / "a.yaml")
    recorded = yaml_of(tmp_path / "a.yaml")["as_recorded"]
    # A raw message reads truth + bias in its own axes; turned into the body that is what the estimate saw.
    np.testing.assert_allclose(FILE_TO_BODY @ recorded["gyro_bias"], GYRO_BIAS, rtol=ROUNDING)
    np.testing.assert_allclose(FILE_TO_BODY @ recorded["accel_bias"], ACCEL_BIAS, rtol=ROUNDING)
    np.testing.assert_allclose(recorded["accel_bias_std"], ACCEL_STD[[1, 0, 2]], rtol=ROUNDING)
    assert (
        "What was left when this had been taken off before: The driver took 1 off." in (tmp_path / "a.yaml").read_text()
    )


def test_kf_gins_takes_them_off_its_increments(make_case: MakeCase, tmp_path: Path) -> None:
    result, log = make_case()
    export_calibration(result, log, "kf-gins", tmp_path / "a.yaml")
    content = yaml_of(tmp_path / "a.yaml")
    assert set(content) == {"initgyrbias", "initbgstd", "initaccbias", "initbastd"}
    # As its loadConfig and imuCompensate do it: deg/h and mGal to SI, times dt, off the increments.
    rate, force, dt = np.array([0.1, 0.0, -0.2]), np.array([0.3, 0.1, -9.8]), 0.005
    gyro = np.array(content["initgyrbias"]) * np.pi / 180.0 / 3600.0
    accel = np.array(content["initaccbias"]) * 1e-5
    np.testing.assert_allclose((rate + GYRO_BIAS) * dt - gyro * dt, rate * dt, atol=1e-13)  # ten digits of a bias
    np.testing.assert_allclose((force + ACCEL_BIAS) * dt - accel * dt, force * dt, atol=1e-11)
    np.testing.assert_allclose(np.array(content["initbgstd"]) * np.pi / 180.0 / 3600.0, GYRO_STD, rtol=ROUNDING)
    np.testing.assert_allclose(np.array(content["initbastd"]) * 1e-5, ACCEL_STD, rtol=ROUNDING)


def test_kf_gins_takes_three_axes_or_none(make_case: MakeCase, tmp_path: Path) -> None:
    result, log = make_case(known_accel=(True, True, False))
    notes = export_calibration(result, log, "kf-gins", tmp_path / "a.yaml", only_known=True)
    assert notes == ("initaccbias is left out: not all axes of the accel are known.",)
    assert set(yaml_of(tmp_path / "a.yaml")) == {"initgyrbias", "initbgstd"}
    result, log = make_case(known_accel=(True, True, False), known_gyro=(True, False, False))
    with pytest.raises(LogError, match="KF-GINS takes the biases of three axes"):
        export_calibration(result, log, "kf-gins", tmp_path / "a.yaml", only_known=True)


def test_kalibr_has_two_sided_densities(make_case: MakeCase, tmp_path: Path) -> None:
    result, log = make_case(params=NOISE, known_gyro=(False,) * 3, known_accel=(False,) * 3)  # it has no biases
    export_calibration(result, log, "kalibr", tmp_path / "a.yaml")
    content = yaml_of(tmp_path / "a.yaml")
    rate = content["update_rate"]
    assert rate == pytest.approx(10.0)
    # The noise of a sample is the same: Kalibr's sigma is density sqrt(rate), ours density sqrt(rate / 2).
    for theirs, ours in (("gyroscope_noise_density", "gyro_noise"), ("accelerometer_noise_density", "accel_noise")):
        assert content[theirs] * np.sqrt(rate) == pytest.approx(NOISE[ours] * np.sqrt(rate / 2.0), rel=ROUNDING)
    assert content["gyroscope_random_walk"] == pytest.approx(NOISE["gyro_bias_walk"])
    assert content["accelerometer_random_walk"] == pytest.approx(NOISE["accel_bias_walk"])
    assert "no field for a bias" in (tmp_path / "a.yaml").read_text()
    assert not [key for key in content if "bias" in key]


def test_kalibr_gets_noise_only_from_methods_that_have_it(make_case: MakeCase, tmp_path: Path) -> None:
    result, log = make_case(method="observer", params={"tau": 4.0})
    with pytest.raises(LogError, match="method 'observer' has no accel_noise"):
        export_calibration(result, log, "kalibr", tmp_path / "a.yaml")
    assert set(NOISE) <= set(PhasorParams().as_dict())


def test_json_has_everything(make_case: MakeCase, tmp_path: Path) -> None:
    mounting = {"yaw": 1.0, "roll": 2.0, "pitch": 3.0}
    result, log = make_case(
        dcm_file_to_body=tuple(map(tuple, FILE_TO_BODY)),
        latency_s=0.1,
        mounting_deg=mounting,
        compensated="x took off.",
    )
    export_calibration(result, log, "json", tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    # JSON keeps every bit.
    assert content["gyro_bias_rad_s"] == GYRO_BIAS.tolist()
    assert content["accel_bias_m_s2"] == ACCEL_BIAS.tolist()
    assert content["gyro_bias_std_rad_s"] == GYRO_STD.tolist()
    np.testing.assert_array_equal(content["as_recorded"]["accel_bias_m_s2"], FILE_TO_BODY.T @ ACCEL_BIAS)
    assert content["dcm_file_to_body"] == FILE_TO_BODY.tolist()
    assert content["known"] == {"gyro": [True] * 3, "accel": [True] * 3}
    assert (content["latency_s"], content["mounting_deg"], content["taken_off_before"]) == (
        0.1,
        mounting,
        "x took off.",
    )
    assert content["sign"] == "reading = truth + bias"


def test_the_axes_of_a_file_are_not_claimed_where_they_are_not_told(make_case: MakeCase, tmp_path: Path) -> None:
    result, log = make_case()
    export_calibration(result, log, "json", tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["as_recorded"] is None
    assert content["dcm_file_to_body"] is None


@pytest.mark.parametrize("target", ["ros", "json"])
def test_what_is_not_known_is_null(make_case: MakeCase, tmp_path: Path, target: str) -> None:
    result, log = make_case(known_accel=(True, True, False))
    with pytest.raises(LogError, match="accelerometer z was never observable"):
        export_calibration(result, log, target, tmp_path / "a")
    assert list(tmp_path.iterdir()) == []
    export_calibration(result, log, target, tmp_path / "a", only_known=True)
    if target == "ros":
        content = yaml_of(tmp_path / "a")
        assert content["accel_bias"][2] is None
        assert content["accel_bias_std"][2] is None
    else:
        content = json.loads((tmp_path / "a").read_text())
        assert content["accel_bias_m_s2"][2] is None
        assert content["accel_bias_std_m_s2"][2] is None


@pytest.mark.parametrize("target", ["ros", "kf-gins", "kalibr", "json"])
def test_hostile_names_stay_what_they_are(make_case: MakeCase, tmp_path: Path, target: str) -> None:
    hostile = 'a\ngyro_bias: [9.0, 9.0, 9.0]\r\u2028"\x00\x1b[31m\u202e {}'
    result, log = make_case(source=hostile, compensated=hostile, params=NOISE)
    export_calibration(result, log, target, tmp_path / "a")
    text = (tmp_path / "a").read_bytes()
    assert text.isascii()
    content = json.loads(text) if target == "json" else yaml_of(tmp_path / "a")
    if target == "json":
        assert content["source"] == hostile
    if target == "ros":
        assert content["gyro_bias"][0] == pytest.approx(GYRO_BIAS[0])
    assert all(byte >= 32 or byte == 10 for byte in text)


def test_every_target_has_a_file_of_its_own() -> None:
    names = [exporter.file_name for exporter in EXPORTERS.values()]
    assert len(set(names)) == len(names)
    page = (Path(__file__).parents[3] / "docs" / "exports.md").read_text()
    for exporter in EXPORTERS.values():
        assert f"| `{exporter.name}` | `{exporter.file_name}` |" in page


def test_the_summary_tells_of_mounting_and_latency(make_case: MakeCase) -> None:
    result, _ = make_case(latency_s=0.1, mounting_deg={"yaw": 1.0})
    summary = result.summary()
    assert summary["latency_s"] == 0.1
    assert summary["mounting"] == {"yaw_deg": 1.0, "roll_deg": None, "pitch_deg": None}
    log = summary["log"]
    assert isinstance(log, dict)
    assert not {"latency_s", "mounting_deg"} & set(log)
    summary = make_case()[0].summary()
    assert summary["latency_s"] is None
    assert summary["mounting"] == {"yaw_deg": None, "roll_deg": None, "pitch_deg": None}


def test_a_real_estimate_is_exported(tmp_path: Path) -> None:
    log, truth = lh.simulate("windrower", seed=4, duration=300.0, earth_rotation=True)
    result = lh.estimate(log)
    assert lh.export_calibration(result, log, "json", tmp_path / "a.json") == ()
    content = json.loads((tmp_path / "a.json").read_text())
    # The accuracy of the smoother on this drive (README), four sigma.
    np.testing.assert_allclose(content["gyro_bias_rad_s"], truth.gyro_bias[-1], atol=np.radians(0.006))
    lh.export_calibration(result, log, "kalibr", tmp_path / "imu.yaml")
    assert yaml_of(tmp_path / "imu.yaml")["update_rate"] == pytest.approx(100.0)
