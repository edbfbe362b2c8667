"""Files made to do harm, and files that are not what they seem: one sentence, in no time and in little memory."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import levelhead.logs.readers as readers
from hostile.rules import Listener, attempt
from hostile.sample import names, prepare
from levelhead.cli.main import main
from levelhead.errors import LevelheadError, LogError, UsageError
from levelhead.logs.readers import read

Writer = Callable[[str, str], Path]

COLUMNS = ("time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z", "vel_n", "vel_e", "vel_d")
HEADER = ",".join(COLUMNS) + "\n"
ROWS = "0,0.1,0.2,0.3,1,2,3,,,\n0.5,0.1,0.2,0.3,1,2,3,7,8,9\n1,0.1,0.2,0.3,1,2,3,,,\n"
MAPPING = '[gnss]\ncolumns = { time = "t", vel_n = "n", vel_e = "e", vel_d = "d" }\n'
POS = "%  GPST  latitude(deg) longitude(deg) height(m) Q ns\n2025/07/08 19:34:18.500 40.0 -105.0 1601.0 1 21\n"
REFUSED_S = 2.0
"""Time in which the known bombs must be refused, s."""


def peak_of(path: Path) -> tuple[str, float, float]:
    """Read a file in a process of its own; return what it said, and seconds and MB that reading took it."""
    code = (
        "import sys, time, levelhead as lh, pyarrow.parquet, pyarrow.csv\n"
        # Not getrusage: its maximum is handed down from the parent.
        "peak = lambda: int(open('/proc/self/status').read().split('VmHWM:')[1].split()[0]) / 1024\n"
        "before, begin = peak(), time.perf_counter()\n"
        "try:\n    said = str(lh.read(sys.argv[1]).time.size)\n"
        "except lh.LevelheadError as error:\n    said = str(error)\n"
        "print(said, time.perf_counter() - begin, peak() - before, sep='\\n')\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    said, seconds, memory = done.stdout.splitlines()
    return said, float(seconds), float(memory)


def big(name: str) -> bytes:
    """Return a text of 20 MB that is no log."""
    texts = {
        "one line": b"9" * 20_000_000,
        "one line of a row": (HEADER + ROWS).encode() + b"9" * 20_000_000,
        "a comma a byte": HEADER.encode() + b"," * 20_000_000,
        "a header of a comma a byte": b"time,gyro_x" + b"," * 20_000_000,
        "a quotation mark": (HEADER + ROWS).encode() + b'"' + b"1,2\n" * 5_000_000,
        "zeros": (HEADER + ROWS).encode() + bytes(20_000_000),
        "zeros in the middle": (HEADER + ROWS).encode() + bytes(20_000_000) + ROWS.encode(),
        "line ends": HEADER.encode() + b"\n" * 20_000_000,
        "comments": b"#\n" * 2_000_000 + HEADER.encode(),
        "one word of a .pos": POS.encode()
        + b"2025/07/08 19:34:18.500 40.0 -105.0 1601.0 1 "
        + b"9" * 1_000_000
        + b"\n",
    }
    return texts[name]


@pytest.mark.parametrize(
    "name",
    [
        "one line", "one line of a row", "a comma a byte", "a header of a comma a byte", "a quotation mark", "zeros",
        "zeros in the middle", "line ends", "comments", "one word of a .pos",
    ],
)  # fmt: skip
def test_a_monstrous_text_is_read_or_refused_in_no_time(tmp_path: Path, name: str) -> None:
    path = tmp_path / "big.csv"
    path.write_bytes(big(name))
    said, seconds, memory = peak_of(path)
    assert len(said) < 800
    assert seconds < REFUSED_S
    # Some copies of the file: nothing is multiplied.
    assert memory < 8 * path.stat().st_size / 1e6 + 100


def bomb(tmp_path: Path, rows: int, value: float = 1.0, **settings: object) -> Path:
    """Write a Parquet file of the canonical columns whose rows are all the same."""
    path = tmp_path / "bomb.parquet"
    same = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int8)), pa.array([value]))
    pq.write_table(pa.table(dict.fromkeys(COLUMNS, same)), path, **settings)
    return path


def test_a_parquet_of_a_million_rows_a_kilobyte_is_refused(tmp_path: Path) -> None:
    # Padded with a column of noise, so that there are bytes enough for the rows that are claimed.
    rows = 6_000_000
    same = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int8)), pa.array([1.0]))
    noise = pa.array(np.frombuffer(np.random.default_rng(1).bytes(rows // 10), dtype=np.uint8).repeat(10))
    path = tmp_path / "bomb.parquet"
    pq.write_table(pa.table({**dict.fromkeys(COLUMNS, same), "noise": noise}), path, compression="zstd")
    said, seconds, memory = peak_of(path)
    assert "which no log does or which is too much" in said
    assert seconds < REFUSED_S
    assert memory < 100  # nothing but the index was read


def test_what_is_read_of_a_parquet_that_packs_well_stays_below_a_gigabyte(tmp_path: Path) -> None:
    path = bomb(tmp_path, 1_990_000, compression="none")
    said, seconds, memory = peak_of(path)
    assert "which no log does" in said
    assert seconds < REFUSED_S
    assert memory < 100


def test_nested_and_odd_columns_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "odd.parquet"
    for kind in (
        pa.array([[1.0], [2.0], [3.0]]),
        pa.array([{"x": 1.0}, {"x": 2.0}, {"x": 3.0}]),
        pa.array([b"1", b"2", b"3"]),
        pa.array([True, False, True]),
        pa.array([1, 2, 3], pa.timestamp("ns")),
        pa.array([[(1, 2.0)], [], []], pa.map_(pa.int64(), pa.float64())),
    ):
        table = {**dict.fromkeys(COLUMNS, pa.array([1.0, 2.0, 3.0])), "gyro_x": kind}
        pq.write_table(pa.table(table), path)
        with pytest.raises(LogError, match=r"odd\.parquet: the column gyro_x is of type .*; store numbers"):
            read(path)
        # Columns that nobody asks for may be anything.
        pq.write_table(pa.table({**dict.fromkeys(COLUMNS, pa.array([1.0, 2.0, 3.0])), "more": kind}), path)
        assert read(path).time.size == 3


def test_a_name_with_a_point_and_a_part_of_a_struct_are_not_confused(tmp_path: Path) -> None:
    path = tmp_path / "odd.parquet"
    numbers = pa.array([1.0, 2.0, 3.0])
    inner = pa.StructArray.from_arrays([pa.array([7.0, 8.0, 9.0])], ["gyro_x"])
    pq.write_table(pa.table({"a": inner, **dict.fromkeys(COLUMNS, numbers), "a.gyro_x": numbers}), path)
    np.testing.assert_array_equal(read(path).gyro[:, 0], [1.0, 2.0, 3.0])


def test_a_byte_that_changed_in_a_page_is_found_by_its_checksum(tmp_path: Path) -> None:
    sample = prepare("canonical_parquet", tmp_path)
    content = sample.files[0].read_bytes()
    refused = 0
    places = range(1000, len(content) * 9 // 10, 997)
    for at in places:
        sample.files[0].write_bytes(content[:at] + bytes([content[at] ^ 16]) + content[at + 1 :])
        with contextlib.suppress(LogError):
            sample.read()
            continue
        refused += 1
    # What is left are headers of pages, whose statistics nobody reads.
    assert refused > 0.97 * len(places)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            (HEADER + ROWS).replace("\n", "\r"),
            "a.csv is a text whose lines end with carriage returns alone (old Mac); convert",
        ),
        (HEADER + ROWS.replace("7,8", "7\0,8"), "the format is not known (binary data)"),
        (
            HEADER + 5000 * ROWS + "2,0.1\0,0.2,0.3,1,2,3,,,\n3,1,1,1,1,1,1,,,\n",
            "holds the text '0.1\\x00' where a num",
        ),
        (HEADER + ROWS.replace("0.1", "٠.١"), "the column gyro_x holds the text '٠.١' where a number is expected"),
        (HEADER + ROWS.replace("0.1", "0_1"), "the column gyro_x holds the text '0_1' where a number is expected"),
        (HEADER + ROWS.replace("0.1", "0x1p3"), "holds the text '0x1p3' where a number is expected"),
        (HEADER + ROWS.replace("0.1", "1e999"), "gyro_x is infinite"),
        (HEADER.replace("gyro_x", "gyro_x[deg/s") + ROWS, "the column gyro_x is missing"),
        (
            HEADER.replace("gyro_y", "\x9b2J" * 5000) + ROWS,
            "the column gyro_y is missing (found: time, gyro_x, \ufffd2J",
        ),
    ],
)
def test_odd_texts_are_refused_with_a_short_sentence(put: Writer, text: str, sentence: str) -> None:
    with pytest.raises(LogError, match=re.escape(sentence)) as refusal:
        read(put("a.csv", text))
    assert str(refusal.value).isprintable()
    assert len(str(refusal.value)) < 800


def test_line_ends_may_be_mixed(put: Writer) -> None:
    text = (HEADER + ROWS).replace("\n", "\r\n", 2)
    np.testing.assert_array_equal(read(put("a.csv", text)).time, [0.0, 0.5, 1.0])


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("2025/07/08 19:34:18Z 40.0 -105.0 1601.0 1 21", "line 3: '2025/07/08 19:34:18Z' is not a time"),
        ("2025/07/08 19 40.0 -105.0 1601.0 1 21", "line 3: '2025/07/08 19' is not a time"),
        ("2025/07/08 19:34:18.5 4_0.0 -105.0 1601.0 1 21", "the column latitude holds '4_0.0' where a number is exp"),
        ("2025/07/08 19:34:18.5 ٤.0 -105.0 1601.0 1 21", "the column latitude holds '٤.0' where a number is expected"),
        ("2025/07/08 19:34:18.5 40.0 -105.0 1601.0 1 21 7", "the line has 8 columns where 7 are exp"),
        (
            "2025/07/08 19:34:18." + "9" * 20 + " 40.0 -105.0 1601.0 1 21",
            "'2025/07/08 19:34:18.99999999999999999999' is not",
        ),
    ],
)
def test_odd_words_in_a_solution_are_refused(put: Writer, line: str, sentence: str) -> None:
    imu = put("a.csv", "".join(row.rsplit(",", 3)[0] + "\n" for row in (HEADER + ROWS).splitlines()))
    with pytest.raises(LogError, match=re.escape(sentence)):
        read(imu, gnss=put("b.pos", POS + line + "\n"))


@pytest.fixture
def listener() -> Iterator[Listener]:
    """What hears everything that is printed."""
    with contextlib.closing(Listener()) as listening:
        yield listening


@pytest.mark.parametrize("name", names())
@pytest.mark.parametrize("left", [0, 3, 2000])
def test_a_file_that_shrinks_while_it_is_read_is_a_cut_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listener: Listener, name: str, left: int
) -> None:
    sample = prepare(name, tmp_path)
    assert sample.whole.time.size
    head, shrunk = readers._head, sample.files[0]
    content = shrunk.read_bytes()

    def shrink(path: Path) -> bytes:
        begin = head(path)
        shrunk.write_bytes(content[:left])
        return begin

    monkeypatch.setattr(readers, "_head", shrink)
    outcome = attempt(sample, listener)
    assert outcome.fault == ""
    if outcome.log is not None and not sample.cut_unseen(shrunk.name, content, left):
        assert outcome.log.meta["completeness"] != "complete"


@pytest.mark.parametrize("name", names())
def test_in_the_place_of_a_file_there_may_be_anything(tmp_path: Path, listener: Listener, name: str) -> None:
    sample = prepare(name, tmp_path)
    assert sample.whole.time.size
    file = sample.files[0]
    for put in (
        lambda: file.write_bytes(b""),
        file.mkdir,
        lambda: os.mkfifo(file),
        lambda: file.symlink_to("/dev/zero"),
        lambda: file.symlink_to(file),
        lambda: file.symlink_to(tmp_path),
        lambda: file.write_bytes(os.urandom(10_000)),
        lambda: file.write_bytes(bytes(100_000)),
        lambda: None,
    ):
        file.unlink(missing_ok=True) if not file.is_dir() or file.is_symlink() else file.rmdir()
        put()
        outcome = attempt(sample, listener, limit_s=5.0)
        assert outcome.fault == ""
        # Of a log of many files the rest may be read, and says what is missing.
        assert outcome.log is None or outcome.log.meta["completeness"] != "complete" or len(sample.files) > 1


def test_a_mapping_may_be_anything_too(put: Writer, tmp_path: Path) -> None:
    log = put("a.csv", HEADER + ROWS)
    fifo = tmp_path / "fifo.toml"
    os.mkfifo(fifo)
    for mapping, sentence in (
        (fifo, "is not a regular file"),
        (Path("/dev/zero"), "is not a regular file"),
        (tmp_path, "is not a regular file"),
        (put("a.toml", "a = " + "[" * 100_000), "nested too deeply"),
        (put("b.toml", "#" * 2_000_000), "pass a mapping file, not a log"),
        (put("c.toml", "\0"), "is not TOML"),
        (tmp_path / ("x" * 300), "cannot be read: File name too long"),
    ):
        with pytest.raises(UsageError, match=sentence):
            read(log, mapping=mapping)


def test_names_that_no_file_can_have(put: Writer) -> None:
    log = put("a.csv", HEADER + ROWS)
    for name in ("x" * 300, "a\0b", ""):
        with pytest.raises(LevelheadError):
            read(log.parent / name)
        with pytest.raises(LevelheadError):
            read(log, gnss=name)


def test_a_folder_that_cannot_be_listed_hides_only_the_file_beside(
    put: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = put("a_imu.csv", HEADER + ROWS)

    def refuse(_path: Path) -> Iterator[Path]:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)  # the tests may run as root, who may list everything
    assert read(path).time.size == 3


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("absent.csv", None, 2),
        ("a.csv", b"", 3),
        ("a.parquet", b"PAR1", 3),
        ("a.csv.gz", b"\x1f\x8b\x08\x00" + bytes(100), 3),
        ("a.csv", ("\ufeff" + HEADER + ROWS).encode("utf-16"), 3),
        ("a.csv", (HEADER + ROWS.replace("7", "x")).encode(), 3),
        ("a.pos", POS.encode(), 3),
    ],
)
def test_the_command_line_says_one_sentence_at_once(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, content: bytes | None, code: int
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    begin = perf_counter()
    with pytest.raises(SystemExit) as end:
        main(["estimate", str(path), "-o", str(tmp_path / "out")])
    assert perf_counter() - begin < 1.0
    assert end.value.code == code
    said = capfd.readouterr()
    assert said.out == ""
    assert re.fullmatch(r"levelhead: .*\.\n", said.err)
    assert not (tmp_path / "out").exists()
