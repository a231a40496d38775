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

from .verdict import Verdict

_MOST_ROWS = 200
_MOST_FINDINGS = 100
"""Most findings of each verdict. GitHub rejects summaries of more than 1 MiB."""

_LONGEST = 500
_SIGNS = {Verdict.FAILED: "❌", Verdict.WARNING: "⚠️", Verdict.PASSED: "✅", Verdict.SKIPPED: "⏭️"}


def format_ci_summary(report: Mapping[str, Any]) -> str:
    """Return a table of the FMUs and a list of their failures and warnings.

    Args:
        report: The result of `Report.as_dict`.
    """
    verdict = Verdict.PASSED if report["passed"] else Verdict.FAILED
    lines = [f"## {_SIGNS[verdict]} FMUs {verdict}", "", *_table(report["examined"]), ""]
    for kind in (Verdict.FAILED, Verdict.WARNING):
        found = [(one, f) for one in report["examined"] for f in one["findings"] if f["verdict"] == kind]
        lines += [_item(kind, one, finding) for one, finding in found[:_MOST_FINDINGS]]
        if len(found) > _MOST_FINDINGS:
            lines.append(f"- {_SIGNS[kind]} and {len(found) - _MOST_FINDINGS} more")
    for one in report["examined"]:
        lines += [
            f"- {_SIGNS[Verdict.FAILED]} {_text(one['name'])}: {_text(o)}" for o in one.get("objections", ())
        ]
    return "\n".join([*lines, "", f"{_text(report['made_by'])}, {_text(report['started'])}", ""])


def _table(examined: list[dict[str, Any]]) -> Iterator[str]:
    yield "| | FMU | passed | warnings | failed | skipped | time / s |"
    yield "|---|---|---:|---:|---:|---:|---:|"
    for one in examined[:_MOST_ROWS]:
        verdicts = [finding["verdict"] for finding in one["findings"]]
        counts = " | ".join(str(verdicts.count(v) or "") for v in Verdict)
        sign = _SIGNS[Verdict.FAILED if one.get("objections") else Verdict(one["verdict"])]
        yield f"| {sign} | {_text(one['name'])} | {counts} | {one['seconds']:.1f} |"
    if len(examined) > _MOST_ROWS:
        yield f"| | and {len(examined) - _MOST_ROWS} more | | | | | |"


def _item(kind: Verdict, one: dict[str, Any], finding: dict[str, Any]) -> str:
    said = f"{_text(one['name'])}: **{_text(finding['check'])}** {_text(finding['sentence'])}"
    if kind == Verdict.FAILED:
        clause = finding["clause"]
        said += f"<br>{_text(clause['document'])}, {_text(clause['section'])}: “{_text(clause['sentence'])}”"
        said += f"<br>{_text(finding['hint'])}"
    return f"- {_SIGNS[kind]} {said}"


def _text(text: object) -> str:
    """Escape Markdown and HTML in a text, and shorten it to one line."""
    line = " ".join(shorten_text(make_visible(text), _LONGEST).split())
    line = html.escape(line, quote=False)  # entities of quotation marks have a #, which is escaped below
    return re.sub(r"[\\`*_{}\[\]()#+!|~@:]", lambda found: f"&#{ord(found[0])};", line)


def main() -> None:
    """Print the summary of the JSON report in the first argument."""
    report = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    sys.stdout.reconfigure(encoding="utf-8")  # pyright: ignore[reportAttributeAccessIssue]
    sys.stdout.write(format_ci_summary(report))


if __name__ == "__main__":
    main()
