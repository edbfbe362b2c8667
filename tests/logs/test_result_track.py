"""The path in a result.parquet: whose it is, where GNSS was absent, and what is said when there is none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from levelhead.conventions import FloatArray, StatusArray
from levelhead.errors import LogError, UsageError
from levelhead.logs.log import Log
from levelhead.logs.result_track import is_result, result_track
from levelhead.logs.writers import write, write_table

Columns = dict[str, FloatArray | StatusArray]


def result_columns(*, navigated: bool = True, reference: bool = False) -> Columns:
    """Eight samples of what `levelhead estimate` writes; the first has no position yet, the last three no GNSS."""
    zeros = np.zeros(8)
    columns: Columns = {"time": np.arange(8) / 100.0, "gyro_bias_x": zeros, "roll": zeros}
    columns["status"] = np.array([1, 0, 16, 16, 16, 4, 20, 4], dtype=np.uint32)
    names = ["", "reference_"] if reference else [""]
    for k, prefix in enumerate(names):
        latitude: FloatArray = np.full(8, 0.5 + 0.25 * k)
        latitude[0] = np.nan
        columns[f"{prefix}latitude"] = latitude
        columns[f"{prefix}longitude"] = np.linspace(-1.8, -1.79, 8)
        columns[f"{prefix}height"] = np.full(8, 100.0 + k)
        for i, axis in enumerate("ned"):
            columns[f"{prefix}velocity_{axis}"] = np.full(8, 10.0 * k + i)
            if navigated:
                columns[f"{prefix}position_std_{axis}"] = np.full(8, 0.1 * (i + 1) + k)
    return columns


def save(tmp_path: Path, columns: Columns, facts: object = None) -> Path:
    path = tmp_path / "result.parquet"
    write_table(columns, {}, path)
    if facts is not None:
        text = facts if isinstance(facts, str) else json.dumps(facts)
        pq.write_table(pq.read_table(path).replace_schema_metadata({b"levelhead": text.encode()}), path)
    return path


def test_only_a_result_is_one(drive: Log, tmp_path: Path) -> None:
    assert is_result(save(tmp_path, result_columns()))
    write(drive, tmp_path / "log.parquet")
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "result.parquet").read_bytes()[:100])
    (tmp_path / "log.csv").write_text("time,status,gyro_bias_x,roll\n")
    for name in ("log.parquet", "cut.parquet", "log.csv", "absent.parquet", "."):
        assert not is_result(tmp_path / name), name


def test_the_path_begins_with_the_first_position_and_knows_where_gnss_was_absent(tmp_path: Path) -> None:
    track = result_track(save(tmp_path, result_columns()))
    assert (track.name, track.point) == ("result.parquet", "IMU")
    np.testing.assert_array_equal(track.time, np.arange(1, 8) / 100.0)
    assert track.coasting is not None
    np.testing.assert_array_equal(track.coasting, [False] * 4 + [True] * 3)
    assert track.position_std is not None
    assert track.velocity_ned is not None
    np.testing.assert_array_equal(track.position_std[0], [0.1, 0.2, 0.1 * 3])
    np.testing.assert_array_equal(track.velocity_ned[0], [0.0, 1.0, 2.0])
    assert track.velocity_std is None
    assert track.epoch is None


def test_the_reference_point_goes_first_unless_the_imu_is_asked_for(tmp_path: Path) -> None:
    path = save(tmp_path, result_columns(reference=True))
    for point, words, latitude, north in ((None, "reference point", 0.75, 10.0), ("imu", "IMU", 0.5, 0.0)):
        track = result_track(path, "imu" if point else None)
        assert track.point == words
        assert track.velocity_ned is not None
        assert (track.position_llh[0, 0], track.velocity_ned[0, 0]) == (latitude, north)
    assert result_track(path, "reference").point == "reference point"
    with pytest.raises(UsageError, match=r"result\.parquet was estimated without a reference point; leave out --point"):
        result_track(save(tmp_path, result_columns()), "reference")


def test_a_method_without_positions_of_its_own_hands_on_the_antennas(tmp_path: Path) -> None:
    track = result_track(save(tmp_path, result_columns(navigated=False)))
    assert track.point == "GNSS antenna, interpolated"
    assert track.position_std is None


@pytest.mark.parametrize("nested", [False, True])
def test_what_the_file_tells_of_its_log_is_used(tmp_path: Path, nested: bool) -> None:
    facts = {"epoch": 1.7e9, "gnss_time_scale": "UTC", "datum": "ETRS89", "height": "mean sea level", "source": "a.csv"}
    track = result_track(save(tmp_path, result_columns(), {"log": facts} if nested else facts))
    assert track.epoch == 1.7e9
    assert track.name == "a.csv"
    assert dict(track.meta) == facts


@pytest.mark.parametrize("facts", [[], 3, {"log": 3}, {"epoch": "noon"}])
def test_facts_of_another_shape_are_no_facts(tmp_path: Path, facts: object) -> None:
    assert result_track(save(tmp_path, result_columns(), facts)).epoch is None


def test_a_result_that_cannot_be_trusted_is_a_sentence(tmp_path: Path) -> None:
    columns = result_columns()
    bare = {name: values for name, values in columns.items() if name != "height"}
    back = {**columns, "time": np.zeros(8)}
    degrees = {**columns, "latitude": np.full(8, 50.0)}
    nowhere = {**columns, "latitude": np.full(8, np.nan)}
    for wrong, sentence in (
        (bare, "has no positions, because its log had none; there is no path to write"),
        (back, "the time does not advance on every row"),
        (degrees, "a position is beyond the globe; a result has latitude and longitude in radians"),
        (nowhere, "has 0 positions; a track needs two at least"),
    ):
        with pytest.raises(LogError, match=rf"result\.parquet:? {sentence}"):
            result_track(save(tmp_path, wrong))
    with pytest.raises(LogError, match="the metadata levelhead are not JSON"):
        result_track(save(tmp_path, columns, "{"))
    with pytest.raises(LogError, match=r"the datum is 'Tokyo', whose positions lie some 400 m off"):
        result_track(save(tmp_path, columns, {"datum": "Tokyo"}))
    path = save(tmp_path, columns)
    text = pq.read_table(path).set_column(0, "time", pa.array(["a"] * 8))
    pq.write_table(text, path)
    with pytest.raises(LogError, match=r"result\.parquet: the result cannot be read \(.*\); estimate or copy it again"):
        result_track(path)
