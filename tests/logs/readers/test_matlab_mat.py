"""MATLAB files: the known layout, mappings of matrices and structs, damage, bombs, and what is no array."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from hostile import cases
from levelhead.errors import LevelheadError, LogError, UsageError
from levelhead.logs.log import Log
from levelhead.logs.readers import matlab_file, read
from levelhead.logs.readers.matlab_file import open_mat
from samples import matlab
from samples.drive import sample_drive

Writer = Callable[[str, str], Path]
MAPPINGS = Path(__file__).parents[3] / "examples" / "mappings"

BY_NUMBER = """
[imu]
variable = "IMU"
columns = { time = 1, accel_x = 2, accel_y = 3, accel_z = 4, gyro_x = 5, gyro_y = 6, gyro_z = 7 }
"""
BY_FIELD = """
[imu]
variable = "log.imu"
units = { time = "ms", gyro = "deg/s", accel = "g" }
axes = ["y", "x", "-z"]

[imu.columns]
time = "t"
gyro_x = "gyro(:,1)"
gyro_y = "gyro(:, 2)"
gyro_z = "gyro(:,3)"
accel_x = "a.x"
accel_y = "a.y"
accel_z = "a.z"
"""
BY_NAME = """
[imu.columns]
time = "t"
gyro_x = "g(:,1)"
gyro_y = "g(:,2)"
gyro_z = "g(:,3)"
accel_x = "a(:,1)"
accel_y = "a(:,2)"
accel_z = "a(:,3)"
"""
GNSS_BY_NAME = """
[gnss]
columns = { time = "tg", vel_n = "v(:,1)", vel_e = "v(:,2)", vel_d = "v(:,3)" }
"""


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return matlab.write(tmp_path)


def codes(log: Log) -> dict[str, int]:
    return {event.code: event.count for event in log.events}


def test_the_drive_comes_back(drive: Path) -> None:
    log, truth = read(drive), sample_drive()
    assert codes(log) == {"I_SIBLING": 1}
    assert (log.meta["format"], log.meta["gnss_source"]) == ("matlab", "RTK0627.mat")
    np.testing.assert_allclose(log.time, truth.time, atol=1e-10)  # a double near 1e5 s
    np.testing.assert_array_equal(log.gyro, truth.gyro)
    np.testing.assert_array_equal(log.accel, truth.accel)
    assert truth.velocity_ned is not None
    assert truth.position_llh is not None
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    np.testing.assert_allclose(log.velocity_ned, truth.velocity_ned, atol=1e-12)  # there and back
    np.testing.assert_allclose(log.position_llh[:, :2], truth.position_llh[:, :2], atol=1e-14)
    np.testing.assert_allclose(log.position_llh[:, 2], truth.position_llh[:, 2], atol=1e-8)  # of 6e6 m
    assert log.wheel_speed is not None
    assert np.isfinite(log.wheel_speed).all()


def test_quality_is_a_sigma_and_epochs_without_one_are_counted(drive: Path) -> None:
    rtk = matlab.rtk()
    rtk[:4, 1] = 0.0
    rtk[4, 2:5] = 0.0
    matlab.save(drive.parent / "RTK0627.mat", {"RTK": rtk})
    log = read(drive)
    assert codes(log)["W_DROPPED"] == 5
    assert log.position_std is not None
    np.testing.assert_array_equal(log.position_std, np.where(rtk[5:, 1] == 1.0, 0.03, 2.0))


def test_what_names_and_widths_do_not_tell_is_left_to_be_found(drive: Path) -> None:
    assert read(drive).meta["undeclared"] == ("gyro_unit", "axes", "clock")
    imu = loadmat(drive)["IMU"]
    imu[:, 1:4] /= 9.8
    matlab.save(drive, {"IMU": imu})
    with pytest.raises(LogError, match=r"columns 2 to 4 of IMU have the median length 1\.0\d*, which is no gravity"):
        read(drive)


@pytest.mark.parametrize("compress", [True, False])
def test_a_matrix_by_column_numbers(drive: Path, put: Writer, compress: bool) -> None:
    imu = loadmat(drive)["IMU"]
    variables = {"IMU": imu, "note": "text", "RTK": matlab.rtk()}
    other = matlab.save(drive.parent / "drive.mat", variables, compress=compress)
    mapping = put("m.toml", (MAPPINGS / "tumsat-matlab.toml").read_text(encoding="utf-8").replace("0.7", "0.0"))
    log = read(other, mapping=mapping)
    np.testing.assert_array_equal(log.gyro, sample_drive().gyro)
    assert log.velocity_ned is not None
    assert sample_drive().velocity_ned is not None
    np.testing.assert_array_equal(log.velocity_ned, read(drive).velocity_ned)
    assert log.meta["height"] == "ellipsoidal"
    assert "undeclared" not in log.meta


def test_fields_of_structs_with_units_and_axes(tmp_path: Path, put: Writer) -> None:
    truth = sample_drive()
    gyro, accel = np.degrees(truth.gyro), truth.accel / 9.80665
    inner = {
        "t": 1000.0 * truth.time[np.newaxis],  # a row
        "gyro": np.column_stack((gyro[:, 1], gyro[:, 0], -gyro[:, 2])),
        "a": {"x": accel[:, 1], "y": accel[:, 0], "z": -accel[:, 2]},
        "name": "board",
    }
    path = matlab.save(tmp_path / "board.mat", {"log": {"imu": inner, "n": 3}})
    matlab.save(tmp_path / "r.mat", {"RTK": matlab.rtk() - ([matlab.START_S] + [0.0] * 7)})
    log = read(path, gnss=tmp_path / "r.mat", mapping=put("m.toml", BY_FIELD))
    np.testing.assert_allclose(log.gyro, truth.gyro, rtol=1e-14)
    np.testing.assert_allclose(log.accel, truth.accel, rtol=1e-14)
    np.testing.assert_allclose(log.time, truth.time, atol=1e-14)


def test_variables_by_name_in_single_precision_and_integers(tmp_path: Path, put: Writer) -> None:
    truth = sample_drive()
    assert truth.velocity_ned is not None
    variables = {
        "t": truth.time,
        "g": truth.gyro.astype(np.float32),
        "a": np.round(truth.accel * 100.0).astype(np.int16),
        "tg": truth.gnss_time,
        "v": truth.velocity_ned,
    }
    path = matlab.save(tmp_path / "a.mat", variables)
    log = read(path, mapping=put("m.toml", BY_NAME + GNSS_BY_NAME))
    np.testing.assert_array_equal(log.gyro, truth.gyro.astype(np.float32))
    np.testing.assert_array_equal(log.accel, np.round(truth.accel * 100.0))
    np.testing.assert_array_equal(log.velocity_ned, truth.velocity_ned)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (BY_NUMBER.replace("IMU", "IMX"), "has no variable IMX (it holds IMU (1500x9 double)"),
        (BY_NUMBER.replace("= 7", "= 10"), "IMU is 1500x9 and has no column 10; check the mapping."),
        (BY_NUMBER.replace('"IMU"', '"IMU.x"'), "IMU.x is not there: what should hold x is no struct"),
        (BY_NUMBER.replace('"IMU"', '"s.y"'), "s.y is not there: what should hold y has the fields x, c"),
        (BY_NUMBER.replace('"IMU"', '"text"'), "text is no array of real numbers"),
        (BY_NUMBER.replace('"IMU"', '"cell"'), "cell is no array of real numbers"),
        (BY_NUMBER.replace('"IMU"', '"complex"'), "complex is no array of real numbers"),
        (BY_NAME.replace('"g(:,1)"', '"IMU"'), "IMU is a 1500x9 matrix; name one column of it"),
        (BY_NAME.replace('"g(:,1)"', '"short"'), "'short' has 3 numbers, the time has 1500"),
    ],
)
def test_a_mapping_that_does_not_fit_is_told(drive: Path, put: Writer, text: str, sentence: str) -> None:
    imu = loadmat(drive)["IMU"]
    variables = {
        "IMU": imu,
        "t": imu[:, 0],
        "g": imu[:, 4:7],
        "a": imu[:, 1:4],
        "s": {"x": 1.0, "c": [1, "a"]},
        "text": "hello",
        "cell": np.array([1, "b"], dtype=object),
        "complex": np.array([[1j, 2.0]]),
        "short": np.ones(3),
    }
    path = matlab.save(drive.parent / "a.mat", variables)
    with pytest.raises(LogError, match=re.escape(sentence)):
        read(path, gnss=drive.parent / "RTK0627.mat", mapping=put("m.toml", text))


def test_a_mapping_of_a_csv_is_not_one_of_a_matlab_file_and_the_other_way_round(drive: Path, put: Writer) -> None:
    numbers = put("m.toml", BY_NUMBER.replace('variable = "IMU"', "header = false"))
    with pytest.raises(UsageError, match=r'has variables; write variable = "NAME" beside the column numbers'):
        read(drive, mapping=numbers)
    csv = put("a.csv", "1,2,3,4,5,6,7\n")
    with pytest.raises(UsageError, match=r"a\.csv is no MATLAB file; leave variable = 'IMU' out"):
        read(csv, gnss=drive.parent / "RTK0627.mat", mapping=put("m.toml", BY_NUMBER))


def test_what_is_no_known_layout_is_listed(tmp_path: Path) -> None:
    path = matlab.save(tmp_path / "a.mat", {"IMU": np.ones((9, 2)), "x": "text"})
    with pytest.raises(LogError, match=re.escape("a.mat holds IMU (9x2 double), x (1x4 text): no layout")):
        read(path)


def test_level_73_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(header + b"\x89HDF\r\n\x1a\n" + bytes(600))
    with pytest.raises(LogError, match=r"a\.mat is a MAT-file of level 7\.3 \(HDF5\), which is not read; save it with"):
        read(path)


@pytest.mark.parametrize("compress", [True, False])
def test_scipy_reads_the_same_numbers(tmp_path: Path, compress: bool) -> None:
    """The format's own library is the oracle, for every class of numbers and both storage forms."""
    rng = np.random.default_rng(2)
    kinds = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
    variables: dict[str, Any] = {kind: (100.0 * rng.random((5, 3))).astype(kind) for kind in kinds}
    variables |= {"cube": rng.random((2, 3, 4)), "flag": np.array([[True, False]]), "empty": np.empty((0, 3))}
    variables["a_long_name_of_thirty_characters"] = np.ones((1, 1))
    path = tmp_path / "a.mat"
    savemat(path, variables, do_compression=compress)
    mat = open_mat(path)
    assert not mat.cut
    assert mat.damaged == ""
    assert set(mat.variables) == set(variables)
    for name, expected in loadmat(path).items():
        if not name.startswith("__"):
            np.testing.assert_array_equal(np.asarray(mat.values(name)), expected)


def test_a_file_of_the_other_byte_order(tmp_path: Path) -> None:
    """As a SPARC would have written it: one matrix of two doubles."""
    flags, dims = struct.pack(">IIII", 6, 8, 6, 0), struct.pack(">IIii", 5, 8, 1, 2)
    body = flags + dims + struct.pack(">I4s", (2 << 16) | 1, b"ab") + struct.pack(">IIdd", 9, 16, 1.5, -2.0)
    header = b"MATLAB 5.0 MAT-file, Platform: SOL2".ljust(124) + b"\x01\x00MI"
    path = tmp_path / "a.mat"
    path.write_bytes(header + struct.pack(">II", 14, len(body)) + body)
    np.testing.assert_array_equal(np.asarray(open_mat(path).values("ab")), [[1.5, -2.0]])
    np.testing.assert_array_equal(loadmat(path)["ab"], [[1.5, -2.0]])


def test_a_bomb_does_not_go_off(tmp_path: Path, put: Writer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three mebibytes of zeros in three kilobytes, that say that they are two numbers; the limit is lower here."""
    monkeypatch.setattr(matlab_file, "MAX_BYTES", 1 << 20)
    flags, dims = struct.pack("<IIII", 6, 8, 6, 0), struct.pack("<IIii", 5, 8, 2, 1)
    body = flags + dims + struct.pack("<I4s", (3 << 16) | 1, b"IMU") + struct.pack("<II", 9, 3 << 20) + bytes(3 << 20)
    data = zlib.compress(struct.pack("<II", 14, len(body)) + body, 9)
    assert len(data) < 4096
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(data)) + data)
    with pytest.raises(LogError, match="is larger than 1 MiB; save fewer samples in one file"):
        read(path, gnss=path, mapping=put("m.toml", BY_NUMBER))


@pytest.mark.parametrize("compress", [True, False])
def test_dimensions_that_are_not_there_take_no_memory(drive: Path, compress: bool) -> None:
    path = drive.parent / "IMUData0627.mat"
    matlab.save(path, {"IMU": loadmat(drive)["IMU"][:300]}, compress=compress)
    element = bytearray(path.read_bytes()[128:])
    element = bytearray(zlib.decompress(element[8:])) if compress else element
    element[32:36] = struct.pack("<i", 1 << 30)
    head = path.read_bytes()[:128]
    deflated = zlib.compress(bytes(element))
    path.write_bytes(head + (struct.pack("<II", 15, len(deflated)) + deflated if compress else bytes(element)))
    with pytest.raises(LogError, match=r"the variable IMU \(at byte 128\) is larger than 512 MiB"):
        read(path)


def test_structs_that_hold_themselves_end(tmp_path: Path, put: Writer) -> None:
    value: Any = 1.0
    for _ in range(30):
        value = {"x": value}
    path = matlab.save(tmp_path / "a.mat", {"s": value})
    text = BY_NUMBER.replace('"IMU"', '"s' + ".x" * 30 + '"')
    with pytest.raises(LogError, match="is not there: what should hold x is no struct"):
        read(path, gnss=path, mapping=put("m.toml", text))


def test_a_deflated_variable_that_is_damaged_is_passed_over_and_said(drive: Path) -> None:
    imu = loadmat(drive)["IMU"]
    path = matlab.save(drive.parent / "IMUData0627.mat", {"note": np.ones((50, 50)), "IMU": imu})
    content = bytearray(path.read_bytes())
    content[136:140] = b"\xff\xff\xff\xff"
    path.write_bytes(content)
    log = read(path)
    assert log.meta["completeness"] == "malformed_record"
    np.testing.assert_array_equal(log.gyro, sample_drive().gyro)


@pytest.mark.parametrize("compress", [True, False])
def test_a_damaged_file_is_marked_or_refused(drive: Path, compress: bool) -> None:
    imu = loadmat(drive)["IMU"][:300]
    variables = {"IMU": imu, "RTK": matlab.rtk(), "x": np.ones((3, 3))}
    path = matlab.save(drive.parent / "IMUData0627.mat", variables, compress=compress)
    content = path.read_bytes()
    (drive.parent / "RTK0627.mat").unlink()
    sizes = {variable.start for variable in open_mat(path).variables.values()}
    for cut in cases.beginnings(content):
        path.write_bytes(cut)
        # A file that ends with a variable is a whole file.
        assert len(cut) in sizes or outcome(path) != "complete"
    for mutated in cases.mutations(content, 400):
        path.write_bytes(mutated)
        outcome(path)


@pytest.mark.parametrize("compress", [True, False])
def test_damaged_structs_are_marked_or_refused(drive: Path, put: Writer, compress: bool) -> None:
    truth = sample_drive().slice(0.0, 2.0)
    gyro, accel = truth.gyro, truth.accel
    inner = {"t": truth.time * 1e3, "gyro": gyro, "a": {"x": accel[:, 0], "y": accel[:, 1], "z": accel[:, 2]}}
    path = matlab.save(drive.parent / "a.mat", {"log": {"imu": inner}}, compress=compress)
    matlab.save(drive.parent / "r.mat", {"RTK": matlab.rtk() - ([matlab.START_S] + [0.0] * 7)})
    mapping = put("m.toml", BY_FIELD)
    content = path.read_bytes()
    for damaged in (*cases.beginnings(content), *cases.mutations(content, 300)):
        path.write_bytes(damaged)
        outcome(path, gnss=drive.parent / "r.mat", mapping=mapping)


def test_the_drive_through_tokyo_is_read_without_options(data_folder: Path) -> None:
    log = read(data_folder / "tumsat-0412" / "IMUData0412.mat")
    about = log.describe()
    assert about["imu_rate_hz"] == pytest.approx(50.0, rel=1e-6)
    assert about["gnss_rate_hz"] == pytest.approx(5.0, rel=1e-6)
    assert about["duration_s"] == pytest.approx(2094.06, abs=0.01)
    assert (log.time.size, log.gnss_time.size) == (104704, 10534)
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    assert log.position_std is not None
    assert log.wheel_speed is not None
    np.testing.assert_allclose(np.degrees(log.position_llh[0, :2]), [35.667, 139.792], atol=1e-3)  # Tokyo
    assert np.isclose(log.position_std, 0.03).sum() == 6778
    rest = np.abs(log.wheel_speed) < 0.01
    assert rest.mean() == pytest.approx(0.39, abs=0.01)
    # Gravity on -z at rest, less bias and the street's camber of 1 degree.
    np.testing.assert_allclose(log.accel[rest].mean(axis=0), [0.0, 0.0, -9.8], atol=0.2)
    speed = np.hypot(*log.velocity_ned[:, :2].T)
    assert speed.max() < 17.0
    # The velocities are those of the positions: north and east by differences, fixed epochs at speed.
    north = np.diff(log.position_llh[:, 0]) * 6.36e6 / np.diff(log.gnss_time)
    steady = (np.isclose(log.position_std[1:], 0.03)) & (np.diff(log.gnss_time) < 0.3) & (speed[1:] > 3.0)
    middle = 0.5 * (log.velocity_ned[1:, 0] + log.velocity_ned[:-1, 0])
    assert np.polyfit(middle[steady], north[steady], 1)[0] == pytest.approx(1.0, abs=0.01)  # the radius of curvature


def outcome(path: Path, *, gnss: Path | None = None, mapping: Path | None = None) -> str:
    """Return how complete a drive is read, or "refused"."""
    try:
        return str(read(path, gnss=gnss, mapping=mapping).meta["completeness"])
    except LevelheadError:
        return "refused"
