"""ROS 2 bags: a folder of SQLite (``.db3``) or MCAP files, or one SQLite file.

The files of a folder are found in the folder; ``metadata.yaml`` only tells their order and whether one is missing, and
its paths are not followed. SQLite files are opened for reading alone and as they are: nothing is written beside them.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from levelhead.errors import LogError
from levelhead.logs.pieces import Pieces
from levelhead.logs.readers import mcap
from levelhead.logs.readers.base import Reader, Source
from levelhead.logs.readers.ros_drive import Add, Topics, pieces
from levelhead.logs.readers.ros_files import Extent, unpacked
from levelhead.logs.readers.ros_messages import MAX_MESSAGE

METADATA: Final = "metadata.yaml"
_SQLITE_MAGIC: Final = b"SQLite format 3\0"
_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_SUFFIXES: Final = (".db3", ".mcap")
_MAX_YAML: Final = 1 << 22
_STEPS: Final = 100_000
"""Steps of SQLite's machine between two looks at how many there were."""
_STEPS_PER_BYTE: Final = 4
"""A row takes some ten steps and more than ten bytes; a database that is made to take more is not worked through."""


def sniff(path: Path, head: bytes) -> bool:
    """Return whether this is a folder with the files of a bag, or a SQLite file with the tables of one."""
    if path.is_dir():
        return bool(_storages(path))
    return head.startswith(_SQLITE_MAGIC) and b"topics" in head and b"messages" in head


def read(source: Source) -> Pieces:
    """Read a folder or a SQLite file; stamps are seconds since 1970, UTC, where the computer's clock was set.

    Raises
    ------
    LogError
        On files that are compressed as a whole, on what is no bag, and where there are no topics that can be used.
    """
    path = source.path
    topics, extent = Topics(source), Extent()
    meta = None
    for storage in _in_order(path, extent) if path.is_dir() else [path]:
        if storage.suffix.lower() == ".mcap":
            of_file, meta = mcap.scan(storage, topics)
            extent.add(of_file)
        else:
            extent.add(scan(storage, topics))
    return pieces(topics, extent, meta)


def _storages(folder: Path) -> list[Path]:
    """Return the SQLite and MCAP files of a folder, in the order of the numbers in their names."""
    found = [p for p in folder.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file()]
    return sorted(found, key=lambda p: [int(t) if t.isdigit() else t for t in re.split(r"(\d+)", p.name)])


def _in_order(folder: Path, extent: Extent) -> list[Path]:
    """Return the files of one recording in their order; note those that ``metadata.yaml`` names and that are missing.

    Raises
    ------
    LogError
        Where the files are compressed as a whole, or seem to be of several recordings.
    """
    there = {path.name: path for path in _storages(folder)}
    named = _named(folder / METADATA)
    packed = [n for n in named if n.endswith(".zstd") and n not in there]
    if packed:
        raise LogError(f"{folder.name}: unpack the compressed files (zstd -d {packed[0]}) and pass the result.")
    if named:
        for name in named:
            if name not in there:
                extent.note(f"the file {name[:80]} is missing")
        order = [there[n] for n in named if n in there]
        if not order:
            raise LogError(f"{folder.name}: none of the files that {METADATA} names is there; pass a whole folder.")
        return order
    if len({re.sub(r"_\d+$", "", path.stem) for path in there.values()}) > 1:
        raise LogError(f"{folder.name} holds several recordings and no {METADATA}; pass one of: {', '.join(there)}.")
    return list(there.values())


def _named(metadata: Path) -> list[str]:
    """Return the names of the files that ``metadata.yaml`` lists, without their folders."""
    if not metadata.is_file():
        return []
    with metadata.open("rb") as file:
        text = file.read(_MAX_YAML).decode(errors="replace")
    listed = re.search(r"^ *relative_file_paths:\s*\n((?: *- .*\n)+)", text, re.MULTILINE)
    names = re.findall(r"- *(.*)", listed[1]) if listed else []
    return [re.split(r"[/\\]", name.strip().strip("'\""))[-1] for name in names]


def scan(path: Path, topics: Topics) -> Extent:
    """Hand every message of the topics that are used to its taker, and return how much of the file was read."""
    is_cut, half = _cut(path)
    extent = Extent(left_out=int(is_cut) + len(half))
    if path.stat().st_size == 0:
        # What a recorder leaves that was stopped when it had just begun a file.
        return extent
    for suffix in ("-wal", "-journal"):
        beside = path.with_name(path.name + suffix)
        if beside.is_file() and beside.stat().st_size:
            what = f"{beside.name} holds what is not yet in the file; run: sqlite3 {path.name} 'PRAGMA wal_checkpoint'"
            extent.note(what)
    taken = 0
    try:
        with closing(_opened(path)) as database:
            adds = _adds(database, topics, path.name)
            for row, topic, time, data in _messages(database, adds):
                if row in half:
                    continue
                content = data if isinstance(data, bytes) else b""
                if content.startswith(_ZSTD_MAGIC):
                    content = unpacked(content, "zstd", MAX_MESSAGE)[0]
                adds[topic](time if isinstance(time, int) else -1, content)
                taken += 1
    except sqlite3.Error as error:
        if extent.left_out == 0:
            extent.note(f"SQLite stops after {taken} messages ({str(error)[:80]})")
    return extent


def _cut(path: Path) -> tuple[bool, frozenset[int]]:
    """Return whether a database is shorter than its header says, and the rows that lie on a page that is not whole.

    SQLite takes the missing part of such a page as zeros, so that a message there may end in wrong numbers.
    """
    with path.open("rb") as file:
        header = file.read(100)
        page = int.from_bytes(header[16:18], "big")
        page = 65536 if page == 1 else max(page, 512)
        size = path.stat().st_size
        file.seek(size - size % page)
        rest = file.read(page)
    # Writers that do not know of the count of pages leave these two unequal.
    counted = header[24:28] == header[92:96]
    short = len(header) < 100 or (counted and int.from_bytes(header[28:32], "big") * page > size)
    return short or bool(rest), frozenset(_rows_on(rest))


def _rows_on(page: bytes) -> Iterator[int]:
    """Yield the numbers of the rows whose begin is on a page of a table (see SQLite's file format, 1.6)."""
    if page[:1] != b"\x0d":
        return
    for k in range(int.from_bytes(page[3:5], "big")):
        at = int.from_bytes(page[8 + 2 * k : 10 + 2 * k], "big")
        # Two numbers of up to nine bytes, 7 bits in each but the last: the length and the row.
        for number in range(2):
            value = 0
            for byte in page[at : at + 9]:
                at += 1
                value = value << 7 | byte & 0x7F
                if byte < 0x80:
                    break
            if number == 1:
                yield value


def _opened(path: Path) -> sqlite3.Connection:
    """Return a connection that writes nothing, trusts nothing in the file, and stops where the file makes it run on."""
    database = sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1", uri=True)
    # Without it SQLite does not even open a file that is shorter than its header says.
    database.execute("PRAGMA writable_schema=ON")
    database.execute("PRAGMA trusted_schema=OFF")
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 16 * MAX_MESSAGE)
    left = 100 + path.stat().st_size * _STEPS_PER_BYTE // _STEPS

    def count() -> int:
        nonlocal left
        left -= 1
        return int(left < 0)

    database.set_progress_handler(count, _STEPS)
    return database


def _adds(database: sqlite3.Connection, topics: Topics, name: str) -> dict[int, Add]:
    """Return what takes the messages, by the topic's number in the database."""
    tables = dict(database.execute("SELECT name, rootpage FROM sqlite_master WHERE type = 'table'").fetchall())
    if not tables.get("topics") or not tables.get("messages"):
        raise LogError(f"{name} is a SQLite database without ROS's tables of topics and messages; pass a ROS 2 bag.")
    definitions: dict[str, str] = {}
    if tables.get("message_definitions"):
        found = database.execute("SELECT topic_type, encoded_message_definition, encoding FROM message_definitions")
        definitions = {str(kind): str(text) for kind, text, form in found if form == "ros2msg"}
    adds: dict[int, Add] = {}
    rows = database.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
    for number, topic, kind, encoding in rows:
        add = topics.open(str(topic), str(kind), str(encoding), definition=definitions.get(str(kind)))
        if add is not None and isinstance(number, int):
            adds[number] = add
    return adds


def _messages(database: sqlite3.Connection, wanted: Iterable[int]) -> Iterator[tuple[int, int, Any, Any]]:
    """Yield row, topic, time (ns) and bytes of the messages, in the order of their rows.

    Raises
    ------
    sqlite3.DatabaseError
        Where the file is damaged.
    """
    numbers = ",".join(str(n) for n in wanted)
    rows = database.execute(
        # The numbers are integers from the table of topics.
        f"SELECT rowid, topic_id, timestamp, data FROM messages NOT INDEXED WHERE topic_id IN ({numbers})"  # noqa: S608
    )
    last = None
    for row in rows:
        if last is not None and row[0] <= last:
            raise sqlite3.DatabaseError("rows repeat")
        last = row[0]
        yield row


READER: Final = Reader(name="ros2-bag", title="ROS 2 bag (folder, .db3)", sniff=sniff, read=read)
