"""The preflight on recorded drives (not part of the repository), as their recorders described them."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import GRAVITY
from levelhead.estimators import phasor
from levelhead.estimators.finishing import finish_filtered
from levelhead.preflight import Preflight, Told, Verdict, check
from samples.strange_logs import FLU, RFU, finding, in_axes, in_degrees, in_frame, in_g, late, unsaid

ROOT = Path(__file__).parents[2]
CERTAIN = (Verdict.FINE, Verdict.CORRECTED)


@pytest.fixture(scope="module")
def drives() -> ModuleType:
    """The benchmark's way of reading the drives: what it prints is what is tested."""
    spec = importlib.util.spec_from_file_location("real_drives", ROOT / "benchmarks" / "real_drives.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def car_roof(data_folder: Path) -> Preflight:
    """The car-roof drive, read without a word on what is in it."""
    return check(lh.read(data_folder / "rtklib-drive" / "imu_1934.csv"))


def test_the_car_roof_drive_needs_no_option(car_roof: Preflight) -> None:
    assert car_roof.refused == ()
    assert finding(car_roof, "accelerometer unit").values["unit"] == "g"
    assert finding(car_roof, "gyro unit").values["unit"] == "deg/s"
    assert finding(car_roof, "axes").values["axes"] == "-x,y,-z"
    assert finding(car_roof, "velocity frame").verdict is Verdict.FINE
    assert car_roof.corrections.gyro_factor == math.pi / 180.0
    assert car_roof.corrections.accel_factor == GRAVITY
    # The author of the data: 5.35 deg, and -0.125 s for the IMU's lines, which are late.
    assert finding(car_roof, "mounting yaw").values["yaw_deg"] == pytest.approx(5.35, abs=1.0)
    assert car_roof.corrections.latency_s == pytest.approx(-0.125, abs=0.05)
    # Pitched about 7 deg, by the notes on the data.
    assert finding(car_roof, "mounting tilt").values["pitch_deg"] == pytest.approx(-7.0, abs=1.0)


def test_the_car_roof_drive_tells_its_gyros_at_rest(car_roof: Preflight) -> None:
    rest = finding(car_roof, "rest").values
    # In the data's notes, FRD axes with z as the file has it (up): vibration of 2 deg/s over a minute leaves 0.01.
    np.testing.assert_allclose(np.asarray(rest["gyro_deg_s"]), [0.0135, -0.045, -0.17], atol=0.02)


def test_the_filter_is_no_more_surprised_than_with_the_authors_numbers(
    car_roof: Preflight, drives: ModuleType, data_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ratios = []

    def recording(*arguments: object, innovation_ratio: float, **more: object) -> object:
        ratios.append(innovation_ratio)
        return finish_filtered(*arguments, innovation_ratio=innovation_ratio, **more)  # type: ignore[arg-type]

    told = Told(axes="-x,y,-z", mounting_yaw=math.radians(5.35), latency_s=-0.125)
    log_as_told = check(lh.read(data_folder / "rtklib-drive" / "imu_1934.csv"), told=told).trusted()
    monkeypatch.setattr(phasor, "finish_filtered", recording)
    lh.estimate(car_roof.trusted(), "phasor")
    lh.estimate(drives.rtklib_drive(data_folder), "phasor")
    lh.estimate(log_as_told, "phasor")
    ours, mapped, as_told = ratios
    assert ours <= mapped
    assert ours <= as_told
    assert mapped == pytest.approx(as_told, rel=1e-3)  # one and the same, by way of the mapping or of the options


def re_expressed(log: lh.Log, axes: str) -> lh.Log:
    """Return a log in deg/s, g, other axes and ENU, its GNSS 0.2 s later, that says nothing of it."""
    log = late(in_axes(in_g(in_degrees(log)), {"FLU": FLU, "RFU": RFU}[axes]), 0.2)
    return unsaid(log if log.velocity_ned is None else in_frame(log, "ENU"))


def kitti(name: str, drives: ModuleType, folder: Path) -> lh.Log:
    log: lh.Log = drives.kitti_log(folder / "kitti" / f"2011_09_30_drive_{name}.parquet")[0]
    return log


def vn100(name: str, _drives: ModuleType, folder: Path) -> lh.Log:
    data = folder / "neu-freecode"
    mapping = ROOT / "examples" / "mappings" / "neu-freecode.toml"
    return lh.read(data / f"{name}_imu.csv", gnss=data / f"{name}_gps.csv", mapping=mapping)


Recorded = Callable[[str, ModuleType, Path], lh.Log]
DRIVES: list[tuple[Recorded, str]] = [
    (kitti, "0018"),
    (kitti, "0028"),
    (kitti, "0033"),
    (vn100, "first_test"),
    (vn100, "town"),
]


@pytest.mark.parametrize("axes", ["FLU", "RFU"])
@pytest.mark.parametrize(("recorded", "name"), DRIVES, ids=[name for _, name in DRIVES])
def test_biases_do_not_depend_on_how_a_drive_is_told(
    recorded: Recorded, name: str, axes: str, drives: ModuleType, data_folder: Path
) -> None:
    log = recorded(name, drives, data_folder)
    plain, told = check(log), check(re_expressed(log, axes))
    assert plain.refused == ()
    assert told.refused == ()
    late_by = told.corrections.latency_s - plain.corrections.latency_s
    assert late_by == pytest.approx(0.2, abs=0.01)  # faults.md
    for method in ("observer", "phasor"):
        a, b = lh.estimate(plain.trusted(), method), lh.estimate(told.trusted(), method)
        np.testing.assert_allclose(np.degrees(b.gyro_bias[-1]), np.degrees(a.gyro_bias[-1]), atol=0.005, rtol=0.0)
        np.testing.assert_allclose(b.accel_bias[-1, :2], a.accel_bias[-1, :2], atol=0.01, rtol=0.0)
        assert a.known_gyro == b.known_gyro
        assert a.known_accel == b.known_accel


@pytest.mark.parametrize(("recorded", "name"), DRIVES, ids=[name for _, name in DRIVES])
def test_axes_and_units_that_are_right_stay(
    recorded: Recorded, name: str, drives: ModuleType, data_folder: Path
) -> None:
    log = recorded(name, drives, data_folder)
    found = check(unsaid(log))
    assert found.corrections.gyro_factor == found.corrections.accel_factor == 1.0
    assert finding(found, "axes").verdict is Verdict.FINE
    assert finding(found, "velocity frame").verdict is Verdict.FINE


def test_clocks_of_the_vn100_drives_agree_with_each_other(drives: ModuleType, data_folder: Path) -> None:
    a, b = (check(vn100(name, drives, data_folder)) for name in ("first_test", "town"))
    # One setup on two days; each is known to 0.02 s.
    assert a.corrections.latency_s == pytest.approx(b.corrections.latency_s, abs=0.05)


def test_tokyo_is_read_with_its_clocks_far_apart(data_folder: Path) -> None:
    folder = data_folder / "tumsat-0412"
    found = check(lh.read(folder / "IMUData0412.mat", gnss=folder / "RTK0412.mat"))
    assert found.refused == ()
    assert finding(found, "axes").verdict is Verdict.FINE  # FRD, by the notes
    assert finding(found, "gyro unit").verdict is Verdict.FINE
    assert finding(found, "velocity frame").verdict is Verdict.FINE
    # About 0.7 s by the notes (yaw rate says 0.68 s, accelerations 0.86 s: examples/mappings/tumsat-matlab.toml).
    assert found.corrections.latency_s == pytest.approx(0.77, abs=0.15)
    # 41 % standstill, by the notes.
    assert finding(found, "driving").values["standing"] == pytest.approx(0.41, abs=0.03)


def test_a_minute_of_highway_tells_nothing_wrong(data_folder: Path) -> None:
    found = check(lh.read(data_folder / "formats" / "comma2k19"))
    assert found.refused == ()  # the format says what it is
    assert found.corrections.gyro_factor == found.corrections.accel_factor == 1.0
    np.testing.assert_array_equal(np.abs(found.corrections.accel_dcm).argmax(axis=1), [0, 1, 2])
    assert finding(found, "velocity frame").verdict in (Verdict.FINE, Verdict.UNDECIDED)
    assert finding(found, "driving").verdict is Verdict.WARNING


def test_the_skid_steer_robot_has_gravity_on_its_y_axis(data_folder: Path) -> None:
    log = lh.read(data_folder / "formats" / "husky_test1.bag")
    found = check(log)
    axes = finding(found, "axes")
    if axes.verdict in CERTAIN:
        down = found.corrections.accel_dcm[2]
        assert np.abs(down).argmax() == 1
    else:
        assert axes.verdict is Verdict.REFUSED
        assert "Gravity does not lie along the z axis" in axes.text
        # The notes: gravity lies on +y. The ground is level within 3 deg.
        np.testing.assert_allclose(np.asarray(axes.values["gravity"]), [0.0, 1.0, 0.0], atol=0.05)
    assert finding(found, "gyro unit").verdict is not Verdict.CORRECTED
