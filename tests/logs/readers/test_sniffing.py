"""Which format takes which file: a sample is claimed by one reader, or the first of those that claim it is right."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest

import samples
from levelhead.logs.readers import READERS, _head
from levelhead.logs.writers import write
from samples import kfgins, nmea
from samples.drive import sample_drive

TAKEN_BY = {
    "ardupilot_bin": "ardupilot-bin",
    "canonical_csv": "csv",
    "canonical_parquet": "parquet",
    "comma2k19": "comma2k19",
    "kfgins": "kfgins",
    "kitti_oxts": "kitti",
    "mapped_csv": "plain-csv",
    "matlab": "matlab",
    "mcap": "mcap",
    "named_csv": "named-csv",
    "nmea": "csv",
    "plain_csv": "plain-csv",
    "px4_ulog": "px4-ulog",
    "ros1_bag": "ros1-bag",
    "ros2_bag": "ros2-bag",
    "rtklib_pos": "rtklib-pos",
    "sbg": "sbg",
    "sensor_logger": "sensor-logger",
    "septentrio_sbf": "septentrio-sbf",
    "ublox_ubx": "ublox-ubx",
    "vectornav": "vectornav",
    "vectornav_ascii": "vectornav-ascii",
}
"""The format of what each module of `samples` writes: of nmea the IMU file, of mapped_csv without its mapping."""

OVERLAPS = {
    "sbg": ("sbg", "named-csv"),
    "vectornav": ("vectornav", "named-csv"),
}
"""What several readers could take, in the order in which they are asked: these are tables whose header also says in
plain words what the columns are, but only their own reader knows the axes, the status and the receivers besides."""


def claims(path: Path) -> tuple[str, ...]:
    return tuple(name for name, reader in READERS.items() if reader.sniff(path, _head(path)))


def modules() -> list[str]:
    names = (module.name for module in pkgutil.iter_modules(samples.__path__))
    return [name for name in names if hasattr(importlib.import_module(f"samples.{name}"), "write")]


@pytest.mark.parametrize("module", modules())
def test_a_sample_is_claimed_by_one_reader(module: str, tmp_path: Path) -> None:
    path = importlib.import_module(f"samples.{module}").write(tmp_path)
    wanted = TAKEN_BY[module]
    assert claims(path) == OVERLAPS.get(module, (wanted,))


def test_what_lies_beside_a_sample_is_claimed_by_one_reader_too(tmp_path: Path) -> None:
    nmea.write(tmp_path)
    assert claims(tmp_path / "drive.gps.nmea") == ("nmea",)
    kfgins.write(tmp_path)
    assert claims(tmp_path / "drive_gnss.txt") == ("kfgins",)


@pytest.mark.parametrize(("name", "format"), [("drive.csv", "csv"), ("drive.parquet", "parquet")])
def test_what_we_write_is_what_we_read(name: str, format: str, tmp_path: Path) -> None:
    write(sample_drive(), tmp_path / name)
    assert claims(tmp_path / name) == (format,)


RECORDED = {
    "formats/ardupilot_test.BIN": ("ardupilot-bin",),
    "formats/comma2k19": ("comma2k19",),
    "formats/husky_test1.bag": ("ros1-bag",),
    "formats/px4_sample.ulg": ("px4-ulog",),
    "formats/walk_0827.ubx": ("ublox-ubx",),
    "kitti/2011_09_30_drive_0018.parquet": ("parquet",),
    "neu-freecode/town_gps.csv": ("named-csv",),
    # Its columns gyro_x, gyro_y, gyro_z are ours, too few for a canonical file: it has other words for the rest.
    "neu-freecode/town_imu.csv": ("named-csv", "csv"),
    "rtklib-drive/gnss_1934_sf.pos": ("rtklib-pos",),
    "rtklib-drive/imu_1934.csv": ("plain-csv",),
    "tumsat-0412/IMUData0412.mat": ("matlab",),
    "tumsat-0412/RTK0412.mat": ("matlab",),
}


@pytest.mark.parametrize("name", RECORDED)
def test_a_recorded_file_is_too(name: str, data_folder: Path) -> None:
    assert claims(data_folder / name) == RECORDED[name]


@pytest.mark.parametrize(
    "content",
    [
        b"Dear all,\nthe meeting is at 10.\n",
        b"a,b,c\n1,2,3\n",
        b"name,city\nAnn,Bonn\n",
        b"1,2\n3,4\n",
        b"\x89PNG\r\n\x1a\n" + bytes(100),
        b"PK\x03\x04" + bytes(100),
        b"SQLite format 3\0" + bytes(100),
        bytes(range(256)) * 20,
        b"% a comment of LaTeX\n\\begin{document}\n",
        b"$GPGGA,this is no sentence*00\n" * 3,
        b"\xa3\x95\x80",
    ],
)
def test_what_is_no_log_is_claimed_by_none(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "something"
    path.write_bytes(content)
    assert claims(path) == ()
    (tmp_path / "folder").mkdir()
    assert claims(tmp_path / "folder") == ()


def test_names_and_titles_have_one_style() -> None:
    for name, reader in READERS.items():
        assert name == name.lower() == reader.name
        assert not set(name) - set("abcdefghijklmnopqrstuvwxyz0123456789-")
        assert reader.title == reader.title.strip()
        assert not reader.title.endswith(".")
    titles = [reader.title for reader in READERS.values()]
    assert len(set(titles)) == len(titles)
