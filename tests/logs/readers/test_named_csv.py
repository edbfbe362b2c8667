"""CSV by its header: names, units, clocks and what a header leaves open."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.logs.readers import read
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.named_csv import READER
from samples import named_csv
from samples.drive import EPOCH_UTC_S, sample_drive

Writer = Callable[[str, str], Path]

ROW = "{t},0.1,0.2,0.3,1,2,9.5,{n},2,3\n"
HEADER = "t,wx,wy,wz,ax,ay,az,vn,ve,vd\n"


def rows(times: list[float], row: str = ROW) -> str:
    return "".join(row.format(t=repr(t) if isinstance(t, float) else t, n=k) for k, t in enumerate(times))


def hundredths(unit: float, start: float = 0.0) -> str:
    return rows([round(start + unit * k / 100.0, 6) for k in range(50)])


def test_the_drive_comes_back(tmp_path: Path) -> None:
    log, drive = read(named_csv.write(tmp_path)), sample_drive()
    assert log.meta["format"] == "named-csv"
    assert log.meta["undeclared"] == ("axes",)
    np.testing.assert_allclose(log.time, drive.time, atol=5e-4)  # whole milliseconds
    np.testing.assert_allclose(log.gyro, drive.gyro, atol=1e-9)  # half of 1e-7 deg/s
    np.testing.assert_allclose(log.accel, drive.accel, atol=5e-8)  # half of 1e-8 g
    assert log.velocity_ned is not None
    assert drive.velocity_ned is not None
    np.testing.assert_allclose(log.velocity_ned, drive.velocity_ned, atol=5e-6)  # half of 1e-5 m/s
    assert log.position_llh is not None
    assert drive.position_llh is not None
    np.testing.assert_allclose(log.position_llh[:, :2], drive.position_llh[:, :2], atol=1e-12)  # half of 1e-10 deg
    assert log.meta["epoch"] == pytest.approx(EPOCH_UTC_S + drive.time[0], abs=5e-4)


def test_the_vn100_drives_need_no_options(data_folder: Path) -> None:
    for name in ("first_test", "town"):
        log = read(data_folder / "neu-freecode" / f"{name}_imu.csv")
        assert log.meta["format"] == log.meta["gnss_format"] == "named-csv"
        assert log.meta["gnss_source"] == f"{name}_gps.csv"
        assert log.meta["undeclared"] == ("gyro_unit", "accel_unit", "axes", "clock")
        about = log.describe()
        assert about["imu_rate_hz"] == pytest.approx(40.0, rel=0.01)  # the host's stamps jitter
        assert about["gnss_rate_hz"] == pytest.approx(1.0, rel=0.01)
        # The static |accel| of the data's notes, 10.03 and 9.99, all on z.
        np.testing.assert_allclose(np.median(log.accel, axis=0), [0.0, 0.0, -10.0], atol=1.0)
        assert log.position_llh is not None
        assert np.degrees(log.position_llh[:, 0].mean()) == pytest.approx(42.34, abs=0.05)  # Boston


@pytest.mark.parametrize(
    "names",
    [
        "Time [s];GyroX;GyroY;GyroZ;AccX;AccY;AccZ;VelN;VelE;VelD",
        "%time,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z,field.linear_acceleration.x,"
        "field.linear_acceleration.y,field.linear_acceleration.z,velocity_north,velocity_east,velocity_down",
        "__time,/imu/data/angular_velocity/x,/imu/data/angular_velocity/y,/imu/data/angular_velocity/z,"
        "/imu/data/linear_acceleration/x,/imu/data/linear_acceleration/y,/imu/data/linear_acceleration/z,vn,ve,vd",
        "timestamp\tgyr_x\tgyr_y\tgyr_z\tacc_x\tacc_y\tacc_z\tv_north\tv_east\tv_down",
        "#t,omega_x,omega_y,omega_z,imu.accel_x,imu.accel_y,imu.accel_z,gps.vel_n,gps.vel_e,gps.vel_d",
    ],
)
def test_many_names_mean_the_same(put: Writer, names: str) -> None:
    delimiter = next(d for d in "\t;," if d in names)
    text = f"{names}\n" + hundredths(1.0).replace(",", delimiter)
    log = read(put("a.csv", text))
    np.testing.assert_array_equal(log.gyro[0], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(log.accel[0], [1.0, 2.0, 9.5])
    assert log.velocity_ned is not None
    np.testing.assert_array_equal(log.velocity_ned[7], [7.0, 2.0, 3.0])
    assert log.meta["undeclared"] == ("gyro_unit", "accel_unit", "axes")


@pytest.mark.parametrize(
    ("gyro", "factor"),
    [("gx_dps", np.pi / 180.0), ("gyro_x_rad_s", 1.0), ("gx [mrad/s]", 1e-3), ("gx (°/s)", np.pi / 180.0)],
)
@pytest.mark.parametrize(("accel", "scale"), [("ax_mg", 9.80665e-3), ("acc_x_ms2", 1.0), ("AccX(g)", 9.80665)])
def test_units_are_part_of_the_names(put: Writer, gyro: str, factor: float, accel: str, scale: float) -> None:
    three = [[name.replace("x", a, 1).replace("X", a.upper(), 1) for a in "xyz"] for name in (gyro, accel)]
    names = ",".join(["t", *three[0], *three[1], "vn", "ve", "vd"])
    log = read(put("a.csv", f"{names}\n" + hundredths(1.0).replace("1,2,9.5", "100,200,950")))
    # The factors are exact to a rounding.
    np.testing.assert_allclose(log.gyro[0], np.array([0.1, 0.2, 0.3]) * factor, rtol=1e-15)
    np.testing.assert_allclose(log.accel[0], np.array([100.0, 200.0, 950.0]) * scale, rtol=1e-15)
    assert log.meta["undeclared"] == ("axes",)


def test_a_line_of_units_may_stand_under_the_header(put: Writer) -> None:
    units = "ms;deg/s;deg/s;deg/s;g;g;g;m/s;m/s;m/s\n"
    text = HEADER.replace(",", ";") + units + hundredths(1000.0).replace(",", ";").replace(".", ",")
    log = read(put("a.csv", text))
    np.testing.assert_allclose(log.time[:3], [0.0, 0.01, 0.02], atol=1e-12)  # rounding of a product
    np.testing.assert_allclose(log.gyro[0], np.radians([0.1, 0.2, 0.3]), rtol=1e-15)
    assert log.meta["undeclared"] == ("axes",)


@pytest.mark.parametrize(("unit", "start"), [(1.0, 0.0), (1e3, 5e3), (1e6, 0.0), (1e9, 1e12), (1e9, 1.75e18)])
def test_the_unit_of_the_time_is_found_in_its_steps(put: Writer, unit: float, start: float) -> None:
    text = HEADER + "".join(ROW.format(t=f"{start + unit * k / 100.0:.9f}", n=k) for k in range(50))
    log = read(put("a.csv", text))
    np.testing.assert_allclose(np.diff(log.time), 0.01, atol=1e-6)  # float64 of ns since 1970 has steps of 256 ns
    assert ("epoch" in log.meta) == (start > 1e18)


@pytest.mark.parametrize(
    "steps",
    [
        [float(k // 100) for k in range(500)],  # whole seconds at 100 Hz: not milliseconds at 1000 Hz
        [230.0 * k for k in range(50)],  # 230 ms or 230 us?
        [5.0] * 50,
    ],
)
def test_a_time_whose_unit_cannot_be_told_is_refused(put: Writer, steps: list[float]) -> None:
    with pytest.raises(LogError, match=r"a\.csv, column t: the .*stamps.*pass a mapping"):
        read(put("a.csv", HEADER + rows(steps)))


def test_speed_and_course_are_a_velocity_without_height(put: Writer) -> None:
    names = HEADER.replace("vn,ve,vd", "speed_kmh,course,sAcc")
    log = read(put("a.csv", names + rows([k / 100.0 for k in range(50)], "{t},0,0,0,0,0,9.8,36,{n},0.2\n")))
    assert log.velocity_ned is not None
    assert log.velocity_std is not None
    course = np.radians(np.arange(50.0))
    expected = 10.0 * np.column_stack((np.cos(course), np.sin(course), np.zeros(50)))
    np.testing.assert_allclose(log.velocity_ned, expected, atol=1e-12)  # rounding
    np.testing.assert_allclose(log.velocity_std[0], [0.2, 0.2, 0.5], rtol=1e-12)
    assert [(e.code, e.count) for e in log.events] == [("I_VELOCITY_2D", 50)]


def test_fixes_written_into_every_row_count_once(put: Writer) -> None:
    names = HEADER.replace("vn,ve,vd", "lat,lon,alt")
    lines = [f"{k / 100.0},0,0,0,0,0,9.8,{50 + (k // 20) * 1e-5},8,100" for k in range(100)]
    log = read(put("a.csv", names + "\n".join(lines) + "\n"))
    np.testing.assert_allclose(log.gnss_time, [0.0, 0.2, 0.4, 0.6, 0.8])
    assert [(e.code, e.count) for e in log.events] == [("W_DROPPED", 95)]


def test_rows_without_a_fix_are_left_out_and_counted(put: Writer) -> None:
    imu = put("imu.csv", "t,wx,wy,wz,ax,ay,az\n" + rows([k / 100.0 for k in range(500)], "{t},0,0,0,0,0,9.8\n"))
    text = "t,latitude,longitude,altitude,fix_quality\n0,0,0,0,0\n1,50,8,100,1\n2,50,8,100,0\n3,50,8,100,4\n"
    log = read(imu, gnss=put("fixes.csv", text))
    np.testing.assert_array_equal(log.gnss_time, [1.0, 3.0])
    assert ("W_DROPPED", 2) in [(e.code, e.count) for e in log.events]
    assert log.meta["undeclared"] == ("gyro_unit", "accel_unit", "axes", "clock")


@pytest.mark.parametrize(
    ("header", "sentence"),
    [
        ("t,wx,wy,wz,ax,ay,az,gx,ve,vd", "'wx' and 'gx' can each be gyro_x; say which one is in a mapping file"),
        ("t,time,wy,wz,ax,ay,az,wx,ve,vd", "'t' and 'time' can each be time"),
        ("t,wx,wy,wz,ax,ay,b,c,d,e", "no column is understood as accel_z (found: t, wx, wy,"),
        ("t,wx[furlong],wy,wz,ax,ay,az,vn,ve,vd", "the unit 'furlong' of the column 'wx[furlong]' is not known"),
    ],
)
def test_what_cannot_be_told_is_refused(put: Writer, header: str, sentence: str) -> None:
    with pytest.raises(LogError, match=re.escape(sentence)):
        READER.read(Source(path=put("a.csv", f"{header}\n" + hundredths(1.0))))


def test_accelerations_without_gravity_are_refused(put: Writer) -> None:
    text = HEADER + rows([k / 100.0 for k in range(50)], "{t},0,0,0,0.1,0,0.1,{n},2,3\n")
    with pytest.raises(LogError, match=r"median length of 0\.14, so gravity was taken off it"):
        read(put("a.csv", text))


def test_canonical_files_stay_canonical(put: Writer) -> None:
    text = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,vel_n,vel_e,vel_d\n" + hundredths(1.0)
    log = read(put("a.csv", text))
    assert log.meta["format"] == "csv"
    assert "undeclared" not in log.meta
    assert read(put("b.csv", "#" + text)).meta["format"] == "named-csv"


def test_stamps_may_be_in_two_columns(put: Writer) -> None:
    header = "header.stamp.sec,header.stamp.nanosec,wx,wy,wz,ax,ay,az,vn,ve,vd\n"
    lines = [f"{1751003243 + k // 100},{k % 100 * 10**7},0,0,0,0,0,9.8,{k},2,3\n" for k in range(150)]
    log = read(put("a.csv", header + "".join(lines)))
    np.testing.assert_allclose(log.time, np.arange(150) / 100.0, atol=1e-6)  # steps of 0.24 us near 1.75e9 s
    both = header.replace("header.stamp.sec,header.stamp.nanosec", "stamp_s,stamp_ns")
    with pytest.raises(LogError, match=r"'stamp_s' and 'stamp_ns' are no whole seconds and nanoseconds"):
        read(put("b.csv", both + "".join(lines[:9]) + "2,2000000000,0,0,0,0,0,9.8,9,2,3\n"))


def test_rows_of_other_sensors_are_left_out_and_counted(put: Writer) -> None:
    text = HEADER + hundredths(1.0) + "".join(f"{k / 100.0 + 0.005},,,,,,,,,\n" for k in range(20))
    log = read(put("a.csv", text))
    assert log.time.size == 50
    assert [(e.code, e.count) for e in log.events] == [("W_DROPPED", 20)]
