"""Checks of the values of all variables, and that instances share none."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from ..check import CheckOutcome, Verdict, check, failed, quote, skipped
from ..host.experiment import make_experiment, read_span, step_through
from ..host.hosted_instance import HostedInstance
from ..host.other_values import (
    MOST,
    Values,
    are_same,
    format_value,
    list_differences,
    list_other_values,
    list_settable,
    read_start,
    run_where_accepted,
)
from ..messages import Breach, judge_problems, list_left_out
from ..subject import Subject
from ..subprocess_run import in_fresh_process, is_single_instance
from .states import restore_bytes, save_bytes

_MAX_SHIFT_OF_ZERO = 1e-6

_VALUES_REFUSED = "It refuses other valid values of its parameters and inputs, or does not return with them."
_NO_OTHER_VALUES = "It has no parameter and no input with another valid value."


@check("values.start", needs=("run.completes",))
def starts(subject: Subject) -> CheckOutcome:
    """Compare values after an initialization in which nothing is set with modelDescription.xml."""
    settable_variables = list_settable(subject, "parameter", "input", most=None)
    names = {v.name for v in settable_variables}
    further = [v for v in subject.description.modelVariables if v.name not in names and v.start is not None]
    further = [v for v in further if v.initial == "exact" or v.variability == "constant"]
    all_variables = [*settable_variables, *further]
    variables = all_variables[:MOST]
    values = in_fresh_process(_read_after_start, subject, [v.name for v in variables])
    messages = {
        v.name: f"{v.name} is {format_value(values[v.name])} after initialization; "
        f"its start value is {format_value(start)}."
        for v in variables
        if (start := read_start(v)) is not None and not are_same(values[v.name], start)
    }
    certain = names | {v.name for v in further if v.variability == "constant"}
    certain -= {
        name for name in values if _is_shifted_zero(read_start(subject.variables[name]), values[name])
    }
    # events of the initialization may change the others
    return judge_problems(
        [text for name, text in messages.items() if name in certain],
        f"{len(variables)} variables have their start values.",
        [Breach(text, quote("values.exact")) for name, text in messages.items() if name not in certain],
        list_left_out(len(variables), len(all_variables), "variables were compared with their start values."),
    )


def _is_shifted_zero(start: Any, value: Any) -> bool:
    """Return whether a start value of 0 became a tiny one, as FMUs do that divide by it."""
    return isinstance(value, float) and start == 0.0 and 0.0 < abs(value) < _MAX_SHIFT_OF_ZERO


def _read_after_start(subject: Subject, names: Sequence[str], changes: Values | None = None) -> Values:
    """Return values after an initialization in which others are set, or none."""
    instance = HostedInstance(subject)
    instance.initialize(changes, read_span(subject)[0])
    return read_values(instance, names)


def read_values(instance: HostedInstance, names: Sequence[str]) -> Values:
    """Return values by name."""
    return dict(zip(names, instance.get(names), strict=True))


@check("values.kept", needs=("run.completes",), time_factor=2.0)
def kept(subject: Subject) -> CheckOutcome:
    """Check that parameters and inputs have the values that were set, after initialization."""
    changes = list_other_values(list_settable(subject, "parameter", "input"))
    if not changes:
        return skipped(_NO_OTHER_VALUES)
    answers = run_where_accepted(lambda s, part: _read_after_start(s, list(part), part), subject, changes)
    if not answers:
        return skipped(_VALUES_REFUSED)
    messages = {
        name: f"{name} is {format_value(values[name])} after it was set to "
        f"{format_value(changes[name])} without an error."
        for values in answers
        for name in list_differences(values, changes, values)
    }
    inputs = {name for name in messages if subject.variables[name].causality == "input"}
    count = sum(map(len, answers))
    return judge_problems(
        [text for name, text in messages.items() if name not in inputs],
        f"{count} parameters and inputs have the values that were set.",
        # an FMU may take them over when a step begins
        [text for name, text in messages.items() if name in inputs],
        _list_unjudged(subject, count),
    )


def _list_unjudged(subject: Subject, count: int, tunable: bool = False) -> tuple[str, ...]:
    """Return a gap if not all parameters and inputs were judged: the FMU refuses values, or has many."""
    all_values = list_other_values(list_settable(subject, "parameter", "input", tunable=tunable, most=None))
    return list_left_out(count, len(all_values), "parameters and inputs were judged with other values.")


@check("values.reset", needs=("run.completes",), time_factor=2.0)
def reset(subject: Subject) -> CheckOutcome:
    """Compare parameters and inputs after other values and fmi2Reset with those of a new instance."""
    return compare_with_new_instance(subject, _read_after_reset, "after fmi2Reset")


def _read_after_reset(subject: Subject, changes: Values) -> tuple[Values, Values]:
    """Return the values that were taken, and those after a reset."""
    (start, step, _), names = read_span(subject), list(changes)
    instance = HostedInstance(subject)
    instance.initialize(changes, start)
    accepted = read_values(instance, names)
    instance.step(start, step)
    instance.reset()
    instance.initialize(None, start)
    return accepted, read_values(instance, names)


def compare_with_new_instance(subject: Subject, read_values_after: Any, when: str) -> CheckOutcome:
    """Judge values that should be those of a new instance, for the changes that were taken."""
    changes = list_other_values(list_settable(subject, "parameter", "input"))
    if not changes:
        return skipped(_NO_OTHER_VALUES)
    answers = run_where_accepted(read_values_after, subject, changes)
    if not answers:
        return skipped(_VALUES_REFUSED)
    # a new process: static variables keep what earlier instances did
    fresh = in_fresh_process(_read_after_start, subject, list(changes))
    problems, count = [], 0
    for accepted, values in answers:
        changed = {n for n in accepted if not are_same(values[n], fresh[n])}
        names = [n for n in accepted if n in changed or are_same(accepted[n], changes[n])]
        count += len(names)
        problems += [
            f"{name} is {format_value(values[name])} {when}; "
            f"in a new instance it is {format_value(fresh[name])}."
            for name in list_differences(values, fresh, names)
        ]
    fine = f"{count} parameters and inputs have the values of a new instance {when}."
    return judge_problems(problems, fine, gaps=_list_unjudged(subject, count))


@check("values.state", needs=("state.restored",), time_factor=3.0)
def state(subject: Subject) -> CheckOutcome:
    """Check that restoring a state restores values that were changed after it was saved."""
    variables = list_settable(subject, "parameter", "input", tunable=True)
    changes = list_other_values(v for v in variables if not v.clocks)
    if messages := _find_lost_parameters(subject):
        return judge_problems(messages, "")
    if not changes and subject.has_clocks:
        return skipped("Its inputs and tunable parameters cannot be read outside of ticks.")
    if not changes:
        return skipped("It has no tunable parameter and no input with another valid value.")
    answers = run_where_accepted(_read_after_restoring, subject, changes)
    if not answers:
        return skipped(_VALUES_REFUSED)
    problems, count, judged_changes = [], 0, 0
    for before, changed, restored, data in answers:
        names = list_differences(changed, before, before)
        changed_names = [n for n in names if n in changes]
        count, judged_changes = count + len(names), judged_changes + len(changed_names)
        problems += _describe_lost_values(restored, before, names, "after fmi2SetFMUstate")
        if data is not None and not problems:
            deserialized = in_fresh_process(_read_from_bytes, subject, data, changed_names)
            problems += _describe_lost_values(deserialized, changed, changed_names, "from a serialized state")
    gaps = () if subject.has_clocks else _list_unjudged(subject, judged_changes, tunable=True)
    fine = f"{count} values that were changed were restored with a state."
    return judge_problems(problems, fine, gaps=gaps)


def _find_lost_parameters(subject: Subject) -> list[str]:
    """Return what is wrong with fixed parameters in a state that is restored after a reset."""
    changes = list_other_values(v for v in list_settable(subject, "parameter") if v.variability != "tunable")
    if not changes or not subject.has_capability("canGetAndSetFMUstate"):
        return []
    problems = []
    for before, restored, data in run_where_accepted(_read_after_reset_and_restoring, subject, changes):
        accepted = [name for name in before if are_same(before[name], changes[name])]
        messages = _describe_lost_values(restored, before, accepted, "after fmi2Reset and fmi2SetFMUstate")
        if data is not None and not messages:
            deserialized = in_fresh_process(_read_from_bytes, subject, data, accepted)
            messages = _describe_lost_values(deserialized, before, accepted, "from a serialized state")
        problems += messages
    return problems


def _describe_lost_values(values: Values, saved: Values, names: Sequence[str], how: str) -> list[str]:
    """Return a message for each value that is not the one that was saved."""
    return [
        f"{name} is {format_value(values[name])} {how}; "
        f"it was {format_value(saved[name])} when the state was saved."
        for name in list_differences(values, saved, names)
    ]


def _read_after_reset_and_restoring(subject: Subject, changes: Values) -> tuple[Values, Values, bytes | None]:
    """Return parameters when a state is saved, and when it is restored after a reset; and the state."""
    start, step, _ = read_span(subject)
    instance = HostedInstance(subject)
    instance.initialize(changes, start)
    instance.step(start, step)
    before, data, saved = read_values(instance, list(changes)), save_bytes(instance), instance.save_state()
    instance.reset()
    instance.initialize(None, start)
    instance.restore_state(saved)
    return before, read_values(instance, list(changes)), data


def _read_after_restoring(subject: Subject, changes: Values) -> tuple[Values, Values, Values, bytes | None]:
    """Return values when a state is saved, after changes, after it is restored; and the changed state."""
    start, step, _ = read_span(subject)
    variables = subject.description.modelVariables
    outputs = [v.name for v in variables if v.causality == "output" and not v.clocks][:MOST]
    names = list(dict.fromkeys([*changes, *outputs]))
    instance = HostedInstance(subject)
    instance.initialize(None, start)
    instance.step(start, step)
    before = read_values(instance, names)
    saved = instance.save_state()
    instance.set(changes)
    instance.step(start + step, step)
    changed, data = read_values(instance, names), save_bytes(instance)
    instance.restore_state(saved)
    return before, changed, read_values(instance, names), data


def _read_from_bytes(subject: Subject, data: bytes, names: Sequence[str]) -> Values:
    instance = HostedInstance(subject)
    instance.initialize(None, read_span(subject)[0])
    restore_bytes(instance, data)
    return read_values(instance, names)


# relative difference of results that is none: instances lie at other addresses
_ROUNDING = 1e-9

_STEPS = 3
"""Steps of runs that show whether instances share values."""


@check("values.shared", clause=quote("shared.several"), needs=("run.deterministic",), time_factor=2.0)
def shared(subject: Subject) -> CheckOutcome:
    """Check that other values in one instance change no values and no results of another one."""
    if is_single_instance(subject):
        return skipped("canBeInstantiatedOnlyOncePerProcess is set.")
    outcome = compare_with_new_instance(
        subject, _read_two_instances, "in an instance beside one with other values"
    )
    if outcome.verdict != Verdict.PASSED:
        return outcome
    changes = list_other_values(list_settable(subject, "parameter", "input"))
    variables = [v for v in subject.description.modelVariables if not v.clocks]
    names = [v.name for v in variables if v.causality in ("output", "structuralParameter")]
    # alone in its process, so that nothing can be shared
    plain = in_fresh_process(_record_results, subject, None, names[:MOST])
    structural = [_record_structural_results] if list_settable(subject, "structuralParameter") else []
    for run in (_record_results, _record_tuned_results, *structural):
        for results in run_where_accepted(partial(run, names=names[:MOST]), subject, changes):
            wrong = [n for n in plain if n in results and _is_different(results[n], plain[n])]
            if wrong and outcome.verdict == Verdict.PASSED:
                message = f"{wrong[0]} has another value in an instance beside one with other values."
                outcome = failed(message, gaps=outcome.gaps)
    return outcome


def _read_two_instances(subject: Subject, changes: Values) -> tuple[Values, Values]:
    """Return the values that one instance took, and those of another one."""
    start, names = read_span(subject)[0], list(changes)
    first, second = (HostedInstance(subject, f"examined {k}") for k in range(2))
    first.initialize(changes, start)
    second.initialize(None, start)
    return read_values(first, names), read_values(second, names)


def _record_results(subject: Subject, changes: Values | None, names: Sequence[str]) -> Values:
    """Return outputs after some steps: alone, or with `changes` beside an instance that has these values."""
    start, step, _ = read_span(subject)
    other_instance = None if changes is None else HostedInstance(subject, "other")
    instance = HostedInstance(subject)
    if other_instance is not None:
        other_instance.initialize(changes, start)
    instance.initialize(None, start)
    if other_instance is not None:
        other_instance.step(start, step)
    return _step_and_read(instance, names)


def _record_tuned_results(subject: Subject, changes: Values, names: Sequence[str]) -> Values:
    """Return outputs after some steps of an instance, while another one gets other values between steps."""
    start, step, _ = read_span(subject)
    instance, other_instance = HostedInstance(subject), HostedInstance(subject, "other")
    instance.initialize(None, start)
    other_instance.initialize(None, start)
    late = {v.name for v in list_settable(subject, "parameter", "input", tunable=True)}
    other_instance.step(start, step)
    other_instance.set({name: value for name, value in changes.items() if name in late})
    return _step_and_read(instance, names)


def _record_structural_results(subject: Subject, changes: Values, names: Sequence[str]) -> Values:
    """Return results of an instance beside one with other structural parameters."""
    structure = list_other_values(list_settable(subject, "structuralParameter"))
    instance, other_instance = HostedInstance(subject), HostedInstance(subject, "other")
    with other_instance.calling():
        other_instance.fmu.enterConfigurationMode()
    other_instance.set(structure)
    with other_instance.calling():
        other_instance.fmu.exitConfigurationMode()
    instance.initialize(None, read_span(subject)[0])
    return _step_and_read(instance, names)


def _step_and_read(instance: HostedInstance, names: Sequence[str]) -> Values:
    """Return values after some steps of an instance that was initialized."""
    course = make_experiment(instance.subject, _STEPS)
    # inputs are 0 at the start, which may hide parameters
    for _ in step_through(instance, course.times[:-1], course.step, lambda k: instance.set(course.at(k + 1))):
        pass
    return read_values(instance, names)


def _is_different(actual: Any, expected: Any) -> bool:
    """Return whether results differ by more than rounding."""
    if isinstance(actual, float) and isinstance(expected, float):
        return abs(actual - expected) > _ROUNDING * max(1.0, abs(expected))
    return actual != expected
