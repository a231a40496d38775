"""Check that instances share no values."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from ..check import check
from ..host.experiment import make_experiment, read_span
from ..host.fresh_process import in_fresh_process, is_single_instance
from ..host.hosted_instance import HostedInstance
from ..host.instance_runs import walk
from ..host.other_values import MOST, Values, list_other_values, list_settable, run_where_accepted
from ..subject import Subject
from ..verdict import CheckOutcome, Verdict, failed, quote, skipped
from .values import judge_unchanged, read_values

# relative difference of results that is none: instances lie at other addresses
_ROUNDING = 1e-9

_STEPS = 3
"""Steps of runs that show whether instances share values."""


@check("values.shared", clause=quote("shared.several"), needs=("run.deterministic",), time_factor=2.0)
def shared(subject: Subject) -> CheckOutcome:
    """Check that other values in one instance change no values and no results of another one."""
    if is_single_instance(subject):
        return skipped("canBeInstantiatedOnlyOncePerProcess is set.")
    outcome = judge_unchanged(subject, _read_two_instances, "in an instance beside one with other values")
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
                message = f"{wrong[0]} is another one in an instance beside one with other values."
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
    """Return outputs after some steps: alone, or of the second of two instances."""
    start, step, _ = read_span(subject)
    second_instance = None if changes is None else HostedInstance(subject, "other")
    instance = HostedInstance(subject)
    if second_instance is not None:
        second_instance.initialize(changes, start)
    instance.initialize(None, start)
    if second_instance is not None:
        second_instance.step(start, step)
    return _step_and_read(instance, names)


def _record_tuned_results(subject: Subject, changes: Values, names: Sequence[str]) -> Values:
    """Return outputs after some steps of an instance, while another one gets other values between steps."""
    start, step, _ = read_span(subject)
    instance, second_instance = HostedInstance(subject), HostedInstance(subject, "other")
    instance.initialize(None, start)
    second_instance.initialize(None, start)
    late = {v.name for v in list_settable(subject, "parameter", "input", tunable=True)}
    second_instance.step(start, step)
    second_instance.set({name: value for name, value in changes.items() if name in late})
    return _step_and_read(instance, names)


def _record_structural_results(subject: Subject, changes: Values, names: Sequence[str]) -> Values:
    """Return results of an instance beside one with other structural parameters."""
    structure = list_other_values(list_settable(subject, "structuralParameter"))
    instance, second_instance = HostedInstance(subject), HostedInstance(subject, "other")
    with second_instance.calling():
        second_instance.fmu.enterConfigurationMode()
    second_instance.set(structure)
    with second_instance.calling():
        second_instance.fmu.exitConfigurationMode()
    instance.initialize(None, read_span(subject)[0])
    return _step_and_read(instance, names)


def _step_and_read(instance: HostedInstance, names: Sequence[str]) -> Values:
    """Return values after some steps of an instance that was initialized."""
    course = make_experiment(instance.subject, _STEPS)
    # inputs are 0 at the start, which may hide parameters
    for _ in walk(instance, course.times[:-1], course.step, lambda k: instance.set(course.at(k + 1))):
        pass
    return read_values(instance, names)


def _is_different(actual: Any, expected: Any) -> bool:
    """Return whether results differ by more than rounding."""
    if isinstance(actual, float) and isinstance(expected, float):
        return abs(actual - expected) > _ROUNDING * max(1.0, abs(expected))
    return actual != expected
