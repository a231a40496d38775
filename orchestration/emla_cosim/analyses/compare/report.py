"""The report of a comparison: tables, joints that are not held, pictures, and equal terms."""

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ...base.wording import format_count, format_rounded
from ...recorders.metrics import HELD
from ...run.options import select_repeatable
from ...run.run_record import list_versions, to_plain
from ...study.controllers import CONTROLLERS
from ...study.paper import PRINTED, REFERENCE, Cells, PrintedTable
from ..frame.outputs import Outputs
from ..frame.report import Report, ReportTable, Section, Text
from .pictures import MOTION, PICTURES
from .result import (
    DISPLAYS,
    LABELS,
    LOST_AT,
    MARGINS,
    PAPER,
    ROBUSTNESS,
    STABILITY,
    WHY,
    CompareResult,
    Row,
    choose_displays,
    choose_position_error,
    group_rows,
    label_variant,
)
from .stability import build_margin_tables
from .statistics import (
    SeedStatistics,
    describe_confidence,
    describe_ranking,
    format_mean,
    group_by_variant,
    mark_winner,
    name_observers,
)

FIGURES = (
    "position_error_m",
    "velocity_error_m_s",
    "torque_effort_N_m",
    "torque_peak_N_m",
    "settling_time_s",
    "observer_position_error_m",
    "saturated_after_settling",
)
_FURTHER_FIGURES = ("torque_peak_N_m", "saturated_after_settling")
"""Figures beside the position error."""

_PRINTED = tuple(DISPLAYS[name] for name in Cells.__struct_fields__)
_ROUNDING = 0.006
"""Averages that differ by more are different: the paper prints two or three digits."""


def build_tables(result: CompareResult) -> list[ReportTable]:
    """Return all tables of a result."""
    builders = {PAPER: _build_paper, ROBUSTNESS: _build_robustness, STABILITY: _build_stability}
    build = build_margin_tables if result.table == MARGINS else builders.get(str(result.table), _build_plain)
    return list(build(result))


def describe_lost_joints(result: CompareResult) -> list[str]:
    """Return a line for each joint that was not held: with which controller, how often, and why at first.

    There are none for the table `stability`, whose maps show these joints.
    """
    if result.table == STABILITY:
        return []  # the maps show these
    several = [name for name in ("scenario", "case") if result.rows[name].n_unique() > 1]
    lines = list[str]()
    for summary in map(SeedStatistics, result.group(*LABELS).values()):
        if summary.is_held:
            continue
        first = min(summary.failures, key=lambda row: math.inf if row[LOST_AT] is None else row[LOST_AT])
        where = "".join(f"{first[name]}, " for name in several)
        runs = f" ({len(summary.failures)} of {len(summary.rows)} runs)" if len(summary.rows) > 1 else ""
        lines.append(f"{where}{first['joint']} with {label_variant(first)}{runs}: {first[WHY]}.")
    return lines


def _build_header(result: CompareResult, first: str, rows: Sequence[Row]) -> list[str]:
    """Return the heads of columns: controller, gains and observer, below each other."""
    observers = {name: text.replace(" at ", "\nat ") for name, text in name_observers(rows).items()}
    heads = {name: name.replace("/", "\n") for name in result.entrants}
    return [first, *(f"{head}\nobserver\n{observers.get(name, 'none')}" for name, head in heads.items())]


def _build_plain(result: CompareResult) -> Iterator[ReportTable]:
    """Yield a table for each scenario: a row for each figure of each joint, a column for each controller."""
    for (scenario,), rows in result.group("scenario").items():
        body, lines = list[Sequence[Text | str]](), list[int]()
        for (joint,), group in group_rows(rows, "joint").items():
            lines.append(len(body))
            variants = group_by_variant(group)
            error = choose_position_error(group)
            names = FIGURES if error.name in FIGURES else (error.name, "load_swing_m", *FIGURES)
            displays = choose_displays(group)
            for figure in (displays[name] for name in names):
                cells = mark_winner(variants, figure)
                label = f"{joint}: {figure.label} / {figure.unit}"
                body.append([label, *(cells.get(name, "") for name in result.entrants)])
        title = f"Controllers on {scenario}; the winner of each row is marked"
        under = [*describe_ranking(rows), *describe_confidence(rows)]
        yield ReportTable(title, _build_header(result, "", rows), body, under, lines)


def _build_robustness(result: CompareResult) -> Iterator[ReportTable]:
    """Return a table of cases and controllers for each joint, then one with the number of cases that hold."""
    further = [DISPLAYS[name] for name in _FURTHER_FIGURES]
    for (scenario, joint), rows in result.group("scenario", "joint").items():
        first = choose_position_error(rows)
        meaning = ", ".join(f"{figure.label} / {figure.unit}" for figure in (first, *further))
        body = list[Sequence[Text | str]]()
        for (case,), group in group_rows(rows, "case").items():
            variants = group_by_variant(group)
            cells = mark_winner(variants, first)
            for name, summary in variants.items():
                if summary.is_held:
                    means = [format_mean(summary, figure) for figure in further]
                    cells[name] = cells[name]._replace(text=" / ".join([cells[name].text, *means]))
            body.append([case, *(cells.get(name, "") for name in result.entrants)])
        title, header = f"{joint} of {scenario}: {meaning}", _build_header(result, "case", rows)
        yield ReportTable(title, header, body, describe_ranking(rows))
    for (scenario,), rows in result.group("scenario").items():
        yield _tabulate_shares(f"Cases of {scenario} that hold", result, rows)


def _build_stability(result: CompareResult) -> Iterator[ReportTable]:
    """Return a table for each map with the number of points that hold."""
    rows = [{**row, "map": row["case"].partition(":")[0]} for row in result.rows.rows(named=True)]
    for (name,), group in group_rows(rows, "map").items():
        yield _tabulate_shares(f"Points of the map of {name} that hold", result, group)


def _tabulate_shares(title: str, result: CompareResult, rows: Sequence[Row]) -> ReportTable:
    """Return for each joint the number of cases in which each controller holds it with all seeds."""
    body = [
        [joint, *(_format_share(group, name) for name in result.entrants)]
        for (joint,), group in group_rows(rows, "joint").items()
    ]
    return ReportTable(title, _build_header(result, "joint", rows), body, describe_confidence(rows))


def _format_share(rows: Sequence[Row], variant: str) -> Text:
    points = group_rows([row for row in rows if label_variant(row) == variant], "case").values()
    count = sum(all(row[HELD] for row in point) for point in points)
    return Text(f"{count} of {len(points)}", is_failure=not count)


def _build_paper(result: CompareResult) -> Iterator[ReportTable]:
    """Yield the cells and the averages of each table of the paper of which something was run."""
    for printed in PRINTED:
        rows = [r for r in result.rows.rows(named=True) if (r["scenario"], r["joint"]) in printed.cells]
        if rows:
            yield _tabulate_cells(rows, printed)
            yield _tabulate_averages(rows, printed)


def _tabulate_cells(rows: Sequence[Row], printed: PrintedTable) -> ReportTable:
    """Return our figures beside those of the paper: a row for each cell and controller."""
    body, lines = list[Sequence[Text | str]](), list[int]()
    for (scenario, joint), paper in printed.cells.items():
        group = [row for row in rows if (row["scenario"], row["joint"]) == (scenario, joint)]
        variants = group_by_variant(group)
        columns = {figure.name: mark_winner(variants, figure) for figure in _PRINTED}
        lines.append(len(body))
        label = joint if len(printed.scenarios) == 1 else scenario
        observers = name_observers(group)
        for name, summary in variants.items():
            cells: list[Text | str] = [label, f"{name}\nobserver {observers[name]}"]
            values = paper.get(summary.rows[0]["controller"], (None,) * len(_PRINTED))
            for figure, value in zip(_PRINTED, values, strict=True):
                cells.append(columns[figure.name][name])
                cells.append("" if value is None else format_rounded(figure.factor * value))
            body.append(cells)
    header = ["", "controller/gains", *(h for f in _PRINTED for h in (f"{f.label} / {f.unit}", "paper"))]
    title = f"{printed.name}: ours beside the paper's; the winner of ours is marked"
    under = [*describe_ranking(rows), *describe_confidence(rows), printed.references]
    return ReportTable(title, header, body, under, lines)


def _tabulate_averages(rows: Sequence[Row], printed: PrintedTable) -> ReportTable:
    """Return ratios of the means over all rows of the table to those of RSBA with its recommended gains."""
    reference_label = f"{REFERENCE}/{CONTROLLERS[REFERENCE].recommended}"
    by_entrant = {name: [r for r in rows if label_variant(r) == name] for name in map(label_variant, rows)}
    base = _sum_means(by_entrant.get(reference_label, ()), len(printed.cells))
    averages = {f"paper, {c}": cells for c, cells in printed.averages.items()}
    averages |= {
        f"paper, {c}, from its cells": printed.recomputed(c) for c in printed.averages if c != REFERENCE
    }
    body: list[Sequence[Text | str]] = [
        *([name, *_format_ratios(_sum_means(x, len(printed.cells)), base)] for name, x in by_entrant.items()),
        *([name, *(f"{x:.3f}".rstrip("0").rstrip(".") for x in cells)] for name, cells in averages.items()),
    ]
    header = ["normalised average", *(figure.label for figure in _PRINTED)]
    under = [f"Averages are ratios of means, ours to {reference_label}.", *_describe_difference(printed)]
    return ReportTable(f"{printed.name}: normalised averages", header, body, under, [len(by_entrant)])


def _sum_means(rows: Sequence[Row], count: int) -> Cells | None:
    """Return sums over `count` joints of means over seeds; None if one was not held or is missing."""
    joints = [SeedStatistics(group) for group in group_rows(rows, "scenario", "joint").values()]
    if len(joints) < count or not all(joint.is_held for joint in joints):
        return None
    means = [[joint.mean(name) for joint in joints] for name in Cells.__struct_fields__]
    return Cells(*(math.fsum(math.nan if x is None else x for x in column) for column in means))


def _format_ratios(means: Cells | None, base: Cells | None) -> list[Text | str]:
    """Return ratios to `base`; "not held" without means, "none" without a base."""
    if means is None or base is None:
        return [Text("not held", is_failure=True) if means is None else "none"] * len(_PRINTED)
    return [format_rounded(ours / reference) for ours, reference in zip(means, base, strict=True)]


def _describe_difference(printed: PrintedTable) -> list[str]:
    """Return a remark on averages of the paper that do not follow from its own cells."""
    wrong: Mapping[str, list[str]] = {figure.label: [] for figure in _PRINTED}
    for controller, averages in printed.averages.items():
        recomputed = printed.recomputed(controller)
        for figure, average, printed_value in zip(_PRINTED, recomputed, averages, strict=True):
            if abs(average - printed_value) > _ROUNDING:
                text = f"{printed_value:.3g} for {controller}, where its cells give {average:.3f}"
                wrong[figure.label].append(text)
    differences = [f"{label} {' and '.join(texts)}" for label, texts in wrong.items() if texts]
    exceptions = f", except {'; '.join(differences)}" if differences else ""
    return [f"The paper's averages follow from its own cells{exceptions}."]


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
