"""What Python shows of the result of an analysis: its report, as the terminal and the page have it."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .report import Report


class ReportedResult:
    """Base of results with a report: that of `build_report` in the module `report` beside their class."""

    def _build_report(self) -> "Report":
        # imported on first use: it needs the class of the result, and loads what only reports need
        return import_module(".report", type(self).__module__.rpartition(".")[0]).build_report(self)

    def __repr__(self) -> str:
        """Return one line: the kind of analysis, its name, and short facts."""
        report = self._build_report()
        return f"<{report.kind} of {report.name}: {', '.join(report.facts)}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the report without its pictures, which `plot` draws."""
        from ...pages.page import Plots, render_template  # importing it loads jinja2

        return render_template(__package__ or "", "report_cell.html", Plots(), report=self._build_report())
