"""What Python shows of the result of an analysis: its report, as the terminal and the page have it."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .report import Report


class ReportedResult(ABC):
    """Base of results with a report."""

    @abstractmethod
    def _build_report(self) -> "Report":
        """Return the report of this result."""

    def __repr__(self) -> str:
        """Return one line: the kind of analysis, its name, and short facts."""
        report = self._build_report()
        return f"<{report.kind} of {report.name}: {', '.join(report.facts)}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the report without its pictures, which `plot` draws."""
        from ...pages.page import Plots, render_template  # importing it loads jinja2

        return render_template(__package__ or "", "report_cell.html", Plots(), report=self._build_report())
