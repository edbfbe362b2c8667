"""What goes into the plots: units, gaps, bands, the vertical range of the first look, the path."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.errors import UsageError
from levelhead.estimators.base import Result, Status
from levelhead.report.path import draw_path, drive_track
from levelhead.report.plots import Plot, status_bands, time_plots, yaw_rate

Make = Callable[..., Result]


def _by_name(plots: tuple[Plot, ...]) -> dict[str, Plot]:
    return {plot.name: plot for plot in plots}


def test_biases_are_drawn_in_degrees_per_second(make_result: Make) -> None:
    result = make_result()
    plot = _by_name(time_plots(result))["gyro-bias"]
    assert plot.unit == "deg/s"
    # The first and the last sample are always kept, so the comparison is exact.
    assert plot.curves[0].values[-1] == np.degrees(result.gyro_bias[-1, 0])


def test_an_unknown_bias_is_drawn_faint_and_named_so(make_result: Make) -> None:
    plot = _by_name(time_plots(make_result(known_gyro=(True, True, False))))["gyro-bias"]
    assert [curve.label for curve in plot.curves] == ["x", "y", "z (unknown)"]
    assert [curve.faint for curve in plot.curves] == [False, False, True]


def test_axes_that_are_not_estimated_are_not_drawn(make_result: Make) -> None:
    result = make_result()
    bias = result.accel_bias.copy()
    bias[:, 2] = np.nan
    plot = _by_name(time_plots(make_result(accel_bias=bias)))["accel-bias"]
    assert [curve.label for curve in plot.curves] == ["x", "y"]
    assert not _by_name(time_plots(make_result(accel_bias=bias * np.nan)))["accel-bias"].drawable


def test_the_truth_is_drawn_on_the_time_base_of_the_estimates(
    make_result: Make, make_reference: Callable[[Result], dict[str, FloatArray]]
) -> None:
    result = make_result()
    plots = _by_name(time_plots(result, make_reference(result)))
    dashed = [curve.label for plot in plots.values() for curve in plot.curves if curve.dashed]
    assert dashed == ["x truth", "y truth", "z truth"] * 2 + ["roll truth", "pitch truth", "heading truth"]
    heading, truth = plots["heading"].curves
    error = np.abs(heading.values - truth.values)
    both = np.isfinite(error)
    # The estimate is the truth here; interpolating the truth between samples 0.5 s apart, at 22.5 deg/s, cuts a
    # corner at the start and the end of a turn by at most a quarter of 0.5 s * 22.5 deg/s.
    assert np.max(error[both]) < 0.25 * 0.5 * 22.5


def test_a_reference_that_does_not_fit_is_refused_with_a_sentence(make_result: Make) -> None:
    with pytest.raises(UsageError, match="has no time"):
        time_plots(make_result(), {"roll": np.zeros(3)})
    with pytest.raises(UsageError, match=r"gyro_bias .* shape \(3,\)"):
        time_plots(make_result(), {"time": np.arange(3.0), "gyro_bias": np.zeros(3)})


def test_a_start_up_peak_does_not_flatten_the_first_look(make_result: Make) -> None:
    result = make_result()
    bias = result.gyro_bias.copy()
    bias[100:110, 0] = np.radians(50.0)
    view = _by_name(time_plots(make_result(gyro_bias=bias)))["gyro-bias"].view
    assert view is not None
    low, high = view
    # The biases lie between -0.12 and 0.31 deg/s; half of that span is left on both sides, the peak is not.
    assert -0.5 < low < -0.12
    assert 0.31 < high < 0.7
    assert _by_name(time_plots(result))["gyro-bias"].view is None


def test_yaw_rate_of_a_steady_turn_is_its_rate_and_gaps_stay_gaps() -> None:
    time = np.arange(0.0, 20.0, 0.01)
    heading = 0.3 * time
    heading[500:600] = np.nan
    later = time.copy()
    later[1500:] += 30.0
    rate = yaw_rate(later, heading)
    finite = np.isfinite(rate)
    # Exact up to rounding: 1e-16 * 6 rad over 0.1 s.
    np.testing.assert_allclose(rate[finite], 0.3, rtol=1e-12)
    assert not finite[500:600].any()
    assert not finite[1495:1505].any()
    assert finite.sum() > 1800


def test_yaw_rate_has_no_spike_where_the_heading_wraps(make_result: Make) -> None:
    result = make_result(heading=np.mod(0.2 * make_result().time, 2.0 * np.pi))
    curve = _by_name(time_plots(result))["yaw-rate"].curves[0]
    np.testing.assert_allclose(curve.values, np.degrees(0.2), rtol=1e-9)  # rounding only


def test_bands_show_from_when_to_when() -> None:
    time = np.arange(100.0)
    status = np.zeros(100, dtype=np.uint32)
    status[:10] = Status.INITIALIZING
    status[10:20] = Status.ALIGNING | Status.GYRO_SETTLED
    status[40:50] = Status.COASTING
    status[90:] = Status.COASTING | Status.REVERSE
    assert status_bands(time, status) == {
        "start": [(0.0, 20.0)],
        "coast": [(40.0, 50.0), (90.0, 99.0)],
        "reverse": [(90.0, 99.0)],
    }


def test_flickering_bands_merge_into_what_can_be_seen() -> None:
    time = np.arange(0.0, 10_000.0)
    status = np.where(np.arange(10_000) % 2 == 0, np.uint32(Status.COASTING), np.uint32(0)).astype(np.uint32)
    assert status_bands(time, status)["coast"] == [(0.0, 9_999.0)]


def test_the_path_comes_from_positions_where_there_are_any(make_result: Make) -> None:
    result = make_result()
    n = result.time.size
    # 1e-4 rad of latitude are 637 m; of longitude, at 60 deg north, half of that. The path crosses the date line.
    position = np.column_stack((np.linspace(0.0, 1e-4, n), np.linspace(0.0, 1e-4, n), np.zeros(n)))
    position += [np.pi / 3.0, np.pi - 5e-5, 0.0]
    position[:, 1] = np.angle(np.exp(1j * position[:, 1]))
    position[:40] = np.nan
    track = drive_track(make_result(position_llh=position))
    assert track.time[0] == result.time[40]
    share = 1.0 - 40.0 / (n - 1)
    assert track.north[-1] == pytest.approx(637.1 * share, rel=1e-3)  # four digits of the radius
    assert track.east[-1] == pytest.approx(0.5 * 637.1 * share, rel=1e-3)


def test_the_path_is_integrated_from_the_velocity_otherwise(make_result: Make) -> None:
    result = make_result()
    velocity = np.broadcast_to([3.0, -1.0, 0.0], (result.time.size, 3)).copy()
    velocity[:20] = np.nan
    track = drive_track(make_result(velocity_ned=velocity))
    span = result.time[-1] - result.time[20]
    assert track.north[-1] == pytest.approx(3.0 * span)  # trapezoids of a constant are exact
    assert track.east[-1] == pytest.approx(-span)


def test_the_path_is_drawn_to_one_scale_with_north_up(make_result: Make) -> None:
    result = make_result()
    drawing = draw_path(result)
    assert drawing is not None
    track = drive_track(result)
    north, east = track.north, track.east
    # A tenth of a pixel of rounding on either side of some hundred pixels.
    assert np.ptp(drawing.x) / np.ptp(east) == pytest.approx(np.ptp(drawing.y) / np.ptp(north), rel=2e-3)
    top = int(np.argmin(drawing.y))
    assert drawing.time[top] == pytest.approx(result.time[np.argmax(north)], abs=2.0)  # the thinned path's spacing
    assert re.search(r'<path class="track" [^>]*d="M[0-9]+ [0-9]+l[-0-9 ]+"/>', drawing.svg)


def test_a_vehicle_that_never_moved_has_a_path_of_one_point(make_result: Make) -> None:
    still = np.zeros((make_result().time.size, 3))
    drawing = draw_path(make_result(velocity_ned=still))
    assert drawing is not None
    assert re.search(r'd="M[0-9]+ [0-9]+"/>', drawing.svg)
    assert draw_path(make_result(velocity_ned=still * np.nan)) is None
