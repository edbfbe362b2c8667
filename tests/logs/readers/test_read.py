"""`read`: finding the format, the second file and the right sentence."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import LogError, UsageError
from levelhead.logs.log import Log
from levelhead.logs.readers import READERS, read
from levelhead.logs.writers import write

Writer = Callable[[str, str], Path]

IMU = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n"
GNSS = "time,vel_n,vel_e,vel_d\n0.5,7,8,9\n1.5,7,8,9\n"
POS = (
    "%  GPST  latitude(deg) longitude(deg) height(m) Q ns\n"
    "2025/07/08 19:34:18.500 40.0 -105.0 1601.0 1 21\n"
    "2025/07/08 19:34:19.500 40.0 -105.0 1601.0 1 21\n"
)
MAPPING = """
[imu]
columns = { time = "t", gyro_x = "a", gyro_y = "b", gyro_z = "c", accel_x = "d", accel_y = "e", accel_z = "f" }
"""
GNSS_MAPPING = '[gnss]\ncolumns = { time = "t", vel_n = "n", vel_e = "e", vel_d = "d" }\n'


def test_the_suffix_is_nothing_the_content_everything(drive: Log, tmp_path: Path) -> None:
    write(drive, tmp_path / "a.parquet")
    os.replace(tmp_path / "a.parquet", tmp_path / "a.csv")
    assert read(tmp_path / "a.csv").meta["format"] == "parquet"


def test_a_path_may_be_a_string_and_the_format_given(put: Writer) -> None:
    log = read(str(put("a.csv", IMU)), format="csv", gnss=str(put("b.csv", GNSS)))
    assert log.meta["format"] == "csv"
    with pytest.raises(LogError, match="damaged or cut short"):
        read(put("a.csv", IMU), format="parquet")


def test_two_files_are_joined(put: Writer) -> None:
    log = read(put("a.csv", IMU), gnss=put("b.csv", GNSS))
    np.testing.assert_array_equal(log.gnss_time, [0.5, 1.5])
    assert log.meta["source"] == "a.csv"
    assert log.meta["gnss_source"] == "b.csv"


def test_the_gnss_file_beside_an_imu_file_is_found_by_its_name(put: Writer) -> None:
    imu = put("my.drive.imu.csv", IMU)
    put("my.drive.gnss.csv", GNSS)
    assert read(imu).meta["gnss_source"] == "my.drive.gnss.csv"
    other = put("other.csv", GNSS.replace("7", "70"))
    assert read(imu, gnss=other).meta["gnss_source"] == "other.csv"


def test_an_imu_file_alone_asks_for_gnss(put: Writer) -> None:
    with pytest.raises(LogError, match=r"a\.imu\.csv .* holds no GNSS data; pass the file that does as gnss=\."):
        read(put("a.imu.csv", IMU))


@pytest.mark.parametrize(("name", "text"), [("b.csv", GNSS), ("b.pos", POS)])
def test_a_gnss_file_alone_asks_for_an_imu_file(put: Writer, name: str, text: str) -> None:
    with pytest.raises(
        LogError, match=rf"{name} \(.*\) holds GNSS data only; an IMU file is needed too: pass that one"
    ):
        read(put(name, text))


def test_two_sources_of_gnss_data_are_one_too_many(drive: Log, tmp_path: Path, put: Writer) -> None:
    write(drive, tmp_path / "a.csv")
    with pytest.raises(UsageError, match=r"a\.csv has GNSS columns of its own; leave out the GNSS file b\.csv"):
        read(tmp_path / "a.csv", gnss=put("b.csv", GNSS))


def test_of_a_whole_log_as_gnss_file_only_the_gnss_data_is_taken(drive: Log, tmp_path: Path, put: Writer) -> None:
    write(drive, tmp_path / "whole.parquet")
    log = read(put("a.csv", IMU), gnss=tmp_path / "whole.parquet")
    assert log.time.size == 3
    np.testing.assert_array_equal(log.gnss_time, drive.gnss_time)


def test_clocks_that_do_not_meet_are_refused_with_the_files_name(put: Writer) -> None:
    with pytest.raises(LogError, match=r"a\.csv: No GNSS epoch lies within the IMU data.*check.*time_zero"):
        read(put("a.csv", IMU), gnss=put("b.pos", POS))


def test_seconds_since_1970_are_counted_from_the_first_sample(put: Writer) -> None:
    start = 1752003258.0  # POS is 19:34:18.5 and 19.5, that is 1752003258.5 and 1752003259.5
    text = IMU.splitlines()[0] + "".join(f"\n{start + k},1,2,3,4,5,6" for k in range(3)) + "\n"
    log = read(put("a.csv", text), gnss=put("b.pos", POS))
    np.testing.assert_array_equal(log.time, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(log.gnss_time, [0.5, 1.5])
    assert log.meta["epoch"] == start
    assert log.meta["gnss_time_scale"] == "GPST"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "a.log is empty; check the recording or the copy."),
        (b"\x00\x01\x02\xff" * 100, "a.log: the format is not known (binary data); levelhead reads "),
        (b"\x1f\x8b\x08\x00" + b"\x99" * 50, "a.log is compressed by gzip; unpack it first (gunzip)."),
        (b"\xff\xfet\0i\0m\0e\0\n\0", "a.log is UTF-16 text; save it as UTF-8"),
        ("time,gyro_x\n0,1\n".encode("utf-16-be"), "a.log is UTF-16 text; save it as UTF-8"),
        (b"PK\x03\x04" + bytes(50), "a.log is a zip archive (or a spreadsheet); unpack it first, or export it as CSV."),
        (b"hello world\n", "a.log: the format is not known (the first line is 'hello world'); levelhead reads"),
        (b"a,b,c\n1,2,3\n", "For a CSV with other columns pass a mapping file (mapping=)."),
        (b"\n\n\n", "the format is not known (the first line is '')"),
        (b"caf\xe9,1\n", "the format is not known (binary data)"),
    ],
)
def test_what_is_no_log_is_refused_with_a_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(content)
    with pytest.raises(LogError, match=re.escape(sentence)):
        read(path)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"absent\.csv does not exist; check the path\."):
        read(tmp_path / "absent.csv")
    with pytest.raises(LogError, match="is a directory, and no log in a known layout"):
        read(tmp_path)
    fifo = tmp_path / "fifo.csv"
    os.mkfifo(fifo)
    # Opening it would block for ever: that the test ends is the proof.
    with pytest.raises(LogError, match="is not a regular file"):
        read(fifo)


def test_an_unreadable_file_is_a_sentence(put: Writer, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put("a.csv", IMU)

    def refuse(*_args: object, **_settings: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)  # the tests may run as root, who may read everything
    with pytest.raises(LogError, match=r"a\.csv cannot be read: Permission denied\."):
        read(path)


def test_unknown_and_unsuitable_options_are_refused(put: Writer) -> None:
    imu = put("a.csv", IMU)
    with pytest.raises(UsageError, match=r"'xml' is not known; the formats are .*csv, parquet, mapped-csv"):
        read(imu, format="xml")
    with pytest.raises(UsageError, match="to be read as mapped-csv; pass mapping= with a section for it"):
        read(imu, format="mapped-csv")
    with pytest.raises(UsageError, match="The mapping describes GNSS data only; pass the GNSS file as gnss="):
        read(imu, mapping=put("m.toml", GNSS_MAPPING))
    with pytest.raises(UsageError, match=r"b\.pos is RTKLIB solution .* which needs no mapping"):
        read(put("b.pos", POS), mapping=put("m.toml", MAPPING))


def test_each_file_may_be_canonical_or_mapped(put: Writer) -> None:
    foreign_imu = put("f.csv", IMU.replace(IMU.splitlines()[0], "t,a,b,c,d,e,f"))
    foreign_gnss = put("g.csv", GNSS.replace(GNSS.splitlines()[0], "t,n,e,d"))
    for imu, gnss, mapping in (
        (foreign_imu, put("b.csv", GNSS), MAPPING),
        (put("a.csv", IMU), foreign_gnss, GNSS_MAPPING),
        (foreign_imu, foreign_gnss, MAPPING + GNSS_MAPPING),
    ):
        log = read(imu, gnss=gnss, mapping=put("m.toml", mapping))
        np.testing.assert_array_equal(log.gnss_time, [0.5, 1.5])
        np.testing.assert_array_equal(log.gyro[0], [1.0, 2.0, 3.0])
        assert log.velocity_ned is not None
        np.testing.assert_array_equal(log.velocity_ned[0], [7.0, 8.0, 9.0])


def test_what_is_wrong_with_the_data_itself_carries_the_files_name(put: Writer) -> None:
    one_sample = "\n".join(IMU.splitlines()[:2]) + "\n"
    with pytest.raises(LogError, match=r"a\.csv: The log has 1 IMU samples"):
        read(put("a.csv", one_sample), gnss=put("b.csv", GNSS.replace("0.5", "0.0")))


def test_every_reader_is_registered_by_its_own_name() -> None:
    assert {name: reader.name for name, reader in READERS.items()} == {name: name for name in READERS}
