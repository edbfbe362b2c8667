"""Two files of one drive: their clocks are brought together, or it is said that they may not be; never 18 s by chance.

GPS time is 18 s ahead of UTC, which is too little to be seen from where two files begin and end.
"""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np
import pytest

from levelhead.conventions import ACCEL_COLUMNS, GYRO_COLUMNS, TIME_COLUMN
from levelhead.errors import LogError, UsageError
from levelhead.logs.log import Log
from levelhead.logs.readers import read
from samples import (
    ardupilot_bin,
    comma2k19,
    kfgins,
    kitti_oxts,
    mcap,
    named_csv,
    nmea,
    px4_ulog,
    ros1_bag,
    ros2_bag,
    sbg,
    sensor_logger,
    septentrio_sbf,
    ublox_ubx,
    vectornav,
    vectornav_ascii,
)
from samples.drive import EPOCH_UTC_S, sample_drive

AHEAD_S = 18.0
ABSOLUTE = {
    "px4": px4_ulog,
    "ardupilot": ardupilot_bin,
    "ros1": ros1_bag,
    "ros2": ros2_bag,
    "mcap": mcap,
    "sbf": septentrio_sbf,
    "ubx": ublox_ubx,
    "phone": sensor_logger,
    "vectornav": vectornav,
}
"""Formats whose stamps become instants in a time scale that is known."""
OF_A_COMPUTER = ("ros1", "ros2", "mcap", "phone", "ubx")
"""Stamps of these are a computer's, or a sensor's of its own."""
LATE_S = {"px4": 0.11, "ardupilot": 0.11, "ubx": 0.05}
"""The samples' receivers send this late, and the boot clock is set by their messages; UBX's IMU is set by the order in
the file. The others are exact to a millisecond, the resolution of the coarsest stamps."""


def write_pos(folder: Path) -> Path:
    """Write the drive's GNSS as an RTKLIB solution in GPST."""
    drive = sample_drive()
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    rows = ["%  GPST  latitude(deg) longitude(deg) height(m) Q ns vn(m/s) ve(m/s) vu(m/s)"]
    for time, velocity, llh in zip(drive.gnss_time.tolist(), drive.velocity_ned, drive.position_llh, strict=True):
        stamp = dt.datetime.fromtimestamp(round(EPOCH_UTC_S + AHEAD_S + time, 3), tz=dt.UTC)
        lat, lon = np.degrees(llh[:2])
        rows.append(
            f"{stamp:%Y/%m/%d %H:%M:%S.%f} {lat:.9f} {lon:.9f} {llh[2]:.4f} 1 20 "
            f"{velocity[0]:.5f} {velocity[1]:.5f} {-velocity[2]:.5f}"
        )
    path = folder / "solution.pos"
    path.write_text("\n".join([*rows, ""]), encoding="ascii")
    return path


def write_nmea(folder: Path) -> Path:
    """Write the drive's GNSS as NMEA sentences, UTC."""
    path = folder / "receiver.nmea"
    path.write_bytes("".join(nmea.lines()).encode())
    return path


def write_ubx(folder: Path) -> Path:
    """Write the drive's GNSS as NAV-PVT, whose dates are UTC and whose times of week GPST."""
    inner = folder / "ubx"
    inner.mkdir()
    return ublox_ubx.write(inner)


GNSS = {"pos": write_pos, "nmea": write_nmea, "ubx": write_ubx}


def write_canonical(folder: Path, header: str, ahead_s: float) -> Path:
    """Write the drive's IMU as a canonical CSV stamped in seconds since 1970."""
    drive = sample_drive()
    table = np.column_stack((drive.time + EPOCH_UTC_S + ahead_s, drive.gyro, drive.accel)).tolist()
    rows = [",".join(f"{v:.9g}" if k else f"{v:.3f}" for k, v in enumerate(row)) for row in table]
    path = folder / "reading.csv"
    path.write_text("\n".join([",".join((header, *GYRO_COLUMNS, *ACCEL_COLUMNS)), *rows, ""]), encoding="ascii")
    return path


def gnss_late_s(log: Log) -> float:
    """Return how much later than the drive's the log's GNSS epochs are, against its IMU samples."""
    drive = sample_drive()
    # A second of the log's turn rates is that of the drive with the most similar ones, whatever the axes are.
    k = log.time.size // 2
    there = np.lib.stride_tricks.sliding_window_view(np.linalg.norm(drive.gyro, axis=1), 50)
    same = int(np.argmin(np.abs(there - np.linalg.norm(log.gyro[k : k + 50], axis=1)).sum(axis=1)))
    zero = float(log.time[k]) - float(drive.time[same])
    assert log.velocity_ned is not None
    assert drive.velocity_ned is not None
    m = log.gnss_time.size // 2
    epoch = int(np.argmin(np.abs(drive.velocity_ned[:, :2] - log.velocity_ned[m, :2]).sum(axis=1)))
    return float(log.gnss_time[m]) - zero - float(drive.gnss_time[epoch])


def undeclared(log: Log) -> set[str]:
    facts = log.meta.get("undeclared", ())
    assert isinstance(facts, tuple)
    return set(facts)


def codes(log: Log) -> set[str]:
    return {event.code for event in log.events}


@pytest.mark.parametrize("gnss", GNSS)
@pytest.mark.parametrize("imu", ABSOLUTE)
def test_instants_in_two_time_scales_are_brought_together(imu: str, gnss: str, tmp_path: Path) -> None:
    log = read(ABSOLUTE[imu].write(tmp_path), gnss=GNSS[gnss](tmp_path))
    assert abs(gnss_late_s(log)) < LATE_S.get(imu, 2e-3)
    assert ("clock" in undeclared(log)) == (imu in OF_A_COMPUTER)
    assert "velocity_frame" not in undeclared(log), (
        "the solution declares its frame, whatever the IMU's file holds besides"
    )
    assert "W_TIME_SCALE" not in codes(log)


@pytest.mark.parametrize("gnss", GNSS)
def test_stamps_that_count_from_1970_by_nobody_knows_what_are_said_to_be_uncertain(gnss: str, tmp_path: Path) -> None:
    log = read(write_canonical(tmp_path, TIME_COLUMN, AHEAD_S), gnss=GNSS[gnss](tmp_path))
    assert "clock" in undeclared(log)
    assert "W_TIME_SCALE" in codes(log)


@pytest.mark.parametrize("gnss", GNSS)
@pytest.mark.parametrize(("scale", "ahead_s"), [("UTC", 0.0), ("GPST", AHEAD_S)])
def test_a_canonical_header_can_say_what_its_stamps_count_in(
    scale: str, ahead_s: float, gnss: str, tmp_path: Path
) -> None:
    log = read(write_canonical(tmp_path, f"{TIME_COLUMN}[{scale}]", ahead_s), gnss=GNSS[gnss](tmp_path))
    assert abs(gnss_late_s(log)) < 2e-3
    assert "clock" not in undeclared(log)
    assert "W_TIME_SCALE" not in codes(log)


def test_a_foreign_header_can_too_and_a_gps_time_may_be_either(tmp_path: Path) -> None:
    text = write_canonical(tmp_path, "time", 0.0).read_text(encoding="ascii")
    body = text.partition("\n")[2]
    axes = "gx[rad/s],gy[rad/s],gz[rad/s],ax[m/s2],ay[m/s2],az[m/s2]"
    path = tmp_path / "someones.csv"
    pos = write_pos(tmp_path)
    for title, known in (("stamp [UTC]", True), ("utc_time", True), ("gpsTime", False), ("timestamp", False)):
        path.write_text(f"{title},{axes}\n{body}", encoding="ascii")
        log = read(path, gnss=pos)
        assert log.meta["format"] == "named-csv"
        assert ("clock" in undeclared(log)) != known, title
        assert (abs(gnss_late_s(log)) < 2e-3) == known, title


def test_a_foreign_csv_with_stamps_of_a_computer_has_a_clock_to_be_found(tmp_path: Path) -> None:
    pos = write_pos(tmp_path)
    log = read(vectornav_ascii.write(tmp_path), gnss=pos)
    assert "clock" in undeclared(log)
    assert "W_TIME_SCALE" in codes(log)
    with pytest.raises(UsageError, match="has GNSS columns of its own"):
        read(named_csv.write(tmp_path), gnss=pos)


@pytest.mark.parametrize("imu", [comma2k19, kfgins, sbg])
def test_a_clock_that_counts_from_elsewhere_does_not_go_with_instants(imu: object, tmp_path: Path) -> None:
    path = imu.write(tmp_path)  # type: ignore[attr-defined]
    with pytest.raises(LogError, match="No GNSS epoch lies within the IMU data"):
        read(path, gnss=write_pos(tmp_path))


def test_kitti_does_not_declare_its_time_zone(tmp_path: Path) -> None:
    log = read(kitti_oxts.write(tmp_path), gnss=write_pos(tmp_path))
    assert "clock" in undeclared(log)
    assert {"W_TIME_SCALE", "I_DECIMATED"} & codes(log) == {"W_TIME_SCALE"}, "the INS's velocities are not used"


def test_what_a_file_tells_of_the_imu_that_is_not_used_does_not_matter(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    log = read(septentrio_sbf.write(tmp_path), gnss=px4_ulog.write(other))
    assert "calibration" not in log.meta, "it is that of the autopilot's IMU"
    assert "imu_device_ids" not in log.meta
    assert "compensated" not in log.meta
    assert log.meta["gnss_format"] == "px4-ulog"
    log = read(septentrio_sbf.write(tmp_path), gnss=ros1_bag.write(other))
    assert undeclared(log) == {"axes", "velocity_frame", "clock"}
