"""Prepare a tuning: resolve the gains, cases, seeds and conditions of a plan in a system with its FMUs.

Stability margins are conditions of a case: the loops that it names are measured as `emla linearize` does.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...base.errors import CommandError, CosimError
from ...run.requirements import Requirement, parse_requirement
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ..execution.worker_payload import Preparation
from ..linearize.perturbation import parse_opening
from ..linearize.response import LARGEST_MS, LEAST_GAIN_DB, LEAST_PHASE_DEG
from ..linearize.runner import measure_loops
from ..variants.factors import Factor, merge_options, resolve_factors
from ..variants.measures import Measures, MetricRequest, SimulationDescription, resolve_measures
from .plan import Case, TuningPlan
from .score import TRACKING_ERROR, Objective
from .space import Expression, Space, build_space, check_during_a_run, parse_expression

_PHASE, _GAIN_UP, _GAIN_DOWN, _MS = "phase_margin_deg", "gain_margin_up_dB", "gain_margin_down_dB", "Ms"

_CONDITIONS = (
    (_PHASE, ">=", LEAST_PHASE_DEG),
    (_GAIN_UP, ">=", LEAST_GAIN_DB),
    (_GAIN_DOWN, "<=", -LEAST_GAIN_DB),
    (_MS, "<=", LARGEST_MS),
)

_MAX_SAMPLES = 1500
"""Length of the responses in steps."""

_UNLIMITED_DB = 200.0
"""Gain margin of a loop that no gain makes unstable."""


@dataclass(frozen=True)
class LoopMargins:
    """The loops of a case, and the operating point at which they are measured.

    Attributes:
        at: time in s.
        duration: length of the responses in s.
        values: start values of the case.
    """

    scenario: Scenario
    loops: Sequence[str]
    at: float
    duration: float
    values: Mapping[str, Any]

    def measure(self, gains: Mapping[str, Any]) -> dict[str, float]:
        """Return figures of all loops with these start values; a loop without margins has none."""
        responses = measure_loops(self.scenario, self.loops, self.at, self.duration, {**gains, **self.values})
        figures = dict[str, float]()
        for loop, response in responses.items():
            margins = None if isinstance(response, CosimError) else response.margins
            if margins is None or not margins.has_crossover:
                continue  # its conditions are missed then, as for an unstable loop
            figures |= {
                f"{loop}: {_PHASE}": margins.phase_deg,
                f"{loop}: {_GAIN_UP}": min(margins.gain_up_dB, _UNLIMITED_DB),
                f"{loop}: {_GAIN_DOWN}": max(margins.gain_down_dB, -_UNLIMITED_DB),
                f"{loop}: {_MS}": margins.Ms,
            }
        return {name: value for name, value in figures.items() if math.isfinite(value)}


@dataclass(frozen=True)
class TuningTask:
    """A prepared tuning; `cases` has the options of each case, `loops` those whose margins it requires."""

    plan: TuningPlan
    space: Space
    objective: Objective
    measures: Measures
    cases: Sequence[Mapping[str, Any]]
    loops: Sequence[LoopMargins | None]
    seeds: Factor | None
    identity: Mapping[str, Any]


def prepare_task(
    plan: TuningPlan, preparation: Preparation, described: SimulationDescription, scenario: Scenario
) -> TuningTask:
    """Resolve a plan in a system; `scenario` is the one that was prepared.

    Raises:
        CommandError: A name does not exist, or parts of the plan contradict each other.
    """
    objective = parse_expression(plan.objective, f"'objective' of {plan.where}")
    subjects = _find_subjects(objective, described)
    required = [_list_conditions(plan, case, subjects, described) for case in plan.cases]
    measures = _resolve_measures(plan, objective, required, described)
    space = build_space(plan, preparation.system, preparation.interfaces)
    times = run_times(preparation.options, plan.name)
    cases = [_resolve_options(case, plan, preparation) for case in plan.cases]
    loops = [
        _prepare_loops(case, values, scenario, plan.where)
        for case, values in zip(plan.cases, cases, strict=True)
    ]
    checked = [
        [
            *conditions,
            *(
                Requirement(f"{loop}: {name}", sign, x)
                for loop in case.margins
                for name, sign, x in _CONDITIONS
            ),
        ]
        for case, conditions in zip(plan.cases, required, strict=True)
    ]
    errors = _list_tracking_errors(described)  # other joints say nothing about the gains
    errors = [name for name in errors if described.figures[name].subject in subjects] or errors
    return TuningTask(
        plan,
        space,
        Objective(objective, plan.cases, checked, times.start, times.stop, plan.margin, errors),
        measures,
        cases,
        loops,
        _resolve_seeds(plan, preparation),
        preparation.identity,
    )


def _find_subjects(objective: Expression, described: SimulationDescription) -> list[str]:
    """Return what the figures of the objective belong to: joints, as a rule."""
    figures = described.figures
    # a metric of the plan belongs to the object that its name begins with
    return list(
        dict.fromkeys(
            figures[name].subject if name in figures else name.rpartition(".")[0]
            for name in sorted(objective.names)
        )
    )


def _list_conditions(
    plan: TuningPlan, case: Case, subjects: Sequence[str], described: SimulationDescription
) -> list[Requirement]:
    """Return the conditions of a case, and that each of the subjects of the objective is held."""
    texts = plan.require if case.require is None else case.require
    conditions = [parse_requirement(text) for text in texts]
    figures = {condition.figure for condition in conditions}
    verdicts = {f.subject: name for name, f in described.figures.items() if f.is_verdict}
    required = [verdicts[subject] for subject in subjects if subject in verdicts]
    return [*conditions, *(Requirement(name, "==", True) for name in required if name not in figures)]


def _resolve_measures(
    plan: TuningPlan,
    objective: Expression,
    required: Sequence[Sequence[Requirement]],
    described: SimulationDescription,
) -> Measures:
    """Return the figures that objective and conditions need; raise CommandError for an unknown one."""
    declared = MetricRequest.of(plan.metrics, plan.where)
    conditions = [r for case in required for r in case]
    needed = dict.fromkeys([*sorted(objective.names), *(r.figure for r in conditions)])
    figures = [name for name in needed if name not in declared.expressions and name not in declared.functions]
    figures += [name for name in _list_tracking_errors(described) if name not in figures]
    request = MetricRequest(figures, declared.expressions, declared.functions)
    measures = resolve_measures(
        request, described.figures, list(described.units), list(described.further), [], plan.where
    )
    if inexact := [name for name in figures if name not in described.figures]:
        raise CommandError(f"{plan.where} needs the figure '{inexact[0]}' by its name, not by a pattern.")
    for condition in conditions:
        if (condition.figure in measures.truths) != isinstance(condition.value, bool):
            right = "true or false" if condition.figure in measures.truths else "a number"
            raise CommandError(
                f"the requirement '{condition}' of {plan.where} has the wrong type: "
                f"{condition.figure} is {right}."
            )
    return measures


def _list_tracking_errors(described: SimulationDescription) -> list[str]:
    return [name for name, figure in described.figures.items() if figure.metric == TRACKING_ERROR]


def _resolve_options(case: Case, plan: TuningPlan, preparation: Preparation) -> dict[str, Any]:
    """Return the options of a case, each with its one value."""
    where = f"the case '{case.name}' of {plan.where}"
    factors = resolve_factors(case.set, preparation.system, preparation.interfaces, where)
    check_during_a_run(factors, where)
    parts = list[dict[str, Any]]()
    for factor in factors:
        levels = factor.distribution.levels
        if levels is None or len(levels) != 1:
            raise CommandError(f"'{factor.name}' of {where} must be one value, such as 0.1 or \"110%\".")
        parts.append(factor.options(factor.value(levels[0])))
    return merge_options(parts)


def _resolve_seeds(plan: TuningPlan, preparation: Preparation) -> Factor | None:
    """Return the start values that seed random sequences; None for a system without any."""
    if not plan.seeds:
        return None
    # the value does not matter: each run gets the seed that is drawn for it
    entry = {"seeds": {"of": list(plan.seeds), "distribution": "values", "values": [1]}}
    try:
        (factor,) = resolve_factors(entry, preparation.system, preparation.interfaces, plan.where)
    except CommandError:
        if plan.seeds == TuningPlan.seeds:  # the default matches nothing in a system without random numbers
            return None
        raise
    return factor


def _prepare_loops(
    case: Case, values: Mapping[str, Any], scenario: Scenario, where: str
) -> LoopMargins | None:
    """Return the loops of a case with these options; None if it has none."""
    if not case.margins:
        return None
    if further := [name for name in values if name != "set"]:
        raise CommandError(
            f"the case '{case.name}' of {where} has 'margins' and sets the option {further[0]}; "
            "set start values only."
        )
    for loop in case.margins:
        parse_opening(scenario.system, loop)
    times = run_times(scenario.options, scenario.name)
    count = min(_MAX_SAMPLES, times.steps // 2)
    last = times.point(times.steps - count)
    at = last if case.at is None else case.at
    if not times.start <= at <= last:
        raise CommandError(
            f"'at' of the case '{case.name}' of {where} is {at:g} s; choose a time from {times.start:g} to "
            f"{last:g} s, so that the responses of {count * times.step:g} s end within the run."
        )
    return LoopMargins(scenario, case.margins, at, count * times.step, values.get("set", {}))
