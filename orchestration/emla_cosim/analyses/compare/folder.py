"""The output folder of a comparison: rows, tables, the record to repeat each run, and pictures."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...run.options import select_repeatable
from ...run.run_record import list_versions, to_plain
from ...views.folder import Folder
from .pictures import NAMES
from .plan import ComparisonPlan
from .result import CompareResult

CSV, MARKDOWN, RECORD = "comparison.csv", "comparison.md", "comparison.json"


class CompareFolder(Folder):
    """The folder of a comparison; `Folder` lists the errors."""

    what = "comparison"
    files = (CSV, MARKDOWN, RECORD)
    pictures = tuple(f"{picture}.png" for picture in NAMES)
    record_file = RECORD

    def keep(self, result: CompareResult, record: Mapping[str, Any]) -> None:
        """Write all files but the pictures, each atomically, and remove pictures of an earlier comparison.

        Raises:
            RunError: A file cannot be written.
        """
        self.remove(self.pictures)
        self.write_json(RECORD, record)
        self.write(CSV, result.rows.write_csv().encode())
        self.write(MARKDOWN, result.markdown().encode())

    def draw_result(self, result: CompareResult) -> list[Path]:
        """Draw all pictures of a result, and return their files. Raises RunError."""
        with self.alone():
            return [self.draw(f"{name}.png", figure) for name, figure in result.figures().items()]


def build_record(plan: ComparisonPlan, result: CompareResult) -> dict[str, Any]:
    """Return what repeats the comparison: versions, options, systems, and the start values of each run."""
    return {
        "name": result.name,
        "table": result.table,
        "status": "completed" if result.complete else "unfinished",
        "entrants": list(result.entrants),
        "options": to_plain(select_repeatable(plan.options)),
        "notes": list(result.notes),
        "wall_s": result.wall_s,
        "versions": dict(list_versions()),
        "systems": [group.identity for group in plan.groups],
        "runs": [
            {
                "run": number,
                "scenario": run.scenario,
                "case": run.case.name,
                "joints": list(run.joints),
                "controller": run.controller_variant.label,
                "gains": run.controller_variant.gains,
                "seed": run.seed,
                "system": run.group,
                "set": to_plain(run.own["set"]),
                "fault": [str(fault) for fault in run.own.get("fault", ())],
                "command": shlex.join(command) if (command := plan.command(number)) else None,
            }
            for number, run in enumerate(plan.runs)
        ],
    }
