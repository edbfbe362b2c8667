"""RTKLIB's .pos: the header decides, up is not down, calendar and GPS week agree."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.logs.pieces import GnssData, Pieces
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.rtklib_pos import READER

Writer = Callable[[str, str], Path]

PROGRAM = "% program   : RTKLIB ver.2.4.3\n% obs start : 2025/07/08 19:34:18.0 GPST (week2374 243258.0s)\n"
NAMES = (
    "%  GPST            latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) "
    "age(s) ratio vn(m/s) ve(m/s) vu(m/s) sdvn sdve sdvu sdvne sdveu sdvun\n"
)
LINE = "{time} 45.0 -90.0 160.5 1 21 0.01 0.02 0.03 0.0 0.0 0.0 0.0 0.0 1.0 2.0 3.0 0.1 0.2 0.3 0.0 0.0 0.0\n"
TWO = LINE.format(time="2025/07/08 19:34:18.500") + LINE.format(time="2025/07/08 19:34:18.750")
START = 20277 * 86400 + 19 * 3600 + 34 * 60 + 18.5
"""2025-07-08 is day 20277 from 1970-01-01."""


def pieces_of(path: Path) -> Pieces:
    return READER.read(Source(path=path, role="gnss"))


def gnss_of(path: Path) -> GnssData:
    gnss = pieces_of(path).gnss
    assert gnss is not None
    return gnss


def test_the_columns_are_found_by_their_names_and_down_is_minus_up(put: Writer) -> None:
    gnss = gnss_of(put("a.pos", PROGRAM + NAMES + TWO))
    np.testing.assert_array_equal(gnss.time, [START, START + 0.25])
    assert gnss.velocity_ned is not None
    assert gnss.velocity_std is not None
    assert gnss.position_llh is not None
    assert gnss.position_std is not None
    np.testing.assert_array_equal(gnss.velocity_ned[0], [1.0, 2.0, -3.0])
    np.testing.assert_array_equal(gnss.velocity_std[0], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(gnss.position_llh[0], [np.pi / 4.0, -np.pi / 2.0, 160.5])
    np.testing.assert_array_equal(gnss.position_std[0], [0.01, 0.02, 0.03])


@pytest.mark.parametrize("scale", ["GPST", "UTC"])
def test_the_time_scale_of_the_header_is_kept(put: Writer, scale: str) -> None:
    assert pieces_of(put("a.pos", NAMES.replace("GPST", scale) + TWO)).meta == {"gnss_time_scale": scale}


def test_gps_week_and_second_mean_the_same_instant(put: Writer) -> None:
    # 2025-07-08 is the Tuesday of GPS week 2374: 2 days and 19:34:18.5 after its Sunday.
    tow = 2 * 86400 + 19 * 3600 + 34 * 60 + 18.5
    np.testing.assert_array_equal(gnss_of(put("a.pos", NAMES + LINE.format(time=f"2374 {tow:.3f}"))).time, [START])


def test_commas_may_separate_the_columns(put: Writer) -> None:
    text = re.sub(r" +", ",", TWO).replace("08,19", "08 19")
    np.testing.assert_array_equal(gnss_of(put("a.pos", NAMES + text)).time, [START, START + 0.25])


def test_a_file_of_positions_has_no_velocity(put: Writer) -> None:
    names = "%  GPST  latitude(deg) longitude(deg) height(m) Q ns\n"
    gnss = gnss_of(put("a.pos", names + "2025/07/08 19:34:18.500 45.0 -90.0 160.5 1 21\n"))
    assert gnss.velocity_ned is None
    assert gnss.velocity_std is None
    assert gnss.position_std is None
    assert gnss.position_llh is not None


def test_a_deviation_of_zero_is_an_unknown_one(put: Writer) -> None:
    gnss = gnss_of(put("a.pos", NAMES + TWO.replace("0.1 0.2 0.3", "0.0 0.0 0.0")))
    assert gnss.velocity_std is None
    gnss = gnss_of(put("a.pos", NAMES + TWO.replace("0.01 0.02 0.03", "0.01 0.02 0.0")))
    assert gnss.position_std is not None
    np.testing.assert_array_equal(gnss.position_std[0], [0.01, 0.02, np.nan])


@pytest.mark.parametrize("cut", [2, 30, 60, len(TWO) // 2 - 1])
def test_a_cut_last_line_is_left_out_and_counted(put: Writer, cut: int) -> None:
    pieces = pieces_of(put("a.pos", NAMES + TWO[:-cut]))
    assert pieces.gnss is not None
    np.testing.assert_array_equal(pieces.gnss.time, [START])
    assert pieces.left_out == 1
    assert pieces_of(put("a.pos", NAMES + TWO)).left_out == 0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (TWO, "a.pos: no header line names the columns"),
        (NAMES, "a.pos: the file has a header but no solution; check RTKLIB's processing."),
        (
            NAMES.replace("latitude(deg)", "x-ecef(m)") + TWO,
            "not latitude, longitude and height in degrees (the columns",
        ),
        (
            NAMES.replace("latitude(deg)", "latitude(d'\")") + TWO,
            "set RTKLIB's out-solformat = llh and out-degform = deg",
        ),
        (NAMES + TWO.replace("1 21 0.01", "1 0.01", 1), "a.pos, line 2: the line has 23 columns where 24 are expected"),
        (NAMES + TWO.replace("45.0", "4x.0", 1), "a.pos, line 2: the column latitude holds '4x.0' where a number"),
        (NAMES + TWO.replace("2.0 3.0", "nan 3.0", 1), "a.pos, line 2: the column ve holds 'nan' where a number"),
        (NAMES + TWO.replace("19:34:18.750", "19:34:78.750"), "a.pos, line 3: '2025/07/08 19:34:78.750' is not a time"),
    ],
)
def test_a_mistake_is_named_with_its_line(put: Writer, text: str, sentence: str) -> None:
    with pytest.raises(LogError, match=re.escape(sentence)):
        pieces_of(put("a.pos", text))


def test_only_the_header_of_rtklib_is_taken_for_one() -> None:
    assert READER.sniff(Path(), (PROGRAM + NAMES + TWO).encode())
    assert READER.sniff(Path(), (NAMES + TWO).encode())
    assert not READER.sniff(Path(), b"% a comment of LaTeX\n")
    assert not READER.sniff(Path(), TWO.encode())
