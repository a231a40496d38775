"""Score sets of gains: their objective if all conditions hold, else how far they are from it.

A joint that is lost is the farther from it the larger its tracking error, which tunings record for this.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...recorders.metrics import METRICS, TRACKED, Figures, Metrics
from ...recorders.recorder import RunLayout
from ...run.requirements import Requirement
from ..variants.measures import VariantOutcome
from .plan import Case
from .space import Expression

Order = tuple[bool, float]
"""Sort key of a point, smaller is better: whether it is invalid; then its violation or its objective."""

TRACKING_ERROR = "miss"
"""Mean of log10(1 + |x_L - x_d| / 1 µm) over all rows: 1 for 9 µm, 6 for a metre."""

_METRICS_NAME = "tuning"
"""Name of the tracking errors among the metrics of a run."""

_SMALL_ERROR_M = 1e-6
"""Tracking error in m that counts as small."""

_MAX_ERROR = 12.0
"""Value of a row that is not a number or is farther away than anything."""

_INCOMPLETE_RUN = 20.0
"""Violation of a run that ended early or has no objective, larger than that of missed conditions."""

_MAX_VIOLATION = 10.0
"""Largest violation of a missed condition."""

_BOOLEAN_VIOLATION = 1.0
"""Violation of a missed condition without a distance, such as a truth value."""


@dataclass(frozen=True)
class Score:
    """The score of a set of gains over all its runs.

    Attributes:
        objective: The mean over cases by their weights, each the mean over seeds; NaN if a run has none.
        violation: 0 if all conditions hold in all runs, with the margin of the plan.
        lost: The number of runs that ended early or have no objective.
        runs: The number of all runs.
        met: The number of seeds with which all conditions hold, without any margin.
        by_case: The objective of each case.
        worst: For each case and condition, the figure that is farthest from it.
    """

    objective: float
    violation: float
    lost: int
    runs: int
    met: int = 0
    by_case: Mapping[str, float] = field(default_factory=dict)
    worst: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def holds(self) -> bool:
        """Whether all conditions hold, without any margin."""
        return not self.lost and not self.list_unmet()

    @property
    def order(self) -> Order:
        """The key that the search compares."""
        # conditions first: an objective counts only where all of them hold
        value = self.violation or self.objective
        # the tracking error of a run that diverged, and so the violation, can be NaN: worse than any number
        return bool(self.violation), math.inf if math.isnan(value) else value

    def list_unmet(self, before: "Score | None" = None) -> list[str]:
        """Return the conditions that do not hold, but did `before`, with their case and the worst figure."""
        return [
            f"{case}: {condition}, but it is {format_figure(worst['figure'])}"
            for case, conditions in self.worst.items()
            for condition, worst in conditions.items()
            if not worst["met"] and (before is None or before.worst[case][condition]["met"])
        ]


def format_figure(figure: Any) -> str:
    """Return a figure as text for messages."""
    if figure is None or figure != figure:
        return "missing"
    return str(figure).lower() if isinstance(figure, bool) else f"{figure:.6g}"


@dataclass(frozen=True)
class Objective:
    """The objective, and the conditions for each case; runs last from `start` to `stop` in s.

    Attributes:
        margin: By which part figures must be better than their conditions.
        tracking_errors: Names of the figures that say how far joints are from their references.
    """

    objective: Expression
    cases: Sequence[Case]
    required: Sequence[Sequence[Requirement]]
    start: float
    stop: float
    margin: float = 0.0
    tracking_errors: Sequence[str] = ()

    def score(self, outcomes: Sequence[Sequence[VariantOutcome]]) -> Score:
        """Return the score of gains.

        Args:
            outcomes: The outcomes of their runs: for each case a list over seeds.
        """
        objectives = dict[str, float]()
        worst = dict[str, Mapping[str, Any]]()
        violation, lost_runs, runs = 0.0, 0, 0
        met = np.ones(len(outcomes[0]), dtype=bool)
        for case, required, by_seed in zip(self.cases, self.required, outcomes, strict=True):
            values = [self._find_objective(case, outcome) for outcome in by_seed]
            missing = [x != x for x in values]
            objectives[case.name] = float(np.mean(values)) if case.weight else math.nan
            violations = [self._rate_run(o, required, x) for o, x in zip(by_seed, missing, strict=True)]
            # the mean, so that the number of seeds does not weigh a case
            violation += sum(violations) / len(violations)
            lost_runs += sum(missing)
            runs += len(by_seed)
            met &= [
                not is_missing and all(r.met_by(outcome.figures.get(r.figure)) for r in required)
                for outcome, is_missing in zip(by_seed, missing, strict=True)
            ]
            worst[case.name] = {str(r): _find_worst(r, by_seed) for r in required}
        total = sum(case.weight for case in self.cases)
        objective = sum(c.weight * objectives[c.name] for c in self.cases if c.weight) / total
        by_case = {name: value for name, value in objectives.items() if value == value}
        return Score(objective, violation, lost_runs, runs, int(met.sum()), by_case, worst)

    def meets_conditions_on_known_figures(self, outcomes: Sequence[Sequence[VariantOutcome]]) -> bool:
        """Return whether runs meet all conditions on figures that they have; margins come later."""
        return all(
            outcome.complete
            and not any(
                _find_excess(r, outcome.figures[r.figure], self.margin)
                for r in required
                if r.figure in outcome.figures
            )
            for required, by_seed in zip(self.required, outcomes, strict=True)
            for outcome in by_seed
        )

    def _find_objective(self, case: Case, outcome: VariantOutcome) -> float:
        """Return the objective of one run; NaN for a lost one, 0 for a case without weight."""
        if not outcome.complete:
            return math.nan
        if not case.weight:
            return 0.0
        numbers = {name: math.nan if x is None else float(x) for name, x in outcome.figures.items()}
        value = self.objective.value(numbers)
        return value if math.isfinite(value) else math.nan

    def _rate_run(self, outcome: VariantOutcome, required: Sequence[Requirement], is_lost: bool) -> float:
        """Return the violation of a run; among lost runs, too, a smaller one is nearer to the conditions."""
        violation = sum(_find_excess(r, outcome.figures.get(r.figure), self.margin) for r in required)
        if is_lost:
            end = self.start if outcome.end_s is None else outcome.end_s
            # a run that ends later is nearer to a run that ends well
            missing = 0.0 if outcome.complete else (self.stop - end) / (self.stop - self.start)
            violation += _INCOMPLETE_RUN + _INCOMPLETE_RUN * min(max(missing, 0.0), 1.0)
        errors = [float(x) for n in self.tracking_errors if (x := outcome.figures.get(n)) is not None]
        return violation + (sum(errors) / len(errors) if errors else 0.0) if violation else 0.0


def _find_excess(required: Requirement, figure: Any, margin: float = 0.0) -> float:
    """Return by how much a figure violates its condition, relative to the limit."""
    if required.met_by(figure) and not margin:
        return 0.0
    if figure is None or figure != figure:
        return _MAX_VIOLATION
    if isinstance(required.value, bool) or required.sign in ("==", "!="):
        return 0.0 if required.met_by(figure) else _BOOLEAN_VIOLATION
    scale = abs(required.value) or 1.0
    # relative, so that conditions in different units weigh the same
    beyond = (figure - required.value) / scale * (1.0 if required.sign[0] == "<" else -1.0) + margin
    if beyond < 0.0 or (beyond == 0.0 and required.sign[1:]):
        return 0.0
    # at least a little: 0 would mean that the condition holds
    return min(max(beyond, 1e-9), _MAX_VIOLATION)


def _find_worst(required: Requirement, outcomes: Sequence[VariantOutcome]) -> dict[str, Any]:
    """Return the figure that violates a condition most, or is nearest to its limit, and whether it holds."""
    figures = [outcome.figures.get(required.figure) for outcome in outcomes]
    numbers = [x for x in figures if isinstance(x, (int, float)) and x == x]
    if failing := [x for x in figures if not required.met_by(x)]:
        figure = max(failing, key=lambda x: _find_excess(required, x))
        return {"figure": None if figure != figure else figure, "met": False}
    low = required.sign in (">", ">=")
    return {"figure": min(numbers) if low else max(numbers), "met": True}


class _TrackingErrorMetrics(Metrics):
    def __init__(self, columns: Mapping[str, tuple[int, int]]) -> None:
        self._columns = columns
        self._sums = dict.fromkeys(columns, 0.0)
        self._rows = 0

    def write(self, rows: Vector) -> None:
        self._rows += len(rows)
        for joint, (position, reference) in self._columns.items():
            error = np.abs(rows[:, position] - rows[:, reference])
            # logarithmic, so that a joint far away does not hide the others
            logarithms = np.log10(1.0 + error / _SMALL_ERROR_M)
            self._sums[joint] += float(
                np.nan_to_num(logarithms, nan=_MAX_ERROR, posinf=_MAX_ERROR).clip(0, _MAX_ERROR).sum()
            )

    def figures(self) -> Figures:
        return {joint: {TRACKING_ERROR: total / max(self._rows, 1)} for joint, total in self._sums.items()}

    def state_dict(self) -> Any:
        return {"sums": self._sums, "rows": self._rows}

    def load_state_dict(self, state: Any) -> None:
        self._sums, self._rows = dict(state["sums"]), int(state["rows"])


def tracking_error(layout: RunLayout) -> Metrics | None:
    """Return the metrics that record the tracking error of each joint; None for a run without joints."""
    column = {name: i + 1 for i, name in enumerate(layout.names)}
    columns = {
        joint: (column[position], column[reference])
        for find in TRACKED.values()
        for joint, (position, reference) in find(column, layout.roles).items()
    }
    return _TrackingErrorMetrics(columns) if columns else None


@contextmanager
def record_tracking_error() -> Iterator[None]:
    """Record the tracking error meanwhile, here and on workers that start meanwhile."""
    # other commands of this process must not show it
    METRICS[_METRICS_NAME] = tracking_error
    try:
        yield
    finally:
        METRICS.pop(_METRICS_NAME, None)
