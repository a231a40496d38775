"""Error messages for the events of an instance, from the numbers of the stepper in C."""

from ...base.errors import RunError
from ...stepper.event_layout import (
    DO_STEP,
    EVENT_CALLS,
    GET_CLOCK,
    MOST_UPDATES,
    SET_CLOCK,
    UPDATE,
    Events,
    Problem,
)
from .event_tables import EventTables
from .fmu_instance import EndRequestedError, InstanceError
from .in_process_instance import InProcessInstance

_TIMED = DO_STEP, UPDATE, SET_CLOCK, GET_CLOCK
"""Calls that a message names together with their time."""

_REFUSED = {Problem.EARLY_RETURN: "it returned early", Problem.EVENT: "it asked for event mode"}


def explain_problem(instance: InProcessInstance, tables: EventTables) -> RunError:
    """Return the error for the problem of an instance in its last event or step, and clear the problem."""
    record = tables.record
    problem, name = Problem(record.problem), instance.name
    record.problem = Problem.NONE
    if problem == Problem.CALL:
        call = EVENT_CALLS[record.call]
        return instance.error(_add_time(call, record.time) if call in _TIMED else call, record.status)
    if problem == Problem.END:
        call = _add_time(EVENT_CALLS[record.call], record.value)
        return EndRequestedError(name, call, "terminateSimulation", instance.messages())
    if problem == Problem.TICK_WITHIN_STEP:
        return RunError(
            f"a clock of {name} ticks at t = {record.value:.9g} s, within a step, and the FMU cannot vary "
            "its step size. Use a step size that divides the interval of the clock."
        )
    if problem == Problem.TICK_ALONE:
        return RunError(
            f"the clock {tables.name_clock(record.clock)} of {name} ticks at t = {record.time:.9g} s "
            f"without {tables.describe_needed(record.clock)}, on which it depends."
        )
    if problem == Problem.TOO_MANY_TICKS:
        return RunError(
            f"the clock {tables.name_clock(record.clock)} of {name} has to tick {record.count} times in "
            f"the step to t = {record.value:.9g} s; less than {MOST_UPDATES} are supported. Use a "
            "smaller step size."
        )
    call, answer = describe_answer(problem, record, tables)
    return InstanceError(name, call, answer, instance.messages())


def describe_answer(problem: Problem, record: Events, tables: EventTables) -> tuple[str, str]:
    """Return the call that gave a wrong answer, with its time, and the answer."""
    step, update = _add_time(DO_STEP, record.time), _add_time(UPDATE, record.time)
    if problem in _REFUSED:
        return step, f"{_REFUSED[problem]}, which is not allowed here"
    if problem == Problem.WRONG_TIME:
        return step, f"lastSuccessfulTime = {record.value:.9g}"
    if problem == Problem.ENDLESS_RETURNS:
        return step, f"a request for more, {record.count} times in a row"
    if problem == Problem.ENDLESS_UPDATES:
        return update, f"a request for more, {record.count} times in a row"
    if problem == Problem.NO_EVENT_TIME:
        return update, "nextEventTime = NaN"
    clock = tables.name_clock(record.clock)
    if problem == Problem.ENDLESS_TICKS:
        return _add_time(GET_CLOCK, record.time), f"a tick of {clock} after each of {record.count} updates"
    quantity = "interval" if problem == Problem.WRONG_INTERVAL else "shift"
    return "getIntervalDecimal", f"its clock {clock} has the {quantity} {record.value:g} s"


def _add_time(call: str, time: float) -> str:
    return f"{call} at t = {time:.9g} s"
