"""Check that steps compute something, and that inputs count."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector

from ..check import CheckOutcome, check, failed, noted, passed, quote, skipped, unjudged, warned
from ..host.experiment import make_experiment, read_limits, read_span, step_through, take_in_time
from ..host.hosted_instance import CallError, HostedInstance
from ..host.other_values import Values, choose_other, list_other_values, list_settable, read_start
from ..messages import join_few_names, judge_problems, list_left_out
from ..subject import Subject
from ..subprocess_run import in_fresh_process, in_separate_process

_TIME_FRACTION = 0.5
"""Part of the time limit in which runs are repeated with other inputs."""

_STEPS = 20
_MORE_STEPS = 100
_MOST_PAIRS = 100
_MOST_INPUTS = 10
_MOST_CHOICES = 5
_MAX_SLOPE_ERROR = 0.3
"""Distance of a state's slope in a step from its derivative, relative to both, that is too far."""

# part of the steps that must be wrong: in others, a state may jump
_MAX_WRONG_FRACTION = 0.5

_MARGIN = 0.05
"""Allowed distance from the derivatives at both ends of a step, relative to the largest."""


@check("steps.integrate", needs=("run.finite",), time_factor=2.0)
def integrate(subject: Subject) -> CheckOutcome:
    """Compare slopes of states with their derivatives in runs with constant inputs, one moved in each."""
    if subject.kinds[0] != "CoSimulation":
        return skipped("The FMU is for Model Exchange: the host integrates it.")
    if subject.has_clocks:
        message = "Its Clocks may change derivatives within a step: only a reference shows what steps do."
        return unjudged(message)
    pairs = [(v.derivative, v) for v in subject.description.modelVariables if v.derivative is not None]
    pairs = [(x, d) for x, d in pairs if x.type == "Real"][:_MOST_PAIRS]
    if not pairs:
        return unjudged("No variable is declared as a derivative: only a reference shows what steps do.")
    inputs = list_other_values(v for v in list_settable(subject, "input", most=None) if v.type == "Real")
    runs = [{}, *({name: value} for name, value in list(inputs.items())[:_MOST_INPUTS])]
    step = read_span(subject)[1]
    names = [v.name for pair in pairs for v in pair]
    constant_states, messages, moved_count, time_stays = set(), {}, 0, False
    for changes in take_in_time(runs, _TIME_FRACTION * subject.settings.seconds):
        moved_count += len(changes)
        points, rows = in_separate_process(_run_with_constant_inputs, subject, changes, names)
        if len(rows) < 3:
            continue
        if np.any(np.diff(points) <= 0.0):
            time_stays = True  # FMI 3.0 allows it: internal steps are longer
            continue
        for k, (state, derivative) in enumerate(pairs):
            x, slopes = rows[:, 2 * k], rows[:, 2 * k + 1]
            if np.all(x == x[0]) and np.all(np.abs(slopes) * step > np.spacing(np.abs(x[0]))):  # not rounded
                constant_states.add(state.name)
            elif (wrong_fraction := _compute_wrong_fraction(x, slopes, points)) > _MAX_WRONG_FRACTION:
                changed_inputs = "".join(f" with {name} = {value:g}" for name, value in changes.items())
                line = f"{state.name} does not follow {derivative.name}{changed_inputs}"
                line = f"{line} in {wrong_fraction:.0%} of the steps."
                messages.setdefault(state.name, line)
    if constant_states:
        states = join_few_names(sorted(constant_states))
        return failed(f"{states} stays the same in {_STEPS} steps, although its derivative is not 0.")
    gaps = list_left_out(moved_count, len(inputs), "inputs were moved.")
    if time_stays:
        gap = "The time that the FMU reaches stays the same in some steps, so that slopes have no length."
        gaps += (gap,)
    # internal steps may be longer
    return judge_problems((), f"{len(pairs)} states follow their derivatives.", list(messages.values()), gaps)


def _run_with_constant_inputs(
    subject: Subject, changes: Values, names: Sequence[str]
) -> tuple[Vector, Vector]:
    """Return times in s that the FMU reached, and values after each step to them, with constant inputs."""
    instance, course = HostedInstance(subject), make_experiment(subject, _STEPS)
    instance.initialize(changes, float(course.times[0]))
    rows, points = [], []
    for k in step_through(instance, course.times[:-1], course.step, lambda _: instance.set(changes)):
        rows.append([float(value) for value in instance.get(names)])
        points.append(float(course.times[k]) if instance.reached is None else instance.reached)
    instance.free()
    return np.array(points), np.array(rows, dtype=float).reshape(len(rows), len(names))


def _compute_wrong_fraction(x: Vector, slopes: Vector, points: Vector) -> float:
    """Return the part of the steps in which a state's slope is far from its derivatives at both ends.

    A state may jump in some steps, at events.
    """
    slope, before, after = np.diff(x) / np.diff(points), slopes[:-1], slopes[1:]
    low, high = np.minimum(before, after), np.maximum(before, after)
    # the constant is for slopes that are 0 but for rounding
    margin = (high - low) + _MARGIN * np.abs(slopes).max() + 1e-12
    outside = np.maximum(np.maximum(low - margin - slope, slope - high - margin), 0.0)
    size = np.maximum(np.abs(slope), np.maximum(np.abs(before), np.abs(after)))
    is_comparable = np.isfinite(size) & (size > 0.0)
    if not is_comparable.any():
        return 0.0
    return float(np.mean(outside[is_comparable] > _MAX_SLOPE_ERROR * size[is_comparable]))


@check("exchange.inputs", clause=quote("shared.indices"), needs=("run.deterministic",), time_factor=2.0)
def inputs(subject: Subject) -> CheckOutcome:
    """Check that an input changes something, if outputs or derivatives are declared to depend on one."""
    variables = [v for v in list_settable(subject, "input", most=None) if choose_other(v) is not None]
    names = _list_results(subject)
    if not variables or not names:
        return skipped("It has no input with another valid value, or nothing that could depend on it.")
    effect = _has_effect(subject, variables, names)
    if effect is None:
        return unjudged("There was no time to move its inputs.")
    if not effect:
        message, dependencies = f"No input changed anything in {_STEPS} steps", _list_dependencies(subject)
        if declared := [v.name for v in variables if v.name in dependencies]:
            return warned(f"{message}, although {declared[0]} is a dependency.")
        return unjudged(f"{message}: only a reference shows if one should.")
    examined, limit = variables[:_MOST_INPUTS], _TIME_FRACTION * subject.settings.seconds
    bases = _Cached(_run_bases(subject, examined, names))
    unused, examined_count, steps = [], 0, _STEPS
    for variable in take_in_time(examined, limit):
        examined_count += 1
        if not any(
            _is_run_changed(subject, {**base, variable.name: value}, names, expected)
            for base, expected in bases
            for value in _list_alternatives(variable, base)
        ):
            unused.append(variable.name)
    if unused:
        unused, steps = [*_find_inputs_unused_in_longer_run(subject, unused, names)], _MORE_STEPS
    gaps = list_left_out(examined_count, len(variables), "inputs were moved alone.")
    message = f"{examined_count - len(unused)} of {examined_count} inputs changed a result."
    if unused:  # parameters or states, such as the direction of a flow, may switch them off
        return noted(f"{join_few_names(unused)} changed nothing in {steps} steps. {message}", gaps=gaps)
    return passed(message, gaps=gaps)


def _find_inputs_unused_in_longer_run(
    subject: Subject, input_names: Sequence[str], names: Sequence[str]
) -> Iterator[str]:
    """Yield those of these inputs that change nothing in a longer run, either: it may sample them rarely."""
    baseline = in_separate_process(_record_run, subject, {}, names, _MORE_STEPS)
    for name in take_in_time(input_names, _TIME_FRACTION * subject.settings.seconds):
        values = {name: choose_other(subject.variables[name])}
        if not _is_run_changed(subject, values, names, baseline, _MORE_STEPS):
            yield name


def _has_effect(subject: Subject, variables: Sequence[ModelVariable], names: Sequence[str]) -> bool | None:
    """Return whether a run changes if inputs are moved, together or alone; None without time for two runs."""
    was_compared, limit = False, _TIME_FRACTION * subject.settings.seconds
    single_moves = [{v.name: choose_other(v)} for v in variables]  # together, they may cancel out
    for parameters, moves in take_in_time(_combine_values(subject, variables), limit):
        try:
            baseline = in_separate_process(_record_run, subject, parameters, names)
        except CallError:  # the model does not accept these values together
            continue
        for values in take_in_time(moves if parameters else [*moves, *single_moves], limit):
            was_compared = True
            if _is_run_changed(subject, {**parameters, **values}, names, baseline):
                return True
    return False if was_compared else None


def _combine_values(
    subject: Subject, variables: Sequence[ModelVariable]
) -> Iterator[tuple[Values, list[Values]]]:
    """Yield values of parameters, and values of all inputs for runs with them: others, then far ones.

    Later ones have other values of parameters, which may switch inputs on: choices together and one by one,
    then gains.
    """
    far: list[Values] = [{}, {}]
    for variable in variables:
        ends = _list_far_values(variable) or [choose_other(variable)] * 2
        for base, value in zip(far, ends, strict=True):
            base[variable.name] = value
    moved_values = {v.name: choose_other(v) for v in variables}
    parameters = list_settable(subject, "parameter")
    choices = list_other_values(v for v in parameters if v.type in ("Boolean", "Enumeration"))
    gains = list_other_values(v for v in parameters if v.type in ("Real", "Integer"))
    one_by_one = [{name: value} for name, value in choices.items()] if len(choices) > 1 else []
    switches = [choices, *one_by_one[:_MOST_CHOICES], gains, {**choices, **gains}]
    yield {}, [moved_values, *far]
    yield from ((values, [moved_values]) for values in switches if values)


def _run_bases(
    subject: Subject, variables: Sequence[ModelVariable], names: Sequence[str]
) -> Iterator[tuple[Values, Any]]:
    """Yield values of parameters and all inputs, with the run that they give: start values, then others."""
    for parameters, moves in _combine_values(subject, variables):
        for values in moves if parameters else ({}, *moves):
            base = {**parameters, **values}
            with suppress(CallError):  # the model does not accept these values together
                yield base, in_separate_process(_record_run, subject, base, names)


class _Cached:
    """Iterates over items any number of times; each is computed once, when it is needed."""

    def __init__(self, source: Iterator[Any]) -> None:
        self._source, self._items = source, []

    def __iter__(self) -> Iterator[Any]:
        yield from self._items
        for item in self._source:
            self._items.append(item)
            yield item


def _list_far_values(variable: ModelVariable) -> list[float]:
    """Return values of a Real far above and below the others; none for other types."""
    if variable.type != "Real":
        return []
    low, high = read_limits(variable)
    far = 10.0 * max(abs(choose_other(variable)), 1.0)
    return [min(max(v, low), high) for v in (far, -far)]


def _list_alternatives(variable: ModelVariable, base: Values) -> list[Any]:
    """Return values to try in place of that of a base: another one, and far ones."""
    start, other_value = read_start(variable), choose_other(variable)
    return [start if base.get(variable.name) == other_value else other_value, *_list_far_values(variable)]


def _is_run_changed(
    subject: Subject, changes: Values, names: Sequence[str], expected: Any, steps: int = _STEPS
) -> bool:
    """Return whether a run with these values differs from the expected one, or the FMU refuses them."""
    try:
        return in_separate_process(_record_run, subject, changes, names, steps) != expected
    except CallError:  # the model does not accept this value, so it counts
        return True


def _record_run(
    subject: Subject, changes: Values, names: Sequence[str], steps: int = _STEPS
) -> list[list[Any]]:
    """Return values as texts, after initialization and each step of a run with these changes."""
    start, step, count = read_span(subject)
    instance = HostedInstance(subject)
    instance.initialize(changes, start)
    rows = [[str(v) for v in instance.get(names)]]
    inputs = {n: v for n, v in changes.items() if subject.variables[n].causality == "input"}
    times = (start + k * step for k in range(min(count, steps)))
    for _ in step_through(instance, times, step, lambda _: instance.set(inputs)):
        rows.append([str(v) for v in instance.get(names)])
    instance.free()
    return rows


def _list_results(subject: Subject) -> list[str]:
    """Return the names of outputs, derivatives and states: the first ones, if there are many."""
    description = subject.description
    result_names = [v.name for v in description.modelVariables if v.causality == "output"]
    states = [v.derivative.name for v in description.modelVariables if v.derivative is not None]
    result_names += [u.variable.name for u in description.derivatives if u.variable is not None]
    names = dict.fromkeys([*result_names, *states])
    return list(names)[:_MOST_PAIRS]


def _list_dependencies(subject: Subject) -> set[str]:
    """Return the names of variables that outputs or derivatives are declared to depend on."""
    description = subject.description
    unknowns = [*description.outputs, *description.derivatives]
    return {v.name for u in unknowns if u.dependencies for v in u.dependencies}


@check("exchange.interpolation", needs=("run.deterministic",), only_for=2)
def interpolation(subject: Subject) -> CheckOutcome:
    """Check that a derivative of the inputs changes a run in which other inputs would change it."""
    if subject.kinds[0] != "CoSimulation" or not subject.has_capability("canInterpolateInputs"):
        return skipped("canInterpolateInputs is not set.")
    inputs = [v for v in list_settable(subject, "input") if v.type == "Real" and choose_other(v) is not None]
    inputs = [v for v in inputs if v.variability in (None, "continuous")]
    names = _list_results(subject)
    if not inputs or not names:
        return skipped("It has no continuous Real input, or nothing that could depend on one.")
    changes = {v.name: choose_other(v) for v in inputs}
    plain = {v.name: read_start(v) for v in inputs}
    plain_run, run_with_derivatives, moved_run = (
        in_fresh_process(_run_with_input_derivatives, subject, values, slopes, names)
        for values, slopes in ((plain, {}), (plain, changes), (changes, {}))
    )
    if run_with_derivatives != plain_run:
        return passed("Derivatives of the inputs change a run.")
    if moved_run == plain_run:
        return skipped("No input has an effect, so that no derivative can have one.")
    # without states, nothing need happen within a step
    judge = failed if any(v.derivative is not None for v in subject.description.modelVariables) else warned
    return judge(
        "fmi2SetRealInputDerivatives returns fmi2OK, but a run with derivatives is the same to the last bit "
        "as one without."
    )


def _run_with_input_derivatives(
    subject: Subject, values: Values, slopes: Values, names: Sequence[str]
) -> list[list[Any]]:
    """Return values after each step of a run; inputs change by the difference to the start in one step."""
    start, step, count = read_span(subject)
    instance = HostedInstance(subject)
    instance.initialize(values, start)
    references = [instance.reference(name) for name in values]
    rates = [(slopes[name] - values[name]) / step if slopes else 0.0 for name in values]

    def prepare(_: int) -> None:
        instance.set(values)
        with instance.calling():
            instance.fmu.setRealInputDerivatives(references, [1] * len(references), rates)

    times = (start + k * step for k in range(min(count, 3)))
    return [[str(v) for v in instance.get(names)] for _ in step_through(instance, times, step, prepare)]
