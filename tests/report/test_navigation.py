"""Navigation in the report and the files: the path with its outages and corridor, the section, summary and columns."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from levelhead.conventions import FloatArray
from levelhead.estimators.base import HeadingSource, Result, Status
from levelhead.estimators.navigation import outages
from levelhead.report.corridor import corridor
from levelhead.report.files import result_columns, write_result
from levelhead.report.html import render_report
from levelhead.report.path import draw_path, drive_track

Make = Callable[..., Result]


def _text(page: str) -> str:
    bare = re.sub(r"(?s)<(script|style)\b.*?</\1>", " ", page)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", bare)).replace("\u00a0", " ")


def _section(page: str) -> str:
    return page.split('<section aria-labelledby="navigation">')[1].split("</section>")[0]


def _row(page: str, head: str) -> str:
    """Return the cells of the section's row with this head."""
    return _text(_section(page).split(f'<th scope="row">{head}</th>')[1].split("</tr>")[0]).strip()


def test_the_summary_tells_the_sigma_the_outages_and_the_point(make_navigated: Make) -> None:
    result = make_navigated(duration=1000.0)
    found = result.summary()["navigation"]
    assert isinstance(found, dict)
    assert found["position_std_m"] == pytest.approx([0.02, 0.018, 0.03])
    assert found["velocity_std_m_s"] == [0.01, 0.01, 0.02]
    # Of a thousand seconds 50 and 10; a sample is 0.05 s.
    assert found["outages"] == {
        "count": 2,
        "longest_s": pytest.approx(50.0, abs=0.05),
        "total_s": pytest.approx(60.0, abs=0.1),
    }
    shares = found["heading_source"]
    expected = {"none": 0.01, "course": 0.86, "reverse": 0.02, "stationary": 0.05, "inertial": 0.06}
    assert shares == pytest.approx(expected, abs=2e-4)  # one sample of 20 001 at each end of a stretch
    point = result.reference
    assert point is not None
    assert found["reference_point"] == {
        "point_m": [-1.2, 0.0, 0.4],
        "position_std_m": pytest.approx([0.025, 0.023, 0.035]),
        "cross_track_rms_m": pytest.approx(np.sqrt(np.mean(point.cross_track**2))),
        "cross_track_max_m": np.abs(point.cross_track).max(),
        "height_rms_m": pytest.approx(np.sqrt(np.mean(point.height**2))),
    }
    json.dumps(result.summary(), allow_nan=False)


def test_without_estimated_positions_nothing_is_said_of_navigation(make_result: Make, make_navigated: Make) -> None:
    assert make_result().summary()["navigation"] is None
    page = render_report(make_result(), title="t")
    assert 'id="navigation"' not in page
    summary = make_navigated(point=False).summary()["navigation"]
    assert isinstance(summary, dict)
    assert summary["reference_point"] is None
    assert "Reference point" not in render_report(make_navigated(point=False), title="t")


def test_an_unknown_point_is_null_and_not_a_number(make_navigated: Make) -> None:
    result = make_navigated()
    assert result.reference is not None
    nothing = np.full(result.time.size, np.nan)
    unknown = dataclasses.replace(result.reference, cross_track=nothing, height=nothing, position_std=None)
    summary = make_navigated(reference=unknown).summary()["navigation"]
    assert isinstance(summary, dict)
    assert summary["reference_point"]["position_std_m"] is None
    assert summary["reference_point"]["cross_track_rms_m"] is None
    assert _row(render_report(make_navigated(reference=unknown), title="t"), "cross-track correction, RMS") == "–"


def test_an_outage_until_the_end_counts_to_the_last_sample(make_navigated: Make) -> None:
    result = make_navigated()
    status = np.where(result.time > 880.0, np.uint32(Status.COASTING), np.uint32(Status.COURSE)).astype(np.uint32)
    found = outages(make_navigated(status=status))
    assert (found.count, found.last[0]) == (1, 900.0)
    assert outages(make_navigated(status=status * np.uint32(0))).longest_s == 0.0


def test_the_section_shows_both_sigmas(make_navigated: Make) -> None:
    page = render_report(make_navigated(duration=1000.0), title="t")
    # 0.02 m, and 0.005 m/s^2 times the square of the last moment of an outage, 49.95 s; 0.9 and 1.5 times as much.
    largest = 0.02 + 0.005 * 49.95**2
    assert _row(page, "position north, m") == f"0.020 {largest:.3f} 0.020"
    assert _row(page, "position down, m") == f"0.030 {1.5 * largest:.3f} 0.030"
    assert _row(page, "velocity down, m/s") == "0.020 0.020 0.020"
    assert _row(page, "GNSS outages") == "2"
    assert _row(page, "longest outage") == "50.0 s"
    assert _row(page, "heading: course, reversed") == "2.0 %"
    assert _row(page, "found standing") == "5.0 %"
    assert _row(page, "forward / right / down of the IMU") == "-1.2 / 0 / 0.4 m"
    assert f"In 2 outages, the longest of 50.0 s it grew to at most {largest:.3f} m." in _text(page)
    assert 'id="plot-position-sigma"' in _section(page)
    assert 'id="plot-slope"' in _section(page)


def test_with_gnss_is_without_the_outages(make_navigated: Make) -> None:
    time = make_navigated().time
    coasting = time > 100.0  # most of the drive
    status = np.where(coasting, np.uint32(Status.COASTING), np.uint32(Status.COURSE)).astype(np.uint32)
    std = np.broadcast_to(np.where(coasting, 5.0, 0.02)[:, None], (time.size, 3)).copy()
    std[10] = 9.0  # while GNSS is there: not the largest of an outage
    page = render_report(make_navigated(status=status, position_std=std), title="t")
    assert _row(page, "position north, m") == "0.020 5.000 5.000"
    assert "known to 0.020 m horizontally, one sigma (median). In one outage of 13 min 20 s" in _text(page)


def test_the_path_is_that_of_the_point_that_was_asked_for(make_navigated: Make) -> None:
    result = make_navigated()
    assert result.reference is not None
    assert result.reference.position_llh is not None
    aside = result.reference.position_llh + np.array([1e-5, 0.0, 0.0])
    result = make_navigated(reference=dataclasses.replace(result.reference, position_llh=aside))
    track = drive_track(result)
    assert track.start_deg == pytest.approx((48.0 + np.degrees(1e-5), 11.0), abs=1e-12)
    drawing = draw_path(result)
    assert drawing is not None
    assert drawing.caption == (
        "The reference point, (-1.2, 0, 0.4) m forward, right, down of the IMU; from latitude 48.000573°, "
        "longitude 11.000000°."
    )
    assert drawing.caption in render_report(result, title="t")
    imu, antenna = draw_path(make_navigated(point=False)), draw_path(make_navigated(point=False, position_std=None))
    assert imu is not None
    assert imu.caption.startswith("The IMU; from latitude 48.000000°")
    assert antenna is not None
    assert antenna.caption.startswith("The GNSS antenna, straight from fix to fix;")


def _points(data: str) -> FloatArray:
    """Return the vertices (p, 2) of a path of relative steps, px."""
    start, _, steps = data[1:].partition("l")
    numbers = np.array([*start.split(), *steps.split()], dtype=float).reshape(-1, 2)
    points: FloatArray = np.cumsum(numbers, axis=0) / 10.0
    return points


def test_outages_lie_on_the_path_from_their_first_to_their_last_sample(make_navigated: Make) -> None:
    result = make_navigated()
    drawing = draw_path(result)
    assert drawing is not None
    assert drawing.coasting
    found = re.findall(r'class="coast" [^>]*d="([^"]*)"', drawing.svg)
    spans = outages(result)
    assert len(found) == spans.count == 2
    for data, first, last in zip(found, spans.first, spans.last, strict=True):
        points = _points(data)
        for place, when in ((points[0], first), (points[-1], last)):
            at = int(np.searchsorted(drawing.time, when))
            assert drawing.time[at] == when  # the ends of an outage are vertices of their own
            np.testing.assert_allclose(place, (drawing.x[at], drawing.y[at]), atol=0.051)  # tenths of a pixel
    # Drawn after the path, so on top of it.
    assert drawing.svg.rindex('class="coast"') > drawing.svg.rindex('class="track"')
    page = render_report(result, title="t")
    assert "without GNSS" in page
    aided = make_navigated(status=result.status & ~np.uint32(Status.COASTING))
    assert "without GNSS</span>" not in render_report(aided, title="t").split("path-key")[1]
    assert "one sigma" not in render_report(aided, title="t").split("path-key")[-1].split("</figure>")[0]


def test_the_corridor_is_as_wide_as_two_sigma(make_navigated: Make) -> None:
    result = make_navigated()
    drawing, track = draw_path(result), drive_track(result)
    assert drawing is not None
    scale = np.ptp(drawing.x) / np.ptp(track.east)  # px/m
    widths = np.array(re.findall(r'stroke-width="([0-9.]+)"', drawing.svg), dtype=float)
    coasting = (result.status & np.uint32(Status.COASTING)) != 0
    assert result.reference is not None
    assert result.reference.position_std is not None
    sigma = result.reference.position_std[coasting, :2].max()
    # Drawn in at most 40 widths, each that of its middle; the last one is within one of them.
    assert 2.0 * sigma * scale * (1.0 - 1.0 / 40.0) <= widths.max() <= 2.0 * sigma * scale
    assert widths.min() >= 1.0
    assert "one sigma" in render_report(result, title="t").split("path-key")[-1]


def test_a_corridor_thinner_than_a_pixel_is_not_drawn(make_navigated: Make) -> None:
    result = make_navigated(point=False)
    assert result.position_std is not None
    thin = make_navigated(point=False, position_std=np.full(result.position_std.shape, 0.02))
    drawing = draw_path(thin)
    assert drawing is not None
    assert drawing.coasting
    assert not drawing.corridor
    assert 'class="corridor"' not in drawing.svg
    nothing = np.full(3, np.nan)
    assert corridor(np.arange(3.0), np.arange(3.0), nothing) == ""
    # Standing still with a growing sigma is a disc: a stroke of no length.
    assert corridor(np.full(3, 7.0), np.full(3, 8.0), np.full(3, 2.0)) == (
        '<path stroke-width="4.0" d="M7.0 8.0L7.0 8.0"/>'
    )


def test_the_scale_bar_is_as_long_as_it_says(make_navigated: Make) -> None:
    result = make_navigated()
    drawing, track = draw_path(result), drive_track(result)
    assert drawing is not None
    left, right = re.findall(r'class="scale-bar" d="M([0-9.]+) [0-9]+V[0-9]+H([0-9]+)V', drawing.svg)[0]
    assert ">50 m</text>" in drawing.svg
    pixels_per_metre = np.ptp(drawing.x) / np.ptp(track.east)
    assert float(right) - float(left) == pytest.approx(50.0 * pixels_per_metre, rel=2e-3)  # tenths of a pixel


def test_a_long_drive_stays_small(make_navigated: Make) -> None:
    result = make_navigated(duration=20_000.0, rate=10.0)
    n = result.time.size
    flicker = np.where(np.arange(n) % 100 < 50, np.uint32(Status.COASTING), np.uint32(0)).astype(np.uint32)
    drawing = draw_path(make_navigated(duration=20_000.0, rate=10.0, status=flicker))
    assert drawing is not None
    assert drawing.time.size < 2502 + 1000 + 2 * 400  # path_indices, OUTAGE_POINTS, two ends for each of MAX_BANDS
    assert len(drawing.svg) < 100_000


def test_the_result_file_has_the_navigation_behind_the_older_columns(make_navigated: Make, tmp_path: Path) -> None:
    result = make_navigated()
    columns, units = result_columns(result)
    names = list(columns)
    assert names[names.index("height") + 1 :] == [
        *(f"velocity_std_{axis}" for axis in "ned"),
        *(f"position_std_{axis}" for axis in "ned"),
        "heading_source",
        *("reference_latitude", "reference_longitude", "reference_height"),
        *(f"reference_position_std_{axis}" for axis in "ned"),
        *(f"reference_velocity_{axis}" for axis in "ned"),
        *(f"reference_velocity_std_{axis}" for axis in "ned"),
        "cross_track_correction",
        "height_correction",
    ]
    assert units["heading_source"] == "enum"
    assert units["reference_latitude"] == "rad"
    assert units["cross_track_correction"] == units["position_std_n"] == "m"
    write_result(result, tmp_path / "result.parquet")
    table = pq.read_table(tmp_path / "result.parquet")
    assert table.column_names == names
    assert str(table.schema.field("heading_source").type) == "uint8"
    assert set(table["heading_source"].to_pylist()) == {int(source) for source in HeadingSource}
    assert result.reference is not None
    np.testing.assert_array_equal(table["height_correction"].to_numpy(), result.reference.height)


def test_a_method_without_positions_writes_no_position_sigma(make_result: Make) -> None:
    names = list(result_columns(make_result())[0])
    assert [n for n in names if n.startswith(("position_std", "reference", "cross"))] == []
    assert names[-4:] == ["velocity_std_n", "velocity_std_e", "velocity_std_d", "heading_source"]
