"""Check that instances share no values."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from ..check import check
from ..host.experiment import make_experiment, span
from ..host.fresh_process import in_fresh_process, is_single_instance
from ..host.hosted_instance import HostedInstance
from ..host.other_values import MOST, Values, others, settable, where_accepted
from ..subject import Subject
from ..verdict import CheckOutcome, Verdict, failed, skipped
from ._clauses import SEVERAL
from ._steps import walk
from .values import judge_unchanged, read_values

_ROUNDING = 1e-9
"""Relative difference of results that is none: instances lie at other addresses."""

_STEPS = 3
"""Steps of runs that show whether instances share values."""


@check(
    "values.shared",
    "Instances have their own parameters and inputs",
    SEVERAL,
    "Keep parameters in the instance, not in static variables, or set canBeInstantiatedOnlyOncePerProcess.",
    needs=("run.deterministic",),
    time_factor=2.0,
)
def shared(subject: Subject) -> CheckOutcome:
    """Check that other values in one instance change no values and no results of another one."""
    if is_single_instance(subject):
        return skipped("canBeInstantiatedOnlyOncePerProcess is set.")
    outcome = judge_unchanged(subject, _in_another, "in an instance beside one with other values")
    if outcome.verdict != Verdict.PASSED:
        return outcome
    changes = others(settable(subject, "parameter", "input"))
    every = [v for v in subject.description.modelVariables if not v.clocks]
    names = [v.name for v in every if v.causality in ("output", "structuralParameter")]
    plain = in_fresh_process(_results, subject, None, names[:MOST])
    structural = [_structural_results] if settable(subject, "structuralParameter") else []
    for run in (_results, _tuned_results, *structural):
        for found in where_accepted(partial(run, names=names[:MOST]), subject, changes):
            wrong = [n for n in plain if n in found and _differs(found[n], plain[n])]
            if wrong and outcome.verdict == Verdict.PASSED:
                said = f"{wrong[0]} is another one in an instance beside one with other values."
                outcome = failed(said, gaps=outcome.gaps)
    return outcome


def _in_another(subject: Subject, changes: Values) -> tuple[Values, Values]:
    """Return the values that one instance took, and those of another one."""
    start, names = span(subject)[0], list(changes)
    first, second = (HostedInstance(subject, f"examined {k}") for k in range(2))
    first.initialize(changes, start)
    second.initialize(None, start)
    return read_values(first, names), read_values(second, names)


def _results(subject: Subject, changes: Values | None, names: Sequence[str]) -> Values:
    """Return outputs after some steps: alone, or of the second of two instances."""
    start, step, _ = span(subject)
    other = None if changes is None else HostedInstance(subject, "other")
    instance = HostedInstance(subject)
    if other is not None:
        other.initialize(changes, start)
    instance.initialize(None, start)
    if other is not None:
        other.step(start, step)
    return _after_steps(instance, names)


def _tuned_results(subject: Subject, changes: Values, names: Sequence[str]) -> Values:
    """Return outputs after some steps of an instance, while another one gets other values between steps."""
    start, step, _ = span(subject)
    instance, other = HostedInstance(subject), HostedInstance(subject, "other")
    instance.initialize(None, start)
    other.initialize(None, start)
    late = {v.name for v in settable(subject, "parameter", "input", tunable=True)}
    other.step(start, step)
    other.set({name: value for name, value in changes.items() if name in late})
    return _after_steps(instance, names)


def _structural_results(subject: Subject, changes: Values, names: Sequence[str]) -> Values:
    """Return results of an instance beside one with other structural parameters."""
    structure = others(settable(subject, "structuralParameter"))
    instance, other = HostedInstance(subject), HostedInstance(subject, "other")
    with other.calling():
        other.fmu.enterConfigurationMode()
    other.set(structure)
    with other.calling():
        other.fmu.exitConfigurationMode()
    instance.initialize(None, span(subject)[0])
    return _after_steps(instance, names)


def _after_steps(instance: HostedInstance, names: Sequence[str]) -> Values:
    """Return values after some steps of an instance that was initialized."""
    course = make_experiment(instance.subject, _STEPS)
    # inputs are 0 at the start, which may hide parameters
    for _ in walk(instance, course.times[:-1], course.step, lambda k: instance.set(course.at(k + 1))):
        pass
    return read_values(instance, names)


def _differs(one: Any, other: Any) -> bool:
    """Return whether results differ by more than rounding."""
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) > _ROUNDING * max(1.0, abs(other))
    return one != other
