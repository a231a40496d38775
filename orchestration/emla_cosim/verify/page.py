"""The report as one page for people: searchable, with plots of results beside references."""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..report.page import Plots, rendered
from ..report.plot import Band, Line, Plot
from ..report.writing import write_text
from ..tubes.comparison import Comparison
from .labels import labels
from .verdict import Verdict

if TYPE_CHECKING:
    from .report import Examined, Finding, Report

_OPEN_PLOTS = 3
"""Signals of a finding whose plots are open from the beginning, where so many left their tubes."""


def save(report: "Report", path: Path) -> None:
    """Write it. Raises CommandError and RunError as `write_text`."""
    write_text(page(report), path, "the HTML report")


def page(report: "Report") -> str:
    """The text of the page."""
    plots = Plots()
    names = labels([one.label for one in report.examined])
    parts = [
        _Part(k, one, name, plots)
        for k, (one, name) in enumerate(zip(report.examined, names, strict=True), 1)
    ]
    groups = list(dict.fromkeys(group for part in parts for group in part.groups))
    return rendered(
        __package__ or "",
        "page.html",
        plots,
        report=report,
        parts=parts,
        groups=groups,
        verdicts=list(Verdict),
        headline=_headline(report),
        thing=_thing(report),
        started=_moment(report.started),
        seconds=sum(one.seconds for one in report.examined),
    )


class _Part:
    """One FMU, as the page's template wants it."""

    def __init__(self, index: int, one: "Examined", name: str, plots: Plots) -> None:
        self.id, self.one, self.name = f"fmu-{index}", one, name
        self.rows = [_Row(f"{self.id}-{_word(f.check)}", f, plots) for f in one.findings]

    @property
    def verdict(self) -> Verdict:
        """The one that decides."""
        return _worst(self.rows)

    @property
    def counts(self) -> Counter[Verdict]:
        """How many checks ended in which way."""
        return Counter(row.finding.verdict for row in self.rows)

    @cached_property
    def groups(self) -> dict[str, "_Group"]:
        """Findings by the first part of their checks' names."""
        found: dict[str, list[_Row]] = {}
        for row in self.rows:
            found.setdefault(row.finding.check.partition(".")[0], []).append(row)
        return {name: _Group(f"{self.id}-{_word(name)}-checks", rows) for name, rows in found.items()}


@dataclass(frozen=True)
class _Group:
    """Findings of one kind about one FMU."""

    id: str
    rows: Sequence["_Row"]

    @property
    def verdict(self) -> Verdict:
        """The one that decides."""
        return _worst(self.rows)

    @property
    def count(self) -> int:
        """How many checks ended with the verdict that decides."""
        return sum(row.finding.verdict == self.verdict for row in self.rows)


class _Row:
    """One finding."""

    def __init__(self, name: str, finding: "Finding", plots: Plots) -> None:
        self.id, self.finding, self.outcome = name, finding, finding.outcome
        ordered = sorted(self.outcome.comparisons, key=_urgency)
        many = sum(not one.inside for one in ordered)
        self.signals = [
            _Signal(one, plots.add(_plot(one)), k < max(1, min(many, _OPEN_PLOTS)))
            for k, one in enumerate(ordered)
        ]

    @property
    def advised(self) -> bool:
        """Whether there is something to be done about it."""
        return self.finding.verdict in (Verdict.FAILED, Verdict.WARNING) and bool(self.finding.hint)


@dataclass(frozen=True)
class _Signal:
    """One signal beside its reference, its plot, and whether that is shown without being asked for."""

    comparison: Comparison
    plot: str
    open: bool

    @property
    def share(self) -> float | None:
        """The worst deviation as a part of the tube's width; None where that is no number."""
        return _share(self.comparison)


def _share(one: Comparison) -> float | None:
    share = abs(one.worst) / one.tube.value if one.tube.value > 0 else math.nan
    return share if math.isfinite(share) else None


def _urgency(one: Comparison) -> tuple[bool, float]:
    """What left its tube stands first, by when it did; then what came nearest to an edge."""
    if one.left_at is not None:
        return False, one.left_at
    return True, -(_share(one) or 0.0)


def _plot(one: Comparison) -> Plot:
    return Plot(
        one.unit,
        (
            Line("result", one.time, one.values, "blue" if one.inside else "red"),
            Line("reference", one.reference_time, one.reference, "grey", dashed=True),
        ),
        Band("tube", one.time, one.lower, one.upper),
        mark=(one.worst_at, "worst"),
        since=None if one.left_at is None else (one.left_at, "left the tube"),
        against=1,
    )


def _worst(rows: Sequence[_Row]) -> Verdict:
    from .report import worst

    return worst([row.finding for row in rows])


def _word(name: str) -> str:
    """As an id of HTML may be."""
    return re.sub(r"[^\w.-]", "_", name)


def _headline(report: "Report") -> str:
    count, thing = len(report.examined), _thing(report)
    bad = sum(not one.passed for one in report.examined)
    how = "failed" if bad else "passed"
    if count == 1:
        return f"The {thing} {how}"
    return f"{bad} of {count} {thing}s {how}" if 0 < bad < count else f"All {count} {thing}s {how}"


def _thing(report: "Report") -> str:
    """What was examined: FMUs, or systems."""
    systems = [one.path.suffix.lower() not in ("", ".fmu") for one in report.examined]
    return "system" if systems and all(systems) else "FMU"


def _moment(text: str) -> dict[str, Any]:
    """A time for people; as it is where it is none."""
    try:
        return {
            "machine": text,
            "people": datetime.fromisoformat(text).strftime("%d %B %Y, %H:%M %Z").lstrip("0"),
        }
    except ValueError:
        return {"machine": None, "people": text}
