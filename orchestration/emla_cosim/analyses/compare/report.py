"""The report of a comparison: joints that are not held, tables, pictures, and equal terms."""

import shlex
from typing import Any

from ...base.wording import format_count
from ...run.options import select_repeatable
from ...run.run_record import list_versions, to_plain
from ..frame.outputs import Outputs
from ..frame.report import Report, Section, Text
from .pictures import MOTION, PICTURES
from .result import CompareResult
from .tables import describe_lost_joints

_MAX_FAILURES = 12
"""Most joints that were not held to show in the terminal; the files have all of them."""


def build_report(result: CompareResult) -> Report:
    """Return the report of a comparison."""
    runs = format_count(result.rows["run"].n_unique(), "run")
    facts = [format_count(len(result.entrants), "set of gains", "sets of gains"), runs]
    pictures = {f"{name}.png": text for name, text in PICTURES.items()}
    motion = {f"{MOTION}.png": pictures.pop(f"{MOTION}.png")}
    sections = [
        Section("Controllers side by side", tables=result.grids, pictures=pictures),
        Section("Assumptions", result.notes, under=[f"{runs} in {result.wall_s:.0f} s"]),
    ]
    if result.motions:
        sections.insert(1, Section("Motion and load", pictures=motion))
    if failures := describe_lost_joints(result):
        count = Text(f"Not held: {result.failed_rows.height} of {result.rows.height}.", is_failure=True)
        sections.insert(0, Section("Joints that are not held", [count, *failures], most=1 + _MAX_FAILURES))
    if not result.complete:
        facts.append("interrupted")
    return Report("Comparison", result.name, facts, sections)


def _build_record(result: CompareResult) -> dict[str, Any]:
    """Return the record: versions, options, systems, and the start values of each run."""
    plan = result.plan
    assert plan is not None
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
                "set": to_plain(run.changes["set"]),
                "fault": [str(fault) for fault in run.changes.get("fault", ())],
                "command": shlex.join(command) if (command := plan.command(number)) else None,
            }
            for number, run in enumerate(plan.runs)
        ],
    }


OUTPUTS = Outputs[CompareResult](
    subject="comparison",
    name="compare",
    record=_build_record,
    record_file="comparison.json",
    tables={
        "comparison.csv": lambda result: result.rows.write_csv(),
        "comparison.md": CompareResult.markdown,
    },
    report=build_report,
    draw=lambda result: ((f"{name}.png", figure) for name, figure in result.figures().items()),
    pictures=[f"{name}.png" for name in PICTURES],
)
