"""The output folder of an identification."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...views.folder import Folder
from ...views.pages.plain import to_plain
from ..frame.scenario_text import format_scenario
from .pictures import draw_certainty, draw_fit
from .result import IdentificationResult

SCENARIO, RECORD, SAMPLES, HISTORY = "identified.toml", "identify.json", "samples.csv", "history.csv"
FIT, CERTAINTY, PAGE = "fit.png", "certainty.png", "identify.html"


class IdentificationFolder(Folder):
    """A scenario with the estimates, the record, samples with predictions, plots and a page.

    Args:
        path: The folder.
        overwrite: Whether to replace files that emla did not write.
        plots: Whether to draw plots.
        report: Whether to write the page.
    """

    what = "identification"
    files = (SCENARIO, RECORD, SAMPLES, HISTORY)
    pictures = (FIT, CERTAINTY, PAGE)
    record_file = RECORD

    def __init__(self, path: Path, overwrite: bool, plots: bool, report: bool) -> None:
        super().__init__(path, overwrite)
        self._plots, self._report = plots, report

    def keep(
        self,
        result: IdentificationResult,
        record: Mapping[str, Any],
        scenario: Mapping[str, Any],
    ) -> None:
        """Write all files. Raises RunError.

        Args:
            result: The result.
            record: The record.
            scenario: Content of the scenario with the estimates, without its description.
        """
        self.write_json(RECORD, to_plain(record))
        if result.estimates:
            described = f"Estimates of the identification {result.name}"
            self.write(SCENARIO, format_scenario(described, scenario, {}).encode())
            self.write(SAMPLES, result.samples.write_csv().encode())
            self.write(HISTORY, result.history.write_csv().encode())
        if self._plots and result.fits:
            self.draw(FIT, draw_fit(result))
            self.draw(CERTAINTY, draw_certainty(result))
        if self._report and result.fits:
            from .page import render_page  # importing it loads jinja2

            self.write(PAGE, render_page(result).encode())

    def keep_unfinished(self, values: Mapping[str, float]) -> None:
        """Write the best values so far. Raises RunError."""
        self.write_json(
            RECORD,
            {
                "format": "emla-identification",
                "status": "unfinished",
                "estimates": [{"name": name, "value": value} for name, value in values.items()],
            },
        )


def read_unfinished(place: Path, names: Sequence[str]) -> dict[str, float] | None:
    """Return the best values of an unfinished identification of these parameters; None if there is none."""
    try:
        found = json.loads((place / RECORD).read_text(encoding="utf-8"))
        values = {one["name"]: float(one["value"]) for one in found["estimates"]}
        unfinished = found["status"] == "unfinished"
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    usable = list(values) == list(names) and all(map(math.isfinite, values.values()))
    return values if unfinished and usable else None
