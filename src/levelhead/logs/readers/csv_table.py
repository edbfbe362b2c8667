"""Numbers out of comma-separated text: quickly by pyarrow where all is well, line by line to say what is not.

A recording that was cut off ends with half a line, one that was cut out of a longer one begins with half a
line; such a line is left out and counted. A bad line anywhere else is an error that names it.
"""

from __future__ import annotations

import csv
import io
import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.logs.readers.base import shown

_LINE_END: Final = b"\r\n"
_CONTROL: Final = bytes(c for c in range(32) if c not in b"\t\r\n")
_BLANK: Final = frozenset({"", "nan", "NaN", "NA", "null", "NULL", "N/A", "#N/A", "n/a", "-nan", "-NaN"})
"""Cells that mean "absent": those of the list of pyarrow that occur in practice."""
DELIMITERS: Final = (",", ";", "\t")
_NUMBER = re.compile(r"\s*([-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?inf(inity)?)\s*", re.IGNORECASE | re.ASCII)
_NOT_LINE_END = re.compile(rb"[^\r\n]")
_PIECE_OF_NUMBER = re.compile(r"[-+.eE\d]*", re.ASCII)
LAYOUT_LINES: Final = 5
"""Lines whose columns are counted where no header names them."""
ENDS_COMPARED: Final = 50
"""Lines whose last cells are compared with that of the last line."""
MAX_LAYOUT_BYTES: Final = 65536
MAX_LINE: Final = 1 << 20
"""Bytes of a line that is looked into."""
LINES_ABOVE: Final = 50
"""Lines that the last one is held against where its end is missing."""


@dataclass(frozen=True, kw_only=True)
class CsvLayout:
    """How a text file is laid out.

    Attributes
    ----------
    names : tuple of str
        Column names; without a header the column numbers from "1" on.
    start : int
        Byte at which the first row begins.
    first_line : int
        Line number of the first row, from 1.
    units : tuple of str
        What the line under the header says of each column; empty where there is no such line.
    decimal : str
        The character that the file has in the place of a decimal point.
    """

    names: tuple[str, ...]
    header: bool
    delimiter: str
    start: int
    first_line: int
    units: tuple[str, ...] = ()
    decimal: str = "."


@dataclass(frozen=True, kw_only=True, eq=False)
class CsvNumbers:
    """Columns as they stand in the file; `where` names the line of a row, `left_out` counts cut lines."""

    columns: Mapping[str, FloatArray]
    path: Path
    start: int
    first_line: int
    left_out: int

    def where(self, row: int) -> str:
        """Return "line 17" for a row (from 0); the file is read again to count its blank lines."""
        seen = -1
        with self.path.open("rb") as file:
            file.seek(self.start)
            for offset, line in enumerate(file):
                seen += bool(line.strip(_LINE_END))
                if seen == row:
                    return f"line {self.first_line + offset}"
        return f"row {row + 1}"


def is_text(head: bytes) -> bool:
    """Return whether the beginning of a file is text: UTF-8 without control characters."""
    body = head.rstrip(b"\0")
    if len(body.translate(None, _CONTROL)) < len(body):
        return False
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        # The head may end in the middle of a character.
        return error.start > len(head) - 4
    return True


def find_layout(content: bytes, *, name: str, header: bool = True, delimiter: str = ",") -> CsvLayout:
    """Find the first row of a CSV text, behind comment lines (``#``), blank lines and the header.

    Raises
    ------
    LogError
        When the text holds no line, or is not text.
    """
    at, line_number = 0, 0
    if content.startswith(b"\xef\xbb\xbf"):
        at = 3
    while at < len(content):
        end = content.find(b"\n", at)
        end = len(content) if end < 0 else end + 1
        line_number += 1
        line = content[at:end]
        if line.strip() and not line.lstrip().startswith(b"#"):
            cells = _cells(line, delimiter)
            if header:
                names = tuple(c.strip() for c in cells)
                return CsvLayout(names=names, header=True, delimiter=delimiter, start=end, first_line=line_number + 1)
            # The first line may be cut: most of the first ones say how many columns there are, in doubt a later one.
            lines = [row for row in content[at : at + MAX_LAYOUT_BYTES].split(b"\n") if row.strip()][:LAYOUT_LINES]
            count = statistics.mode(len(_cells(row, delimiter)) for row in reversed(lines))
            names = tuple(str(k + 1) for k in range(count))
            return CsvLayout(names=names, header=False, delimiter=delimiter, start=at, first_line=line_number)
        at = end
    raise LogError(f"{name}: the file holds no line of data; check the export.")


def guess_layout(content: bytes, *, name: str) -> CsvLayout:
    """Find delimiter, header, line of units and first row of a text that follows no contract.

    The header may be a comment (``#timestamp,...``), rows may end with a delimiter, numbers may have decimal commas
    where semicolons or tabs separate the columns. The layout has no header where the first row is of numbers.

    Raises
    ------
    LogError
        When the text holds no line.
    """
    head = content[:MAX_LAYOUT_BYTES]
    plain = find_layout(head, name=name)
    lines = [line for line in head[plain.start :].split(b"\n") if line.strip()][:LAYOUT_LINES]
    titles = _line_before(head, plain.start)
    delimiter = max(DELIMITERS, key=lambda d: _fitness([titles, *lines], d))
    layout = find_layout(head, name=name, delimiter=delimiter)
    if sum(_is_number(cell) for cell in layout.names) > len(layout.names) / 2:
        # The first row is of numbers: a comment above it may name its columns.
        at = head.find(titles)
        bare = find_layout(content, name=name, header=False, delimiter=delimiter)
        above = _line_before(head, at).lstrip(b"#% \t") if at > 0 else b""
        cells = tuple(c.strip() for c in _cells(above, delimiter))
        if len(cells) == len(layout.names) and not any(map(_is_number, cells)):
            bare = replace(bare, names=cells, header=True)
        return replace(bare, decimal=_decimal(lines, delimiter))
    names = tuple(n.lstrip("#%").strip() for n in layout.names)
    rows = [_cells(line, delimiter) for line in lines]
    if rows and all(len(row) == len(names) + 1 and not row[-1] for row in rows[:-1] or rows):
        names = (*names, "")  # every row ends with a delimiter, the header does not
    layout = replace(layout, names=names, decimal=_decimal(lines, delimiter))
    if rows and len(rows[0]) == len(names) and any(rows[0]) and not any(map(_begins_like_number, rows[0])):
        end = content.index(lines[0], layout.start) + len(lines[0]) + 1
        units = tuple(c.strip().strip("()[]") for c in rows[0])
        line = layout.first_line + content.count(b"\n", layout.start, end)
        return replace(layout, units=units, start=min(end, len(content)), first_line=line)
    return layout


def _line_before(text: bytes, at: int) -> bytes:
    """Return the last line that is not blank and ends before a place in a text."""
    return text[:at].rstrip(_LINE_END).rpartition(b"\n")[2]


def _begins_like_number(cell: str) -> bool:
    return cell.strip() in _BLANK - {""} or re.match(r"\s*[-+.]?\d", cell) is not None


def _fitness(lines: Sequence[bytes], delimiter: str) -> float:
    """Return how many columns most lines have with this delimiter, less if the first line has not as many."""
    counts = [len(_cells(line, delimiter)) for line in lines]
    # The last line looked at may be cut.
    common = statistics.mode(counts[:-1] or counts)
    if common == 1 or counts[0] == common:
        return common - 1
    return common - 0.5 if counts[0] > 1 else common / 1000.0


def _decimal(lines: Sequence[bytes], delimiter: str) -> str:
    """Return the decimal sign: a comma where cells such as ``0,5`` are there and none such as ``0.5``."""
    if delimiter == ",":
        return "."
    cells = [cell.strip() for line in lines for cell in _cells(line, delimiter)]
    commas = any(re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell) for cell in cells)
    return "," if commas and not any(re.fullmatch(r"[-+]?\d*\.\d+", cell) for cell in cells) else "."


def read_numbers(
    path: Path,
    content: bytes,
    layout: CsvLayout,
    wanted: Mapping[str, int],
    *,
    time_column: str,
    doubt_end: bool = False,
) -> CsvNumbers:
    """Read columns of a CSV text as float64; an empty cell is NaN.

    Parameters
    ----------
    path : Path
        Where `content` comes from, for errors.
    content : bytes
        The whole file.
    layout : CsvLayout
        See `find_layout`.
    wanted : mapping
        Name in the result to index of the column, from 0.
    time_column : str
        The key of `wanted` whose numbers advance: it shows a last line that was cut within its time stamp.
    doubt_end : bool
        Leave out a last line without line end unless its last number is written like those above it: a program that
        ends its lines was stopped there.

    Raises
    ------
    LogError
        On a line with the wrong number of columns and on text in place of a number.
    """
    start, first_line, left_out = layout.start, layout.first_line, 0
    body = content[start:].rstrip(_LINE_END)
    if layout.decimal != ".":
        # One character for one: every place in the file stays where it was.
        body = body.replace(layout.decimal.encode(), b".")
    ended = content.endswith(b"\n")
    if body.endswith(b"\0"):
        # What a power cut leaves on a memory card: the length of the file was written, its last block was not.
        body = body.rstrip(b"\0")
        body, ended, left_out = body[: body.rfind(b"\n") + 1], True, 1
    first, last = _line(body, first=True), _line(body, first=False)
    # Where a file has a header, that was its first line, and the first row is whole.
    begins_empty = 0 in wanted.values() and first.startswith(layout.delimiter.encode())
    if first and not layout.header and (begins_empty or _is_cut(first, layout, wanted)):
        cut = body.find(b"\n") + 1
        start, body, first_line, left_out = start + cut, body[cut:] if cut else b"", first_line + 1, left_out + 1
    ends_early = not ended and (
        last.endswith(layout.delimiter.encode())
        or _steps_back(body, layout, wanted[time_column])
        or (doubt_end and not _ends_like_others(body, layout.delimiter))
        or (len(layout.names) - 1 in wanted.values() and _lost_digits(body, layout))
    )
    if body and (ends_early or _is_cut(last, layout, wanted)):
        body = body[: body.rfind(b"\n") + 1]
        left_out += 1
    if not body and not ended and not left_out:
        # Of a table that was begun not even the line of its names, or of its units, has an end.
        left_out = 1
    columns = _parse(path, body, layout, wanted, first_line)
    return CsvNumbers(columns=columns, path=path, start=start, first_line=first_line, left_out=left_out)


def _parse(
    path: Path, body: bytes, layout: CsvLayout, wanted: Mapping[str, int], first_line: int
) -> dict[str, FloatArray]:
    """Let pyarrow parse rows; where it fails, find the reason."""
    if not body.strip():
        return {name: np.empty(0) for name in wanted}
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    keys = [f"c{k}" for k in range(len(layout.names))]
    used = sorted({keys[index] for index in wanted.values()})
    try:
        # One thread: Arrow's pool sometimes aborts a short process at its exit (apache/arrow#34314), and an exit code
        # must be right.
        table = arrow_csv.read_csv(
            pa.BufferReader(pa.py_buffer(body)),
            read_options=arrow_csv.ReadOptions(column_names=keys, use_threads=False),
            parse_options=arrow_csv.ParseOptions(delimiter=layout.delimiter),
            convert_options=arrow_csv.ConvertOptions(
                column_types=dict.fromkeys(used, pa.float64()), include_columns=used, null_values=sorted(_BLANK)
            ),
        )
    except pa.ArrowInvalid as error:
        raise LogError(_explain(path.name, body, layout, wanted, first_line, str(error))) from error
    return {name: table.column(keys[index]).to_numpy() for name, index in wanted.items()}


def _explain(name: str, body: bytes, layout: CsvLayout, wanted: Mapping[str, int], first_line: int, reason: str) -> str:
    """Return the sentence for the first line that pyarrow cannot take."""
    for number, line in enumerate(io.BytesIO(body), first_line):
        if not line.strip(_LINE_END):
            continue
        cells = _cells(line, layout.delimiter)
        if len(cells) != len(layout.names):
            return (
                f"{name}, line {number}: the line has {len(cells)} columns where {len(layout.names)} are expected; "
                "repair or remove the line."
            )
        for index in wanted.values():
            if not _is_number(cells[index]):
                column = layout.names[index] if layout.header else f"number {layout.names[index]}"
                return (
                    f"{name}, line {number}: the column {column} holds the text {shown(cells[index])} where a number "
                    "is expected; repair or remove the line."
                )
    return f"{name}: the text cannot be parsed as CSV ({reason}); check the export."


def _is_cut(line: bytes, layout: CsvLayout, wanted: Mapping[str, int]) -> bool:
    """Return whether a line lacks columns, or a wanted cell holds a piece of a number such as ``-`` or ``1.2e``."""
    cells = _cells(line, layout.delimiter)
    if len(cells) < len(layout.names):
        return bool(line.strip())
    if len(cells) > len(layout.names):
        return False
    texts = (cells[index].strip() for index in wanted.values())
    return any(not _is_number(t) and _PIECE_OF_NUMBER.fullmatch(t) for t in texts)


def _steps_back(body: bytes, layout: CsvLayout, index: int) -> bool:
    """Return whether the time stamp of the last line is before that of the line above: its end was cut off."""
    above, _, last = body.rpartition(b"\n")
    texts = [_cells(line, layout.delimiter) for line in (_line(above, first=False), last)]
    if any(len(cells) != len(layout.names) or _NUMBER.fullmatch(cells[index]) is None for cells in texts):
        return False
    return float(texts[1][index]) <= float(texts[0][index])


def _ends_like_others(body: bytes, delimiter: str) -> bool:
    """Return whether the last number of the last lines always has as many decimals, or digits where it has none."""
    cells = [line.strip(_LINE_END).rpartition(delimiter.encode())[2] for line in body[-MAX_LAYOUT_BYTES:].split(b"\n")]
    written = [(len(c.rpartition(b".")[2]), True) if b"." in c else (len(c), False) for c in cells if c]
    # The first of these lines may be a piece.
    return len(set(written[1:][-ENDS_COMPARED:])) <= 1


def _lost_digits(body: bytes, layout: CsvLayout) -> bool:
    """Return whether the last number has fewer decimals than those above it: 9.8 under numbers like 9.81 was cut."""
    lines = [line for line in body[-MAX_LAYOUT_BYTES:].split(b"\n")[-LINES_ABOVE - 1 :] if line.strip(_LINE_END)]
    rows = [cells for cells in (_cells(line, layout.delimiter) for line in lines) if len(cells) == len(layout.names)]
    decimals = [len(row[-1].strip().partition(".")[2]) for row in rows if row[-1].strip()]
    return len(decimals) > 1 and decimals[-1] < min(decimals[:-1])


def _line(body: bytes, *, first: bool) -> bytes:
    """Return the first or the last line that is not blank."""
    # Searched and sliced, so that a long text is not copied.
    if first:
        begin = next((m.start() for m in _NOT_LINE_END.finditer(body)), 0)
        end = body.find(b"\n", begin)
        return body[begin:] if end < 0 else body[begin:end].rstrip(_LINE_END)
    end = len(body)
    while end and body[end - 1] in _LINE_END:
        end -= 1
    return body[body.rfind(b"\n", 0, end) + 1 : end]


def _cells(line: bytes, delimiter: str) -> Sequence[str]:
    if len(line) > MAX_LINE:
        # No row of a log, whatever it is; as one cell it is refused with a sentence.
        return [line[:MAX_LAYOUT_BYTES].decode("utf-8", errors="replace")]
    text = line.decode("utf-8", errors="replace").strip("\r\n")
    try:
        return next(csv.reader([text], delimiter=delimiter), [])
    except csv.Error:
        # A cell of more than 128 KiB: no number, whatever it is; as one cell it is refused with a sentence.
        return [text]


def _is_number(text: str) -> bool:
    return text.strip() in _BLANK or _NUMBER.fullmatch(text) is not None
