"""Checks of running Clocks: their intervals, and variables that only change while they tick."""

import math
from collections.abc import Sequence
from ctypes import c_double, c_int, c_uint
from typing import Any

from fmpy.model_description import ModelVariable

from emla_cosim.base.wording import format_count
from emla_cosim.fmu.clocks import PERIODIC, InputClock, belongs
from emla_cosim.fmu.instance import FINE

from ..check import check
from ..host.experiment import make_experiment, read_span
from ..host.hosted_instance import CallError, HostedInstance
from ..messages import Breach, Problem, join_few_names, judge_problems, list_left_out
from ..subject import Subject
from ..verdict import CheckOutcome, passed, quote, skipped, warned

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
    """Return what a function says about a Clock, None if the FMU refuses the call."""
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
        values = {str(v.name): value for v in readable for value in _read(instance, v)}
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


def _read(instance: HostedInstance, variable: ModelVariable) -> Sequence[Any]:
    """Return the present value of a variable, nothing if the FMU refuses it."""
    try:
        return instance.read([variable])
    except CallError:
        return ()
