"""The tables of a comparison."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ...recorders.metrics import HELD
from .data import MARGINS, PAPER, ROBUSTNESS, STABILITY, CompareData
from .margin_tables import build_margin_tables
from .paper_tables import build_paper_tables
from .remarks import describe_ranking, name_observers
from .rows import LOST_AT, SHOWN, WHY, Row, label_variant
from .statistics import SeedStatistics, format_mean, group_by_variant, mark_winner
from .text_table import Cell, TextTable

_FIGURES = (
    "position_error_m",
    "velocity_error_m_s",
    "torque_effort_N_m",
    "torque_peak_N_m",
    "settling_time_s",
    "observer_position_error_m",
    "saturated_after_settling",
)
_COMPACT = ("position_error_m", "torque_peak_N_m", "saturated_after_settling")


def build_tables(result: CompareData) -> list[TextTable]:
    """Return all tables of a result."""
    if result.table == PAPER:
        return build_paper_tables(result)
    if result.table == ROBUSTNESS:
        return list(_robustness(result))
    if result.table == STABILITY:
        return list(_stability(result))
    if result.table == MARGINS:
        return build_margin_tables(result)
    return list(_plain(result))


def describe_lost_joints(result: CompareData) -> list[str]:
    """Return a line for each joint that was not held: with which controller, in how many runs, and why."""
    if result.table == STABILITY:
        return []  # the maps show these
    several = {name: result.rows[name].n_unique() > 1 for name in ("scenario", "case")}
    found = group_rows(result.rows.rows(named=True), "scenario", "case", "joint", "controller", "gains")
    return [
        _describe_lost_joint(SeedStatistics(rows), several)
        for rows in found.values()
        if not SeedStatistics(rows).is_held
    ]


def group_rows(rows: Sequence[Row], *by: str) -> dict[tuple[Any, ...], list[Row]]:
    """Return rows grouped by the values of these columns, in their order."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in by), []).append(row)
    return found


def _describe_lost_joint(summary: SeedStatistics, several: Mapping[str, bool]) -> str:
    """Describe the earliest loss of a joint, and the number of runs with a loss."""
    first = min(summary.lost, key=lambda row: math.inf if row[LOST_AT] is None else row[LOST_AT])
    where = "".join(f"{first[name]}, " for name, many in several.items() if many)
    runs = f" ({len(summary.lost)} of {len(summary.rows)} runs)" if len(summary.rows) > 1 else ""
    return f"{where}{first['joint']} with {summary.controller_variant}{runs}: {first[WHY]}."


def _header(result: CompareData, first: str, rows: Sequence[Row]) -> list[str]:
    """Return the heads of columns: controller, gains and observer, below each other."""
    observers = {name: text.replace(" at ", "\nat ") for name, text in name_observers(rows).items()}
    heads = {name: name.replace("/", "\n") for name in result.entrants}
    return [first, *(f"{head}\nobserver\n{observers.get(name, 'none')}" for name, head in heads.items())]


def _plain(result: CompareData) -> Iterator[TextTable]:
    """Return a table for each joint, with figures in rows and controllers in columns."""
    shown = [SHOWN[name] for name in _FIGURES]
    for (scenario,), rows in group_rows(result.rows.rows(named=True), "scenario").items():
        body, lines = list[Sequence[Cell]](), list[int]()
        for (joint,), own in group_rows(rows, "joint").items():
            lines.append(len(body))
            found = group_by_variant(own)
            for figure in shown:
                cells = mark_winner(found, figure)
                body.append(
                    [
                        Cell(f"{joint}: {figure.label} / {figure.unit}"),
                        *(cells.get(name, Cell("")) for name in result.entrants),
                    ]
                )
        title = f"Controllers on {scenario}; the winner of each row is marked"
        yield TextTable(title, _header(result, "", rows), body, describe_ranking(rows), lines)


def _robustness(result: CompareData) -> Iterator[TextTable]:
    """Return a table of cases and controllers for each joint, then one with the number of cases that hold."""
    first, *others = (SHOWN[name] for name in _COMPACT)
    meaning = ", ".join(f"{one.label} / {one.unit}" for one in (first, *others))
    for (scenario, joint), rows in group_rows(result.rows.rows(named=True), "scenario", "joint").items():
        body = list[Sequence[Cell]]()
        for (case,), own in group_rows(rows, "case").items():
            found = group_by_variant(own)
            cells = mark_winner(found, first)
            for name, one in found.items():
                if one.is_held:
                    means = [format_mean(one, figure) for figure in others]
                    cells[name] = cells[name]._replace(text=" / ".join([cells[name].text, *means]))
            body.append([Cell(case), *(cells.get(name, Cell("")) for name in result.entrants)])
        title, header = f"{joint} of {scenario}: {meaning}", _header(result, "case", rows)
        yield TextTable(title, header, body, describe_ranking(rows))
    for (scenario,), rows in group_rows(result.rows.rows(named=True), "scenario").items():
        yield TextTable(
            f"Cases of {scenario} that hold", _header(result, "joint", rows), _shares(result, rows)
        )


def _stability(result: CompareData) -> Iterator[TextTable]:
    """Return a table for each map with the number of points that hold."""
    rows = [{**row, "map": row["case"].partition(":")[0]} for row in result.rows.rows(named=True)]
    for (name,), own in group_rows(rows, "map").items():
        title = f"Points of the map of {name} that hold"
        yield TextTable(title, _header(result, "joint", own), _shares(result, own))


def _shares(result: CompareData, rows: Sequence[Row]) -> list[Sequence[Cell]]:
    """Return for each joint the number of cases in which each controller holds it with all seeds."""
    return [
        [Cell(str(joint)), *(_share([r for r in own if label_variant(r) == e]) for e in result.entrants)]
        for (joint,), own in group_rows(rows, "joint").items()
    ]


def _share(rows: Sequence[Row]) -> Cell:
    points = group_rows(rows, "case").values()
    held = sum(all(row[HELD] for row in point) for point in points)
    return Cell(f"{held} of {len(points)}", lost=not held)
