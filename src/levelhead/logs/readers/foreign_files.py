"""Files that are no log as they are but may hold one: what they are, and what to do."""

from __future__ import annotations

from typing import Final

from levelhead.logs.readers.csv_table import is_text

_LOOKED_AT: Final = 1000
_UTF_16: Final = "UTF-16 text; save it as UTF-8 (in a spreadsheet: CSV UTF-8)"
_FOREIGN: Final = (
    (b"\xff\xfe", _UTF_16),
    (b"\xfe\xff", _UTF_16),
    (b"\x1f\x8b", "compressed by gzip; unpack it first (gunzip)"),
    (b"BZh", "compressed by bzip2; unpack it first (bunzip2)"),
    (b"\xfd7zXZ\0", "compressed by xz; unpack it first (unxz)"),
    (b"\x28\xb5\x2f\xfd", "compressed by Zstandard; unpack it first (unzstd)"),
    (b"\x04\x22\x4d\x18", "compressed by LZ4; unpack it first (unlz4)"),
    (b"PK\x03\x04", "a zip archive (or a spreadsheet); unpack it first, or export it as CSV"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive; unpack it first"),
    (b"\xd0\xcf\x11\xe0", "a document of an old office program; export it as CSV"),
)
"""Their beginnings."""


def what_it_is(head: bytes) -> str:
    """Return what a file that begins so is and what to do, as the end of a sentence; nothing where it is not known."""
    for begin, what in _FOREIGN:
        if head.startswith(begin):
            return what
    begin = head[:_LOOKED_AT]
    if begin.count(0) > len(begin) // 3 and is_text(head.replace(b"\0", b"")):
        return _UTF_16
    if is_text(head) and b"\n" not in head and head.count(b"\r") > 1:
        return "a text whose lines end with carriage returns alone (old Mac); convert them to line feeds"
    return ""
