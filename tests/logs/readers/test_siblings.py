"""Which GNSS file goes with an IMU file."""

from __future__ import annotations

from pathlib import Path

import pytest

from levelhead.errors import UsageError
from levelhead.logs.readers.siblings import find_sibling


@pytest.mark.parametrize(
    ("imu", "gnss"),
    [
        ("drive.imu.csv", "drive.gnss.csv"),
        ("town_imu.csv", "town_gps.csv"),
        ("imu_1934.csv", "gnss_1934_sf.pos"),
        ("IMUData0412.mat", "RTK0412.mat"),
        ("imu.txt", "GPS.txt"),
    ],
)
def test_the_name_of_the_imu_file_leads_to_the_other(tmp_path: Path, imu: str, gnss: str) -> None:
    for name in (imu, gnss, "gnss_1933.pos", "other_gps.csv", "gnss_19345.pos"):
        (tmp_path / name).touch()
    assert find_sibling(tmp_path / imu) == tmp_path / gnss


@pytest.mark.parametrize("name", ["drive.csv", "simurun.csv", "imu_7.csv"])
def test_no_name_no_sibling(tmp_path: Path, name: str) -> None:
    for other in (name, "gps_8.csv", "sgpsrun.csv", "gnss_7.png"):
        (tmp_path / other).touch()
    assert find_sibling(tmp_path / name) is None


def test_of_several_the_user_chooses(tmp_path: Path) -> None:
    for name in ("imu_7.csv", "gps_7_a.pos", "gps_7_b.pos"):
        (tmp_path / name).touch()
    with pytest.raises(UsageError, match=r"go with imu_7.csv: gps_7_a.pos, gps_7_b.pos; choose one with gnss="):
        find_sibling(tmp_path / "imu_7.csv")
