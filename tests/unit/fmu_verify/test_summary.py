"""The summary of a report that CI systems show, whatever names and sentences FMUs bring."""

from html import unescape
from typing import Any

import pytest
from markdown_it import MarkdownIt

from fmu_verify.check import Verdict, failed
from fmu_verify.ci_summary import format_ci_summary
from tests.support.reports import examined, finding, ordinary, report


def one_failure(text: str) -> dict[str, Any]:
    """A report of one FMU that fails one check, with a text as its name and its sentence."""
    report_ = report(examined("x.fmu", [finding("state.restored", failed(text))])).as_dict()
    report_["examined"][0]["name"] = text
    return report_


def render_markdown(text: str) -> str:
    """Render a text as GitHub does, which knows tables and some HTML."""
    return MarkdownIt("commonmark", {"html": True}).enable("table").render(text)


def test_counts_and_failures_are_shown() -> None:
    text = format_ci_summary(ordinary().as_dict())
    (headline,) = [x for x in text.splitlines() if x.startswith("| | FMU")]
    names = [name.strip().removesuffix("s") for name in headline.split("|")][3:7]
    assert names == [v.value.removesuffix("s") for v in Verdict]
    assert "| ❌ | build/Plant.fmu | 1 | 1 | 2 | 1 | 1.5 |" in text
    assert "| ✅ | other/Plant.fmu | 2 |  |  |  | 1.5 |" in text
    page = unescape(render_markdown(text))
    assert page.count("<tr>") == 3 and page.count("<li>") == 3
    clause = "FMI 2.0.4, 2.1.5: “The function returns a new instance of an FMU.”"
    assert f"<strong>state.restored</strong> x is 2 where it was 1.<br>{clause}" in page


@pytest.mark.parametrize(
    "odd",
    [
        "a|b",
        'it\'s "so"',
        "<script>alert(1)</script>",
        "[x](javascript:1) ![y](z)",
        "one\n\n# two\n- three",
        "`code` *strong* _it_ ~~no~~ \\| &lt;",
        "@everyone :tada: https://example.com",
    ],
)
def test_texts_are_escaped(odd: str) -> None:
    page, plain = (render_markdown(format_ci_summary(one_failure(text))) for text in (odd, "plain"))
    assert page.count("<") == plain.count("<")  # no element more
    assert unescape(page).count(" ".join(odd.split())) == 3


def test_large_report_stays_below_the_limit_of_github() -> None:
    large = one_failure("long " * 1000)
    large["examined"][0]["findings"] *= 500
    large["examined"] *= 500
    text = format_ci_summary(large)
    assert len(text.encode()) < 2**20
    assert "and 300 more" in text and "and 249900 more" in text
