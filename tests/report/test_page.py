"""The page in a real Chromium: it draws, zooms in step, prints, and neither fetches nor complains."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.estimators.base import Result
from levelhead.events import Event
from levelhead.report.html import render_report

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

Make = Callable[..., Result]
Open = Callable[[str], "Page"]
HOSTILE = "</script><img src=x onerror=alert(1)>"

# Pixels per canvas in the colour of the first curve, #0072b2: grid, text and bands have other colours.
CURVE_PIXELS = """() => [...document.querySelectorAll('.plots canvas')].map(canvas => {
  const p = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let drawn = 0;
  for (let i = 0; i < p.length; i += 4)
    drawn += p[i + 3] > 200 && p[i] < 40 && Math.abs(p[i + 1] - 114) < 40 && Math.abs(p[i + 2] - 178) < 40;
  return drawn;
})"""
WIDTHS = "() => [...document.querySelectorAll('.uplot')].map(plot => plot.getBoundingClientRect().width)"
VIOLATIONS = """window.violations = [];
document.addEventListener('securitypolicyviolation', event => window.violations.push(event.violatedDirective));"""


@pytest.fixture
def complaints() -> list[str]:
    """Everything that the open page complained about or asked for."""
    return []


@pytest.fixture
def open_page(browser: Browser, tmp_path: Path, complaints: list[str]) -> Iterator[Open]:
    """Open a report from a file, as a user does, and write down what happens."""
    context = browser.new_context(viewport={"width": 1366, "height": 768})

    def open_report(text: str) -> Page:
        file = tmp_path / "report.html"
        file.write_text(text, encoding="utf-8")
        page = context.new_page()
        page.add_init_script(VIOLATIONS)

        def dismiss(dialog: object) -> None:
            complaints.append(f"dialog: {dialog}")

        page.on("dialog", dismiss)
        page.on("console", lambda message: complaints.append(f"console: {message.text}"))
        page.on("pageerror", lambda error: complaints.append(f"error: {error}"))
        page.on("request", lambda request: complaints.append(f"request: {request.url}"))
        page.goto(file.as_uri())
        complaints.remove(f"request: {file.as_uri()}")
        if "request: data:," in complaints:
            complaints.remove("request: data:,")
        page.wait_for_selector(".u-over")
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return page

    yield open_report
    context.close()


def _edges(page: Page) -> tuple[list[float], list[float]]:
    """Return the time at the left and at the right edge of each plot, read with the mouse in that very plot.

    The legends of the other plots would not do: they follow the cursor's time, whatever their own plot shows.
    """
    left: list[float] = []
    right: list[float] = []
    for plot in page.locator("figure:has(.u-over)").all():
        plot.scroll_into_view_if_needed()
        box = plot.locator(".u-over").bounding_box()
        assert box is not None
        for x, times in ((1.0, left), (box["width"] - 1.0, right)):
            page.mouse.move(box["x"] + x, box["y"] + 20.0)
            page.mouse.move(box["x"] + x, box["y"] + 30.0)
            times.append(float(plot.locator(".u-series:first-child .u-value").inner_text().removesuffix(" s")))
    page.locator("#plot-gyro-bias").scroll_into_view_if_needed()
    return left, right


def _drag(page: Page, first: float, last: float) -> None:
    """Drag across the gyro plot, from one share of its width to another."""
    box = page.locator("#plot-gyro-bias .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + first * box["width"], box["y"] + 40.0)
    page.mouse.down()
    page.mouse.move(box["x"] + last * box["width"], box["y"] + 60.0, steps=5)
    page.mouse.up()


def test_every_plot_is_drawn_without_a_complaint(make_result: Make, open_page: Open, complaints: list[str]) -> None:
    page = open_page(render_report(make_result(), title="field-07.csv"))
    pixels = page.evaluate(CURVE_PIXELS)
    assert len(pixels) == 6
    # A line across a plot of more than 500 pixels, 1.6 wide; where it lies between two rows, antialiasing takes half.
    assert min(pixels) > 400
    box = page.evaluate("() => { const b = document.querySelector('.track').getBBox(); return [b.width, b.height]; }")
    assert min(box) > 1000.0  # tenths of a pixel: at least 100 of the 500 pixels of the drawing
    assert page.evaluate("() => window.violations") == []
    assert complaints == []


def test_the_plots_of_the_navigation_belong_to_the_others(
    make_navigated: Make, open_page: Open, complaints: list[str]
) -> None:
    page = open_page(render_report(make_navigated(), title="t"))
    pixels = page.evaluate(CURVE_PIXELS)
    assert len(pixels) == 8
    # The first curve of the sigma, the IMU's, lies under that of the reference point; see above for the number.
    assert min(pixels[1:]) > 400
    page.locator("#plot-gyro-bias").scroll_into_view_if_needed()
    _drag(page, 0.2, 0.5)
    page.get_by_role("button", name="Show all").wait_for(state="visible")
    assert _edges(page)[0] == pytest.approx([180.0] * 8, abs=4.0)
    # The corridor stays within the axes, and the path's own lines have their colours.
    strokes = page.evaluate(
        "() => ['.track', '.coast', '.corridor'].map(n => getComputedStyle(document.querySelector(n)).stroke)"
    )
    assert strokes == ["rgb(0, 114, 178)", "rgb(199, 119, 0)", "rgb(199, 119, 0)"]
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    assert page.evaluate("() => window.violations") == []
    assert complaints == []


def test_hostile_names_do_nothing(
    make_result: Make,
    make_reference: Callable[[Result], dict[str, FloatArray]],
    open_page: Open,
    complaints: list[str],
) -> None:
    result = make_result(
        events=(Event(code="W_GAP", count=1, detail=HOSTILE),),
        log_info={**make_result().log_info, "source": HOSTILE, "completeness": HOSTILE},
        params={HOSTILE: HOSTILE},
        method=HOSTILE,
    )
    page = open_page(render_report(result, title=HOSTILE, reference=make_reference(result)))
    assert page.title() == HOSTILE
    assert page.locator(".source").inner_text() == HOSTILE
    assert page.locator("img").count() == 0
    assert page.evaluate("() => window.violations") == []
    assert complaints == []


def test_the_policy_stops_what_escaping_might_miss(make_result: Make, open_page: Open) -> None:
    """The control of the two tests above: a script that gets into the page does not run, and we would see it."""
    page = open_page(render_report(make_result(), title="t"))
    page.evaluate(
        """() => {
          const script = document.createElement('script');
          script.textContent = 'window.intruder = true';
          document.body.append(script);
        }"""
    )
    page.wait_for_function("() => window.violations.length > 0")
    assert page.evaluate("() => window.intruder") is None
    assert page.evaluate("() => window.violations") == ["script-src-elem"]


def test_all_plots_zoom_together_and_back(make_result: Make, open_page: Open, complaints: list[str]) -> None:
    page = open_page(render_report(make_result(duration=900.0), title="t"))
    reset = page.get_by_role("button", name="Show all")
    assert reset.is_hidden()
    left, right = _edges(page)
    # The legends show the nearest drawn sample: the buckets are 1 s wide, and a pixel is 1.7 s.
    assert left == pytest.approx([0.0] * 6, abs=4.0)
    assert right == pytest.approx([900.0] * 6, abs=4.0)

    _drag(page, 0.2, 0.5)
    reset.wait_for(state="visible")
    left, right = _edges(page)
    assert left == pytest.approx([180.0] * 6, abs=4.0)
    assert right == pytest.approx([450.0] * 6, abs=4.0)

    page.locator("#plot-gyro-bias .u-over").dblclick()
    reset.wait_for(state="hidden")
    assert _edges(page)[1] == pytest.approx([900.0] * 6, abs=4.0)

    _drag(page, 0.5, 0.9)
    reset.wait_for(state="visible")
    reset.click()
    reset.wait_for(state="hidden")
    assert _edges(page)[0] == pytest.approx([0.0] * 6, abs=4.0)
    assert complaints == []


def test_the_cursor_marks_its_time_on_the_path(make_result: Make, open_page: Open) -> None:
    page = open_page(render_report(make_result(), title="t"))
    mark = "() => ['cx', 'cy'].map(name => parseFloat(document.getElementById('path-cursor').getAttribute(name)))"
    start = "() => ['cx', 'cy'].map(name => parseFloat(document.querySelector('circle.mark-start').getAttribute(name)))"
    assert page.evaluate(mark) == [-20.0, -20.0]
    page.locator("#plot-gyro-bias").scroll_into_view_if_needed()
    box = page.locator("#plot-gyro-bias .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 60.0, box["y"] + 20.0)
    page.mouse.move(box["x"] + 1.0, box["y"] + 20.0)
    # At most two pixels of the plot from the start, 3.5 s at 2.2 m/s: 8 m; a pixel of the drawing is about 0.6 m.
    assert page.evaluate(mark) == pytest.approx(page.evaluate(start), abs=15.0)


def test_the_tables_read_without_scripts(make_result: Make, browser: Browser, tmp_path: Path) -> None:
    file = tmp_path / "report.html"
    file.write_text(render_report(make_result(), title="t"), encoding="utf-8")
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(file.as_uri())
    assert page.locator("table.bias .value").count() == 6
    assert page.locator("noscript .banner").is_visible()
    assert page.locator(".hint").is_hidden()
    context.close()


def test_it_prints_on_three_pages_and_comes_back(make_result: Make, open_page: Open, complaints: list[str]) -> None:
    page = open_page(render_report(make_result(), title="t"))
    on_screen = page.evaluate(WIDTHS)
    pdf = page.pdf(format="A4")
    assert pdf.count(b"/Type /Page\n") == 3
    assert page.evaluate(WIDTHS) == on_screen
    assert complaints == []


def test_plots_are_redrawn_for_paper_while_printing(make_result: Make, open_page: Open) -> None:
    """A dark screen, a white sheet: the browser's print events make the plots fit A4 and take the light colours."""
    page = open_page(render_report(make_result(), title="t"))
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"() => ({CURVE_PIXELS})().every(count => count === 0)")
    on_screen = page.evaluate(WIDTHS)
    page.evaluate("() => window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(WIDTHS) == [688.0] * 6  # px; A4 less its margins, 184 mm, is 695 px
    assert min(page.evaluate(CURVE_PIXELS)) > 400
    page.evaluate("() => window.dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(WIDTHS) == on_screen
    assert max(page.evaluate(CURVE_PIXELS)) == 0


def test_a_start_up_peak_leaves_the_curves_apart(make_result: Make, open_page: Open) -> None:
    """A bias that starts 50 deg/s off must not press the three curves into one line."""
    bias = make_result().gyro_bias.copy()
    bias[100:110, 0] = np.radians(50.0)
    page = open_page(render_report(make_result(gyro_bias=bias), title="t"))
    # The middle row of the right half's pixels in the colour of x (#0072b2), and of y (#d55e00).
    rows = page.evaluate(
        """() => {
          const canvas = document.querySelector('#plot-gyro-bias canvas');
          const p = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
          return [[0, 114, 178], [213, 94, 0]].map(wanted => {
            const found = [];
            for (let i = 0; i < p.length; i += 4) {
              const near = wanted.every((value, k) => Math.abs(p[i + k] - value) < 40);
              if (near && p[i + 3] > 200 && (i / 4) % canvas.width > canvas.width / 2)
                found.push(Math.floor(i / 4 / canvas.width));
            }
            return found[Math.floor(found.length / 2)];
          });
        }"""
    )
    # 0.43 deg/s apart in a view of about 0.9 deg/s and 180 pixels: 90; in one of 50 deg/s it would be 2.
    assert rows[1] - rows[0] > 50
