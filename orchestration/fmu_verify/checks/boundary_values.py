"""Check values at the edges of a run, and those that are set after initialization."""

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from fmpy.model_description import ModelVariable

from emla_cosim.base.wording import format_count

from ..check import CheckOutcome, check, skipped
from ..host.experiment import (
    list_outputs,
    make_experiment,
    read_span,
    step_instance,
    step_through,
    take_in_time,
)
from ..host.hosted_instance import CallError, HostedInstance
from ..host.other_values import are_same, choose_other, format_value, list_settable
from ..messages import join_few_names, judge_problems, list_left_out
from ..subject import Subject
from ..subprocess_run import in_separate_process

_STEPS = 5
_MAX_VARIABLES = 300


@check("values.initial", needs=("run.finite",))
def initial(subject: Subject) -> CheckOutcome:
    """Check that outputs are finite in initialization mode; those of Clocks may begin with the first tick."""
    instance, course = HostedInstance(subject), make_experiment(subject, 1)
    output_names = [n for n in list_outputs(subject) if not subject.variables[n].clocks]
    names = output_names[:_MAX_VARIABLES]
    tolerance, start = subject.interface.tolerance, float(course.times[0])
    instance.begin_initialization(start, None, tolerance, lambda: instance.set(course.at(0)))
    values = dict(zip(names, instance.get(names), strict=True))
    instance.free()
    infinite = {name: value for name, value in values.items() if not math.isfinite(value)}
    warnings = [f"{name} is {value:g} in initialization mode." for name, value in infinite.items()]
    gaps = list_left_out(len(names), len(output_names), "outputs were read in initialization mode.")
    return judge_problems((), f"{len(names)} outputs are finite in initialization mode.", warnings, gaps)


@check("values.final", needs=("run.finite",))
def final(subject: Subject) -> CheckOutcome:
    """Compare values before and after `fmi2Terminate`."""
    if subject.has_clocks:
        return skipped("Values of clocked variables need not be readable between ticks.")
    instance, course = HostedInstance(subject), make_experiment(subject, _STEPS)
    variables = subject.description.modelVariables
    variable_names = [v.name for v in variables if v.causality in ("output", "input", "parameter")]
    names = variable_names[:_MAX_VARIABLES]
    instance.initialize(course.at(0), float(course.times[0]))
    step_instance(instance, course)
    if instance.terminated:
        return skipped("It asked to end the run.")
    before = instance.get(names)
    instance.terminate()
    after = instance.get(names)
    instance.free()
    changed = [
        f"{name} is {format_value(new)} after fmi2Terminate; before it was {format_value(old)}."
        for name, old, new in zip(names, before, after, strict=True)
        if not are_same(new, old) and not (old != old and new != new)
    ]
    gaps = list_left_out(len(names), len(variable_names), "values were compared.")
    return judge_problems(changed, f"{len(names)} values are the same after fmi2Terminate.", (), gaps)


@check("values.direct", needs=("run.finite",))
def direct(subject: Subject) -> CheckOutcome:
    """Set inputs between steps, and read the outputs that are declared to change with them at once."""
    if subject.kinds[0] != "CoSimulation" or subject.has_clocks:
        return skipped("The FMU is for Model Exchange, or has Clocks.")
    all_pairs = [*_list_direct_pairs(subject)]
    pairs = all_pairs[:_MAX_VARIABLES]
    if not pairs:
        return skipped("No output has a constant or fixed factor of an input.")
    instance, course = HostedInstance(subject), make_experiment(subject, 3)
    instance.initialize(course.at(0), float(course.times[0]))
    step_instance(instance, course)
    warnings = list[str]()
    for known, names in pairs:
        (old,), before = instance.get([known]), instance.get(names)
        variable = subject.variables[known]
        other_value = choose_other(variable)
        is_other = are_same(other_value, old)
        instance.set({known: float(str(variable.start)) if is_other else other_value})
        after = instance.get(names)
        instance.set({known: old})
        warnings += [
            f"{name} stays {format_value(value)} when {known} is set between steps, on which it is declared "
            "to depend by a constant factor."
            for name, value, new in zip(names, before, after, strict=True)
            if value == new
        ]
    instance.free()
    gaps = list_left_out(len(pairs), len(all_pairs), "inputs were set.")
    return judge_problems((), f"Outputs follow {len(pairs)} inputs at once.", warnings, gaps)


def _list_direct_pairs(subject: Subject) -> Iterator[tuple[str, list[str]]]:
    """Yield inputs and the outputs that depend on them by a constant or fixed factor."""
    outputs_by_input = dict[str, list[str]]()
    # elements of arrays of FMI 3.0 have no kinds: each may depend on all others
    for unknown in subject.read_description().outputs:
        if unknown.variable is None:
            continue
        kinds = unknown.dependenciesKind or ()
        for known, kind in zip(unknown.dependencies or (), kinds, strict=False):
            reals = [subject.variables.get(v.name) for v in (known, unknown.variable)]
            if known.causality != "input" or any(v is None or v.type != "Real" for v in reals):
                continue
            if kind in ("constant", "fixed") and choose_other(subject.variables[known.name]) is not None:
                outputs_by_input.setdefault(known.name, []).append(unknown.variable.name)
    yield from outputs_by_input.items()


_LATE_STEPS = 6
# steps of a longer run, before a value counts as one without effect: a controller may sample rarely
_MORE_STEPS = 60

_STEPS_OF_CHANGE = (1, 2, 3)
"""Steps before which a value is set."""

_MOST = 100
_MOST_RESULTS = 300

Rows = list[list[str]]


class _LateEffect(NamedTuple):
    """What is wrong with a variable: it lacks an effect, or has it some steps later than at the start."""

    name: str
    delay: int | None


@check("values.late", needs=("run.deterministic", "run.finite"), time_factor=3.0)
def late(subject: Subject) -> CheckOutcome:
    """Set each input and tunable parameter after some steps, if it has an effect when it is set at first.

    Values are compared with those that were set, and results with a run without the change.
    """
    variables = list_settable(subject, "input", "parameter", tunable=True, most=None)
    variables = [v for v in variables if choose_other(v) is not None and not v.clocks]
    all_results = _list_results(subject)
    results = all_results[:_MOST_RESULTS]
    if not variables or not results:
        return skipped("It has no tunable parameter and no input with another valid value, or no output.")
    judged_count, late_effects, not_kept = 0, list[_LateEffect](), list[str]()
    plain = in_separate_process(_run_with_change, subject, results, None, 0, _LATE_STEPS)[0]
    for variable in take_in_time(variables[:_MOST], subject.settings.seconds):
        with suppress(CallError):  # the model does not accept this value
            late_effects += _find_late_effects(subject, variable, results, plain, not_kept)
            judged_count += 1
    description = "inputs and tunable parameters were set between steps."
    gaps = list_left_out(judged_count, len(variables), description)
    gaps += list_left_out(len(results), len(all_results), "outputs and derivatives were compared.")
    without_effect = [effect.name for effect in late_effects if effect.delay is None]
    problems = list(not_kept)
    if without_effect:
        message = f"{join_few_names(without_effect)} changes nothing if it is set after initialization"
        problems.append(f"{message}, although it does if it is set before.")
    problems += [
        f"{effect.name} has its effect {format_count(effect.delay, 'step', 'steps')} later if it is set "
        "between steps than at the start."
        for effect in late_effects
        if effect.delay is not None
    ]
    fine = (
        f"Of {judged_count} inputs and tunable parameters, all that have an effect at the start have it "
        "later."
    )
    return judge_problems((), fine, problems, gaps)


def _list_results(subject: Subject) -> list[str]:
    """Return outputs of all types, and state derivatives."""
    variables = subject.description.modelVariables
    names = [v.name for v in variables if v.causality == "output" and not v.clocks]
    slopes = [v.name for v in variables if v.derivative is not None]
    return list(dict.fromkeys([*names, *slopes]))


def _find_late_effects(
    subject: Subject, variable: ModelVariable, results: list[str], plain: Rows, not_kept: list[str]
) -> Iterator[_LateEffect]:
    """Yield what is wrong with a variable; `not_kept` gets a message if it does not keep its value."""
    first = in_separate_process(_run_with_change, subject, results, variable, 0, _LATE_STEPS)[0]
    at_start = _find_effect_delay(first, plain, 0)
    if at_start is None or _find_effect_delay(first[2:], plain[2:], 0) is None:
        return  # nothing, or only in initial values that vanish
    # several instants, since one may be when the FMU samples its inputs
    delays = list[int | None]()
    for change_step in _STEPS_OF_CHANGE:
        rows, value = in_separate_process(
            _run_with_change, subject, results, variable, change_step, _LATE_STEPS
        )
        if change_step == _STEPS_OF_CHANGE[0] and not are_same(value, choose_other(variable)):
            new = format_value(choose_other(variable))
            not_kept.append(
                f"{variable.name} is {format_value(value)} after it was set to {new} between steps."
            )
            return
        delays.append(_find_effect_delay(rows, plain, change_step))
    if set(delays) == {None}:
        longer = in_separate_process(_run_with_change, subject, results, None, 0, _MORE_STEPS)[0]
        rows, _ = in_separate_process(
            _run_with_change, subject, results, variable, _STEPS_OF_CHANGE[0], _MORE_STEPS
        )
        if _find_effect_delay(rows, longer, _STEPS_OF_CHANGE[0]) is None and len(rows) > _LATE_STEPS:
            yield _LateEffect(variable.name, None)
        return
    (delay, *later_delays) = delays
    # one that samples its inputs rarely has other delays after each step
    if delay is not None and later_delays == [delay] * len(later_delays) and delay > max(at_start, 1):
        yield _LateEffect(variable.name, delay - max(at_start, 1))


def _find_effect_delay(rows: Rows, plain: Rows, change_step: int) -> int | None:
    """Return the number of steps after which rows differ, counted from a step; None if they do not."""
    for k, (changed_row, plain_row) in enumerate(zip(rows, plain, strict=False)):
        if changed_row != plain_row:
            return k - change_step
    return None


def _run_with_change(
    subject: Subject, results: list[str], variable: ModelVariable | None, change_step: int, steps: int
) -> tuple[Rows, Any]:
    """Return results after initialization and each step, and the value of a variable after it was set.

    It is set before the step `change_step`, counted from 0; before initialization for 0.
    """
    start, step, count = read_span(subject)
    changes = {} if variable is None else {variable.name: choose_other(variable)}
    instance = HostedInstance(subject)
    instance.initialize(changes if change_step == 0 else None, start)
    rows, values = [[str(v) for v in instance.get(results)]], [None]

    def change(k: int) -> None:
        if k == change_step and changes and k:
            instance.set(changes)
            values[:] = instance.get(list(changes))

    times = (start + k * step for k in range(min(count, steps, subject.most_steps)))
    rows += [[str(v) for v in instance.get(results)] for _ in step_through(instance, times, step, change)]
    instance.free()
    return rows, values[0]
