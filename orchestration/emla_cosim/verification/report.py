"""The report of `verify`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import json_file
from .findings import Findings


@dataclass(frozen=True)
class Report(Findings):
    """The findings of `verify`. `report["x.fmu"]` returns those about one FMU."""

    def as_dict(self) -> dict[str, Any]:
        """Return the report as `save_json` writes it. The module `json_file` describes the fields."""
        return json_file.as_dict(self)

    def save_json(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as JSON for programs.

        Args:
            path: File to write.
            overwrite: Whether to replace a file that is not a JSON report.

        Raises:
            CommandError: The file exists and must not be replaced.
            RunError: Writing fails.
        """
        json_file.save(self, Path(path), overwrite)

    def save_junit(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as JUnit XML for CI systems. Arguments and errors are those of `save_json`."""
        from .junit import save

        save(self, Path(path), overwrite)

    def save_html(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as one HTML page. Arguments and errors are those of `save_json`."""
        from .page import save

        save(self, Path(path), overwrite)
