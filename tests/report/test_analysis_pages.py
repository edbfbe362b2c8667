"""The pages of `compare`, `validate` and Monte Carlo: complete in themselves, escaped, and drawn by a real browser."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from levelhead.analysis.comparison import Comparison, Entry, Errors
from levelhead.analysis.injection import Case, Change, Recovery, Sensitivity, Validation
from levelhead.analysis.trials import QUANTITIES, MonteCarlo, Trial
from levelhead.conventions import FloatArray
from levelhead.estimators.base import Result
from levelhead.events import Event
from levelhead.report.comparison import TONES, comparison_plots, render_comparison
from levelhead.report.montecarlo import render_monte_carlo
from levelhead.report.validation import render_validation
from levelhead.sim import Truth

if TYPE_CHECKING:
    from playwright.sync_api import Browser

Make = Callable[..., Result]
HOSTILE = "</script><img src=x onerror=alert(1)>"


def entry(method: str, result: Result) -> Entry:
    """Return an entry with numbers in every cell."""
    return Entry(
        method=method,
        runtime_s=0.5,
        runtime_ratio=2.0,
        attitude_difference=np.radians([0.123, 0.234, 0.345]),
        gyro_in_sigma=np.array([0.7, 1.8, 3.1]),
        result=result,
    )


def comparison_of(make: Make, *methods: str, failed: str = "", **changes: object) -> Comparison:
    """Compare made-up methods: each one's gyro biases are shifted by its number times 0.01 deg/s."""
    plain = make(**changes)
    shift = np.radians(0.01)
    entries = [entry(name, replace(plain, gyro_bias=plain.gyro_bias + k * shift)) for k, name in enumerate(methods)]
    if failed:
        entries.append(Entry(method="stubborn", failure=failed))
    return Comparison(entries=tuple(entries), reference=methods[0], after_s=120.0, log_info=plain.log_info)


def truth_of(result: Result) -> Truth:
    """Return a truth at the samples of a result."""
    zeros = np.zeros((result.time.size, 3))
    return Truth(
        time=result.time,
        gyro_bias=zeros,
        accel_bias=zeros,
        roll=zeros[:, 0],
        pitch=zeros[:, 0],
        heading=zeros[:, 0],
        velocity_ned=zeros,
        position_llh=zeros,
        angular_rate=zeros,
        specific_force=zeros,
    )


def validation_of(result: Result, method: str = "observer") -> Validation:
    """One case within three sigma, one beyond, one without a sigma that hides an axis."""
    nothing = np.full(3, np.nan)
    sure = np.full(3, 1e-4)
    gyro = np.radians([0.0123, 0.0, -0.0011])
    recoveries = (
        Recovery(
            case=Case(gyro_bias=(1e-3, 0, 0)), gyro_error=gyro, accel_error=nothing, gyro_std=sure, accel_std=sure
        ),
        Recovery(
            case=Case(accel_bias=(0, 0.3, 0)), gyro_error=9 * gyro, accel_error=nothing, gyro_std=sure, accel_std=sure
        ),
        Recovery(
            case=Case(gyro_bias=(1e-3, 0, 0)),
            gyro_error=nothing,
            accel_error=nothing,
            gyro_std=nothing,
            accel_std=nothing,
            lost=("gyro x",),
        ),
    )
    return Validation(method=method, params={}, log_info=result.log_info, base=result, recoveries=recoveries)


def sensitivity_of(name: str = "tau", refused: str = "") -> Sensitivity:
    """One change."""
    return Sensitivity(
        method="observer",
        changes=(
            Change(name="tau", change=0.2, gyro=np.radians([4e-4, 0, 0]), accel=np.full(3, np.nan), tilt=np.zeros(2)),
            Change(
                name=name,
                change=-0.2,
                gyro=np.full(3, np.nan),
                accel=np.full(3, np.nan),
                tilt=np.full(2, np.nan),
                refused=refused,
            ),
        ),
    )


def monte_carlo_of(method: str = "observer", failure: str = "") -> MonteCarlo:
    """Forty runs of one method whose sigma is right for the roll and three times too small for the pitch."""
    squared = np.full(len(QUANTITIES), np.nan)
    squared[:2] = (1.0, 9.0)
    looks = np.where(np.isfinite(squared), 30, 0)
    trials = [
        Trial(
            seed=seed,
            rms=np.full(len(QUANTITIES), 0.01),
            squared=squared,
            samples=looks,
            covered=looks // 2,
            gyro_settles=100.0,
        )
        for seed in range(40)
    ]
    if failure:
        trials.append(Trial(seed=40, failure=failure))
    return MonteCarlo(
        scenario="field",
        runs=len(trials),
        seed0=0,
        duration=600.0,
        after=300.0,
        imu_rate=100.0,
        gnss_rate=10.0,
        params={method: {}},
        trials={method: tuple(trials)},
    )


def text_of(page: str) -> str:
    """Return the words of a page, without scripts and tags."""
    bare = re.sub(r"(?s)<(script|style)\b.*?</\1>", " ", page)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", bare))


def data_of(page: str) -> dict[str, list[dict[str, object]]]:
    """Return what the page's script reads."""
    found = re.search(r'(?s)id="report-data">(.*?)</script>', page)
    assert found is not None
    data: dict[str, list[dict[str, object]]] = json.loads(found.group(1))
    return data


def test_every_method_has_its_row_and_its_curves(make_result: Make) -> None:
    page = render_comparison(comparison_of(make_result, "observer", "smoother"), title="field-07.csv")
    text = text_of(page)
    assert "the final estimates lie at most 0.0100 deg/s in gyro" in text.replace("\u00a0", " ")
    assert text.count("observer") >= 3
    assert "2.0×" in text
    names = [str(plot["name"]) for plot in data_of(page)["plots"]]
    assert names == [*(f"gyro-{a}" for a in "xyz"), *(f"accel-{a}" for a in "xyz"), "roll", "pitch", "heading"]
    for name in names:
        assert f'id="plot-{name}"' in page


def test_the_reference_is_not_compared_with_itself(make_result: Make) -> None:
    comparison = comparison_of(make_result, "observer", "smoother")
    roll = next(plot for plot in comparison_plots(comparison) if plot.name == "roll")
    assert [curve.label for curve in roll.curves] == ["smoother"]
    text = text_of(render_comparison(comparison, title="t"))
    assert "observer the reference" in text
    assert "0.123 0.234 0.345 0.7 1.8 3.1" in text


def test_a_contradiction_is_marked(make_result: Make) -> None:
    page = render_comparison(comparison_of(make_result, "observer", "smoother"), title="t")
    assert re.findall(r'<strong class="far">(.*?)</strong>', page) == ["3.1"]


def test_with_the_truth_the_errors_are_shown(make_result: Make) -> None:
    comparison = comparison_of(make_result, "observer", "smoother")
    result = comparison.results["observer"]
    errors = Errors(gyro_bias=np.full(3, 1e-3), accel_bias=np.array([0.01, 0.02, np.nan]), attitude=np.full(3, 0.1))
    entries = tuple(replace(e, errors=errors) for e in comparison.entries)
    page = render_comparison(replace(comparison, entries=entries, truth=truth_of(result)), title="t")
    assert "observer 5.730 5.730 5.730 0.0573 0.0573 0.0573 0.0100 0.0200" in text_of(page)
    plots = {str(plot["name"]): plot for plot in data_of(page)["plots"]}
    for name, labels in (("gyro-x", ["observer", "smoother", "truth"]), ("roll", ["observer", "smoother"])):
        curves = plots[name]["curves"]
        assert isinstance(curves, list)
        assert [curve["label"] for curve in curves] == labels
    assert "truth of the simulation" in text_of(page)


def test_what_methods_said_is_said_once(make_result: Make) -> None:
    gap = Event(code="W_GAP", count=1, first_s=1.0, detail="It lasted 1 s.")
    page = render_comparison(comparison_of(make_result, "a", "b", events=(gap,)), title="t")
    assert page.count("It lasted 1 s.") == 1
    assert "all methods" in text_of(page)


def test_more_methods_than_colours_still_have_one_each(make_result: Make) -> None:
    names = [f"method-{k}" for k in range(TONES + 2)]
    page = render_comparison(comparison_of(make_result, *names), title="t")
    tones = {int(tone) for tone in re.findall(r"swatch tone-(\d)", page)}
    style = "".join(re.findall(r"(?s)<style>(.*?)</style>", page))
    assert tones == set(range(TONES))
    for tone in tones:
        assert style.count(f"--tone-{tone}:") == 2  # light and dark
        assert f".swatch.tone-{tone} " in style


def test_six_methods_over_an_hour_stay_below_a_megabyte(make_result: Make) -> None:
    comparison = comparison_of(make_result, *(f"method-{k}" for k in range(6)), duration=3600.0, rate=50.0)
    # What a mail takes without a word; about 700 kB with the noise of this drive.
    assert len(render_comparison(comparison, title="t").encode()) < 1_000_000


def test_validation_names_what_is_beyond_and_what_is_lost(make_result: Make) -> None:
    page = render_validation(validation_of(make_result()), sensitivity_of(), title="t")
    text = text_of(page).replace("\u00a0", " ")
    assert "1 +0.06 0.0123 0.0000 -0.0011 within" in text
    assert "2 +0.3 0.1107 0.0000 -0.0099 beyond" in text
    assert "no longer known: gyro x" in text
    assert "Within three sigma: 1 of 2. In 1 of the cases a bias that is known without them" in text
    assert "largest 0.1107 0.0000 0.0099" in text
    assert "moves the final biases by at most 0.0004 deg/s." in text


def test_a_sigma_that_is_too_small_is_marked() -> None:
    page = render_monte_carlo(monte_carlo_of())
    assert '<strong class="far">9.00</strong> not in 0.' in page
    assert page.count('<strong class="far">') == 1
    assert "50.0\u00a0%" in page
    assert "1 min 40 s" in text_of(page).replace("\u00a0", " ")
    assert "0 of 40" in text_of(page)


PAGES: dict[str, Callable[[Make], str]] = {
    "comparison": lambda make: render_comparison(comparison_of(make, "observer", "b", failed=HOSTILE), title=HOSTILE),
    "validation": lambda make: render_validation(
        validation_of(make(log_info={"source": HOSTILE, "completeness": HOSTILE}), HOSTILE),
        sensitivity_of(HOSTILE, HOSTILE),
        title=f"{HOSTILE} $policy",
    ),
    "montecarlo": lambda _: render_monte_carlo(monte_carlo_of(HOSTILE, HOSTILE)),
    "hostile method": lambda make: render_comparison(
        comparison_of(
            make, HOSTILE, "b", log_info={"source": HOSTILE}, events=(Event(code="W_GAP", count=1, detail=HOSTILE),)
        ),
        title="t",
    ),
}


@pytest.mark.parametrize("name", PAGES)
def test_hostile_texts_stay_texts_and_nothing_is_fetched(make_result: Make, name: str) -> None:
    page = PAGES[name](make_result)
    assert HOSTILE not in page
    assert "<img" not in page
    assert page == PAGES[name](make_result)  # the same inputs, the same page
    bare = page.replace("/*! https://github.com/leeoniya/uPlot (v1.6.32) */", "")
    assert not re.findall(r"(?i)https?:|\bws{1,2}:|url\(|@import", bare)
    assert "unsafe" not in page.split('Content-Security-Policy" content="')[1].split('"')[0]
    assert re.findall(r"(?<!u-)\bstyle=", re.sub(r"(?s)<script>.*?</script>", "", page)) == []
    assert 'scope="col"' in page
    assert re.findall(r"<th(?! scope)[ >]", page) == []


def _nothing_known(result: Result) -> Result:
    nan: FloatArray = np.full((result.time.size, 3), np.nan)
    return replace(
        result,
        gyro_bias=nan,
        accel_bias=nan,
        roll=nan[:, 0],
        pitch=nan[:, 0],
        heading=nan[:, 0],
        known_gyro=(False,) * 3,
        known_accel=(False,) * 3,
    )


def test_nothing_known_at_all_still_gives_pages(make_result: Make) -> None:
    result = _nothing_known(make_result())
    entries = (entry("a", result), entry("b", result))
    page = render_comparison(
        Comparison(entries=entries, reference="a", after_s=120.0, log_info=result.log_info), title="t"
    )
    assert "No bias is known to two methods or more." in text_of(page)
    assert "<script" not in page  # nothing to draw
    nothing = np.full(3, np.nan)
    recovery = Recovery(case=Case(), gyro_error=nothing, accel_error=nothing, gyro_std=nothing, accel_std=nothing)
    validation = Validation(method="a", params={}, log_info={}, base=result, recoveries=(recovery,))
    text = text_of(render_validation(validation, Sensitivity(method="a", changes=()), title="t"))
    assert "No bias is known on this log" in text


def test_the_browser_draws_every_plot_without_a_complaint(make_result: Make, browser: Browser, tmp_path: Path) -> None:
    complaints: list[str] = []
    context = browser.new_context(viewport={"width": 1366, "height": 768})
    for name, text in (
        ("comparison", render_comparison(comparison_of(make_result, *"abcdef", failed="No."), title="t")),
        ("validation", render_validation(validation_of(make_result()), sensitivity_of(), title="t")),
        ("montecarlo", render_monte_carlo(monte_carlo_of())),
    ):
        file = tmp_path / f"{name}.html"
        file.write_text(text, encoding="utf-8")
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(file.as_uri())
        assert page.locator("figure .u-over").count() == (9 if name == "comparison" else 0)
        # Wide tables scroll inside their card; the page itself never does sideways.
        assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
        page.close()
    context.close()
    assert complaints == []
