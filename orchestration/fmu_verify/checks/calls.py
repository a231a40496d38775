"""Checks with calls that the standard forbids: wrong phase, values that are not finite."""

import math
from collections.abc import Callable, Iterator, Sequence
from ctypes import c_bool, c_double, c_uint
from itertools import product
from typing import NamedTuple

from fmpy.model_description import ModelVariable

from emla_cosim.fmu.instance import FATAL, FINE

from ..check import RETURNS, CheckOutcome, check, failed, noted, passed, quote, warned
from ..host.experiment import (
    list_outputs,
    make_experiment,
    parse_number,
    read_span,
    step_through,
    take_in_time,
)
from ..host.hosted_instance import CallError, HostedInstance
from ..messages import list_left_out
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process, in_separate_process

_PHASES = ("before initialization", "in initialization mode", "after initialization", "after fmi2Terminate")


class _ForbiddenCall(NamedTuple):
    """A call that the standard's table of calling sequences does not allow in a phase."""

    phase: str
    function: str
    call: Callable[[HostedInstance], int]


_CALLS: dict[str, Callable[[HostedInstance], int]] = {
    "fmi2EnterInitializationMode": lambda i: i.enter_initialization_status(read_span(i.subject)[0]),
    "fmi2SetupExperiment": lambda i: i.status("fmi2SetupExperiment", 0, 0.0, read_span(i.subject)[0], 0, 0.0),
    "fmi2DoStep": lambda i: i.step_status(*read_span(i.subject)[:2]),
}
"""Calls of functions with arguments."""


def _make_forbidden_call(phase: str, function: str) -> _ForbiddenCall:
    return _ForbiddenCall(phase, function, _CALLS.get(function, lambda instance: instance.status(function)))


_BEFORE, _INITIALIZING, _AFTER, _TERMINATED = _PHASES
_OF_BOTH = (
    _make_forbidden_call(_BEFORE, "fmi2ExitInitializationMode"),
    _make_forbidden_call(_BEFORE, "fmi2Terminate"),
    _make_forbidden_call(_INITIALIZING, "fmi2EnterInitializationMode"),
    _make_forbidden_call(_AFTER, "fmi2EnterInitializationMode"),
    _make_forbidden_call(_AFTER, "fmi2ExitInitializationMode"),
    _make_forbidden_call(_AFTER, "fmi2SetupExperiment"),
    _make_forbidden_call(_TERMINATED, "fmi2EnterInitializationMode"),
)
_OF = {
    kind: tuple(_make_forbidden_call(phase, function) for phase in (_BEFORE, _INITIALIZING, _TERMINATED))
    for kind, function in (("CoSimulation", "fmi2DoStep"), ("ModelExchange", "fmi2EnterContinuousTimeMode"))
}


@check("calls.phases", needs=("run.completes",), time_factor=2.0, advisory=True)
def phases(subject: Subject) -> CheckOutcome:
    """Check that the FMU refuses calls that the state machine forbids, and does not crash.

    FMI 2.0 leaves the behaviour undefined, so what does not is only noted.
    """
    judge = warned if subject.version == 3 else noted
    try:
        count, accepted = in_fresh_process(_find_accepted_calls, subject)
    except EndedError as error:
        return judge(str(error))
    if accepted:
        return judge(
            f"{len(accepted)} of {count} calls in a wrong phase returned fmi2OK: {accepted[0]}.",
            details=tuple(f"{call} returned fmi2OK." for call in accepted),
        )
    return passed(f"The FMU refused {count} calls in a wrong phase.")


def _find_accepted_calls(subject: Subject) -> tuple[int, list[str]]:
    """Return the number of calls, and those that returned fmi2OK."""
    calls = [*_OF_BOTH, *_OF[subject.kinds[0]]]
    calls += [*_yield_parameter_calls(subject), *_yield_clock_calls(subject)]
    calls = [f for f in calls if subject.version == 2 or f.function != "fmi2SetupExperiment"]
    accepted = [
        f"{f.function} {f.phase}" for f in calls if in_separate_process(_call_in_phase, subject, f) in FINE
    ]
    return len(calls), accepted


def _yield_parameter_calls(subject: Subject) -> Iterator[_ForbiddenCall]:
    """Yield the call that sets a fixed parameter after initialization, if there is one."""
    fixed = [v for v in subject.of_causality("parameter") if v.variability == "fixed" and v.start is not None]
    for variable in fixed[:1]:
        values = {variable.name: parse_number(variable.start, 0.0)}
        name = f"fmi2SetReal of the fixed parameter {variable.name}"
        yield _ForbiddenCall(_AFTER, name, lambda i, v=values: i.set_status(v))


def _yield_clock_calls(subject: Subject) -> Iterator[_ForbiddenCall]:
    """Yield the call that makes a Clock tick in step mode, if there is one."""
    for clock in subject.input_clocks[:1]:
        reference, active = (c_uint * 1)(clock.reference), (c_bool * 1)(True)
        name = f"fmi3SetClock of {clock.name} in step mode"
        yield _ForbiddenCall(_AFTER, name, lambda i, r=reference, a=active: i.status("fmi3SetClock", r, 1, a))


def list_calls_usually_refused(subject: Subject) -> list[_ForbiddenCall]:
    """Return a few calls in a wrong phase that most FMUs refuse. This calls no function."""
    return [*_OF_BOTH[:4], *_OF[subject.kinds[0]][:1], *_yield_parameter_calls(subject)]


def go_to_phase(instance: HostedInstance, phase: str) -> None:
    """Bring a new instance to a phase, by the calls that lead there."""
    reached = _PHASES.index(phase)
    if reached >= 1:
        instance.begin_initialization(read_span(instance.subject)[0])
    if reached >= 2:
        instance.exit_initialization()
    if reached >= 3:
        instance.terminate()


def _call_in_phase(subject: Subject, forbidden: _ForbiddenCall) -> int:
    """Return the status of a call in its phase. Then reset the instance, if it can be, and free it."""
    instance = HostedInstance(subject)
    go_to_phase(instance, forbidden.phase)
    instance.circumstance = f" {forbidden.phase}"
    status = forbidden.call(instance)
    # a crash in these calls is a consequence of the forbidden one
    instance.circumstance = f" after {forbidden.function} {forbidden.phase}"
    if status != FATAL:
        instance.status("fmi2Reset")
    instance.free()
    return status


_MOST_VARIABLES = 40
_STEPS = 3


@check("calls.nonfinite", needs=("run.completes",), advisory=True)
def nonfinite(subject: Subject) -> CheckOutcome:
    """Check that NaN or infinity in an input or parameter is refused or has no effect, without a crash.

    The standard does not say which values come out then, so that is only noted. But a function returns a
    status for any value of its type.
    """
    variables = [*subject.of_causality("input"), *subject.of_causality("parameter")]
    variables = [v for v in variables if v.variability != "constant" and v.start is not None]
    try:
        first_variables = variables[:_MOST_VARIABLES]
        accepted, variable_count = in_fresh_process(_find_accepted_values, subject, first_variables)
    except EndedError as error:
        return warned(str(error), clause=RETURNS)
    gaps = list_left_out(variable_count, len(variables), "inputs and parameters were set to NaN.")
    if accepted:
        message = (
            f"The FMU accepted {len(accepted)} values that are not finite, without an error: {accepted[0]}"
        )
        return noted(message, details=tuple(accepted), gaps=gaps)
    message = f"{variable_count} inputs and parameters were set to NaN and infinity, without harm."
    return passed(message, gaps=gaps)


def _find_accepted_values(subject: Subject, variables: Sequence[ModelVariable]) -> tuple[list[str], int]:
    """Return messages on values that were accepted although NaN comes out, and the number of variables."""
    values = (math.nan, math.inf)
    accepted, call_count = list[str](), 0
    for variable, value in take_in_time(product(variables, values), 0.5 * subject.settings.seconds):
        nonfinite_outputs = in_separate_process(_find_nonfinite_output, subject, variable, value)
        if nonfinite_outputs is None:
            break
        accepted += [
            f"{variable.name} = {value} gives {name} = {got}, and every call returns fmi2OK."
            for name, got in nonfinite_outputs
        ]
        call_count += 1
    return accepted, call_count // len(values)


def _find_nonfinite_output(
    subject: Subject, variable: ModelVariable, value: float
) -> list[tuple[str, float]] | None:
    """Return the first output that is not finite after this value was set, unless a call refused it.

    After fmi2Fatal no function of the FMU can be called, so that the result is None.
    """
    course, instance = make_experiment(subject, _STEPS), HostedInstance(subject)
    instance.circumstance = f" with {variable.name} = {value}"
    changes = {variable.name: value}
    before, later = ({}, changes) if variable.causality == "input" else (changes, {})
    names, output_values = list_outputs(subject), []
    try:
        instance.initialize({**course.at(0), **before}, float(course.times[0]))
        prepare = lambda k: instance.set({**course.at(k), **later})  # noqa: E731
        for _ in step_through(instance, course.times[:-1], course.step, prepare):
            pass
        output_values = [] if instance.terminated else instance.get(names)
    except CallError as error:
        if error.status == FATAL:
            return None
    instance.free()
    pairs = zip(names, map(float, output_values), strict=False)
    return [(name, number) for name, number in pairs if not math.isfinite(number)][:1]


@check(
    "calls.arguments", clause=quote("calls.illegal"), needs=("run.completes",), time_factor=2.0, only_for=3
)
def arguments(subject: Subject) -> CheckOutcome:
    """Check calls with wrong value references, types and numbers of values, and fmi3FreeInstance of NULL.

    The standard requires an error only where an FMU detects them, so what is accepted only warns.
    """
    try:
        in_fresh_process(_free_null, subject)
    except EndedError as error:
        return failed(str(error), clause=quote("calls.ignored"))
    accepted, count = [], 0
    for wrong in _list_wrong_calls(subject):
        count += 1
        try:
            message = in_fresh_process(_try_wrong_call, subject, wrong)
        except EndedError as error:
            return warned(str(error))
        accepted += [message] if message else []
    if accepted:
        first = f"{len(accepted)} of {count} calls with wrong arguments returned fmi3OK: {accepted[0]}"
        return warned(first, details=tuple(accepted))
    return passed(f"The FMU refused {count} calls with wrong arguments.")


def _free_null(subject: Subject) -> None:
    instance = HostedInstance(subject)
    instance.circumstance = " of a NULL pointer"
    instance.fmu.fmi3FreeInstance(None)


class _WrongCall(NamedTuple):
    """A call of `fmi3GetFloat64` or `fmi3SetFloat64` with a value reference and a number of values.

    `size` is the number of values that the FMU may write if it does not look at the number.
    """

    function: str
    reference: int
    values: int
    size: int
    argument_fault: str


def _list_wrong_calls(subject: Subject) -> Iterator[_WrongCall]:
    """Yield calls that the declarations of the variables do not allow."""
    declared = subject.declared.variables
    unknown = max(v.reference for v in declared) + 1
    for function in ("fmi3GetFloat64", "fmi3SetFloat64"):
        yield _WrongCall(function, unknown, 1, 1, f"value reference {unknown}, which no variable has")
    wrong_types = [v for v in declared if v.type in ("Int32", "Int64", "Boolean") and not v.dimensions]
    for variable in wrong_types[:1]:
        argument_fault = f"{variable}, which is of type {variable.type}"
        yield _WrongCall("fmi3GetFloat64", variable.reference, 1, 1, argument_fault)
    doubles = [v for v in subject.of_causality("output", "local") if getattr(v, "data_type", "") == "Float64"]
    for v in doubles[:1]:
        size = getattr(v, "size", 1)
        for count in (0, size + 1):
            argument_fault = f"{count} values for the {size} of {v.name.partition('[')[0]}"
            yield _WrongCall("fmi3GetFloat64", int(v.valueReference), count, size, argument_fault)


def _try_wrong_call(subject: Subject, wrong: _WrongCall) -> str:
    """Make a wrong call. Return what was accepted, as a message; empty if the FMU refuses it."""
    instance = HostedInstance(subject)
    if wrong.function.startswith("fmi3Set"):
        instance.begin_initialization(read_span(subject)[0])
    else:
        instance.initialize(None, read_span(subject)[0])
    instance.circumstance = f" with {wrong.argument_fault}"
    reference, values = (c_uint * 1)(wrong.reference), (c_double * (wrong.size + 1))()
    status = instance.status(wrong.function, reference, 1, values, wrong.values)
    return f"{wrong.function} with {wrong.argument_fault}." if status in FINE else ""
