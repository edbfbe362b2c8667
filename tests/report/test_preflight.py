"""The report's section on the preflight: every finding with its verdict, in words that cannot become markup."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

import levelhead as lh
from levelhead.estimators.base import Result
from levelhead.preflight import Finding, Verdict
from levelhead.report.html import render_report
from levelhead.report.preflight import STYLES, preflight_section
from samples.strange_logs import BACK_RIGHT_UP, in_axes, in_degrees, late, unsaid

if TYPE_CHECKING:
    from playwright.sync_api import Browser

Make = Callable[..., Result]
HOSTILE = "</td></table><script>alert(1)</script><img src=x onerror=alert(2)>&\"'"


def with_findings(result: Result, *findings: Finding) -> Result:
    about = {**result.log_info, "preflight": {"findings": [finding.as_dict() for finding in findings]}}
    return replace(result, log_info=about)


def text_of(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page)).strip()


def test_a_log_that_was_not_checked_has_no_section(make_result: Make) -> None:
    result = make_result(duration=60.0)
    assert preflight_section(result) == ""
    assert 'id="preflight"' not in render_report(result, title="t")
    odds: list[object] = [None, "text", [], {"findings": None}, {"findings": []}, {"findings": "text"}]
    for odd in odds:
        assert preflight_section(replace(result, log_info={"preflight": odd})) == ""


def test_every_finding_is_a_row_with_its_verdict(make_result: Make) -> None:
    findings = [
        Finding(name=f"thing {verdict}", verdict=verdict, text=f"It is {verdict} by 3 +- 1.") for verdict in Verdict
    ]
    page = preflight_section(with_findings(make_result(duration=60.0), *findings))
    assert page.count("<tr>") == len(findings) + 1
    assert set(STYLES) == set(Verdict)
    for verdict in Verdict:
        chip = f'<td class="{STYLES[verdict]}"><span class="chip">{verdict}</span></td>'
        assert f'<th scope="row">thing {verdict}</th>{chip}' in page
        assert f"It is {verdict} by 3 +- 1." in page


@pytest.mark.parametrize(
    ("corrected", "undecided", "lead"),
    [
        (0, 0, "Everything was as the log says."),
        (1, 0, "1 thing was put right before the biases were estimated."),
        (3, 0, "3 things were put right before the biases were estimated."),
        (0, 1, "Nothing was put right. 1 thing the drive could not tell."),
        (1, 2, "1 thing was put right before the biases were estimated. 2 things the drive could not tell."),
    ],
)
def test_the_lead_counts_what_was_put_right(corrected: int, undecided: int, lead: str, make_result: Make) -> None:
    findings = [Finding(name=f"n{k}", verdict=Verdict.CORRECTED, text="Put right.") for k in range(corrected)]
    findings += [Finding(name=f"u{k}", verdict=Verdict.UNDECIDED, text="Not certain.") for k in range(undecided)]
    findings.append(Finding(name="gaps", verdict=Verdict.FINE, text="None."))
    assert f'<p class="lead">{lead}</p>' in preflight_section(with_findings(make_result(duration=60.0), *findings))


def test_everything_is_escaped(make_result: Make) -> None:
    hostile = {"name": HOSTILE, "verdict": HOSTILE, "text": HOSTILE, "code": HOSTILE}
    result = replace(make_result(duration=60.0), log_info={"preflight": {"findings": [hostile, "no finding"]}})
    page = preflight_section(result)
    assert "<script" not in page
    assert "<img" not in page
    assert page.count("</table>") == 1
    assert page.count("&lt;script&gt;alert(1)&lt;/script&gt;") == 3


def checked_page() -> tuple[str, Mapping[str, object]]:
    log = lh.simulate("windrower", seed=1, duration=240.0, speed=7.0)[0]
    log = unsaid(late(in_degrees(in_axes(log, BACK_RIGHT_UP)), 0.2))
    log = replace(log, meta={**log.meta, "compensated": f"Taken off by {HOSTILE}."})
    found = lh.check(log)
    result = lh.estimate(found.trusted())
    return render_report(result, title=HOSTILE), found.as_dict()


def test_the_report_of_a_checked_drive_tells_all_findings() -> None:
    page, content = checked_page()
    words = text_of(page)
    findings = content["findings"]
    assert isinstance(findings, list)
    for finding in findings:
        assert str(finding["name"]) in words
    assert "Forward, right, down are -x,y,-z of the file" in words
    assert "3 things were put right" in words
    assert "<script>alert" not in page
    assert "<img src=x" not in page


def test_hostile_findings_run_nothing_in_a_browser(browser: Browser) -> None:
    page = browser.new_page()
    dialogs: list[str] = []

    def dismiss(dialog: object) -> None:
        dialogs.append(str(dialog))

    page.on("dialog", dismiss)
    page.set_content(checked_page()[0])
    assert page.locator("section[aria-labelledby=preflight] table.findings tbody tr").count() > 10
    assert HOSTILE in page.locator("section[aria-labelledby=preflight]").inner_text()
    assert dialogs == []
    page.close()
