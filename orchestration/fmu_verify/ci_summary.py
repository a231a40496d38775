"""Summarize a report as Markdown for the summary page of a CI run.

python -m fmu_verify.ci_summary report.json >> "$GITHUB_STEP_SUMMARY"
"""

import html
import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from emla_cosim.pages.text import make_visible, shorten_text

from .check import Verdict

_MOST_ROWS = 200
# Most findings of each verdict. GitHub rejects summaries of more than 1 MiB.
_MOST_FINDINGS = 100

_MAX_LENGTH = 500
_SIGNS = {Verdict.FAILED: "❌", Verdict.WARNING: "⚠️", Verdict.PASSED: "✅", Verdict.SKIPPED: "⏭️"}


def format_ci_summary(report: Mapping[str, Any]) -> str:
    """Return a table of the FMUs and a list of their failures and warnings.

    Args:
        report: The result of `Report.as_dict`.
    """
    verdict = Verdict.PASSED if report["passed"] else Verdict.FAILED
    lines = [f"## {_SIGNS[verdict]} FMUs {verdict}", "", *_format_table(report["examined"]), ""]
    for kind in (Verdict.FAILED, Verdict.WARNING):
        findings = [
            (examined, f)
            for examined in report["examined"]
            for f in examined["findings"]
            if f["verdict"] == kind
        ]
        lines += [_format_item(kind, examined, finding) for examined, finding in findings[:_MOST_FINDINGS]]
        if len(findings) > _MOST_FINDINGS:
            lines.append(f"- {_SIGNS[kind]} and {len(findings) - _MOST_FINDINGS} more")
    for examined in report["examined"]:
        lines += [
            f"- {_SIGNS[Verdict.FAILED]} {_escape(examined['name'])}: {_escape(o)}"
            for o in examined.get("objections", ())
        ]
    return "\n".join([*lines, "", f"{_escape(report['made_by'])}, {_escape(report['started'])}", ""])


def _format_table(examined: list[dict[str, Any]]) -> Iterator[str]:
    yield "| | FMU | passed | warnings | failed | skipped | time / s |"
    yield "|---|---|---:|---:|---:|---:|---:|"
    for fmu_report in examined[:_MOST_ROWS]:
        verdicts = [finding["verdict"] for finding in fmu_report["findings"]]
        counts = " | ".join(str(verdicts.count(v) or "") for v in Verdict)
        sign = _SIGNS[Verdict.FAILED if fmu_report.get("objections") else Verdict(fmu_report["verdict"])]
        yield f"| {sign} | {_escape(fmu_report['name'])} | {counts} | {fmu_report['seconds']:.1f} |"
    if len(examined) > _MOST_ROWS:
        yield f"| | and {len(examined) - _MOST_ROWS} more | | | | | |"


def _format_item(kind: Verdict, examined: dict[str, Any], finding: dict[str, Any]) -> str:
    """Return the line of a list for a finding; failures with clause and hint."""
    message = f"{_escape(examined['name'])}: **{_escape(finding['check'])}** {_escape(finding['sentence'])}"
    if kind == Verdict.FAILED:
        clause = finding["clause"]
        document, section, sentence = (_escape(clause[name]) for name in ("document", "section", "sentence"))
        message += f"<br>{document}, {section}: “{sentence}”"
        message += f"<br>{_escape(finding['hint'])}"
    return f"- {_SIGNS[kind]} {message}"


def _escape(text: object) -> str:
    """Escape Markdown and HTML in a text, and shorten it to one line."""
    line = " ".join(shorten_text(make_visible(text), _MAX_LENGTH).split())
    line = html.escape(line, quote=False)  # entities of quotation marks have a #, which is escaped below
    return re.sub(r"[\\`*_{}\[\]()#+!|~@:]", lambda match: f"&#{ord(match[0])};", line)


def main() -> None:
    """Print the summary of the JSON report in the first argument."""
    report = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    sys.stdout.reconfigure(encoding="utf-8")  # pyright: ignore[reportAttributeAccessIssue]
    sys.stdout.write(format_ci_summary(report))


if __name__ == "__main__":
    main()
