"""NMEA: what the sentences say and no more; dates, midnight, velocities without a time, damage."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from pynmeagps import NMEAReader

from hostile import cases
from levelhead.errors import LevelheadError, LogError
from levelhead.logs.pieces import GnssData, Pieces
from levelhead.logs.readers import nmea_sentences, read
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.nmea import READER
from levelhead.logs.readers.ublox_ubx import READER as UBX
from samples import nmea
from samples.drive import EPOCH_UTC_S, sample_drive
from samples.nmea import gga, gst, rmc, sentence, vtg

LLH = np.array([0.84, -0.16, 300.0])
EAST = np.array([0.0, 5.0, 0.0])


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return nmea.write(tmp_path_factory.mktemp("nmea"))


def pieces_of(folder: Path, text: str | bytes) -> Pieces:
    path = folder / "a.nmea"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return READER.read(Source(path=path, role="gnss"))


def gnss_of(folder: Path, text: str | bytes) -> GnssData:
    gnss = pieces_of(folder, text).gnss
    assert gnss is not None
    return gnss


def test_the_drive_comes_back_beside_its_imu_file(sample: Path) -> None:
    drive, log = sample_drive(), read(sample)
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    assert log.meta["gnss_format"] == "nmea"
    assert log.meta["completeness"] == "complete"
    assert log.meta["height"] == "ellipsoidal"
    assert "undeclared" not in log.meta
    assert log.velocity_ned is not None
    assert log.velocity_std is not None
    assert log.position_llh is not None
    # Two digits of the second hold 5 Hz exactly; float64 at 1.75e9 s resolves 2.4e-7 s.
    np.testing.assert_allclose(log.gnss_time, drive.gnss_time, rtol=0, atol=1e-6)
    # Half of 0.001 kn, and half of 0.01 deg of up to 10 m/s; the vertical velocity is not told.
    np.testing.assert_allclose(log.velocity_ned[:, :2], drive.velocity_ned[:, :2], rtol=0, atol=2.6e-4 + 9e-4)
    np.testing.assert_array_equal(log.velocity_ned[:, 2], 0.0)
    assert np.isnan(log.velocity_std[:, :2]).all()
    assert (log.velocity_std[:, 2] >= 0.5).all()
    # Half of 1e-7 min; altitude and separation each to half a millimetre.
    np.testing.assert_allclose(log.position_llh[:, :2], drive.position_llh[:, :2], rtol=0, atol=np.radians(1e-9))
    np.testing.assert_allclose(log.position_llh[:, 2], drive.position_llh[:, 2], rtol=0, atol=1.01e-3)
    np.testing.assert_array_equal(log.position_std, np.tile([0.01, 0.02, 0.03], (log.gnss_time.size, 1)))
    assert [(e.code, e.count) for e in log.events if e.code == "I_VELOCITY_2D"] == [("I_VELOCITY_2D", 150)]


def test_numbers_are_those_of_pynmeagps(sample: Path) -> None:
    path = sample.parent / "drive.gps.nmea"
    with path.open("rb") as file:
        theirs = [m for _, m in NMEAReader(file)]
    found = nmea_sentences.scan(path)
    assert found.sentences == len(theirs)
    places, speeds = found.of(b"GGA"), found.of(b"RMC")
    expected = [m for m in theirs if m.msgID == "GGA"]
    # pynmeagps rounds degrees to 1e-10.
    np.testing.assert_allclose(np.degrees(places[:, 2]), [m.lat for m in expected], rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.degrees(places[:, 3]), [m.lon for m in expected], rtol=0, atol=1e-10)
    np.testing.assert_array_equal(places[:, 4:], [[m.alt, m.sep, m.quality] for m in expected])
    expected = [m for m in theirs if m.msgID == "RMC"]
    np.testing.assert_allclose(speeds[:, 4] * 3600 / 1852, [m.spd for m in expected], rtol=1e-14)
    np.testing.assert_allclose(np.degrees(speeds[:, 5]), [m.cog for m in expected], rtol=1e-14)


def test_a_recorded_receiver_says_the_same_in_nmea_and_in_ubx(data_folder: Path, tmp_path: Path) -> None:
    ubx = data_folder / "formats" / "walk_0827.ubx"
    text = b"".join(re.findall(rb"\$[\x20-\x7e]+\r\n", ubx.read_bytes()))
    pieces = pieces_of(tmp_path, text)
    ours, theirs = pieces.gnss, UBX.read(Source(path=ubx, role="gnss")).gnss
    assert ours is not None
    assert theirs is not None
    assert ours.position_llh is not None
    assert ours.velocity_ned is not None
    assert theirs.velocity_ned is not None
    # UTC is 18 s behind GPS time; the sentences have hundredths of a second, the epochs lie half a millisecond beside.
    np.testing.assert_allclose(ours.time + 18.0, theirs.time, rtol=0, atol=5e-4)
    # 1e-7 deg in UBX, 1 mm in both heights.
    np.testing.assert_allclose(ours.position_llh[:, :2], theirs.position_llh[:, :2], rtol=0, atol=1e-9)  # type: ignore[index]
    np.testing.assert_allclose(ours.position_llh[:, 2], theirs.position_llh[:, 2], rtol=0, atol=1.01e-3)  # type: ignore[index]
    # Where the receiver tells a course: 0.001 kn, 1 mm/s, and 0.01 deg of up to 2 m/s.
    told = np.hypot(*theirs.velocity_ned[:, :2].T) > 0.5
    difference = ours.velocity_ned[told, :2] - theirs.velocity_ned[told, :2]
    assert told.sum() > 100
    assert np.abs(difference).max() < 2e-3
    # One line begins twice: "$$GNTXT".
    assert pieces.damaged.startswith(
        "a.nmea: 1 lines are no NMEA sentences with the right checksum and fields; the first"
    )


def test_epochs_without_a_fix_are_left_out_and_counted(tmp_path: Path) -> None:
    t = EPOCH_UTC_S
    text = (
        gga(t, LLH, quality=0) + rmc(t + 1, LLH, EAST, status="V") + gga(t + 2, LLH, quality=6)
        + gga(t + 3, LLH) + rmc(t + 3, LLH, EAST, status="V") + gga(t + 4, LLH, quality=1) + rmc(t + 4, LLH, EAST)
    )  # fmt: skip
    pieces = pieces_of(tmp_path, text)
    assert pieces.gnss is not None
    np.testing.assert_array_equal(pieces.gnss.time, [t + 4])
    assert [(e.code, e.count) for e in pieces.events] == [("W_DROPPED", 4), ("I_VELOCITY_2D", 1)]
    with pytest.raises(LogError, match=r"a\.nmea: none of 1 epochs has a GNSS fix\."):
        pieces_of(tmp_path, gga(t, LLH, quality=0))


def test_the_date_of_rmc_carries_over_midnight(tmp_path: Path) -> None:
    midnight = 20_266 * 86400.0
    text = "".join(gga(midnight + dt, LLH) for dt in (-0.4, -0.2, 0.0, 0.2)) + rmc(midnight + 0.2, LLH, EAST)
    np.testing.assert_allclose(gnss_of(tmp_path, text).time - midnight, [-0.4, -0.2, 0.0, 0.2], rtol=0, atol=1e-6)
    zda = sentence("GPZDA,235959.80,26,06,2025,00,00")
    undated = "".join(gga(midnight + dt, LLH) for dt in (-0.4, -0.2, 0.0, 0.2))
    np.testing.assert_allclose(
        gnss_of(tmp_path, zda + undated).time - midnight, [-0.4, -0.2, 0.0, 0.2], rtol=0, atol=1e-6
    )


def test_a_receiver_that_knows_no_date_yet_is_no_damage(tmp_path: Path) -> None:
    empty = sentence("GPRMC,000003.00,V,,,,,,,000000,,,N")
    pieces = pieces_of(tmp_path, empty + rmc(EPOCH_UTC_S, LLH, EAST))
    assert pieces.damaged == ""
    assert pieces.gnss is not None
    np.testing.assert_array_equal(pieces.gnss.time, [EPOCH_UTC_S])


def test_a_second_copy_of_a_drive_is_counted_and_not_used(tmp_path: Path) -> None:
    text = "".join(rmc(EPOCH_UTC_S + k, LLH, EAST) for k in range(5))
    pieces = pieces_of(tmp_path, text + text)
    assert pieces.gnss is not None
    assert pieces.gnss.time.size == 5
    assert pieces.events[0].detail == "5 sentences that repeat the time of others of their kind."


def test_gga_alone_has_no_date_and_says_so(tmp_path: Path) -> None:
    midnight = 20_266 * 86400.0
    pieces = pieces_of(tmp_path, "".join(gga(midnight + dt, LLH) for dt in (-0.2, 0.0, 0.2)))
    assert pieces.gnss is not None
    np.testing.assert_allclose(pieces.gnss.time, [86399.8, 86400.0, 86400.2], rtol=0, atol=1e-9)
    assert pieces.gnss.time_scale is None
    assert pieces.gnss.velocity_ned is None
    assert pieces.undeclared == ("clock",)


@pytest.mark.parametrize("before", ["{:.2f} ", "{:.0f}000,", "2025-06-27T07:47:23.1 ", "[2025-06-27 00:30:00] "])
def test_a_clock_before_the_sentence_tells_the_date_where_none_does(tmp_path: Path, before: str) -> None:
    # The computer runs on its own time zone, up to half a day beside UTC; the drive was at 05:47 UTC.
    text = "".join(before.format(EPOCH_UTC_S) + gga(EPOCH_UTC_S + k, LLH) for k in range(3))
    gnss = gnss_of(tmp_path, text)
    np.testing.assert_array_equal(gnss.time, EPOCH_UTC_S + np.arange(3))
    assert gnss.time_scale == "UTC"
    # A date of the receiver's own is the better one.
    wrong = "1234567890.0 " + rmc(EPOCH_UTC_S, LLH, EAST)
    np.testing.assert_array_equal(gnss_of(tmp_path, wrong).time, [EPOCH_UTC_S])


def driven(*, vtg_first: bool, moving: bool) -> str:
    """Return GGA and VTG of a drive of 40 s at 5 Hz that speeds up and slows down, or stands."""
    text, east = "", 0.0
    for k in range(200):
        t = 0.2 * k
        speed = 8.0 - 4.0 * np.cos(0.5 * t) if moving else 0.0
        east = 8.0 * t - 8.0 * np.sin(0.5 * t) if moving else 0.0
        llh = np.array([0.0, east / 6378137.0, 300.0])
        pair = [gga(EPOCH_UTC_S + t, llh), vtg(np.array([0.0, speed, 0.0]))]
        text += "".join(reversed(pair) if vtg_first else pair)
    return text + sentence("GPZDA,054723.00,27,06,2025,00,00")


@pytest.mark.parametrize("vtg_first", [False, True])
def test_velocities_without_a_time_go_to_the_epoch_that_the_positions_prove(tmp_path: Path, vtg_first: bool) -> None:
    pieces = pieces_of(tmp_path, driven(vtg_first=vtg_first, moving=True))
    assert pieces.gnss is not None
    assert pieces.gnss.velocity_ned is not None
    t = pieces.gnss.time - EPOCH_UTC_S
    # Half of 0.001 kn; an epoch late it would be up to 0.4 m/s off.
    np.testing.assert_allclose(pieces.gnss.velocity_ned[:, 1], 8.0 - 4.0 * np.cos(0.5 * t), rtol=0, atol=3e-4)
    assert pieces.undeclared == ()


def test_where_the_positions_do_not_tell_the_clock_is_undeclared(tmp_path: Path) -> None:
    assert pieces_of(tmp_path, driven(vtg_first=False, moving=False)).undeclared == ("clock",)


def test_a_velocity_between_two_sentences_of_one_time_is_sure(tmp_path: Path) -> None:
    t = EPOCH_UTC_S
    zda = sentence("GPZDA,054723.00,27,06,2025,00,00")
    pieces = pieces_of(tmp_path, zda + gga(t, LLH) + vtg(EAST) + gst(t) + gga(t + 1, LLH) + vtg(2 * EAST) + gst(t + 1))
    assert pieces.gnss is not None
    assert pieces.gnss.velocity_ned is not None
    np.testing.assert_allclose(pieces.gnss.velocity_ned[:, 1], [5.0, 10.0], rtol=0, atol=3e-4)
    assert pieces.undeclared == ()


def test_a_slow_receiver_without_a_course_stands_still_within_its_speed(tmp_path: Path) -> None:
    def slow(k: int, knots: str) -> str:
        return sentence(f"GNRMC,05472{k}.00,A,4805.0,N,00905.0,E,{knots},,270625,,,A")

    gnss = gnss_of(tmp_path, slow(3, "0.2") + slow(4, "5.0") + slow(5, "") + rmc(EPOCH_UTC_S + 3, LLH, EAST))
    assert gnss.velocity_ned is not None
    assert gnss.velocity_std is not None
    np.testing.assert_array_equal(gnss.velocity_ned[0], [0.0, 0.0, 0.0])
    np.testing.assert_allclose(gnss.velocity_std[0], [0.2 * nmea.KNOT, 0.2 * nmea.KNOT, 0.5])
    assert np.isnan(gnss.velocity_ned[1:3]).all()
    # RMC alone has no altitude, and half a position is none.
    assert gnss.position_llh is None


def test_heights_count_from_the_sea_where_its_height_is_not_told(tmp_path: Path) -> None:
    bare = sentence("GPGGA,054723.00,4805.0,N,00905.0,E,1,08,1.0,250.5,M,,M,,")
    pieces = pieces_of(tmp_path, bare + rmc(EPOCH_UTC_S, LLH, EAST))
    assert pieces.gnss is not None
    assert pieces.gnss.position_llh is not None
    assert pieces.gnss.position_llh[0, 2] == 250.5
    assert pieces.meta == {"height": "mean sea level"}


def test_a_datum_that_dtm_declares_is_checked(tmp_path: Path) -> None:
    text = gga(EPOCH_UTC_S, LLH)
    assert pieces_of(tmp_path, sentence("GPDTM,W84,,0.0,N,0.0,E,0.0,W84") + text).meta["datum"] == "WGS84"
    with pytest.raises(LogError, match=r"a\.nmea: the datum '999' is not known to lie within a metre of WGS84"):
        pieces_of(tmp_path, sentence("GPDTM,999,CH95,0.08,N,0.07,E,-47.7,W84") + text)


def test_bad_lines_are_counted_and_named(tmp_path: Path) -> None:
    good = rmc(EPOCH_UTC_S, LLH, EAST)
    bad = gga(EPOCH_UTC_S, LLH).replace("*", "*0")
    no_time = sentence("GPGGA,99xx00.00,4805.0,N,00905.0,E,1,08,1.0,250.5,M,47.0,M,,")
    text = good + bad + no_time + "the engine was started\r\n" + "# a comment\r\n\r\n!AIVDM,1\r\n"
    text += rmc(EPOCH_UTC_S + 1, LLH, EAST)[:-2]
    pieces = pieces_of(tmp_path, text)
    assert pieces.damaged == (
        "a.nmea: 2 lines are no NMEA sentences with the right checksum and fields; the first is line 2."
    )
    assert pieces.left_out == 0
    assert [(e.code, e.count) for e in pieces.events] == [("W_DROPPED", 1), ("I_VELOCITY_2D", 2)]


def test_a_cut_first_and_last_line_are_left_out(tmp_path: Path) -> None:
    text = gga(EPOCH_UTC_S, LLH)[20:] + rmc(EPOCH_UTC_S, LLH, EAST) + gga(EPOCH_UTC_S, LLH)[:-8]
    pieces = pieces_of(tmp_path, text)
    assert (pieces.left_out, pieces.damaged) == (2, "")


def test_a_long_file_is_read_in_parts(sample: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = sample.parent / "drive.gps.nmea"
    once = nmea_sentences.scan(path)
    monkeypatch.setattr(nmea_sentences, "_CHUNK", 1000)
    parts = nmea_sentences.scan(path)
    for kind in (b"GGA", b"RMC", b"GST"):
        np.testing.assert_array_equal(parts.of(kind), once.of(kind))
    assert (parts.sentences, parts.damaged, parts.odd, parts.left_out) == (450, 0, 0, 0)


def test_a_cut_file_is_marked_or_refused(sample: Path, tmp_path: Path) -> None:
    content = (sample.parent / "drive.gps.nmea").read_bytes()
    # The format has no end mark: a file cut behind a checksum, or a line end, is whole for all that can be told.
    ends = list(itertools.accumulate(len(line) for line in content.splitlines(keepends=True)))
    whole = {end - k for end in ends for k in (0, 1, 2)}
    for length in cases.cuts(content, 100):
        path = tmp_path / "cut.nmea"
        path.write_bytes(content[:length])
        try:
            log = read(sample, gnss=path)
        except LevelheadError:
            continue
        assert log.meta["completeness"] == "truncated" or length in whole, length


def test_damage_is_marked_or_refused(sample: Path, tmp_path: Path) -> None:
    content = (sample.parent / "drive.gps.nmea").read_bytes()
    clean = read(sample)
    for k, hurt in enumerate(cases.mutations(content)):
        path = tmp_path / "hurt.nmea"
        path.write_bytes(hurt)
        try:
            log = read(sample, gnss=path)
        except LevelheadError:
            continue
        same = all(
            np.array_equal(getattr(log, name), getattr(clean, name), equal_nan=True)
            for name in ("gnss_time", "velocity_ned", "position_llh", "position_std")
        )
        # A line that has lost all that makes a sentence is counted as one that is none.
        odd = any(e.code == "W_DROPPED" for e in log.events)
        assert log.meta["completeness"] != "complete" or odd or same, k


def test_nonsense_with_the_right_checksum_is_marked_or_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    words = (
        "",
        "A",
        "N",
        "1",
        "9" * 30,
        "-5",
        "1e308",
        "nan",
        "235959.99",
        "4812.5",
        "0000",
        "270625",
        "W",
        "27069999999",
    )
    for _ in range(200):
        text = vtg(EAST)
        for kind in rng.choice(["GGA", "RMC", "VTG", "GST", "ZDA", "DTM"], 5):
            text += sentence(f"GP{kind}," + ",".join(rng.choice(words, int(rng.integers(16)))))
        try:
            gnss = gnss_of(tmp_path, text)
        except LevelheadError:
            continue
        assert np.isfinite(gnss.time).all()


@pytest.mark.parametrize(
    "head", [b"time,gps\n1,$GPGGA\n" * 9, b"$GPGGA,1,2*00\r\n", b"$GPGSV,1*77\r\n", b"\xd3\0" * 999, b"$,*\n" * 999]
)
def test_what_only_looks_like_it_is_left_to_others(head: bytes) -> None:
    assert not READER.sniff(Path(), head)
