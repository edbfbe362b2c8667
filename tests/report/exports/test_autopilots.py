"""Offsets for PX4 and ArduPilot: their own formula on raw readings is right with them, whatever scale and rotation.

The formulas and the names of the orientations are those of PX4's `sensor_calibration` and `rotation.h` and of
ArduPilot's `AP_InertialSensor_Backend`, `AP_AHRS` and `rotations.h`; scipy makes the rotations here.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from levelhead.conventions import FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.report.exports import export_calibration
from levelhead.report.exports.parameters import read_parameters

from .conftest import ACCEL_BIAS, GYRO_BIAS, MakeCase

RESOLUTION = 6e-10
"""Offsets are written to nine decimals, so half of 1e-9 and rounding."""

SHARED_NAMES = [
    "NONE",
    "YAW_45",
    "YAW_90",
    "YAW_135",
    "YAW_180",
    "YAW_225",
    "YAW_270",
    "YAW_315",
    "ROLL_180",
    "ROLL_180_YAW_45",
    "ROLL_180_YAW_90",
    "ROLL_180_YAW_135",
    "PITCH_180",
    "ROLL_180_YAW_225",
    "ROLL_180_YAW_270",
    "ROLL_180_YAW_315",
    "ROLL_90",
    "ROLL_90_YAW_45",
    "ROLL_90_YAW_90",
    "ROLL_90_YAW_135",
    "ROLL_270",
    "ROLL_270_YAW_45",
    "ROLL_270_YAW_90",
    "ROLL_270_YAW_135",
    "PITCH_90",
    "PITCH_270",
    "PITCH_180_YAW_90",
    "PITCH_180_YAW_270",
    "ROLL_90_PITCH_90",
    "ROLL_180_PITCH_90",
    "ROLL_270_PITCH_90",
    "ROLL_90_PITCH_180",
    "ROLL_270_PITCH_180",
    "ROLL_90_PITCH_270",
    "ROLL_180_PITCH_270",
    "ROLL_270_PITCH_270",
    "ROLL_90_PITCH_180_YAW_90",
    "ROLL_90_YAW_270",
]
PX4_NAMES = [
    *SHARED_NAMES,
    *[
        "ROLL_90_PITCH_68_YAW_293",
        "PITCH_315",
        "ROLL_90_PITCH_315",
        "ROLL_270_YAW_180",
        "ROLL_270_YAW_270",
        "PITCH_90_YAW_180",
    ],
    *["PITCH_9_YAW_180", "PITCH_45", "ROLL_270_YAW_225", "ROLL_270_YAW_315"],
]
ARDUPILOT_NAMES = [
    *SHARED_NAMES,
    *["ROLL_90_PITCH_68.8_YAW_293.3", "PITCH_315", "ROLL_90_PITCH_315", "PITCH_7", "ROLL_45", "ROLL_315"],
]

COMPENSATED = "The autopilot took its offsets off."
MOUNTED = Rotation.from_euler("ZYX", [5.0, -3.0, 2.0], degrees=True).as_matrix()
"""How the log was turned from the file's axes to the body."""

PX4_OLD = {
    "CAL_GYRO0_ID": 2490378.0,
    "CAL_GYRO0_ROT": -1.0,
    **{f"CAL_GYRO0_{a}OFF": v for a, v in zip("XYZ", (0.01, -0.02, 0.005), strict=True)},
    "CAL_ACC0_ID": 2490378.0,
    "CAL_ACC0_ROT": -1.0,
    **{f"CAL_ACC0_{a}OFF": v for a, v in zip("XYZ", (-0.3, 0.05, 0.2), strict=True)},
    **{f"CAL_ACC0_{a}SCALE": v for a, v in zip("XYZ", (1.01, 0.98, 1.003), strict=True)},
    "SENS_BOARD_ROT": 0.0,
    "SENS_BOARD_X_OFF": 0.0,
    "SENS_BOARD_Y_OFF": 0.0,
    "SENS_BOARD_Z_OFF": 0.0,
    "SENS_IMU_AUTOCAL": 0.0,
}
ARDUPILOT_OLD = {
    "INS_ACC_ID": 2753028.0,
    "INS_GYR_ID": 2752772.0,
    **{f"INS_GYROFFS_{a}": v for a, v in zip("XYZ", (0.01, -0.02, 0.005), strict=True)},
    **{f"INS_ACCOFFS_{a}": v for a, v in zip("XYZ", (-0.3, 0.05, 0.2), strict=True)},
    **{f"INS_ACCSCAL_{a}": v for a, v in zip("XYZ", (1.01, 0.98, 1.003), strict=True)},
    "AHRS_ORIENTATION": 0.0,
    "INS_GYR_CAL": 0.0,
}


def rotation_named(name: str) -> FloatArray:
    """Return the rotation that a name such as ROLL_180_YAW_45 means: roll first, yaw last, about fixed axes."""
    angles = {axis: float(degrees) for axis, degrees in re.findall(r"(ROLL|PITCH|YAW)_([\d.]+)", name)}
    roll, pitch, yaw = (angles.get(axis, 0.0) for axis in ("ROLL", "PITCH", "YAW"))
    matrix: FloatArray = Rotation.from_euler("xyz", [roll, pitch, yaw], degrees=True).as_matrix()
    return matrix


def three(values: dict[str, float], pattern: str) -> FloatArray:
    return np.array([values[pattern.format(a)] for a in "XYZ"])


def written(make_case: MakeCase, target: str, folder: Path, **options: object) -> dict[str, float]:
    """Export, and return the parameters in the file; `calibration_in_log` is the log's own `meta["calibration"]`."""
    keys = ("calibration", "slot", "only_known")
    given = {key: options.pop(key) for key in keys if key in options}
    if "calibration_in_log" in options:
        options["calibration"] = options.pop("calibration_in_log")
    result, log = make_case(**options)
    path = folder / "out"
    export_calibration(result, log, target, path, **given)  # type: ignore[arg-type]
    return read_parameters(path)


def biases_left(old: FloatArray, true: FloatArray, scale: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return the biases in the body that an estimate finds, where offsets `old` stand for the `true` ones."""
    raw = np.array([0.3, -0.2, 9.7])

    def calibrated(offset: FloatArray) -> FloatArray:
        return np.asarray(rotation @ ((raw - offset) * scale))

    return np.asarray(MOUNTED @ (calibrated(old) - calibrated(true)))


@pytest.mark.parametrize("number", range(len(PX4_NAMES)), ids=PX4_NAMES)
def test_px4_reads_without_bias_afterwards(make_case: MakeCase, tmp_path: Path, number: int) -> None:
    level = Rotation.from_euler("xyz", [1.5, -2.0, 4.0], degrees=True).as_matrix()  # the level horizon's angles
    rotation = level @ rotation_named(PX4_NAMES[number])
    parameters = {**PX4_OLD, "SENS_BOARD_ROT": float(number)}
    parameters |= {"SENS_BOARD_X_OFF": 1.5, "SENS_BOARD_Y_OFF": -2.0, "SENS_BOARD_Z_OFF": 4.0}
    true_gyro, true_accel = np.array([0.012, -0.019, 0.0]), np.array([-0.25, 0.0, 0.27])
    scale = three(PX4_OLD, "CAL_ACC0_{}SCALE")
    new = written(
        make_case,
        "px4",
        tmp_path,
        gyro=biases_left(three(PX4_OLD, "CAL_GYRO0_{}OFF"), true_gyro, np.ones(3), rotation),
        accel=biases_left(three(PX4_OLD, "CAL_ACC0_{}OFF"), true_accel, scale, rotation),
        compensated=COMPENSATED,
        calibration_in_log=parameters,
        dcm_file_to_body=tuple(map(tuple, MOUNTED)),
    )
    np.testing.assert_allclose(three(new, "CAL_GYRO0_{}OFF"), true_gyro, rtol=0.0, atol=RESOLUTION)
    np.testing.assert_allclose(three(new, "CAL_ACC0_{}OFF"), true_accel, rtol=0.0, atol=RESOLUTION)


@pytest.mark.parametrize("number", range(len(ARDUPILOT_NAMES)), ids=ARDUPILOT_NAMES)
def test_ardupilot_reads_without_bias_afterwards(make_case: MakeCase, tmp_path: Path, number: int) -> None:
    rotation = rotation_named(ARDUPILOT_NAMES[number])
    true_gyro, true_accel = np.array([0.012, -0.019, 0.0]), np.array([-0.25, 0.0, 0.27])
    scale = three(ARDUPILOT_OLD, "INS_ACCSCAL_{}")
    new = written(
        make_case,
        "ardupilot",
        tmp_path,
        gyro=biases_left(three(ARDUPILOT_OLD, "INS_GYROFFS_{}"), true_gyro, np.ones(3), rotation),
        accel=biases_left(three(ARDUPILOT_OLD, "INS_ACCOFFS_{}"), true_accel, scale, rotation),
        compensated=COMPENSATED,
        calibration_in_log={**ARDUPILOT_OLD, "AHRS_ORIENTATION": number},
        dcm_file_to_body=tuple(map(tuple, MOUNTED)),
    )
    np.testing.assert_allclose(three(new, "INS_GYROFFS_{}"), true_gyro, rtol=0.0, atol=RESOLUTION)
    np.testing.assert_allclose(three(new, "INS_ACCOFFS_{}"), true_accel, rtol=0.0, atol=RESOLUTION)


def test_a_sensor_beside_the_board_has_a_rotation_of_its_own(make_case: MakeCase, tmp_path: Path) -> None:
    parameters = {**PX4_OLD, "CAL_GYRO0_ROT": 4.0, "SENS_BOARD_ROT": 8.0}
    new = written(make_case, "px4", tmp_path, compensated=COMPENSATED, calibration_in_log=parameters)
    old = three(PX4_OLD, "CAL_GYRO0_{}OFF")
    # Yaw 180 of its own, not the board's roll 180.
    np.testing.assert_allclose(three(new, "CAL_GYRO0_{}OFF"), old + GYRO_BIAS * [-1, -1, 1], rtol=0.0, atol=RESOLUTION)
    scale = three(PX4_OLD, "CAL_ACC0_{}SCALE")
    expected = three(PX4_OLD, "CAL_ACC0_{}OFF") + ACCEL_BIAS * [1, -1, -1] / scale
    np.testing.assert_allclose(three(new, "CAL_ACC0_{}OFF"), expected, rtol=0.0, atol=RESOLUTION)


@pytest.mark.parametrize(
    ("target", "gyro", "accel"),
    [("px4", "CAL_GYRO0_{}OFF", "CAL_ACC0_{}OFF"), ("ardupilot", "INS_GYROFFS_{}", "INS_ACCOFFS_{}")],
)
def test_of_raw_readings_the_offset_is_the_bias_in_the_files_axes(
    make_case: MakeCase, tmp_path: Path, target: str, gyro: str, accel: str
) -> None:
    result, log = make_case(dcm_file_to_body=tuple(map(tuple, MOUNTED)))
    notes = export_calibration(result, log, target, tmp_path / "out")
    new = read_parameters(tmp_path / "out")
    np.testing.assert_allclose(three(new, gyro), MOUNTED.T @ GYRO_BIAS, rtol=0.0, atol=RESOLUTION)
    np.testing.assert_allclose(three(new, accel), MOUNTED.T @ ACCEL_BIAS, rtol=0.0, atol=RESOLUTION)
    assert any("these offsets replace those of the vehicle" in note for note in notes)
    assert any("was assumed" in note for note in notes)
    assert all(f"# {note}" in (tmp_path / "out").read_text().splitlines() for note in notes)


def test_raw_topics_of_a_calibrated_px4(make_case: MakeCase, tmp_path: Path) -> None:
    # The scale would take its part of gravity: 2 % of 9.8 m/s^2.
    with pytest.raises(LogError, match=r"raw accelerometer readings, but the autopilot scales them \(CAL_ACC0_\*SCALE"):
        written(make_case, "px4", tmp_path, calibration_in_log=PX4_OLD)
    unscaled = {**PX4_OLD, **{f"CAL_ACC0_{a}SCALE": 1.0 for a in "XYZ"}, "SENS_BOARD_ROT": 6.0}
    new = written(make_case, "px4", tmp_path, calibration_in_log=unscaled)
    # Neither old offset nor board rotation: raw readings have seen neither.
    np.testing.assert_allclose(three(new, "CAL_ACC0_{}OFF"), ACCEL_BIAS, rtol=0.0, atol=RESOLUTION)
    with pytest.raises(LogError, match="PX4 compensates their temperature"):
        written(make_case, "px4", tmp_path, calibration_in_log={**unscaled, "TC_G_ENABLE": 1.0})


@pytest.mark.parametrize("target", ["px4", "ardupilot"])
def test_offsets_on_top_of_others_that_are_not_known_are_refused(
    make_case: MakeCase, tmp_path: Path, target: str
) -> None:
    with pytest.raises(LogError, match="Pass the vehicle's parameter file of that day with --calibration"):
        written(make_case, target, tmp_path, compensated=COMPENSATED)
    with pytest.raises(LogError, match="levelhead itself had taken biases off"):
        written(make_case, target, tmp_path, corrected_by="smoother", calibration={**PX4_OLD, **ARDUPILOT_OLD})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("target", "parameters", "missing"),
    [
        *[("px4", PX4_OLD, name) for name in ("CAL_GYRO0_YOFF", "CAL_ACC0_ZOFF", "CAL_ACC0_XSCALE", "SENS_BOARD_ROT")],
        *[("ardupilot", ARDUPILOT_OLD, name) for name in ("INS_GYROFFS_Y", "INS_ACCOFFS_Z", "INS_ACCSCAL_X")],
        ("ardupilot", ARDUPILOT_OLD, "AHRS_ORIENTATION"),
    ],
)
def test_a_parameter_that_is_missing_is_not_taken_as_zero(
    make_case: MakeCase, tmp_path: Path, target: str, parameters: dict[str, float], missing: str
) -> None:
    partly = {name: value for name, value in parameters.items() if name != missing}
    with pytest.raises(LogError, match=f"parameters lack {missing}"):
        written(make_case, target, tmp_path, compensated=COMPENSATED, calibration_in_log=partly)


@pytest.mark.parametrize(
    ("target", "parameters", "name", "value"),
    [
        ("px4", PX4_OLD, "SENS_BOARD_ROT", 48.0),
        ("px4", PX4_OLD, "SENS_BOARD_ROT", 1.5),
        ("ardupilot", ARDUPILOT_OLD, "AHRS_ORIENTATION", 101.0),
        ("px4", PX4_OLD, "CAL_ACC0_YSCALE", 0.0),
        ("ardupilot", ARDUPILOT_OLD, "INS_ACCSCAL_Z", -1.0),
    ],
)
def test_orientations_and_scales_that_are_none_are_refused(
    make_case: MakeCase, tmp_path: Path, target: str, parameters: dict[str, float], name: str, value: float
) -> None:
    with pytest.raises(LogError, match=r"orientation that levelhead does not know|a scale lies near 1"):
        written(make_case, target, tmp_path, compensated=COMPENSATED, calibration_in_log={**parameters, name: value})


def test_the_users_parameters_stand_in_for_those_of_the_log(make_case: MakeCase, tmp_path: Path) -> None:
    text = "".join(f"1\t1\t{name}\t{value!r}\t9\n" for name, value in PX4_OLD.items())
    (tmp_path / "vehicle.params").write_text(f"# Onboard parameters for Vehicle 1\n{text}")
    expected = three(PX4_OLD, "CAL_GYRO0_{}OFF") + GYRO_BIAS
    for options in ({"compensated": COMPENSATED}, {}):  # given, they were taken off, whether the log says so or not
        new = written(make_case, "px4", tmp_path, calibration=tmp_path / "vehicle.params", **options)
        np.testing.assert_allclose(three(new, "CAL_GYRO0_{}OFF"), expected, rtol=0.0, atol=RESOLUTION)
    # What the log itself has was at work.
    new = written(
        make_case,
        "px4",
        tmp_path,
        compensated=COMPENSATED,
        calibration_in_log=PX4_OLD,
        calibration={**PX4_OLD, "CAL_GYRO0_XOFF": 0.9},
    )
    np.testing.assert_allclose(three(new, "CAL_GYRO0_{}OFF"), expected, rtol=0.0, atol=RESOLUTION)


TWO_IMUS = {**PX4_OLD, **{k.replace("0_", "1_"): v for k, v in PX4_OLD.items() if k.startswith("CAL_")}}
TWO_IMUS |= {"CAL_GYRO1_ID": -1234.0, "CAL_ACC1_ID": 77.0, "CAL_GYRO1_XOFF": 0.5}


def test_px4s_imu_is_found_by_its_id(make_case: MakeCase, tmp_path: Path) -> None:
    options = {"compensated": COMPENSATED, "calibration_in_log": TWO_IMUS}
    # The topics have the ID without sign.
    new = written(make_case, "px4", tmp_path, imu_device_ids={"gyro": 2**32 - 1234, "accel": 77}, **options)
    assert new["CAL_GYRO1_XOFF"] == pytest.approx(0.5 + GYRO_BIAS[0], abs=RESOLUTION)
    assert "CAL_GYRO0_XOFF" not in new
    assert "CAL_ACC1_XOFF" in new
    assert not any(name.endswith("_ID") for name in new)
    with pytest.raises(UsageError, match=r"several calibrated IMUs \(CAL_GYRO0, 1\).*pass --slot"):
        written(make_case, "px4", tmp_path, **options)
    assert "CAL_GYRO1_XOFF" in written(make_case, "px4", tmp_path, slot=1, **options)
    with pytest.raises(LogError, match="the ID 99, for which the vehicle's parameters have no calibration"):
        written(make_case, "px4", tmp_path, imu_device_ids={"gyro": 99, "accel": 77}, **options)
    with pytest.raises(UsageError, match="slot 4 does not exist"):
        written(make_case, "px4", tmp_path, slot=4, **options)
    with pytest.raises(LogError, match="CAL_GYRO0_ID is 0"):
        written(make_case, "px4", tmp_path, slot=0, compensated="x", calibration_in_log={**TWO_IMUS, "CAL_GYRO0_ID": 0})


def test_ardupilots_imu_is_found_by_its_number(make_case: MakeCase, tmp_path: Path) -> None:
    second = {
        "INS_ACC2_ID": 5.0,
        **{f"INS_GYR2OFFS_{a}": 0.5 for a in "XYZ"},
        **{f"INS_ACC2OFFS_{a}": 0.25 for a in "XYZ"},
        **{f"INS_ACC2SCAL_{a}": 0.8 for a in "XYZ"},
    }
    options = {"compensated": COMPENSATED, "calibration_in_log": {**ARDUPILOT_OLD, **second}}
    new = written(make_case, "ardupilot", tmp_path, imu_instance=1, **options)
    np.testing.assert_allclose(three(new, "INS_GYR2OFFS_{}"), 0.5 + GYRO_BIAS, rtol=0.0, atol=RESOLUTION)
    np.testing.assert_allclose(three(new, "INS_ACC2OFFS_{}"), 0.25 + ACCEL_BIAS / 0.8, rtol=0.0, atol=RESOLUTION)
    assert set(new) == {*(f"INS_GYR2OFFS_{a}" for a in "XYZ"), *(f"INS_ACC2OFFS_{a}" for a in "XYZ")}
    assert written(make_case, "ardupilot", tmp_path, slot=2, **options) == new
    with pytest.raises(UsageError, match=r"has 2 IMUs.*pass --slot"):
        written(make_case, "ardupilot", tmp_path, **options)
    with pytest.raises(UsageError, match="slot 0 does not exist"):
        written(make_case, "ardupilot", tmp_path, slot=0, **options)


@pytest.mark.parametrize("target", ["px4", "ardupilot"])
def test_a_bias_that_was_never_observable_is_refused(make_case: MakeCase, tmp_path: Path, target: str) -> None:
    unknown = {"known_accel": (True, True, False), "known_gyro": (True, False, True)}
    with pytest.raises(LogError, match=r"gyro y, accelerometer z were never observable on drive\.ulg"):
        written(make_case, target, tmp_path, **unknown)
    with pytest.raises(LogError, match="accelerometer z was never observable"):
        written(make_case, target, tmp_path, accel=[0.1, 0.2, np.nan])  # said to be known, but is no number
    assert list(tmp_path.iterdir()) == []
    names = set(written(make_case, target, tmp_path, only_known=True, **unknown))
    expected = {
        "px4": {"CAL_GYRO0_XOFF", "CAL_GYRO0_ZOFF", "CAL_ACC0_XOFF", "CAL_ACC0_YOFF"},
        "ardupilot": {"INS_GYROFFS_X", "INS_GYROFFS_Z", "INS_ACCOFFS_X", "INS_ACCOFFS_Y"},
    }
    assert names == expected[target]
    nothing = {"known_gyro": (False,) * 3, "known_accel": (False,) * 3}
    with pytest.raises(LogError, match="No calibration is written"):
        written(make_case, target, tmp_path, only_known=True, **nothing)


def test_an_axis_that_mixes_in_an_unknown_one_is_unknown(make_case: MakeCase, tmp_path: Path) -> None:
    turned = {"calibration_in_log": {**PX4_OLD, "SENS_BOARD_ROT": 16.0}, "compensated": COMPENSATED}  # roll 90
    new = written(make_case, "px4", tmp_path, known_accel=(True, True, False), only_known=True, **turned)
    # The body's z is the sensor's y, whose sine of 90 degrees is not quite 1 in floating point.
    assert {n for n in new if "ACC" in n} == {"CAL_ACC0_XOFF", "CAL_ACC0_ZOFF"}
    skew = {"dcm_file_to_body": tuple(map(tuple, MOUNTED))}
    new = written(make_case, "px4", tmp_path, known_accel=(True, True, False), only_known=True, **skew)
    assert {n for n in new if "ACC" in n} == set()
    assert {n for n in new if "GYRO" in n} == {f"CAL_GYRO0_{a}OFF" for a in "XYZ"}


def test_the_gnss_delay_has_the_name_that_the_vehicle_knows(make_case: MakeCase, tmp_path: Path) -> None:
    def delays(target: str, latency: float, old: dict[str, float]) -> dict[str, float]:
        new = written(make_case, target, tmp_path, latency_s=latency, compensated="x", calibration_in_log=old)
        return {name: value for name, value in new.items() if "DELAY" in name}

    assert delays("px4", 0.1234, {**PX4_OLD, "EKF2_GPS_DELAY": 110.0}) == {"EKF2_GPS_DELAY": 123.0}
    assert "1\t1\tEKF2_GPS_DELAY\t123\t9\n" in (tmp_path / "out").read_text()
    assert delays("px4", 0.1234, {**PX4_OLD, "SENS_GPS0_DELAY": 110.0}) == {"SENS_GPS0_DELAY": 123.0}
    assert "1\t1\tSENS_GPS0_DELAY\t123\t6\n" in (tmp_path / "out").read_text()
    assert delays("ardupilot", 0.1234, {**ARDUPILOT_OLD, "GPS_DELAY_MS": 0.0}) == {"GPS_DELAY_MS": 123.0}
    assert delays("ardupilot", 0.1234, ARDUPILOT_OLD) == {"GPS1_DELAY_MS": 123.0}
    for target, old, latency in (
        ("px4", PX4_OLD, -0.02),  # early: no autopilot can wait for the past
        ("px4", PX4_OLD, 0.301),
        ("ardupilot", ARDUPILOT_OLD, 0.0),  # 0 means the default there
        ("ardupilot", ARDUPILOT_OLD, 0.251),
    ):
        assert delays(target, latency, old) == {}
        assert "no delay is written" in (tmp_path / "out").read_text()


@pytest.mark.parametrize(
    ("target", "meta", "sentence"),
    [
        # PX4 takes its delay off the stamp of arrival, where the driver tells no other.
        ("px4", {"gnss_stamp": "timestamp_sample"}, "# The log has the times of the fixes"),
        ("px4", {"gnss_source": "base.pos"}, "# The GNSS data was in a file of its own"),
        ("ardupilot", {"gnss_source": "base.pos"}, "# The GNSS data was in a file of its own"),
    ],
)
def test_a_latency_that_is_not_the_autopilots_delay_is_not_written(
    make_case: MakeCase, tmp_path: Path, target: str, meta: dict[str, object], sentence: str
) -> None:
    new = written(make_case, target, tmp_path, latency_s=0.1, **meta)
    assert not any("DELAY" in name for name in new)
    assert sentence in (tmp_path / "out").read_text()
    assert any("DELAY" in name for name in written(make_case, target, tmp_path, latency_s=0.1, gnss_stamp="timestamp"))


def test_the_trim_levels_what_is_mounted_askew(make_case: MakeCase, tmp_path: Path) -> None:
    mounting = {"yaw": 1.0, "roll": 4.0, "pitch": -6.0}
    new = written(make_case, "ardupilot", tmp_path, mounting_deg=mounting)
    # The vehicle stands level: gravity as the IMU reads it, and as ArduPilot turns it into the vehicle's axes.
    to_vehicle = Rotation.from_euler("ZYX", [1.0, -6.0, 4.0], degrees=True)
    reading = to_vehicle.inv().apply([0.0, 0.0, -9.8])
    trim = Rotation.from_euler("ZYX", [0.0, new["AHRS_TRIM_Y"], new["AHRS_TRIM_X"]])
    np.testing.assert_allclose(trim.apply(reading), [0.0, 0.0, -9.8], atol=2e-8)  # 1e-9 rad times g
    for askew in ({"yaw": 90.0, "roll": 0.0, "pitch": 0.0}, {"yaw": 0.0, "roll": 11.0, "pitch": 0.0}):
        new = written(make_case, "ardupilot", tmp_path, mounting_deg=askew)
        assert "AHRS_TRIM_X" not in new
        assert "no AHRS_TRIM is written" in (tmp_path / "out").read_text()


def test_what_may_overwrite_the_offsets_is_said(make_case: MakeCase, tmp_path: Path) -> None:
    def notes(target: str, old: dict[str, float]) -> str:
        result, log = make_case(compensated="x", calibration=old)  # its only IMU needs no assumption
        return " ".join(export_calibration(result, log, target, tmp_path / "out"))

    assert notes("px4", PX4_OLD) == ""
    assert "SENS_IMU_AUTOCAL = 1 lets PX4 overwrite" in notes("px4", {**PX4_OLD, "SENS_IMU_AUTOCAL": 1.0})
    assert notes("ardupilot", ARDUPILOT_OLD) == ""
    assert "set INS_GYR_CAL to 0" in notes("ardupilot", {**ARDUPILOT_OLD, "INS_GYR_CAL": 1.0})


def test_qgroundcontrols_five_columns(make_case: MakeCase, tmp_path: Path) -> None:
    written(make_case, "px4", tmp_path)
    rows = [line.split("\t") for line in (tmp_path / "out").read_text().splitlines() if not line.startswith("#")]
    assert [row[2] for row in rows] == [*(f"CAL_GYRO0_{a}OFF" for a in "XYZ"), *(f"CAL_ACC0_{a}OFF" for a in "XYZ")]
    assert all(row[:2] == ["1", "1"] and row[4] == "9" and re.fullmatch(r"-?\d\.\d{9}", row[3]) for row in rows)


HOSTILE = "a\n1\t1\tCAL_GYRO0_XOFF\t9\t9\r\u2028INS_GYROFFS_X,9\x00\x1b[31m\u202e\U0001f4a3 <script> {}" + "x" * 500


@pytest.mark.parametrize("target", ["px4", "ardupilot"])
def test_a_hostile_name_stays_in_its_comment(make_case: MakeCase, tmp_path: Path, target: str) -> None:
    written(make_case, target, tmp_path, source=HOSTILE)
    hostile = (tmp_path / "out").read_bytes()
    written(make_case, target, tmp_path)
    honest = (tmp_path / "out").read_bytes()
    assert hostile.isascii()
    lines = [line for line in hostile.splitlines() if not line.startswith(b"#")]
    assert lines == [line for line in honest.splitlines() if not line.startswith(b"#")]
    assert len(hostile.splitlines()) == len(honest.splitlines())
    assert all(byte >= 32 or byte in b"\n\t" for byte in hostile)


def test_a_rotation_that_is_none_and_a_result_of_another_log_are_refused(make_case: MakeCase, tmp_path: Path) -> None:
    for dcm in (((1, 0, 0), (0, 2, 0), (0, 0, 1)), "x", ((1.0, 0.0), (0.0, 1.0)), [[np.nan] * 3] * 3):
        with pytest.raises(LogError, match="no rotation of three axes"):
            written(make_case, "px4", tmp_path, dcm_file_to_body=dcm)
    result, log = make_case()
    with pytest.raises(LogError, match="export with the log"):
        export_calibration(result, log.slice(0.0, 2.0), "px4", tmp_path / "out")
    with pytest.raises(UsageError, match="no export target 'mavlink'; choose one of px4, ardupilot"):
        export_calibration(result, log, "mavlink", tmp_path / "out")
