"""The outage test on the validation page: its figures, bars and sentences."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from levelhead.analysis.drift import Agreement, Drift, Window
from levelhead.analysis.injection import Case, Recovery, Sensitivity, Validation
from levelhead.analysis.outages import OutageRun, OutageTest
from levelhead.estimators.base import Result
from levelhead.report.outages import HEIGHT, outage_section
from levelhead.report.validation import render_validation

if TYPE_CHECKING:
    from playwright.sync_api import Browser

Make = Callable[..., Result]
HOSTILE = "</script><img src=x onerror=alert(1)>"
AIDED = Agreement(epochs=4810, horizontal_m=0.021, vertical_m=0.034, horizontal_in_sigma=0.71, vertical_in_sigma=0.69)


def run_of(name: str, *drifts: float, sigma: float = 2.0) -> OutageRun:
    """Return a run with an outage of 15 s every minute, after which the position is so many metres off."""
    return OutageRun(
        name=name,
        drifts=tuple(
            Drift(
                window=Window(start_s=120.0 + 60.0 * k, end_s=135.0 + 60.0 * k),
                compared_s=134.8 + 60.0 * k,
                horizontal_m=drift,
                vertical_m=0.1 * drift,
                horizontal_std_m=sigma,
                vertical_std_m=0.5 * sigma,
                largest_m=1.1 * drift,
                distance_m=150.0,
            )
            for k, drift in enumerate(drifts)
        ),
        agreement=AIDED,
    )


def text_of(page: str) -> str:
    """Return the words."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page)).replace("\u00a0", " ")


def page_of(result: Result, test: OutageTest | None) -> str:
    """Return a validation page with one empty case."""
    nothing = np.full(3, np.nan)
    recovery = Recovery(case=Case(), gyro_error=nothing, accel_error=nothing, gyro_std=nothing, accel_std=nothing)
    validation = Validation(method="a", params={}, log_info={}, base=result, recoveries=(recovery,))
    return render_validation(validation, Sensitivity(method="a", changes=()), title="t", outages=test)


def test_every_outage_and_the_figures_over_them_are_shown() -> None:
    text = text_of(outage_section(OutageTest(length_s=15.0, runs=(run_of("phasor", 1.0, 2.0, 7.0),))))
    # RMS of 1, 2, 7 m is sqrt(18); sigma 2 m; 150 m driven.
    assert "Horizontal distance from GNSS at the end of 3 outages of 15 s: phasor 4.24 m RMS (2.12 sigma)." in text
    assert "phasor 4.24 2.00 7.00 0.42 0.20 0.70 2.83 1.33 4.67 2.12 0.42 0.021 0.034 0.71 0.69" in text
    assert "120–135 150 1.00 2.00 0.50 0.67 0.10 1.10" in text
    assert "240–255 150 7.00 2.00 3.50 4.67 0.70 7.70" in text


def test_a_drift_beyond_three_sigma_is_marked() -> None:
    section = outage_section(OutageTest(length_s=15.0, runs=(run_of("phasor", 1.0, 2.0, 7.0),)))
    assert re.findall(r'<strong class="far">(.*?)</strong>', section) == ["3.50"]


def test_bars_are_as_tall_as_the_drift_and_the_line_is_at_the_sigma() -> None:
    section = outage_section(
        OutageTest(length_s=15.0, runs=(run_of("phasor", 1.0, 2.0, 8.0), run_of("b", 4.0, 4.0, math.nan)))
    )
    bars = re.findall(r'<rect class="tone-(\d)" x="[0-9.]+" y="([0-9.]+)" width="[0-9.]+" height="([0-9.]+)"', section)
    tall = {tone: [float(h) for t, _, h in bars if t == tone] for tone in "01"}
    assert len(tall["1"]) == 2  # what is not known has no bar
    assert np.array(tall["0"]) / tall["0"][2] == pytest.approx([1 / 8, 2 / 8, 1.0], abs=1e-3)  # tenths of a pixel
    assert tall["1"][0] / tall["0"][2] == pytest.approx(0.5, abs=1e-3)
    lines = [float(y) for y in re.findall(r'class="claimed" d="M[0-9.]+ ([0-9.]+)h', section)]
    foot = float(bars[0][1]) + float(bars[0][2])
    assert foot < HEIGHT
    assert foot - np.array(lines) == pytest.approx(2 / 8 * tall["0"][2], abs=0.2)


def test_reasons_are_sentences_and_hostile_names_stay_names(make_result: Make) -> None:
    assert 'id="outages"' not in page_of(make_result(), None)
    page = page_of(make_result(), OutageTest(length_s=15.0, reason=f"No. {HOSTILE}"))
    assert "GNSS taken away for 15" in page
    assert HOSTILE not in page
    runs = (run_of(HOSTILE, 1.0), OutageRun(name=HOSTILE, refused=HOSTILE))
    page = page_of(make_result(), OutageTest(length_s=15.0, runs=runs))
    assert HOSTILE not in page
    assert "<img" not in page
    assert "at the end of one outage" in page
    assert re.findall(r"(?<!u-)\bstyle=", page) == []
    assert re.findall(r"<th(?! scope)[ >]", page) == []
    nothing = outage_section(OutageTest(length_s=15.0, runs=(OutageRun(name="a", refused="It refuses."),)))
    assert "No method gave positions through an outage." in nothing
    assert "It refuses." in nothing
    assert "<svg" not in nothing


def test_thirty_outages_of_three_methods_fit_the_page(make_result: Make, browser: Browser, tmp_path: Path) -> None:
    drifts = np.random.default_rng(3).rayleigh(1.5, (3, 30))
    names = ("phasor", "smoother", "phasor, rear axle")
    runs = tuple(run_of(name, *row.tolist()) for name, row in zip(names, drifts, strict=True))
    file = tmp_path / "validation.html"
    file.write_text(page_of(make_result(), OutageTest(length_s=15.0, runs=runs)), encoding="utf-8")
    complaints: list[str] = []
    page = browser.new_page(viewport={"width": 1366, "height": 768})
    page.on("console", lambda message: complaints.append(message.text))
    page.goto(file.as_uri())
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    colours = page.evaluate(
        "() => [0, 1, 2].map(k => getComputedStyle(document.querySelector(`.bars rect.tone-${k}`)).fill)"
    )
    assert len(set(colours)) == 3
    assert "rgb(0, 0, 0)" not in colours
    page.close()
    assert complaints == []
