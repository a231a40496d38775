"""Rows with the outcome of each run: one for each scenario, case, joint, controller and set of gains."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import polars

from ...recorders.metrics import HELD, MetricDisplay
from ...study.metrics import CONVERGENCE_TIME, JointFigures, JointMetrics
from ..variants.data import DIED, VariantOutcome
from .plan import ComparisonPlan, ComparisonRun

FIGURES = tuple(f.name for f in fields(JointFigures) if f.type is float)
"""Columns with figures of a joint, by their names in metrics.json."""

LOST_AT, WHY, SEED = "lost_at_s", "why", "seed"
"""Columns that say when and why a joint was not held (`HELD`), and the held-out seed."""

RANDOM, OBSERVER, RESERVES = "random", "observer", "reserves"
"""Columns that say whether random sequences affect the run, and what may differ between controllers."""

COLUMNS: Mapping[str, Any] = {
    "run": polars.Int64,
    "scenario": polars.String,
    "case": polars.String,
    "joint": polars.String,
    "controller": polars.String,
    "gains": polars.String,
    OBSERVER: polars.String,
    RESERVES: polars.String,
    SEED: polars.Int64,
    RANDOM: polars.Boolean,
    HELD: polars.Boolean,
    LOST_AT: polars.Float64,
    WHY: polars.String,
    **dict.fromkeys(FIGURES, polars.Float64),
    "x": polars.Float64,
    "y": polars.Float64,
}

SHOWN: Mapping[str, MetricDisplay] = {shown.name: shown for shown in (*JointMetrics.shown, CONVERGENCE_TIME)}
"""How tables and pictures show a figure."""

Row = Mapping[str, Any]


def build_rows(plan: ComparisonPlan, outcomes: Mapping[int, VariantOutcome]) -> polars.DataFrame:
    """Return the rows of all finished runs, in the order of the plan."""
    found = [row for number in sorted(outcomes) for row in _rows(plan.runs[number], outcomes[number])]
    return polars.DataFrame(found, schema=dict(COLUMNS), orient="row")


def _rows(run: ComparisonRun, outcome: VariantOutcome) -> list[dict[str, Any]]:
    return [_row(run, joint, outcome) for joint in run.joints]


def _row(run: ComparisonRun, joint: str, outcome: VariantOutcome) -> dict[str, Any]:
    figures = outcome.figures.get(joint, {})
    is_held, at, why = read_verdict(figures, outcome)
    x, y = run.case.at or (None, None)
    return {
        "run": outcome.number,
        "scenario": run.scenario,
        "case": run.case.name,
        "joint": joint,
        "controller": run.controller_variant.label,
        "gains": run.controller_variant.gains,
        OBSERVER: run.observers.get(joint),
        RESERVES: run.reserves,
        SEED: run.seed,
        RANDOM: run.is_random,
        HELD: is_held,
        LOST_AT: at,
        WHY: why,
        **{name: figures.get(name) for name in FIGURES},
        "x": x,
        "y": y,
    }


def read_verdict(
    figures: Mapping[str, Any], outcome: VariantOutcome
) -> tuple[bool, float | None, str | None]:
    """Return whether a joint was held; if not, at which time in s this was detected, and why."""
    is_done = outcome.complete
    if is_done and figures.get(HELD):
        return True, None, None
    cause = figures.get("trip") or (figures.get("oscillation") if is_done else None) or {}
    problem = "its process ended" if outcome.status == DIED else str(outcome.problem)
    why = problem if not (is_done or cause) else str(figures.get("reason") or "it has no figures")
    return False, cause.get("time_s", outcome.end_s), why.rstrip(".")


def label_variant(row: Row) -> str:
    """Return the controller of a row with its gains."""
    return f"{row['controller']}/{row['gains']}"
