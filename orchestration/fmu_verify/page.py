"""Write the report as one HTML page, searchable, with plots of results and references."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from typing import Any

from emla_cosim.pages.comparisons import build_comparison_rows
from emla_cosim.pages.page import Plots, render_template

from .check import Verdict
from .findings import Examined, Finding, Findings, find_worst, format_command, shorten_names

_MOST_ROWS = 200
"""Most findings and FMUs in a cell of a notebook."""


def render(report: Findings) -> str:
    """Return the HTML of the page."""
    plots = Plots()
    names = shorten_names([examined.label for examined in report.examined])
    parts = [
        _FmuPart(k, examined, name, plots)
        for k, (examined, name) in enumerate(zip(report.examined, names, strict=True), 1)
    ]
    groups = list(dict.fromkeys(group for part in parts for group in part.groups))
    return render_template(
        __package__ or "",
        "page.html",
        plots,
        report=report,
        parts=parts,
        groups=groups,
        verdicts=list(Verdict),
        headline=describe_verdict(report),
        thing=_name_subject(report),
        started=_format_time(report.started),
        seconds=sum(examined.seconds for examined in report.examined),
    )


def render_cell(report: Findings) -> str:
    """Return the HTML for a cell of a notebook, with failed checks and warnings."""
    return render_template(
        __package__ or "",
        "report_cell.html",
        Plots(),
        report=report,
        headline=describe_verdict(report),
        verdicts=list(Verdict),
        findings=[
            (examined, verdict, finding)
            for examined in report.examined
            for verdict in (Verdict.FAILED, Verdict.WARNING)
            for finding in examined.of(verdict)
        ],
        most=_MOST_ROWS,
    )


class _FmuPart:
    """One FMU, for the template of the page."""

    def __init__(self, index: int, examined: Examined, name: str, plots: Plots) -> None:
        self.id, self.examined, self.name = f"fmu-{index}", examined, name
        self.rows = [
            _FindingRow(f"{self.id}-{_make_id(f.check)}", f, plots, format_command(examined, f))
            for f in examined.findings
        ]

    @property
    def verdict(self) -> Verdict:
        """The worst verdict."""
        return _find_worst(self.rows)

    @property
    def counts(self) -> Counter[Verdict]:
        """The number of checks with each verdict."""
        return Counter(row.finding.verdict for row in self.rows)

    @cached_property
    def groups(self) -> dict[str, "_CheckGroup"]:
        """Findings by group of checks."""
        rows_by_group: dict[str, list[_FindingRow]] = {}
        for row in self.rows:
            rows_by_group.setdefault(row.finding.check.partition(".")[0], []).append(row)
        return {n: _CheckGroup(f"{self.id}-{_make_id(n)}-checks", rows) for n, rows in rows_by_group.items()}


@dataclass(frozen=True)
class _CheckGroup:
    """Findings of one group of checks about one FMU."""

    id: str
    rows: Sequence["_FindingRow"]

    @property
    def verdict(self) -> Verdict:
        """The worst verdict."""
        return _find_worst(self.rows)

    @property
    def count(self) -> int:
        """The number of checks with the worst verdict."""
        return sum(row.finding.verdict == self.verdict for row in self.rows)


class _FindingRow:
    """One finding."""

    def __init__(self, name: str, finding: Finding, plots: Plots, repeat: str) -> None:
        self.id, self.finding, self.outcome, self.repeat = name, finding, finding.outcome, repeat
        self.signals = build_comparison_rows(self.outcome.comparisons, plots)

    @property
    def shows_hint(self) -> bool:
        """Whether the page shows the hint."""
        return self.finding.verdict in (Verdict.FAILED, Verdict.WARNING) and bool(self.finding.hint)


def _find_worst(rows: Sequence[_FindingRow]) -> Verdict:
    return find_worst([row.finding for row in rows])


def _make_id(name: str) -> str:
    """Replace the characters that an HTML id must not have."""
    return re.sub(r"[^\w.-]", "_", name)


def describe_verdict(report: Findings) -> str:
    """Return the verdict on all FMUs as a message without a full stop."""
    count, thing = len(report.examined), _name_subject(report)
    failed_count = sum(not examined.passed for examined in report.examined)
    who = f"{failed_count} of {count} {thing}s" if 0 < failed_count < count else f"All {count} {thing}s"
    who = f"The {thing}" if count == 1 else who
    message = f"{who} {'failed' if failed_count else 'passed'}"
    return message if report.complete else f"Interrupted: {message[0].lower()}{message[1:]}"


def _name_subject(report: Findings) -> str:
    """Return what was examined: `FMU` or `system`."""
    systems = [examined.path.suffix.lower() not in ("", ".fmu") for examined in report.examined]
    return "system" if systems and all(systems) else "FMU"


def _format_time(text: str) -> dict[str, Any]:
    """Format an ISO time for machines and for people; keep any other text."""
    try:
        people = datetime.fromisoformat(text).strftime("%d %B %Y, %H:%M %Z").lstrip("0")
        return {"machine": text, "people": people}
    except ValueError:
        return {"machine": None, "people": text}
