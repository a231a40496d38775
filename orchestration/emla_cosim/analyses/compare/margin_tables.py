"""Tables of stability margins: the loops of each joint, beside its position error."""

from collections.abc import Mapping
from typing import Any

from ..linearize.margins import LARGEST_MS, LEAST_GAIN_DB, LEAST_PHASE_DEG
from .data import CompareData
from .margins import AT, DELAY, FIGURES, LOOPS, PROBLEM
from .remarks import describe_ranking, name_observers
from .rows import SHOWN, Row
from .statistics import group_by_variant, mark_winner
from .text_table import Cell, TextTable

_ERROR = SHOWN["position_error_m"]
_HEADER = (
    "controller,\nobserver",
    "error\n/ µm",
    "loop",
    "phase\n/ °",
    "gain\n/ dB",
    "Ms",
    "delay\n/ ms",
    "conditions",
)


def missed_conditions(figures: Mapping[str, Any]) -> list[str]:
    """Return the conditions that the figures of a loop do not meet; a figure is None if nothing limits it."""
    phase, up, down, Ms = (figures[name] for name in FIGURES[:4])
    met = {
        "phase": phase is None or phase >= LEAST_PHASE_DEG,
        "gain": (up is None or up >= LEAST_GAIN_DB) and (down is None or down <= -LEAST_GAIN_DB),
        "Ms": Ms is None or Ms <= LARGEST_MS,
    }
    return [name for name, is_met in met.items() if not is_met]


def build_margin_tables(result: CompareData) -> list[TextTable]:
    """Return a table for each joint, with a row for each loop of each controller."""
    places = dict[tuple[str, str], list[Row]]()
    for row in result.rows.rows(named=True):
        places.setdefault((row["scenario"], row["joint"]), []).append(row)
    return [_build_table(scenario, joint, rows) for (scenario, joint), rows in places.items()]


def _build_table(scenario: str, joint: str, rows: list[Row]) -> TextTable:
    body, lines = list[list[Cell]](), list[int]()
    found = group_by_variant(rows)
    errors, observers = mark_winner(found, _ERROR), name_observers(rows)
    for name, one in found.items():
        lines.append(len(body))
        heads = [[Cell(name), errors[name]], [Cell(observers[name]), Cell("")]]
        for loop, head in zip(LOOPS, heads, strict=True):
            body.append([*head, Cell(loop.removesuffix("_loop")), *_cells(one.rows[0], loop)])
    times = sorted({row[AT] for row in rows if row[AT] is not None})
    delay = next((row[DELAY] for row in rows if row[DELAY] is not None), None)
    when = f" at t = {' and '.join(f'{at:.4g}' for at in times)} s" if times else ""
    known = "unknown" if delay is None else f"{1e3 * delay:.3g} ms"
    under = [
        f"Computing delay: {known}. Conditions: phase margin of at least {LEAST_PHASE_DEG:g}°, gain margins "
        f"of at least {LEAST_GAIN_DB:g} dB both ways, Ms of at most {LARGEST_MS:g}. none: nothing limits it."
    ]
    under += describe_ranking(rows)
    return TextTable(f"{joint} of {scenario}: stability margins{when}", _HEADER, body, under, lines)


def _cells(row: Row, loop: str) -> list[Cell]:
    """Return margins and conditions of a loop, or the reason in words why there are none."""
    problem = row[f"{loop}_{PROBLEM}"]
    figures = {name: row[f"{loop}_{name}"] for name in FIGURES}
    if problem is None and figures["Ms"] is None:
        problem = "not measured"
    if problem is not None:
        return [Cell(problem, lost=True), *(Cell("") for _ in range(3)), Cell("not met", lost=True)]
    phase, up, down, Ms, delay = figures.values()
    missed = missed_conditions(figures)
    return [
        Cell(_format(phase, ".1f")),
        Cell(f"{_format(up, '+.1f')}/{_format(down, '.1f')}"),
        Cell(_format(Ms, ".2f")),
        Cell(_format(None if delay is None else 1e3 * delay, ".2f")),
        Cell(f"not met: {', '.join(missed)}" if missed else "met", lost=bool(missed)),
    ]


def _format(value: float | None, digits: str) -> str:
    return "none" if value is None else f"{value:{digits}}"
