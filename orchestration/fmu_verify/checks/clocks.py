"""Checks of Clocks and dimensions in the description, and of Clocks that run."""

import math
from collections.abc import Iterator, Sequence
from ctypes import c_double, c_int, c_uint
from typing import Any

from fmpy.model_description import ModelVariable

from emla_cosim.base.wording import format_count
from emla_cosim.fmu.elements import PERIODIC, InputClock, belongs
from emla_cosim.fmu.instance import FINE

from ..check import CheckOutcome, check, passed, quote, skipped, warned
from ..declarations import Declarations, DeclaredVariable, find_repeated
from ..host.experiment import make_experiment, read_span
from ..host.hosted_instance import CallError, HostedInstance
from ..messages import Breach, Problem, join_few_names, judge_problems, list_left_out
from ..subject import Subject

_PERIODIC = ("constant", "fixed", "tunable")

_TRIGGERED = quote("clocks.triggered")
_FRACTION = quote("clocks.fraction")
_CLOCKS = quote("variables.clocks")
_CLOCKED = quote("clocks.clocked")
_DISCRETE = quote("clocks.discrete")
_SINGLE_PREVIOUS = quote("clocks.single_previous")
_SAME_TYPE = quote("clocks.same_type")


@check("variables.clocks", needs=("description.schema",), only_for=3)
def clocks(subject: Subject) -> CheckOutcome:
    """Check the attributes of Clocks, and what clocked variables and previous values refer to."""
    declared = subject.declared
    clock_variables = [v for v in declared.variables if v.type == "Clock"]
    clocked = [v for v in declared.variables if v.clocks is not None or v.previous is not None]
    if not clock_variables and not clocked:
        return skipped("It has no Clocks.")
    problems = [p for v in clock_variables for p in _judge_clock(v)]
    problems += [
        p for v in clocked for p in (*_judge_clocks_of_variable(v, declared), *_judge_previous(v, declared))
    ]
    for index in find_repeated(v.previous for v in clocked if v.previous is not None):
        previous = declared.variable(index) or index
        message = f"More than one variable has the previous value {previous}."
        problems.append(Breach(message, _SINGLE_PREVIOUS))
    fine = f"{len(clock_variables)} Clocks and {len(clocked)} clocked variables are compatible."
    return judge_problems(problems, fine)


def _judge_clock(clock: DeclaredVariable) -> Iterator[Problem]:
    """Yield what is wrong with the attributes of a Clock."""
    attributes, kind = clock.attributes, clock.attributes.get("intervalVariability", "")
    if clock.causality not in ("input", "output", "local"):
        yield Breach(
            f"The Clock {clock} has the causality {clock.causality}, which is none of "
            "input, output and local.",
            quote("clocks.causality"),
        )
    if clock.variability != "discrete":
        yield Breach(
            f"The Clock {clock} is {clock.variability}; it must be discrete.", quote("clocks.variability")
        )
    if clock.causality == "output" and kind != "triggered":
        yield Breach(
            f"The output Clock {clock} has the intervalVariability {kind}, not triggered.", _TRIGGERED
        )
    interval, shift = attributes.get("intervalDecimal"), attributes.get("shiftDecimal")
    if interval is None and kind == "constant":
        # 2.2.8.2 says what fixed and tunable Clocks without it mean
        yield Breach(f"The Clock {clock} is constant, but has no intervalDecimal.", quote("clocks.required"))
    if interval is not None and kind not in _PERIODIC:
        yield Breach(f"The Clock {clock} is {kind}, but has an intervalDecimal.", quote("clocks.not_used"))
    if interval is not None and not 0.0 < float(interval) < math.inf:
        message = f"The Clock {clock} has the intervalDecimal {interval}; it must be positive and finite."
        yield Breach(message, quote("clocks.interval"))
    yield from _judge_fractions(clock, kind)
    if shift is not None and interval is None:
        yield Breach(f"The Clock {clock} has a shiftDecimal, but no intervalDecimal.", quote("clocks.shift"))
    if shift is not None and not float(shift) >= 0.0:
        message = f"The Clock {clock} has the shiftDecimal {shift}; it must not be negative."
        yield Breach(message, quote("clocks.shift_value"))


def _judge_fractions(clock: DeclaredVariable, kind: str) -> Iterator[Problem]:
    """Yield what is wrong with the interval and the shift as fractions."""
    attributes = clock.attributes
    resolution = attributes.get("resolution")
    for name in ("interval", "shift"):
        attribute, decimal_attribute = f"{name}Counter", f"{name}Decimal"
        counter, decimal = attributes.get(attribute), attributes.get(decimal_attribute)
        if counter is None:
            continue
        if attributes.get("supportsFraction") not in ("true", "1") or kind not in _PERIODIC:
            but = f"is {kind}" if kind not in _PERIODIC else "supportsFraction is not true"
            yield Breach(f"The Clock {clock} has {attribute}, but {but}.", _FRACTION)
        elif resolution is None:
            yield Breach(f"The Clock {clock} has {attribute}, but no resolution.", quote("clocks.resolution"))
        elif decimal is not None and int(resolution) > 0:
            fraction = int(counter) / int(resolution)
            if not math.isclose(fraction, float(decimal), rel_tol=1e-6, abs_tol=1e-12):
                message = f"The Clock {clock} has {attribute} / resolution = {counter}/{resolution} s"
                yield Breach(f"{message}, but {decimal_attribute} = {decimal} s.", quote("clocks.equal"))


def _judge_clocks_of_variable(variable: DeclaredVariable, declared: Declarations) -> Iterator[Problem]:
    """Yield what is wrong with the list of Clocks of a variable; nothing if it has none."""
    if variable.clocks is None:
        return
    if not variable.clocks:
        yield Breach(f"The list of Clocks of {variable} is empty.", _CLOCKS)
    for index in variable.clocks:
        if (clock := declared.variable(index)) is None:
            yield Breach(f"{variable} belongs to {declared.describe_missing(index)}.", _CLOCKS)
        elif clock.type != "Clock":
            yield Breach(f"{variable} belongs to {clock}, which is not a Clock.", _CLOCKS)
    if variable.variability not in ("discrete", "tunable"):
        yield Breach(f"{variable} belongs to a Clock, but is {variable.variability}.", _CLOCKED)


def _judge_previous(variable: DeclaredVariable, declared: Declarations) -> Iterator[Problem]:
    """Yield what is wrong with the previous value of a variable; nothing if it has none."""
    if variable.previous is None:
        return
    if variable.type == "Clock":
        yield Breach(f"The Clock {variable} has a previous value.", quote("clocks.no_clock"))
    elif variable.clocks is None:
        yield Breach(f"{variable} has a previous value, but no Clock.", quote("clocks.previous"))
    elif variable.variability != "discrete":
        yield Breach(f"{variable} has a previous value, but is {variable.variability}.", _DISCRETE)
    previous = declared.variable(variable.previous)
    if previous is None:
        missing = declared.describe_missing(variable.previous)
        yield Breach(f"The previous value of {variable} is {missing}.", _SAME_TYPE)
    elif previous.index == variable.index:
        yield Breach(f"{variable} is its own previous value.", quote("clocks.itself"))
    elif (
        previous.type != variable.type or previous.variability != "discrete" or previous.causality == "input"
    ):
        description = f"a {previous.variability} {previous.causality} of type {previous.type}"
        message = f"{previous} is the previous value of {variable}, but {description}."
        yield Breach(message, _SAME_TYPE)


_CHOICE = quote("clocks.choice")
_SIZE_VARIABLE = quote("variables.dimensions")
_STARTS = quote("clocks.starts")


@check("variables.dimensions", needs=("description.schema",), only_for=3)
def dimensions(subject: Subject) -> CheckOutcome:
    """Check that sizes of arrays are positive, and that there is one start value or one for each element."""
    declared = subject.declared
    arrays = [v for v in declared.variables if v.dimensions]
    if not arrays:
        return skipped("It has no arrays.")
    problems = [p for v in arrays for p in _judge_dimensions(v, declared)]
    return judge_problems(problems, f"{len(arrays)} arrays have sizes, and as many start values.")


def _judge_dimensions(variable: DeclaredVariable, declared: Declarations) -> Iterator[Problem]:
    """Yield what is wrong with the sizes of an array and its number of start values."""
    if variable.causality == "structuralParameter":
        yield Breach(f"The structural parameter {variable} is an array.", quote("clocks.scalar"))
    for dimension in variable.dimensions:
        if (dimension.size is None) == (dimension.index is None):
            problem = "neither" if dimension.size is None else "both"
            yield Breach(f"A Dimension of {variable} has {problem} of start and valueReference.", _CHOICE)
        elif dimension.index is not None:
            size_variable = declared.variable(dimension.index)
            if size_variable is None:
                message = f"A Dimension of {variable} is {declared.describe_missing(dimension.index)}."
                yield Breach(message, _SIZE_VARIABLE)
            elif size_variable.type != "UInt64" or not (
                size_variable.variability == "constant" or size_variable.causality == "structuralParameter"
            ):
                kind = f"a {size_variable.variability} {size_variable.causality} of type {size_variable.type}"
                yield Breach(f"A Dimension of {variable} is {size_variable}, {kind}.", _SIZE_VARIABLE)
    sizes = list(declared.sizes(variable))
    if 0 in sizes:
        yield Breach(f"A Dimension of {variable} has the size 0.", quote("clocks.size"))
    elif None not in sizes:
        count = math.prod(size or 0 for size in sizes)
        if variable.start_count not in (0, 1, count):
            yield Breach(
                f"{variable} has {count} elements, but {variable.start_count} start values.", _STARTS
            )


_SAME = 1e-9
"""Relative difference of intervals that counts."""

_MOST = 300
"""Most clocked variables that a check reads."""

_ACTIVE = quote("clocks.ticks")


@check("clocks.intervals", needs=("run.completes",), only_for=3)
def intervals(subject: Subject) -> CheckOutcome:
    """Compare what the FMU says about intervals and shifts of Clocks with modelDescription.xml."""
    clocks = [c for c in subject.input_clocks if c.kind in PERIODIC and c.interval is not None]
    if not clocks:
        return skipped("It has no Clock with a declared interval.")
    instance, problems, answer_count = HostedInstance(subject), list[Problem](), 0
    instance.begin_initialization(read_span(subject)[0])
    for clock in clocks:
        clause = quote("ticks.constant") if clock.kind == "constant" else quote("clocks.intervals")
        answers = (
            ("interval", clock.interval, _read_interval(instance, "fmi3GetIntervalDecimal", clock)),
            ("shift", clock.shift, _read_interval(instance, "fmi3GetShiftDecimal", clock)),
        )
        for name, declared, answer in answers:
            answer_count += answer is not None
            if answer is not None and not math.isclose(answer, declared or 0.0, rel_tol=_SAME, abs_tol=1e-15):
                text = f"The Clock {clock.name} has the {name} {answer:.9g} s; declared are {declared:.9g} s."
                problems.append(Breach(text, clause))
    instance.free()
    if not answer_count:
        return skipped("The FMU does not say the intervals of its Clocks, which are declared.")
    fine = f"{format_count(len(clocks), 'Clock has its', 'Clocks have their')} declared intervals."
    return judge_problems(problems, fine)


def _read_interval(instance: HostedInstance, function: str, clock: InputClock) -> float | None:
    """Return the interval or shift in s that a function answers; None if the FMU refuses the call."""
    number, reference = (c_double * 1)(), (c_uint * 1)(clock.reference)
    qualifier = ((c_int * 1)(),) if "Interval" in function else ()
    status = instance.status(function, reference, 1, number, *qualifier)
    return number[0] if status in FINE else None


@check("clocks.ticks", needs=("run.completes",), only_for=3)
def ticks(subject: Subject) -> CheckOutcome:
    """Read clocked variables after each step. They must not change in steps in which no Clock ticks.

    An FMU must refuse such calls only if it detects them, so that it is a warning if it does not.
    """
    clocks = [clock.reference for clock in subject.input_clocks]
    all_variables = [v for v in subject.variables.values() if v.causality in ("output", "local")]
    all_variables = [v for v in all_variables if v.type != "String" and belongs(v, clocks)]
    if not all_variables:
        return skipped("It has no clocked variables to read.")
    variables = all_variables[:_MOST]
    instance, course = HostedInstance(subject), make_experiment(subject)
    instance.initialize(course.at(0), float(course.times[0]))
    assert instance.events is not None
    readable, changed, before = variables, dict[str, str](), dict[str, Any]()
    for k, time in enumerate(course.times[:-1]):
        ticks = sum(instance.events.ticks.values())
        instance.set(course.at(k))
        instance.step(float(time), course.step)
        if instance.terminated or not readable:
            break
        values = {str(v.name): value for v in readable for value in _read_if_accepted(instance, v)}
        readable = [v for v in readable if v.name in values]
        if sum(instance.events.ticks.values()) == ticks:
            for name, value in values.items():
                was = before.get(name, value)
                # NaN is not a change
                if value != was and not (math.isnan(value) and math.isnan(was)):
                    text = (
                        f"{name} changes from {was:.9g} to {value:.9g} in the step to "
                        f"t = {time + course.step:.9g} s, in which no Clock ticks."
                    )
                    changed.setdefault(name, text)
        before = values
    instance.free()
    gaps = list_left_out(len(variables), len(all_variables), "clocked variables were read between ticks.")
    if changed:
        return judge_problems([Breach(text, _ACTIVE) for text in changed.values()], "", gaps=gaps)
    if readable:
        message = f"{join_few_names([str(v.name) for v in readable])} can be read while no Clock ticks."
        return warned(message, clause=quote("ticks.allowed"), gaps=gaps)
    message = format_count(len(variables), "clocked variable", "clocked variables")
    return passed(f"{message} can be read only while a Clock ticks.", gaps=gaps)


def _read_if_accepted(instance: HostedInstance, variable: ModelVariable) -> Sequence[Any]:
    """Return the present value of a variable, nothing if the FMU refuses it."""
    try:
        return instance.read([variable])
    except CallError:
        return ()
