"""The report of `verify`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import json_file
from .findings import Findings


@dataclass(frozen=True)
class Report(Findings):
    """Findings of `verify`. `report["x.fmu"]` has those of one FMU."""

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
        json_file.save(self, Path(path), overwrite)

    def save_junit(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as JUnit XML, which CI systems display.

        Args:
            path: path of the file.
            overwrite: replace a file that emla did not write.

        Raises:
            CommandError: the file must not be written.
            RunError: writing fails.
        """
        from .junit import save

        save(self, Path(path), overwrite)

    def save_html(self, path: str | Path, overwrite: bool = False) -> None:
        """Write the report as one HTML page without external files.

        Args:
            path: path of the file.
            overwrite: replace a file that emla did not write.

        Raises:
            CommandError: the file must not be written.
            RunError: writing fails.
        """
        from .page import save

        save(self, Path(path), overwrite)
