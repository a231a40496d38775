"""The summary of a report that CI systems show, whatever names and sentences FMUs bring."""

from html import unescape
from typing import Any

import pytest
from markdown_it import MarkdownIt

from emla_cosim.verification.ci_summary import format_ci_summary
from emla_cosim.verification.verdict import Verdict


def report(
    name: str = "build/x.fmu", sentence: str = "It is so.", verdicts: str = "passed"
) -> dict[str, Any]:
    """A report of one FMU with a finding for each of the verdicts."""
    findings = [
        {
            "check": "state.restored",
            "verdict": verdict,
            "sentence": sentence,
            "hint": "Look there.",
            "clause": {"document": "FMI 2.0.4", "section": "2.1.8", "sentence": "It has to be so."},
        }
        for verdict in verdicts.split()
    ]
    worst = "failed" if "failed" in verdicts else "passed"
    one = {"name": name, "verdict": worst, "seconds": 1.26, "findings": findings}
    about = {"made_by": "emla-cosim 0.1.0", "started": "2026-01-31T12:00:00+00:00"}
    return {"passed": worst == "passed", "examined": [one], **about}


def shown(text: str) -> str:
    """As GitHub shows it, which knows tables and some HTML."""
    return MarkdownIt("commonmark", {"html": True}).enable("table").render(text)


def test_counts_and_failures_are_shown() -> None:
    text = format_ci_summary(report(verdicts="passed passed warning failed skipped"))
    assert "| ❌ | build/x.fmu | 2 | 1 | 1 | 1 | 1.3 |" in text
    page = shown(text)
    assert page.count("<tr>") == 2 and page.count("<li>") == 2
    assert "<strong>state.restored</strong> It is so.<br>FMI 2.0.4, 2.1.8: “It has to be so.”" in unescape(
        page
    )


@pytest.mark.parametrize(
    "odd",
    [
        "a|b",
        "<script>alert(1)</script>",
        "[x](javascript:1) ![y](z)",
        "one\n\n# two\n- three",
        "`code` *strong* _it_ ~~no~~ \\| &lt;",
        "@everyone :tada: https://example.com",
    ],
)
def test_texts_are_escaped(odd: str) -> None:
    page = shown(format_ci_summary(report(odd, odd, "failed")))
    plain = shown(format_ci_summary(report("plain", "plain", "failed")))
    assert page.count("<") == plain.count("<")  # no element more
    assert unescape(page).count(" ".join(odd.split())) == 3


def test_large_report_stays_below_the_limit_of_github() -> None:
    large = report(sentence="long " * 1000, verdicts="failed " * 500)
    large["examined"] *= 500
    text = format_ci_summary(large)
    assert len(text.encode()) < 2**20
    assert "and 300 more" in text and "and 249900 more" in text


def test_every_verdict_has_a_column() -> None:
    """In the order of the headline."""
    (headline,) = [x for x in format_ci_summary(report()).splitlines() if x.startswith("| | FMU")]
    names = [name.strip() for name in headline.split("|")][3:7]
    assert [n.removesuffix("s") for n in names] == [v.value.removesuffix("s") for v in Verdict]
