"""The report of `verify`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import json_file
from .findings import Findings
from .report_files import REPORT_FILES


@dataclass(frozen=True, repr=False)
class Report(Findings):
    """Findings of `verify`. `report["x.fmu"]` has those of one FMU."""

    def __repr__(self) -> str:
        """Return one line: the verdict, and how many checks have each."""
        from .page import describe_verdict

        counts = ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items())
        return f"<Report: {describe_verdict(self)}; checks: {counts or 'none'}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: verdict, failed checks and warnings, and a row for each FMU."""
        from .page import render_cell

        return render_cell(self)

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain data, as `save_json` writes it."""
        return json_file.as_dict(self)

    def save_json(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as JSON.

        Args:
            path: path of the file.
            overwrite: replace a file that emla did not write.

        Raises:
            CommandError: the file must not be written.
            RunError: writing fails.
        """
        REPORT_FILES["json"].save(self, Path(path), overwrite)

    def save_junit(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as JUnit XML, which CI systems display; arguments as of `save_json`."""
        REPORT_FILES["junit"].save(self, Path(path), overwrite)

    def save_sarif(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as SARIF 2.1.0, for code scanning; arguments as of `save_json`."""
        REPORT_FILES["sarif"].save(self, Path(path), overwrite)

    def save_html(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as one HTML page without external files; arguments as of `save_json`."""
        REPORT_FILES["html"].save(self, Path(path), overwrite)

    def save_badge(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the verdict as a badge, an SVG image; arguments as of `save_json`."""
        REPORT_FILES["badge"].save(self, Path(path), overwrite)
