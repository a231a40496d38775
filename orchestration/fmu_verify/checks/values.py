"""Checks of the values of all variables: after the start, a reset, from a saved state."""

from collections.abc import Sequence
from typing import Any

from ..check import check
from ..host.experiment import span
from ..host.fresh_process import in_fresh_process
from ..host.hosted_instance import HostedInstance
from ..host.other_values import (
    MOST,
    Values,
    differences,
    others,
    same,
    settable,
    show,
    start_of,
    where_accepted,
)
from ..messages import Breach, judge_problems, list_left_out
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, fmi3, in_both, skipped
from ._clauses import KEPT
from .states import restore_bytes, save_bytes

_EXACT = Clause(
    "2.2.7",
    "The variable is initialized with the start value (provided under Real, Integer, Boolean, String or "
    "Enumeration).",
    in_3=fmi3("2.4.7.5", "exact: The variable is initialized with the start value by the FMU."),
)
_TINY = 1e-6

_REFUSED = "It refuses other valid values of its parameters and inputs, or does not return with them."
_NOTHING = "It has no parameter and no input with another valid value."


@check(
    "values.start",
    "Variables have their start values",
    Clause(
        "2.2.7",
        "This value is also stored in the C functions.",
        in_3=fmi3(
            "2.4.7.5", "During instantiation, the FMU initializes its variables with their start values."
        ),
    ),
    "Generate the model description and the library from the same values.",
    needs=("run.completes",),
)
def starts(subject: Subject) -> CheckOutcome:
    """Compare values after an initialization in which nothing is set with modelDescription.xml."""
    firm = settable(subject, "parameter", "input", most=None)
    names = {v.name for v in firm}
    loose = [v for v in subject.description.modelVariables if v.name not in names and v.start is not None]
    loose = [v for v in loose if v.initial == "exact" or v.variability == "constant"]
    every = [*firm, *loose]
    variables = every[:MOST]
    found = in_fresh_process(_read_after_start, subject, [v.name for v in variables])
    wrong = {
        v.name: f"{v.name} is {show(found[v.name])} after initialization; its start value is {show(start)}."
        for v in variables
        if (start := start_of(v)) is not None and not same(found[v.name], start)
    }
    certain = names | {v.name for v in loose if v.variability == "constant"}
    certain -= {name for name in found if _is_bound(start_of(subject.variables[name]), found[name])}
    # events of the initialization may change the others
    return judge_problems(
        [text for name, text in wrong.items() if name in certain],
        f"{len(variables)} variables have their start values.",
        [Breach(text, _EXACT) for name, text in wrong.items() if name not in certain],
        list_left_out(len(variables), len(every), "variables were compared with their start values."),
    )


def _is_bound(start: Any, value: Any) -> bool:
    """Return whether a start value of 0 became a tiny one, as FMUs do that divide by it."""
    return isinstance(value, float) and start == 0.0 and 0.0 < abs(value) < _TINY


def _read_after_start(subject: Subject, names: Sequence[str], changes: Values | None = None) -> Values:
    """Return values after an initialization in which others are set, or none."""
    instance = HostedInstance(subject)
    instance.initialize(changes, span(subject)[0])
    return read_values(instance, names)


def read_values(instance: HostedInstance, names: Sequence[str]) -> Values:
    """Return values by name."""
    return dict(zip(names, instance.get(names), strict=True))


@check(
    "values.kept",
    "Values that are set are kept",
    Clause(
        "2.1.7",
        "Set parameters, inputs, and start values, and re-initialize caching of variables that depend on "
        "these variables",
        in_3=KEPT,
    ),
    "Store the value in fmi2SetXXX, or return fmi2Discard or fmi2Error if it cannot be taken.",
    needs=("run.completes",),
    time_factor=2.0,
)
def kept(subject: Subject) -> CheckOutcome:
    """Check that parameters and inputs have the values that were set, after initialization."""
    changes = others(settable(subject, "parameter", "input"))
    if not changes:
        return skipped(_NOTHING)
    answers = where_accepted(lambda s, part: _read_after_start(s, list(part), part), subject, changes)
    if not answers:
        return skipped(_REFUSED)
    lost = {
        name: f"{name} is {show(found[name])} after it was set to {show(changes[name])} without an error."
        for found in answers
        for name in differences(found, changes, found)
    }
    inputs = {name for name in lost if subject.variables[name].causality == "input"}
    count = sum(map(len, answers))
    return judge_problems(
        [text for name, text in lost.items() if name not in inputs],
        f"{count} parameters and inputs have the values that were set.",
        # an FMU may take them over when a step begins
        [text for name, text in lost.items() if name in inputs],
        _not_judged(subject, count),
    )


def _not_judged(subject: Subject, count: int, tunable: bool = False) -> tuple[str, ...]:
    """Return a gap if not all parameters and inputs were judged: the FMU refuses values, or has many."""
    every = others(settable(subject, "parameter", "input", tunable=tunable, most=None))
    return list_left_out(count, len(every), "parameters and inputs were judged with other values.")


@check(
    "values.reset",
    "Reset restores the values of parameters and inputs",
    in_both("2.1.6", "2.3.1", "All variables have their default values."),
    "fmi2Reset must set every parameter and input to its start value.",
    needs=("run.completes",),
    time_factor=2.0,
)
def reset(subject: Subject) -> CheckOutcome:
    """Compare parameters and inputs after other values and fmi2Reset with those of a new instance."""
    return judge_unchanged(subject, _after_reset, "after fmi2Reset")


def _after_reset(subject: Subject, changes: Values) -> tuple[Values, Values]:
    """Return the values that were taken, and those after a reset."""
    (start, step, _), names = span(subject), list(changes)
    instance = HostedInstance(subject)
    instance.initialize(changes, start)
    taken = read_values(instance, names)
    instance.step(start, step)
    instance.reset()
    instance.initialize(None, start)
    return taken, read_values(instance, names)


def judge_unchanged(subject: Subject, do: Any, when: str) -> CheckOutcome:
    """Judge values that should be those of a new instance, for the changes that were taken."""
    changes = others(settable(subject, "parameter", "input"))
    if not changes:
        return skipped(_NOTHING)
    answers = where_accepted(do, subject, changes)
    if not answers:
        return skipped(_REFUSED)
    fresh = in_fresh_process(_read_after_start, subject, list(changes))
    problems, count = [], 0
    for taken, found in answers:
        judged = [n for n in taken if same(taken[n], changes[n]) or not same(found[n], fresh[n])]
        count += len(judged)
        problems += [
            f"{name} is {show(found[name])} {when}; in a new instance it is {show(fresh[name])}."
            for name in differences(found, fresh, judged)
        ]
    fine = f"{count} parameters and inputs have the values of a new instance {when}."
    return judge_problems(problems, fine, gaps=_not_judged(subject, count))


@check(
    "values.state",
    "A saved state has the values of parameters, inputs and outputs",
    Clause(
        "2.1.8",
        "This internal state consists especially of the values of the continuous-time states, iteration "
        "variables, parameter values, input values, delay buffers, file identifiers, and FMU internal status "
        "information.",
        in_3=fmi3(
            "2.2.7.4",
            "This internal state consists especially of the values of the continuous states, iteration "
            "variables, parameter values, input values, delay buffers, file identifiers, and FMU internal "
            "status information.",
        ),
    ),
    "Copy parameters and inputs of all types into the state, also Booleans and Strings.",
    needs=("state.restored",),
    time_factor=3.0,
)
def state(subject: Subject) -> CheckOutcome:
    """Check that restoring a state restores values that were changed after it was saved."""
    changes = others(v for v in settable(subject, "parameter", "input", tunable=True) if not v.clocks)
    if lost := _lost_parameters(subject):
        return judge_problems(lost, "")
    if not changes and subject.has_clocks:
        return skipped("Its inputs and tunable parameters cannot be read outside of ticks.")
    if not changes:
        return skipped("It has no tunable parameter and no input with another valid value.")
    answers = where_accepted(_after_restoring, subject, changes)
    if not answers:
        return skipped(_REFUSED)
    problems, count, moved = [], 0, 0
    for before, changed, restored, data in answers:
        judged = differences(changed, before, before)
        settled = [n for n in judged if n in changes]
        count, moved = count + len(judged), moved + len(settled)
        problems += _list_lost(restored, before, judged, "after fmi2SetFMUstate")
        if data is not None and not problems:
            other = in_fresh_process(_from_bytes, subject, data, settled)
            problems += _list_lost(other, changed, settled, "from a serialized state")
    gaps = () if subject.has_clocks else _not_judged(subject, moved, tunable=True)
    return judge_problems(
        problems, f"{count} values that were changed were restored with a state.", gaps=gaps
    )


def _lost_parameters(subject: Subject) -> list[str]:
    """Return what is wrong with fixed parameters in a state that is restored after a reset."""
    changes = others(v for v in settable(subject, "parameter") if v.variability != "tunable")
    if not changes or not subject.has_capability("canGetAndSetFMUstate"):
        return []
    problems = []
    for before, restored, data in where_accepted(_after_reset_and_restoring, subject, changes):
        taken = [name for name in before if same(before[name], changes[name])]
        lost = _list_lost(restored, before, taken, "after fmi2Reset and fmi2SetFMUstate")
        if data is not None and not lost:
            other = in_fresh_process(_from_bytes, subject, data, taken)
            lost = _list_lost(other, before, taken, "from a serialized state")
        problems += lost
    return problems


def _list_lost(found: Values, saved: Values, names: Sequence[str], how: str) -> list[str]:
    """Return a message for each value that is not the one that was saved."""
    return [
        f"{name} is {show(found[name])} {how}; it was {show(saved[name])} when the state was saved."
        for name in differences(found, saved, names)
    ]


def _after_reset_and_restoring(subject: Subject, changes: Values) -> tuple[Values, Values, bytes | None]:
    """Return parameters when a state is saved, and when it is restored after a reset; and the state."""
    start, step, _ = span(subject)
    instance = HostedInstance(subject)
    instance.initialize(changes, start)
    instance.step(start, step)
    before, data, saved = read_values(instance, list(changes)), save_bytes(instance), instance.save_state()
    instance.reset()
    instance.initialize(None, start)
    instance.restore_state(saved)
    return before, read_values(instance, list(changes)), data


def _after_restoring(subject: Subject, changes: Values) -> tuple[Values, Values, Values, bytes | None]:
    """Return values when a state is saved, after changes, after it is restored; and the changed state."""
    start, step, _ = span(subject)
    found = subject.description.modelVariables
    outputs = [v.name for v in found if v.causality == "output" and not v.clocks][:MOST]
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


def _from_bytes(subject: Subject, data: bytes, names: Sequence[str]) -> Values:
    instance = HostedInstance(subject)
    instance.initialize(None, span(subject)[0])
    restore_bytes(instance, data)
    return read_values(instance, names)
