"""`levelhead convert` into tracks: from a log, and from the result of a drive."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest

import levelhead as lh
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.rtklib_pos import READER


def levelhead(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command as a user does."""
    command = [sys.executable, "-m", "levelhead", *map(str, arguments)]
    environment = {**os.environ, "COLUMNS": "200", "PYTHONWARNINGS": "error"}
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, env=environment)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of one minute, its log without positions, and its result."""
    folder = tmp_path_factory.mktemp("convert")
    log, _ = lh.simulate("field", seed=1, duration=60.0)
    lh.write(log, folder / "drive.parquet")
    text = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,vel_n,vel_e,vel_d\n"
    rows = (f"{0.1 * k:.1f},0,0,0,0,0,-9.8,1,0,0\n" for k in range(100))
    (folder / "nowhere.csv").write_text(text + "".join(rows))
    assert levelhead("estimate", "drive.parquet", "-o", "out", cwd=folder).returncode == 0
    return folder


@pytest.mark.parametrize("suffix", ["kml", "geojson", "pos"])
def test_a_log_becomes_a_track_of_its_gnss_positions(folder: Path, tmp_path: Path, suffix: str) -> None:
    output = tmp_path / f"a.{suffix}"
    done = levelhead("convert", "drive.parquet", "-o", output, cwd=folder)
    assert done.returncode == 0, done.stderr
    count = lh.read(folder / "drive.parquet").gnss_time.size
    assert f"path of the GNSS antenna, {count} positions." in done.stdout
    if suffix == "kml":
        root = ElementTree.fromstring(output.read_text())
        text = root.findtext(".//{http://www.opengis.net/kml/2.2}coordinates")
        assert text is not None
        assert len(text.split()) == count
    elif suffix == "geojson":
        (feature,) = json.loads(output.read_text())["features"]
        assert len(feature["geometry"]["coordinates"]) == count
    else:
        gnss = READER.read(Source(path=output, role="gnss")).gnss
        assert gnss is not None
        assert gnss.time.size == count


def test_a_result_becomes_its_path_ten_positions_a_second(folder: Path, tmp_path: Path) -> None:
    table = pq.read_table(folder / "out" / "result.parquet")
    samples = int(np.isfinite(table["latitude"].to_numpy()).sum())
    for options, count in (
        ([], samples // 10 + 1),
        (["--every", "0"], samples),
        (["--every", "1"], samples // 100 + 1),
    ):
        done = levelhead("convert", "out/result.parquet", "-o", tmp_path / "a.geojson", *options, cwd=folder)
        assert done.returncode == 0, done.stderr
        written = int(done.stdout.rsplit(",", 1)[1].split()[0])
        # The last position is kept too, and the path may begin within a span.
        assert abs(written - count) <= 1, options
        places = [f["geometry"]["coordinates"] for f in json.loads((tmp_path / "a.geojson").read_text())["features"]]
        # Stretches share the position where they meet.
        assert sum(map(len, places)) - (len(places) - 1) in (written, written - 1)


def test_a_pos_file_of_a_log_is_gnss_data_again(folder: Path, tmp_path: Path) -> None:
    # A log on an absolute clock, whose track then is the GNSS file of its own IMU data.
    log = lh.read(folder / "drive.parquet")
    epoch = 1.7e9
    names = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
    rows = np.column_stack([log.time + epoch, log.gyro, log.accel])
    np.savetxt(tmp_path / "imu.csv", rows, "%.17g", delimiter=",", header=",".join(("time", *names)), comments="")
    lh.write(lh.Log(**{**vars(log), "meta": {"epoch": epoch, "gnss_time_scale": "GPST"}}), tmp_path / "a.parquet")
    assert levelhead("convert", "a.parquet", "-o", "a.pos", cwd=tmp_path).returncode == 0
    back = lh.read(tmp_path / "imu.csv", gnss=tmp_path / "a.pos")
    # Microseconds in the file, and a double of 1.7e9 s resolves 2.4e-7 s.
    np.testing.assert_allclose(back.gnss_time, log.gnss_time, rtol=0.0, atol=2e-6)
    assert back.velocity_ned is not None
    assert log.velocity_ned is not None
    np.testing.assert_allclose(back.velocity_ned, log.velocity_ned, rtol=0.0, atol=0.51e-5)  # half of the last digit


BAD = [
    (
        ["drive.parquet", "-o", "a.gpx"],
        2,
        "a log is written as .csv, .parquet, .mcap, a track as .kml, .geojson, .pos.",
    ),
    (["nowhere.csv", "-o", "a.kml"], 3, "nowhere.csv has no GNSS positions, so that there is no track to write"),
    (["out/result.parquet", "-o", "a.csv"], 2, "result.parquet is a result, not a log; it becomes a track"),
    (["out/result.parquet", "-o", "a.parquet"], 2, "result.parquet is a result, not a log; it becomes a track"),
    (["out/result.parquet", "-o", "a.kml", "--format", "csv"], 2, "--gnss, --imu, --mapping and --format go with"),
    (["out/result.parquet", "-o", "a.kml", "--point", "reference"], 2, "was estimated without a reference point"),
    (["out/result.parquet", "-o", "a.kml", "--every", "-1"], 2, "One position every -1 s cannot be"),
    (["drive.parquet", "-o", "a.kml", "--point", "imu"], 2, "is not a result.parquet; --point goes with one."),
    (["drive.parquet", "-o", "a.csv", "--every", "1"], 2, "a.csv is a log, which keeps all samples"),
    (["drive.parquet", "-o", "absent/a.kml"], 1, "could not be written"),
    (["absent.parquet", "-o", "a.kml"], 2, "absent.parquet does not exist"),
]


@pytest.mark.parametrize(("arguments", "code", "words"), BAD)
def test_every_mistake_is_one_sentence_and_leaves_nothing(
    arguments: list[str], code: int, words: str, folder: Path
) -> None:
    before = sorted(p.name for p in folder.rglob("*"))
    done = levelhead("convert", *arguments, cwd=folder)
    assert done.returncode == code, done.stderr
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert sorted(p.name for p in folder.rglob("*")) == before


def test_a_path_over_bad_terrain_of_file_names_is_still_a_track(folder: Path, tmp_path: Path) -> None:
    hostile = tmp_path / "a<b>&\"'\n% UTC .parquet"
    hostile.write_bytes((folder / "drive.parquet").read_bytes())
    for suffix in ("kml", "geojson", "pos"):
        output = tmp_path / f"a.{suffix}"
        done = levelhead("convert", hostile, "-o", output, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    name = "a<b>&\"'\ufffd% UTC .parquet"
    root = ElementTree.fromstring((tmp_path / "a.kml").read_text())
    assert root.findtext(".//{http://www.opengis.net/kml/2.2}name") == name
    assert json.loads((tmp_path / "a.geojson").read_text())["features"][0]["properties"]["name"] == name
    assert READER.read(Source(path=tmp_path / "a.pos", role="gnss")).meta["gnss_time_scale"] == "GPST"
