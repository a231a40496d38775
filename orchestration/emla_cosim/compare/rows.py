"""What came out of each run, as rows: one for each scenario, case, joint, controller and set of gains."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import polars

from ..recorders.metrics import Shown
from ..study.metrics import SETTLED_AFTER, JointFigures, JointMetrics
from ..sweep.result import DIED, DONE
from ..sweep.worker import Outcome
from .contest import Contest, Heat

FIGURES = tuple(f.name for f in fields(JointFigures) if f.name not in ("converged", "left_limits"))
"""Columns with figures of a joint, by the names that metrics.json has for them."""

HELD, LOST_AT, WHY = "held", "lost_at_s", "why"
"""Whether a joint converged and never left its limits; if not, when that was seen, and why."""

COLUMNS: Mapping[str, Any] = {
    "run": polars.Int64,
    "scenario": polars.String,
    "case": polars.String,
    "joint": polars.String,
    "controller": polars.String,
    "gains": polars.String,
    HELD: polars.Boolean,
    LOST_AT: polars.Float64,
    WHY: polars.String,
    **dict.fromkeys(FIGURES, polars.Float64),
    "x": polars.Float64,
    "y": polars.Float64,
}

SHOWN: Mapping[str, Shown] = {shown.name: shown for shown in JointMetrics.shown}
"""How a person sees a figure."""

Row = Mapping[str, Any]


def table(contest: Contest, outcomes: Mapping[int, Outcome]) -> polars.DataFrame:
    """The rows of all heats that came to an end, in the order of the heats."""
    found = [row for number in sorted(outcomes) for row in _rows(contest.heats[number], outcomes[number])]
    return polars.DataFrame(found, schema=dict(COLUMNS), orient="row")


def _rows(heat: Heat, outcome: Outcome) -> list[dict[str, Any]]:
    return [_row(heat, joint, outcome) for joint in heat.joints]


def _row(heat: Heat, joint: str, outcome: Outcome) -> dict[str, Any]:
    figures = outcome.figures.get(joint, {})
    at, why = _lost(figures, outcome)
    x, y = heat.case.at or (None, None)
    return {
        "run": outcome.number,
        "scenario": heat.scenario,
        "case": heat.case.name,
        "joint": joint,
        "controller": heat.entrant.called,
        "gains": heat.entrant.gains,
        HELD: why is None,
        LOST_AT: at,
        WHY: why,
        **{name: figures.get(name) for name in FIGURES},
        "x": x,
        "y": y,
    }


def _lost(figures: Mapping[str, Any], outcome: Outcome) -> tuple[float | None, str | None]:
    """When a joint was lost in s, and why; twice None where it held."""
    left = figures.get("left_limits")
    if left is not None:
        signal = left["signal"].partition(".")[2]
        limits = f"{left['minimum']:.4g} to {left['maximum']:.4g}"
        return left["time_s"], f"{signal} = {left['value']:.6g}, not within {limits}"
    if outcome.status != DONE:
        return outcome.end_s, "its process ended" if outcome.status == DIED else str(outcome.problem).rstrip(
            "."
        )
    if figures.get("converged"):
        return None, None
    if (outcome.end_s or 0.0) <= SETTLED_AFTER:
        return outcome.end_s, f"too short to judge: that takes more than {SETTLED_AFTER:g} s"
    return outcome.end_s, "not converged: at the end the position error is above 5 % of the first"


def of_entrant(row: Row) -> str:
    """The controller of a row with its gains."""
    return f"{row['controller']}/{row['gains']}"


def best(rows: Sequence[Row], figure: str) -> float | None:
    """The smallest value of a figure among those that held; None where none did, or all are the same."""
    values = [row[figure] for row in rows if row[HELD] and row[figure] is not None]
    return min(values) if values and min(values) < max(values) else None
