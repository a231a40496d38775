"""The measures of each compared run, and the rows with its outcome."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars

from ...base.wording import matches_pattern
from ...recorders.metrics import HELD
from ...run.result import Result
from ...study.registration import JOINTS, LOADS
from ...study.roles import find_tracked_joints, find_tracked_loads, find_variable, list_role_patterns
from ..variants.measures import DIED, Measures, VariantOutcome
from .plan import ComparisonPlan
from .result import COLUMNS, FIGURES, LOAD_FIGURES, LOST_AT, OBSERVER, RANDOM, RESERVES, SEED, WHY

LARGEST_SPEED, FASTEST_AT, MOTION = "largest_speed_m_s", "fastest_at_s", "motion"
"""Names of figures of the reference of a joint."""

_POINTS = 500
"""Number of points of a motion; a picture does not show more."""


@dataclass(frozen=True)
class JointMeasures(Measures):
    """The figures of joints as in metrics.json, by joint instead of by name.

    If signals are read, also the largest speed of the reference in m/s, its time in s, and the motion.
    """

    def select_signals(self, names: Sequence[str]) -> Sequence[str]:
        """Return the signals to read: the patterns that the system has signals for."""
        return [name for name in names if any(matches_pattern(name, pattern) for pattern in self.read)]

    def of(self, result: Result) -> dict[str, Any]:
        """Return the figures by joint."""
        loads = result.metrics.get(LOADS, {})
        figures = {
            joint: {**values, **loads.get(joint, {})}
            for joint, values in result.metrics.get(JOINTS, {}).items()
        }
        if self.read:
            for joint, (_, reference) in _find_tracked(result).items():
                figures[joint] = figures.get(joint, {}) | _measure_motion(result, joint, reference)
        return figures

    def series(self, result: Result) -> polars.DataFrame:
        """Return the position error in m over time in s, of the load if it is not rigid, by joint."""
        ends = _find_tracked(result)
        table = polars.DataFrame(result.read(["time", *(name for pair in ends.values() for name in pair)]))
        errors = [
            (polars.col(position) - polars.col(reference)).alias(joint)
            for joint, (position, reference) in ends.items()
        ]
        return table.select("time", *errors)


def _find_tracked(result: Result) -> dict[str, tuple[str, str]]:
    """Return position and reference of each joint's load, or of its screw if the load is rigid."""
    names, roles = result.names, result.roles
    return find_tracked_joints(names, roles) | find_tracked_loads(names, roles)


def _measure_motion(result: Result, joint: str, reference: str) -> dict[str, Any]:
    """Return the largest speed of the reference, its time, and the motion; empty for a single row."""
    load = find_variable(joint, "F_L", result.names, result.roles)
    names = {"time": "time", "reference": reference, **({"load": load} if load else {})}
    signals = result.read([*names.values()])
    time = signals["time"]
    if len(time) < 2:
        return {}
    # of the reference: it is the same for all controllers, also for one that loses the joint
    speed = np.abs(np.gradient(signals[reference], time))
    k = int(np.argmax(speed))
    stride = -(-len(time) // _POINTS)
    return {
        LARGEST_SPEED: float(speed[k]),
        FASTEST_AT: float(time[k]),
        MOTION: {name: signals[full_name][::stride].tolist() for name, full_name in names.items()},
    }


FIGURES_ONLY = JointMeasures()
"""Figures only."""

WITH_ERRORS = JointMeasures(signals=["errors"], read=list_role_patterns("x_L", "x_load", "x_c", "x_s", "F_L"))
"""Figures, errors over time, and the motion of the reference."""


def build_rows(plan: ComparisonPlan, outcomes: Mapping[int, VariantOutcome]) -> polars.DataFrame:
    """Return the rows of all finished runs, in the order of the plan."""
    rows, has_loads = list[dict[str, Any]](), False
    for number, outcome in sorted(outcomes.items()):
        run = plan.runs[number]
        x, y = run.case.at or (None, None)
        for joint in run.joints:
            figures = outcome.figures.get(joint, {})
            verdict = zip((HELD, LOST_AT, WHY), read_verdict(figures, outcome), strict=True)
            terms = {OBSERVER: run.observers.get(joint), RESERVES: run.reserves, RANDOM: run.is_random}
            labels = {"run": number, **run.labels(joint), SEED: run.seed, "x": x, "y": y}
            has_loads |= LOAD_FIGURES[0] in figures
            measured = {name: figures.get(name) for name in (*FIGURES, *LOAD_FIGURES)}
            rows.append(measured | labels | terms | dict(verdict))
    columns = {**COLUMNS, **dict.fromkeys(LOAD_FIGURES if has_loads else (), polars.Float64)}
    return polars.DataFrame(rows, schema=columns, orient="row")


def list_joint_figures(
    plan: ComparisonPlan, outcomes: Mapping[int, VariantOutcome]
) -> Iterator[tuple[tuple[str, str], Mapping[str, Any]]]:
    """Yield the figures of each joint of all finished runs, with its scenario and its name."""
    for number, outcome in sorted(outcomes.items()):
        run = plan.runs[number]
        for joint in run.joints:
            yield (run.scenario, joint), outcome.figures.get(joint, {})


def collect_motions(
    plan: ComparisonPlan, outcomes: Mapping[int, VariantOutcome]
) -> dict[tuple[str, str], polars.DataFrame]:
    """Return the motion of each joint by scenario and joint, from the longest run."""
    motions = dict[tuple[str, str], Mapping[str, Any]]()
    for key, figures in list_joint_figures(plan, outcomes):
        motion = figures.get(MOTION)
        if motion and (key not in motions or motion["time"][-1] > motions[key]["time"][-1]):
            motions[key] = motion
    return {key: polars.DataFrame(motion) for key, motion in motions.items()}


def read_verdict(
    figures: Mapping[str, Any], outcome: VariantOutcome
) -> tuple[bool, float | None, str | None]:
    """Return whether a joint was held; if not, at which time in s this was detected, and why."""
    # figures of a run that ended early do not compare with others
    is_done = outcome.complete
    if is_done and figures.get(HELD):
        return True, None, None
    cause = figures.get("trip") or (figures.get("oscillation") if is_done else None) or {}
    problem = "its process ended" if outcome.status == DIED else str(outcome.problem)
    why = problem if not (is_done or cause) else str(figures.get("reason") or "it has no figures")
    return False, cause.get("time_s", outcome.end_s), why.rstrip(".")
