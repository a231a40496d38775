"""Checks with calls that the standard forbids: wrong phase, values that are not finite."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from fmpy.fmi2 import fmi2Real, fmi2ValueReference
from fmpy.model_description import ModelVariable

from ...fmu.instance import FATAL, FINE
from ..check import check
from ..host.experiment import make_experiment, parse_number, span
from ..host.fresh_process import EndedError, in_fresh_process, in_separate_process
from ..host.hosted_instance import CallError, HostedInstance
from ..host.instance_runs import outputs
from ..messages import list_left_out
from ..subject import Subject
from ..verdict import RETURNS, CheckOutcome, noted, own_rule, passed, warned

_PHASES = ("before initialization", "in initialization mode", "after initialization", "after fmi2Terminate")


class _Forbidden(NamedTuple):
    """A call that the standard's table of calling sequences does not allow in a phase."""

    phase: str
    function: str
    call: Callable[[HostedInstance], int]


def _plain(phase: str, function: str) -> _Forbidden:
    return _Forbidden(phase, function, lambda instance: instance.status(function))


def _step(phase: str) -> _Forbidden:
    def call(instance: HostedInstance) -> int:
        start, step, _ = span(instance.subject)
        return instance.status("fmi2DoStep", start, step, 0)

    return _Forbidden(phase, "fmi2DoStep", call)


def _set_up(instance: HostedInstance) -> int:
    return instance.status("fmi2SetupExperiment", 0, 0.0, span(instance.subject)[0], 0, 0.0)


_BEFORE, _INITIALIZING, _AFTER, _TERMINATED = _PHASES
_OF_BOTH = (
    _plain(_BEFORE, "fmi2ExitInitializationMode"),
    _plain(_BEFORE, "fmi2Terminate"),
    _plain(_INITIALIZING, "fmi2EnterInitializationMode"),
    _plain(_AFTER, "fmi2EnterInitializationMode"),
    _plain(_AFTER, "fmi2ExitInitializationMode"),
    _Forbidden(_AFTER, "fmi2SetupExperiment", _set_up),
    _plain(_TERMINATED, "fmi2EnterInitializationMode"),
)
_OF = {
    "CoSimulation": (_step(_BEFORE), _step(_INITIALIZING), _step(_TERMINATED)),
    "ModelExchange": (
        _plain(_BEFORE, "fmi2EnterContinuousTimeMode"),
        _plain(_INITIALIZING, "fmi2EnterContinuousTimeMode"),
        _plain(_TERMINATED, "fmi2EnterContinuousTimeMode"),
    ),
}


@check(
    "calls.phases",
    "Calls in the wrong phase are refused",
    own_rule(
        "calls.phases", "A call in the wrong phase is refused. Its behavior is undefined (FMI 2.0.4, 3.2.3)."
    ),
    "Keep the phase in the instance. Return fmi2Error and log a message for calls that it does not allow.",
    needs=("run.completes",),
    time_factor=2.0,
    advisory=True,
)
def phases(subject: Subject) -> CheckOutcome:
    """Check that the FMU refuses calls that the state machine forbids, and does not crash.

    The standard leaves the behaviour undefined, so what does not is only noted.
    """
    try:
        count, accepted = in_fresh_process(_find_accepted, subject)
    except EndedError as error:
        return noted(str(error))
    if accepted:
        return noted(
            f"{len(accepted)} of {count} calls in a wrong phase returned fmi2OK: {accepted[0]}.",
            details=tuple(f"{call} returned fmi2OK." for call in accepted),
        )
    return passed(f"The FMU refused {count} calls in a wrong phase.")


def _find_accepted(subject: Subject) -> tuple[int, list[str]]:
    """Return the number of calls, and those that returned fmi2OK."""
    calls = [*_OF_BOTH, *_OF[subject.kinds[0]], *_parameters(subject)]
    accepted = [f"{f.function} {f.phase}" for f in calls if in_separate_process(_answer, subject, f) in FINE]
    return len(calls), accepted


def _parameters(subject: Subject) -> Iterator[_Forbidden]:
    """Yield the call that sets a fixed parameter after initialization, if there is one."""
    fixed = [v for v in subject.of_causality("parameter") if v.variability == "fixed" and v.start is not None]
    for variable in fixed[:1]:
        reference = (fmi2ValueReference * 1)(variable.valueReference)
        value = (fmi2Real * 1)(parse_number(variable.start, 0.0))
        name = f"fmi2SetReal of the fixed parameter {variable.name}"
        yield _Forbidden(_AFTER, name, lambda i, r=reference, v=value: i.status("fmi2SetReal", r, 1, v))


def _answer(subject: Subject, forbidden: _Forbidden) -> int:
    """Return the status of a call in its phase. Then reset the instance, if it can be, and free it."""
    instance, start = HostedInstance(subject), span(subject)[0]
    reached = _PHASES.index(forbidden.phase)
    if reached >= 1:
        instance.begin_initialization(start)
    if reached >= 2:
        instance.exit_initialization()
    if reached >= 3:
        with instance.calling():
            instance.fmu.terminate()
    instance.circumstance = f" {forbidden.phase}"
    status = forbidden.call(instance)
    instance.circumstance = f" after {forbidden.function} {forbidden.phase}"
    if status != FATAL:
        instance.status("fmi2Reset")
    instance.free()
    return status


_MOST_VARIABLES = 40
_STEPS = 3


@check(
    "calls.nonfinite",
    "NaN and infinity do no harm",
    own_rule(
        "calls.nonfinite", "NaN and infinity are refused, or have no effect. The standard does not say it."
    ),
    "Return fmi2Discard or fmi2Error for values that are not finite, and name the variable in the log.",
    needs=("run.completes",),
    advisory=True,
)
def nonfinite(subject: Subject) -> CheckOutcome:
    """Check that NaN or infinity in an input or parameter is refused or has no effect, without a crash.

    The standard does not say which values come out then, so that is only noted. But a function returns a
    status for any value of its type.
    """
    variables = [*subject.of_causality("input"), *subject.of_causality("parameter")]
    variables = [v for v in variables if v.variability != "constant" and v.start is not None]
    try:
        silent, tried = in_fresh_process(_find_silent, subject, variables[:_MOST_VARIABLES])
    except EndedError as error:
        return warned(str(error), clause=RETURNS)
    gaps = list_left_out(tried, len(variables), "inputs and parameters were set to NaN.")
    if silent:
        said = f"The FMU accepted {len(silent)} values that are not finite, without a message: {silent[0]}"
        return noted(said, details=tuple(silent), gaps=gaps)
    return passed(f"{tried} inputs and parameters were set to NaN and infinity, without harm.", gaps=gaps)


def _find_silent(subject: Subject, variables: Sequence[ModelVariable]) -> tuple[list[str], int]:
    """Return values that were accepted without a message although NaN comes out, and how many were tried."""
    until = time.monotonic() + 0.5 * subject.settings.seconds
    silent: list[str] = []
    for tried, variable in enumerate(variables):
        for value in (math.nan, math.inf):
            if time.monotonic() > until:
                return silent, tried  # instantiation is slow
            found = in_separate_process(_spoiled, subject, variable, value)
            if found is None:
                return silent, tried
            silent += [
                f"{variable.name} = {value} gives {name} = {got}, and every call returns fmi2OK."
                for name, got in found
            ]
    return silent, len(variables)


def _spoiled(subject: Subject, variable: ModelVariable, value: float) -> list[tuple[str, float]] | None:
    """Return the first output that is not finite after this value was set, unless a call refused it.

    After fmi2Fatal no function of the FMU can be called, so that the result is None.
    """
    course = make_experiment(subject, _STEPS)
    instance = HostedInstance(subject)
    instance.circumstance = f" with {variable.name} = {value}"
    names = outputs(subject)
    found: list[float] = []
    try:
        if variable.causality == "input":
            instance.initialize(course.at(0), float(course.times[0]))
            values = {variable.name: value}
        else:
            instance.initialize({**course.at(0), variable.name: value}, float(course.times[0]))
            values = {}
        for k in range(len(course.times) - 1):
            instance.set({**course.at(k), **values})
            instance.step(float(course.times[k]), course.step)
            if instance.terminated:
                break
        found = [] if instance.terminated else instance.get(names)
    except CallError as error:
        if error.status == FATAL:
            return None
        found = []
    instance.free()
    wrong = ~np.isfinite(np.array(found, dtype=float))
    return (
        [(names[int(np.argmax(wrong))], float(np.array(found, dtype=float)[wrong][0]))] if wrong.any() else []
    )
