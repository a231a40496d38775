"""The tables of a comparison, as grids."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..recorders.metrics import Shown
from .grid import Cell, Grid
from .paper_tables import paper_grids
from .result import PAPER, ROBUSTNESS, STABILITY, CompareResult
from .rows import HELD, LOST_AT, SHOWN, WHY, Row, best, of_entrant

_FIGURES = (
    "position_error_m",
    "velocity_error_m_s",
    "torque_effort_N_m",
    "torque_peak_N_m",
    "convergence_time_s",
    "observer_position_error_m",
    "saturated_after_convergence",
)
_COMPACT = ("position_error_m", "torque_peak_N_m", "saturated_after_convergence")


def grids(result: CompareResult) -> list[Grid]:
    """All tables of a result."""
    if result.table == PAPER:
        return paper_grids(result)
    if result.table == ROBUSTNESS:
        return list(_robustness(result))
    if result.table == STABILITY:
        return list(_stability(result))
    return list(_plain(result))


def lost_lines(result: CompareResult) -> list[str]:
    """For each joint that was lost a line that says with which controller, when, and why."""
    if result.table == STABILITY:
        return []  # that is what the maps show
    several = {name: result.rows[name].n_unique() > 1 for name in ("scenario", "case")}
    return [_lost_line(row, several) for row in result.lost.iter_rows(named=True)]


def told(row: Row, figure: Shown) -> Cell:
    """A figure in the unit of its row; that a joint was lost instead, as no figure of that stands alone."""
    if not row[HELD]:
        return Cell(lost(row), lost=True)
    value = row[figure.name]
    return Cell("none" if value is None or value != value else f"{figure.factor * value:.3g}")


def lost(row: Row) -> str:
    """That a joint was lost, and when."""
    return "lost" if row[LOST_AT] is None else f"lost at {row[LOST_AT]:.3g} s"


def marked(row: Row, figure: Shown, smallest: float | None) -> Cell:
    """`told`, marked where it is the best."""
    cell = told(row, figure)
    return cell._replace(best=row[HELD] and smallest is not None and row[figure.name] == smallest)


def grouped(rows: Sequence[Row], *by: str) -> dict[tuple[Any, ...], list[Row]]:
    """Rows by the values of these columns, in their order."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in by), []).append(row)
    return found


def _lost_line(row: Row, several: Mapping[str, bool]) -> str:
    where = "".join(f"{row[name]}, " for name, many in several.items() if many)
    at = "" if row[LOST_AT] is None else f" at t = {row[LOST_AT]:.4g} s"
    return f"{where}{row['joint']} with {of_entrant(row)}{at}: {row[WHY]}."


def _plain(result: CompareResult) -> Iterator[Grid]:
    """For each joint its figures in rows, and the controllers in columns."""
    shown = [SHOWN[name] for name in _FIGURES]
    for (scenario,), rows in grouped(result.rows.rows(named=True), "scenario").items():
        body, lines = list[Sequence[Cell]](), list[int]()
        for (joint,), own in grouped(rows, "joint").items():
            lines.append(len(body))
            by_entrant = {of_entrant(row): row for row in own}
            for figure in shown:
                smallest = best(own, figure.name)
                cells = [
                    marked(by_entrant[name], figure, smallest) if name in by_entrant else Cell("")
                    for name in result.entrants
                ]
                body.append([Cell(f"{joint}: {figure.label} / {figure.unit}"), *cells])
        header = ["", *(name.replace("/", "\n") for name in result.entrants)]
        yield Grid(f"Controllers on {scenario}; the best of each row is marked", header, body, lines=lines)


def _robustness(result: CompareResult) -> Iterator[Grid]:
    """For each joint the cases in rows, and the controllers in columns."""
    shown = [SHOWN[name] for name in _COMPACT]
    meaning = ", ".join(f"{one.label} / {one.unit}" for one in shown)
    header = ["case", *(name.replace("/", "\n") for name in result.entrants)]
    for (scenario, joint), rows in grouped(result.rows.rows(named=True), "scenario", "joint").items():
        body = list[Sequence[Cell]]()
        for (case,), own in grouped(rows, "case").items():
            smallest, by_entrant = best(own, _COMPACT[0]), {of_entrant(row): row for row in own}
            cells = [
                _compact(by_entrant[name], shown, smallest) if name in by_entrant else Cell("")
                for name in result.entrants
            ]
            body.append([Cell(case), *cells])
        yield Grid(f"{joint} of {scenario}: {meaning}", header, body)


def _compact(row: Row, shown: Sequence[Shown], smallest: float | None) -> Cell:
    first = marked(row, shown[0], smallest)
    return first if first.lost else first._replace(text=" / ".join(told(row, one).text for one in shown))


def _stability(result: CompareResult) -> Iterator[Grid]:
    """For each map how many of its points hold."""
    header = ["joint", *(name.replace("/", "\n") for name in result.entrants)]
    rows = [{**row, "map": row["case"].partition(":")[0]} for row in result.rows.rows(named=True)]
    for (name,), own in grouped(rows, "map").items():
        body = [
            [
                Cell(str(joint)),
                *(_share([r for r in of_joint if of_entrant(r) == e]) for e in result.entrants),
            ]
            for (joint,), of_joint in grouped(own, "joint").items()
        ]
        yield Grid(f"Points of the map of {name} that hold", header, body)


def _share(rows: Sequence[Row]) -> Cell:
    held = sum(row[HELD] for row in rows)
    return Cell(f"{held} of {len(rows)}", lost=not held)
