"""What was found about FMUs, for people and for programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import json_file
from .findings import Findings


@dataclass(frozen=True)
class Report(Findings):
    """What `verify` found. `report["x.fmu"]` is what concerns one of its FMUs."""

    def as_dict(self) -> dict[str, Any]:
        """The report for programs, as `save_json` writes it; the module `json_file` says what is where."""
        return json_file.as_dict(self)

    def save_json(self, path: str | Path, overwrite: bool = False) -> None:
        """Write it for programs; a file of something else is only replaced with `overwrite`.

        Raises CommandError where the file may not be written, RunError where writing fails.
        """
        json_file.save(self, Path(path), overwrite)

    def save_junit(self, path: str | Path, overwrite: bool = False) -> None:
        """Write it as JUnit XML, as CI systems display it. Raises CommandError as `save_json`."""
        from .junit import save

        save(self, Path(path), overwrite)

    def save_html(self, path: str | Path, overwrite: bool = False) -> None:
        """Write it as one page that needs nothing else. Raises CommandError as `save_json`."""
        from .page import save

        save(self, Path(path), overwrite)
