"""The tables of a comparison, as grids."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from .data import PAPER, ROBUSTNESS, STABILITY, CompareData
from .grid import Cell, Grid
from .paper_tables import paper_grids
from .rows import HELD, LOST_AT, SHOWN, WHY, Row, of_entrant
from .summary import Summary, marked, mean_text, summaries

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


def grids(result: CompareData) -> list[Grid]:
    """All tables of a result."""
    if result.table == PAPER:
        return paper_grids(result)
    if result.table == ROBUSTNESS:
        return list(_robustness(result))
    if result.table == STABILITY:
        return list(_stability(result))
    return list(_plain(result))


def lost_lines(result: CompareData) -> list[str]:
    """For each joint that was not held a line that says with which controller, in how many runs, and why."""
    if result.table == STABILITY:
        return []  # that is what the maps show
    several = {name: result.rows[name].n_unique() > 1 for name in ("scenario", "case")}
    found = grouped(result.rows.rows(named=True), "scenario", "case", "joint", "controller", "gains")
    return [_lost_line(Summary(rows), several) for rows in found.values() if not Summary(rows).is_held]


def grouped(rows: Sequence[Row], *by: str) -> dict[tuple[Any, ...], list[Row]]:
    """Rows by the values of these columns, in their order."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in by), []).append(row)
    return found


def _lost_line(summary: Summary, several: Mapping[str, bool]) -> str:
    """The earliest of the runs in which a joint was not held, and how many there are."""
    first = min(summary.lost, key=lambda row: math.inf if row[LOST_AT] is None else row[LOST_AT])
    where = "".join(f"{first[name]}, " for name, many in several.items() if many)
    runs = f" ({len(summary.lost)} of {len(summary.rows)} runs)" if len(summary.rows) > 1 else ""
    return f"{where}{first['joint']} with {summary.entrant}{runs}: {first[WHY]}."


def _header(result: CompareData, first: str) -> list[str]:
    return [first, *(name.replace("/", "\n") for name in result.entrants)]


def _under(rows: Sequence[Row]) -> list[str]:
    """What a reader has to know of cells that are means."""
    seeds = len({row["seed"] for row in rows} - {None})
    if seeds < 2:
        return []
    return [
        f"± is the standard deviation over {seeds} seeds that no tuning used. A winner is marked only where "
        "its mean is below all others by more than both standard deviations together."
    ]


def _plain(result: CompareData) -> Iterator[Grid]:
    """For each joint its figures in rows, and the controllers in columns."""
    shown = [SHOWN[name] for name in _FIGURES]
    for (scenario,), rows in grouped(result.rows.rows(named=True), "scenario").items():
        body, lines = list[Sequence[Cell]](), list[int]()
        for (joint,), own in grouped(rows, "joint").items():
            lines.append(len(body))
            found = summaries(own)
            for figure in shown:
                cells = marked(found, figure)
                body.append(
                    [
                        Cell(f"{joint}: {figure.label} / {figure.unit}"),
                        *(cells.get(name, Cell("")) for name in result.entrants),
                    ]
                )
        title = f"Controllers on {scenario}; the winner of each row is marked"
        yield Grid(title, _header(result, ""), body, _under(rows), lines)


def _robustness(result: CompareData) -> Iterator[Grid]:
    """For each joint the cases in rows, and the controllers in columns; then how many of these hold."""
    first, *others = (SHOWN[name] for name in _COMPACT)
    meaning = ", ".join(f"{one.label} / {one.unit}" for one in (first, *others))
    for (scenario, joint), rows in grouped(result.rows.rows(named=True), "scenario", "joint").items():
        body = list[Sequence[Cell]]()
        for (case,), own in grouped(rows, "case").items():
            found = summaries(own)
            cells = marked(found, first)
            for name, one in found.items():
                if one.is_held:
                    means = [mean_text(one, figure) for figure in others]
                    cells[name] = cells[name]._replace(text=" / ".join([cells[name].text, *means]))
            body.append([Cell(case), *(cells.get(name, Cell("")) for name in result.entrants)])
        yield Grid(f"{joint} of {scenario}: {meaning}", _header(result, "case"), body, _under(rows))
    for (scenario,), rows in grouped(result.rows.rows(named=True), "scenario").items():
        yield Grid(f"Cases of {scenario} that hold", _header(result, "joint"), _shares(result, rows))


def _stability(result: CompareData) -> Iterator[Grid]:
    """For each map how many of its points hold."""
    rows = [{**row, "map": row["case"].partition(":")[0]} for row in result.rows.rows(named=True)]
    for (name,), own in grouped(rows, "map").items():
        title = f"Points of the map of {name} that hold"
        yield Grid(title, _header(result, "joint"), _shares(result, own))


def _shares(result: CompareData, rows: Sequence[Row]) -> list[Sequence[Cell]]:
    """For each joint in how many cases each controller holds it, with all seeds."""
    return [
        [Cell(str(joint)), *(_share([r for r in own if of_entrant(r) == e]) for e in result.entrants)]
        for (joint,), own in grouped(rows, "joint").items()
    ]


def _share(rows: Sequence[Row]) -> Cell:
    points = grouped(rows, "case").values()
    held = sum(all(row[HELD] for row in point) for point in points)
    return Cell(f"{held} of {len(points)}", lost=not held)
