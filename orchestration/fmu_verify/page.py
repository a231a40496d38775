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

from .explanation import format_command, shorten_names
from .findings import Examined, Finding, Findings, worst
from .verdict import Verdict

_MOST_ROWS = 200
"""Most findings and FMUs in a cell of a notebook."""


def render(report: Findings) -> str:
    """Return the HTML of the page."""
    plots = Plots()
    names = shorten_names([one.label for one in report.examined])
    parts = [
        _FmuPart(k, one, name, plots)
        for k, (one, name) in enumerate(zip(report.examined, names, strict=True), 1)
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
        thing=_thing(report),
        started=_moment(report.started),
        seconds=sum(one.seconds for one in report.examined),
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

    def __init__(self, index: int, one: Examined, name: str, plots: Plots) -> None:
        self.id, self.one, self.name = f"fmu-{index}", one, name
        self.rows = [
            _FindingRow(f"{self.id}-{_word(f.check)}", f, plots, format_command(one, f)) for f in one.findings
        ]

    @property
    def verdict(self) -> Verdict:
        """The worst verdict."""
        return _worst(self.rows)

    @property
    def counts(self) -> Counter[Verdict]:
        """The number of checks with each verdict."""
        return Counter(row.finding.verdict for row in self.rows)

    @cached_property
    def groups(self) -> dict[str, "_CheckGroup"]:
        """Findings by group of checks."""
        found: dict[str, list[_FindingRow]] = {}
        for row in self.rows:
            found.setdefault(row.finding.check.partition(".")[0], []).append(row)
        return {name: _CheckGroup(f"{self.id}-{_word(name)}-checks", rows) for name, rows in found.items()}


@dataclass(frozen=True)
class _CheckGroup:
    """Findings of one group of checks about one FMU."""

    id: str
    rows: Sequence["_FindingRow"]

    @property
    def verdict(self) -> Verdict:
        """The worst verdict."""
        return _worst(self.rows)

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
    def advised(self) -> bool:
        """Whether to show the hint."""
        return self.finding.verdict in (Verdict.FAILED, Verdict.WARNING) and bool(self.finding.hint)


def _worst(rows: Sequence[_FindingRow]) -> Verdict:
    return worst([row.finding for row in rows])


def _word(name: str) -> str:
    """Replace the characters that an HTML id must not have."""
    return re.sub(r"[^\w.-]", "_", name)


def describe_verdict(report: Findings) -> str:
    """Return the verdict on all FMUs as a sentence without a full stop."""
    said = _verdict_of_all(report)
    return said if report.complete else f"Interrupted: {said[0].lower()}{said[1:]}"


def _verdict_of_all(report: Findings) -> str:
    count, thing = len(report.examined), _thing(report)
    bad = sum(not one.passed for one in report.examined)
    how = "failed" if bad else "passed"
    if count == 1:
        return f"The {thing} {how}"
    return f"{bad} of {count} {thing}s {how}" if 0 < bad < count else f"All {count} {thing}s {how}"


def _thing(report: Findings) -> str:
    """Return what was examined: `FMU` or `system`."""
    systems = [one.path.suffix.lower() not in ("", ".fmu") for one in report.examined]
    return "system" if systems and all(systems) else "FMU"


def _moment(text: str) -> dict[str, Any]:
    """Format an ISO time for machines and for people; keep any other text."""
    try:
        return {
            "machine": text,
            "people": datetime.fromisoformat(text).strftime("%d %B %Y, %H:%M %Z").lstrip("0"),
        }
    except ValueError:
        return {"machine": None, "people": text}
