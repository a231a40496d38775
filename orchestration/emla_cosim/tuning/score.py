"""What a set of gains is worth: its objective where all conditions hold, else by how much they do not."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..run.requirements import Requirement
from ..sweeps.data import DONE
from ..sweeps.worker import VariantOutcome
from .expressions import Expression
from .plan import Case
from .search import Order
from .tracking import TRACKING_ERROR

LOST = 20.0
"""What a run counts that ended early or has no objective, more than any that missed its conditions."""

_MOST = 10.0
"""What a missed condition counts at most."""

_MISSED = 1.0
"""What a condition counts that is missed and has no distance, such as a truth."""


@dataclass(frozen=True)
class Score:
    """What came out of all runs of a set of gains.

    `objective` is the mean over cases by their weights, each the mean over seeds; NaN where a run has
    none. `violation` is 0 where all conditions hold in all runs, with the margin of the plan; `lost` is
    how many runs ended early or have no objective, of `runs`. `by_case` has the objective of each case,
    `worst` for each case the figure farthest from each condition.
    """

    objective: float
    violation: float
    lost: int
    runs: int
    by_case: Mapping[str, float] = field(default_factory=dict)
    worst: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def holds(self) -> bool:
        """Whether all conditions do, without any margin."""
        return not self.lost and not self.list_unmet()

    @property
    def order(self) -> Order:
        """What the search compares."""
        return (True, self.violation) if self.violation else (False, self.objective)

    def list_unmet(self) -> list[str]:
        """Conditions that do not hold, with their case and the worst figure."""
        return [
            f"{case}: {condition}, but it is {format_figure(worst['figure'])}"
            for case, conditions in self.worst.items()
            for condition, worst in conditions.items()
            if not worst["met"]
        ]


def format_figure(figure: Any) -> str:
    """A figure as a sentence has it."""
    if figure is None or figure != figure:
        return "missing"
    return str(figure).lower() if isinstance(figure, bool) else f"{figure:.6g}"


@dataclass(frozen=True)
class Objective:
    """What is wanted: an objective, and for each case its conditions; runs last from `start` to `stop` in s.

    `margin` is the part by which figures have to be better than their conditions.
    """

    objective: Expression
    cases: Sequence[Case]
    required: Sequence[Sequence[Requirement]]
    start: float
    stop: float
    margin: float = 0.0

    def score(self, outcomes: Sequence[Sequence[VariantOutcome]]) -> Score:
        """What gains are worth whose runs gave these, a list over seeds for each case."""
        objectives = dict[str, float]()
        worst = dict[str, Mapping[str, Any]]()
        violation, lost, runs = 0.0, 0, 0
        for case, required, ours in zip(self.cases, self.required, outcomes, strict=True):
            values = [self._objective(case, outcome) for outcome in ours]
            missing = [x != x for x in values]
            objectives[case.name] = float(np.mean(values)) if case.weight else math.nan
            each = [self._violation(o, required, gone) for o, gone in zip(ours, missing, strict=True)]
            violation += sum(each) / len(each)
            lost += sum(missing)
            runs += len(ours)
            worst[case.name] = {str(r): _worst(r, ours) for r in required}
        total = sum(case.weight for case in self.cases)
        objective = sum(c.weight * objectives[c.name] for c in self.cases if c.weight) / total
        by_case = {name: value for name, value in objectives.items() if value == value}
        return Score(objective, violation, lost, runs, by_case, worst)

    def _objective(self, case: Case, outcome: VariantOutcome) -> float:
        """The objective of one run; NaN for one that is lost, 0 where a case has no weight."""
        if outcome.status != DONE:
            return math.nan
        if not case.weight:
            return 0.0
        numbers = {name: math.nan if x is None else float(x) for name, x in outcome.figures.items()}
        value = self.objective.value(numbers)
        return value if math.isfinite(value) else math.nan

    def _violation(self, outcome: VariantOutcome, required: Sequence[Requirement], is_lost: bool) -> float:
        """How far a run is from what is wanted, so that less is nearer also among those that are lost."""
        found = sum(_excess(r, outcome.figures.get(r.figure), self.margin) for r in required)
        if is_lost:
            found += LOST + LOST * self._missing_part(outcome)
        return found + _distance(outcome) if found else 0.0

    def _missing_part(self, outcome: VariantOutcome) -> float:
        """The part of the run that is not there."""
        if outcome.status == DONE:
            return 0.0
        end = self.start if outcome.end_s is None else outcome.end_s
        return min(max((self.stop - end) / (self.stop - self.start), 0.0), 1.0)


def _excess(required: Requirement, figure: Any, margin: float = 0.0) -> float:
    """By how much a figure is not as required, relative to what is."""
    if required.met_by(figure) and not margin:
        return 0.0
    if figure is None or figure != figure:
        return _MOST
    if isinstance(required.value, bool) or required.sign in ("==", "!="):
        return 0.0 if required.met_by(figure) else _MISSED
    scale = abs(required.value) or 1.0
    beyond = (figure - required.value) / scale * (1.0 if required.sign[0] == "<" else -1.0) + margin
    if beyond < 0.0 or (beyond == 0.0 and required.sign[1:]):
        return 0.0
    return min(max(beyond, 1e-9), _MOST)


def _distance(outcome: VariantOutcome) -> float:
    """How far joints are from their references."""
    misses = [
        float(x)
        for name, x in outcome.figures.items()
        if name.endswith(f".{TRACKING_ERROR}") and x is not None
    ]
    return sum(misses) / len(misses) if misses else 0.0


def _worst(required: Requirement, outcomes: Sequence[VariantOutcome]) -> dict[str, Any]:
    """The figure farthest from a condition, and whether it meets it; where all do, the one that just does."""
    figures = [outcome.figures.get(required.figure) for outcome in outcomes]
    numbers = [x for x in figures if isinstance(x, (int, float)) and x == x]
    if failing := [x for x in figures if not required.met_by(x)]:
        figure = max(failing, key=lambda x: _excess(required, x))
        return {"figure": None if figure != figure else figure, "met": False}
    low = required.sign in (">", ">=")
    return {"figure": min(numbers) if low else max(numbers), "met": True}
