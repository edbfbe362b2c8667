"""Tracks as other programs read them: KML by an XML parser, GeoJSON by its own rules, .pos by our reader."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from levelhead.conventions import FloatArray
from levelhead.errors import LogError, OutputError, UsageError
from levelhead.logs.log import Log
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.rtklib_pos import READER
from levelhead.logs.timescales import GPS_EPOCH_S
from levelhead.logs.tracks import TRACK_WRITERS, Track, thinned, track_of_log, write_track

KML = "{http://www.opengis.net/kml/2.2}"
HOSTILE = 'a<b>&"\'</name>]]>\x00\n% UTC latitude(deg)\r\udcff{"ü"}.csv'
SUFFIXES = pytest.mark.parametrize("suffix", sorted(TRACK_WRITERS))

NINTH_DIGIT = np.radians(0.5e-9) * 1.001
"""Half of the last digit of a degree, and the rounding of degrees to radians and back."""


def track_of(llh_deg: list[list[float]], **settings: Any) -> Track:
    """A track of one position per second: latitude and longitude (deg), height (m)."""
    llh = np.array(llh_deg)
    llh[:, :2] = np.radians(llh[:, :2])
    return Track(
        **{"name": "drive", "point": "IMU", "time": np.arange(float(len(llh))), "position_llh": llh, **settings}
    )


def coasting_track(name: str = "drive") -> Track:
    """Six positions northwards, the third and the fourth without GNSS."""
    places = [[50.0 + 0.001 * k, 8.0, 100.0 + k] for k in range(6)]
    return track_of(places, name=name, coasting=np.array([False, False, True, True, False, False]))


def geojson(track: Track) -> Any:
    return json.loads(TRACK_WRITERS[".geojson"](track))


def kml(track: Track) -> ElementTree.Element:
    return ElementTree.fromstring(TRACK_WRITERS[".kml"](track).encode())


def kml_lines(track: Track) -> list[tuple[str, FloatArray]]:
    """Return the style and the coordinates of every line."""
    lines = []
    for placemark in kml(track).iter(f"{KML}Placemark"):
        style = placemark.findtext(f"{KML}styleUrl")
        for line in placemark.iter(f"{KML}LineString"):
            assert line.findtext(f"{KML}altitudeMode") == "absolute"
            text = line.findtext(f"{KML}coordinates")
            assert style is not None
            assert text is not None
            lines.append((style, np.array([place.split(",") for place in text.split()], dtype=float)))
    return lines


def read_pos(track: Track, folder: Path) -> Track:
    """Write a track as .pos and read it with the reader of this package."""
    write_track(track, folder / "a.pos")
    pieces = READER.read(Source(path=folder / "a.pos", role="gnss"))
    assert pieces.left_out == 0
    gnss = pieces.gnss
    assert gnss is not None
    assert gnss.position_llh is not None
    return replace(
        track,
        time=gnss.time - gnss.time[0],
        position_llh=gnss.position_llh,
        position_std=gnss.position_std,
        velocity_ned=gnss.velocity_ned,
        velocity_std=gnss.velocity_std,
        meta={**pieces.meta, "epoch": float(gnss.time[0])},
    )


def test_a_log_gives_the_track_of_its_antenna(drive: Log) -> None:
    assert drive.position_llh is not None
    assert drive.position_std is not None
    llh = drive.position_llh.copy()
    llh[3] = np.nan
    track = track_of_log(replace(drive, position_llh=llh, meta={"source": "a.csv"}))
    assert (track.name, track.point, track.time.size) == ("a.csv", "GNSS antenna", 19)
    np.testing.assert_array_equal(track.time, np.delete(drive.gnss_time, 3))
    assert track.position_std is not None
    np.testing.assert_array_equal(track.position_std[:, 2], np.delete(drive.position_std, 3))


def test_a_log_without_positions_and_a_single_position_are_sentences(drive: Log) -> None:
    with pytest.raises(LogError, match="log has no GNSS positions, so that there is no track to write; record posit"):
        track_of_log(replace(drive, position_llh=None, position_std=None))
    assert drive.position_llh is not None
    llh = np.full((20, 3), np.nan)
    llh[3] = drive.position_llh[3]
    with pytest.raises(LogError, match="log has 1 positions; a track needs two at least"):
        track_of_log(replace(drive, position_llh=llh))


def test_geojson_is_a_collection_of_lines_as_rfc_7946_asks() -> None:
    document = geojson(coasting_track())
    assert set(document) == {"type", "features"}
    assert document["type"] == "FeatureCollection"
    spans = []
    for feature in document["features"]:
        assert set(feature) == {"type", "properties", "geometry"}
        assert feature["type"] == "Feature"
        assert feature["geometry"]["type"] == "LineString"
        assert len(feature["geometry"]["coordinates"]) >= 2
        about = feature["properties"]
        spans.append((about["aided"], about["start_s"], about["end_s"], len(feature["geometry"]["coordinates"])))
    # Each line goes on to the first position of the next: no holes.
    assert spans == [(True, 0.0, 2.0, 3), (False, 2.0, 4.0, 3), (True, 4.0, 5.0, 2)]
    # Longitude first.
    assert document["features"][0]["geometry"]["coordinates"][1] == [8.0, 50.001, 101.0]


def test_a_last_position_of_another_kind_ends_the_line_before_it() -> None:
    track = replace(coasting_track(), coasting=np.array([False] * 5 + [True]))
    (feature,) = geojson(track)["features"]
    assert len(feature["geometry"]["coordinates"]) == 6


def test_kml_shows_stretches_without_gnss_in_their_own_style() -> None:
    document = kml(coasting_track())
    assert document.tag == f"{KML}kml"
    assert len(document) == 1
    assert {style.get("id") for style in document.iter(f"{KML}Style")} == {"aided", "coasting"}
    lines = kml_lines(coasting_track())
    assert [(style, len(places)) for style, places in lines] == [("#aided", 3), ("#coasting", 3), ("#aided", 2)]
    np.testing.assert_array_equal(lines[0][1][1], [8.0, 50.001, 101.0])


def test_a_path_over_the_antimeridian_is_cut_there() -> None:
    # The example of RFC 7946, 3.1.9, with heights.
    track = track_of([[45.0, 170.0, 0.0], [45.0, -170.0, 10.0]])
    (feature,) = geojson(track)["features"]
    assert feature["geometry"] == {
        "type": "MultiLineString",
        "coordinates": [[[170.0, 45.0, 0.0], [180.0, 45.0, 5.0]], [[-180.0, 45.0, 5.0], [-170.0, 45.0, 10.0]]],
    }
    assert [len(places) for _, places in kml_lines(track)] == [2, 2]


@given(st.lists(st.tuples(st.floats(-360.0, 360.0), st.floats(-90.0, 90.0)), min_size=2, max_size=6))
def test_whatever_the_longitudes_no_line_goes_round_the_world(places: list[tuple[float, float]]) -> None:
    track = track_of([[lat, lon, 0.0] for lon, lat in places])
    for feature in geojson(track)["features"]:
        shape = feature["geometry"]
        lines = shape["coordinates"] if shape["type"] == "MultiLineString" else [shape["coordinates"]]
        for line in lines:
            longitude, latitude, _ = np.array(line).T
            assert len(line) >= 2
            assert np.abs(longitude).max() <= 180.0
            assert np.abs(latitude).max() <= 90.0
            assert np.abs(np.diff(longitude)).max() <= 180.0 + 1e-9  # the last digit
        for one, other in itertools.pairwise(lines):
            assert one[-1][0] == -other[0][0]
            assert one[-1][1:] == other[0][1:]


def test_a_pos_file_is_read_again_to_the_last_printed_digit(drive: Log, tmp_path: Path) -> None:
    meta = {"epoch": 1752003261.871, "gnss_time_scale": "UTC", "height": "mean sea level", "datum": "ETRS89"}
    track = track_of_log(replace(drive, meta=meta))
    back = read_pos(track, tmp_path)
    assert {key: back.meta[key] for key in meta if key != "epoch"} == {k: v for k, v in meta.items() if k != "epoch"}
    # A double of 1.75e9 s resolves 2.4e-7 s; the file has microseconds.
    assert back.epoch == pytest.approx(1752003261.871, abs=1e-6)
    np.testing.assert_allclose(back.time, track.time, rtol=0.0, atol=2e-6)
    np.testing.assert_allclose(back.position_llh[:, :2], track.position_llh[:, :2], rtol=0.0, atol=NINTH_DIGIT)
    # Half of the last printed digit, and the rounding of a double.
    np.testing.assert_allclose(back.position_llh[:, 2], track.position_llh[:, 2], rtol=0.0, atol=0.5001e-4)
    for ours, theirs, digit in (
        (track.position_std, back.position_std, 1e-4),
        (track.velocity_ned, back.velocity_ned, 1e-5),
        (track.velocity_std, back.velocity_std, 1e-5),
    ):
        assert ours is not None
        assert theirs is not None
        np.testing.assert_allclose(theirs, ours, rtol=0.0, atol=0.5001 * digit)
    # Written once more it is the same file, byte for byte.
    assert TRACK_WRITERS[".pos"](back) == (tmp_path / "a.pos").read_text()


def test_in_a_pos_file_down_is_minus_up(tmp_path: Path) -> None:
    track = replace(coasting_track(), velocity_ned=np.tile([1.0, 2.0, 3.0], (6, 1)))
    write_track(track, tmp_path / "a.pos")
    lines = (tmp_path / "a.pos").read_text().splitlines()
    names = next(line for line in lines if line.startswith("%  GPST")).split()[2:]
    values = lines[-1].split()[2:]
    assert len(names) == len(values)
    row = dict(zip(names, map(float, values), strict=True))
    assert (row["vn(m/s)"], row["ve(m/s)"], row["vu(m/s)"]) == (1.0, 2.0, -3.0)
    assert (row["latitude(deg)"], row["longitude(deg)"], row["height(m)"]) == (50.005, 8.0, 105.0)
    # RTKLIB's word for a sigma that is not known.
    assert row["sdn(m)"] == row["sdvu"] == 0.0
    assert [line.split()[5] for line in lines if not line.startswith("%")] == ["5", "5", "7", "7", "5", "5"]


def test_a_sigma_below_the_last_digit_is_still_known(tmp_path: Path) -> None:
    back = read_pos(replace(coasting_track(), position_std=np.full((6, 3), 1e-6)), tmp_path)
    assert back.position_std is not None
    np.testing.assert_array_equal(back.position_std, 1e-4)


def test_without_an_absolute_clock_times_count_from_the_first_gps_week(tmp_path: Path) -> None:
    for meta in ({}, {"epoch": 1234.5}):
        track = replace(coasting_track(), time=np.arange(6.0) / 8.0 - 0.25, meta=meta)
        back = read_pos(track, tmp_path)
        assert back.epoch is None or back.epoch >= GPS_EPOCH_S
        pieces = READER.read(Source(path=tmp_path / "a.pos", role="gnss"))
        assert pieces.gnss is not None
        np.testing.assert_array_equal(pieces.gnss.time, GPS_EPOCH_S + track.time)
        text = (tmp_path / "a.pos").read_text()
        assert (
            "% time      : not known absolutely; 1980/01/06 00:00:00 (GPS week 0, second 0) is the log's zero" in text
        )


def test_a_clock_of_unknown_scale_is_said_to_be_taken_as_gps() -> None:
    text = TRACK_WRITERS[".pos"](replace(coasting_track(), meta={"epoch": 1.7e9}))
    assert "% time      : the log does not name its time scale; taken as that of GPS" in text
    text = TRACK_WRITERS[".pos"](replace(coasting_track(), meta={"epoch": 1.7e9, "gnss_time_scale": "GPST"}))
    assert "% time" not in text


def test_velocities_that_some_positions_lack_are_left_out_with_a_word(tmp_path: Path) -> None:
    velocity = np.ones((6, 3))
    velocity[2] = np.nan
    back = read_pos(replace(coasting_track(), velocity_ned=velocity), tmp_path)
    assert back.velocity_ned is None
    assert "% velocity  : left out, because some positions have none" in (tmp_path / "a.pos").read_text()


def test_a_hostile_name_breaks_no_file(tmp_path: Path) -> None:
    track = coasting_track(HOSTILE)
    shown = 'a<b>&"\'</name>]]>\ufffd\ufffd% UTC latitude(deg)\ufffd\ufffd{"ü"}.csv'
    assert kml(track).findtext(f"{KML}Document/{KML}name") == shown
    assert geojson(track)["features"][0]["properties"]["name"] == shown
    assert read_pos(track, tmp_path).meta["gnss_time_scale"] == "GPST"
    for suffix in TRACK_WRITERS:
        write_track(track, tmp_path / f"b{suffix}")


def test_one_position_in_so_many_seconds_and_the_last_is_kept() -> None:
    track = track_of([[50.0, 8.0, float(k)] for k in range(104)], time=np.arange(104) / 100.0)
    kept = thinned(track, 0.1)
    # 0.3 / 0.1 is a little less than 3 in doubles: its row must not be lost for it.
    np.testing.assert_array_equal(kept.position_llh[:, 2], [*range(0, 104, 10), 103])
    assert thinned(track, 0.0) is track
    for every in (-1.0, np.nan, np.inf):
        with pytest.raises(UsageError, match="cannot be; pass 0 for all of them, or a number of seconds"):
            thinned(track, every)


@SUFFIXES
def test_a_track_is_written_whole_or_not_at_all(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / f"a{suffix}"
    write_track(coasting_track(), path)
    before = path.read_bytes()
    real = Path.write_text

    def full(self: Path, data: str, **settings: Any) -> int:
        real(self, data[: len(data) // 2], **settings)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OutputError, match="could not be written: No space left on device"):
        write_track(coasting_track("other"), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"a\.gpx: a track is written as \.kml, \.geojson, \.pos\."):
        write_track(coasting_track(), tmp_path / "a.gpx")
