"""Layouts of the records for compiled loops: one per operation, instance, connected input and group.

Addresses point to doubles unless a comment says otherwise. `records.py` fills the records; `loop.py` and
`parallel_loop.py` read them.
"""

from enum import IntEnum

import numpy as np

from ...sandbox.crash_page import Activity


class Failure(IntEnum):
    """Why the loop ended before its last step.

    An FMI function failed, a signal is not finite, a group of instances cannot do the step in one
    (`NOT_IN_ONE`), or the time for one call of the loop is over (`LATE`). A group that cannot do the step
    is then at the begin of the step; the groups before it have done the step.
    """

    NONE = 0
    SET_REAL = 1
    SET_DERIVATIVES = 2
    DO_STEP = 3
    GET_REAL = 4
    NOT_FINITE = 5
    GET_STATE = 6
    SET_STATE = 7
    NOT_IN_ONE = 8
    OBSERVE = 9
    LATE = 10


_ADDRESS, _NUMBER = "intp", "int64"


def _record(**fields: str | np.dtype | tuple[str, int]) -> np.dtype:
    layout = [(n, *f) if isinstance(f, tuple) else (n, f) for n, f in fields.items()]
    return np.dtype(layout, align=True)


CLOCK = _record(first="float64", per_step="float64", denominator="float64")
"""See `timing.Clock`."""

PRESENT = np.dtype(Activity)
"""See `Activity`."""

OPERATION = _record(call=_NUMBER, instance=_NUMBER)
"""A `Call`, and the position of its instance."""

INPUT = _record(
    signal=_ADDRESS,  # that drives the input
    previous=_ADDRESS,  # the value of that signal one communication point earlier
    at=_ADDRESS,  # time of the signal
    before=_ADDRESS,  # time of the previous value
    taken=_ADDRESS,  # last value that the instance read, if it has a step multiple
    taken_at=_ADDRESS,  # time of that value
    factor="float64",
    offset="float64",
    moves="bool",  # whether signal and input are continuous
)

INSTANCE = _record(
    code=_NUMBER,  # its code in `Activity`, without a call
    code_set=_NUMBER,  # those of its calls that differ between versions of FMI
    code_get=_NUMBER,
    code_save=_NUMBER,
    code_restore=_NUMBER,
    is_version_3="bool",  # whether the functions are those of FMI 3.0, with more arguments
    component=_ADDRESS,  # fmi2Component, or fmi3Instance
    set_real=_ADDRESS,  # of this FMI function, as in the next five fields
    set_real_input_derivatives=_ADDRESS,
    do_step=_ADDRESS,
    get_real=_ADDRESS,
    get_state=_ADDRESS,
    set_state=_ADDRESS,
    input_references=_ADDRESS,  # of value references
    derivative_orders=_ADDRESS,  # of C ints
    output_references=_ADDRESS,
    input_reference_count=_NUMBER,  # an array of FMI 3.0 has one
    output_reference_count=_NUMBER,
    input_count=_NUMBER,
    output_count=_NUMBER,
    sources=_ADDRESS,  # of the first of its INPUT records
    inputs=_ADDRESS,
    derivatives=_ADDRESS,
    outputs=_ADDRESS,
    previous=_ADDRESS,  # the outputs one communication point earlier
    at=_ADDRESS,  # time of the outputs
    before=_ADDRESS,  # time of the previous outputs
    multiple=_NUMBER,
    mode=_NUMBER,  # a `Mode`
    rare="bool",  # whether it reads inputs more rarely than each step
    no_way_back="int32",  # noSetFMUStatePriorToCurrentPoint
    step_end=_ADDRESS,  # of the next field
    step_end_memory=("float64", 2),  # what `fmi3DoStep` says; see `StepEnd`
    state=_ADDRESS,  # of the address of its saved state
    undo=_ADDRESS,  # room for the values before `previous` and `before`
)

OBSERVED = _record(
    code=_NUMBER,  # of its call in `Activity`
    instance=_NUMBER,  # position of the instance
    get=_ADDRESS,  # of the FMI function
    component=_ADDRESS,  # fmi2Component
    references=_ADDRESS,  # of value references
    count=_NUMBER,
    values=_ADDRESS,  # of doubles or C ints
    real="bool",  # whether these are doubles
    boolean="bool",  # whether any value other than 0 is 1
    targets=_ADDRESS,  # of the addresses of the doubles to fill
)
"""Observed variables of one type of an instance; see `ObservedGroup`."""

GROUP = _record(
    members=_ADDRESS,  # of the positions of its instances, in order
    member_count=_NUMBER,
    saved="bool",  # whether the instances save their states to repeat a step
    cut_count=_NUMBER,  # number of coupling variables
    cut=_ADDRESS,  # of their INPUT records, without factor and offset
    positions=_ADDRESS,  # of their positions among the signals
    floors=_ADDRESS,  # of the lower bounds of their sizes
    jacobian=_ADDRESS,  # for this and the next fields, see `quasi_newton.improve`
    earlier=_ADDRESS,
    residuals=_ADDRESS,
    answers=_ADDRESS,
    sizes=_ADDRESS,
    basis=_ADDRESS,
    direction=_ADDRESS,
    guess=_ADDRESS,
)
"""See `algorithms.group.CoupledGroup`."""

LANE = _record(
    tasks=_ADDRESS,  # of the places of its tasks, in order
    task_count=_NUMBER,
    present=_ADDRESS,  # of a PRESENT record
    sweeps=_NUMBER,  # output: sweeps over groups
    instance=_NUMBER,  # output: the instance that failed
    status=_NUMBER,  # output: what its FMI function returned
    failed=_NUMBER,  # the place of its first task that failed in the present step, or `NOWHERE`
    failure=_NUMBER,  # the `Failure` of that task
    failed_instance=_NUMBER,  # `instance` and `status` of that task
    failed_status=_NUMBER,
    reached=_NUMBER,  # number of finished steps; other lanes wait for it
    apart=(_NUMBER, 5),  # padding: avoids false sharing of cache lines between threads
)
"""One thread's part of the work, and its results."""

TASK = _record(
    waits=_ADDRESS,  # of the places of tasks in other lanes that it waits for in every step
    wait_count=_NUMBER,
    through=_NUMBER,  # number of steps in which it was done or skipped; other tasks wait for it
    done=_NUMBER,  # number of steps in which it was done; a step that fails skips tasks
    apart=(_NUMBER, 4),
)
"""A group or an operation that one of several threads does.

The place of a task is its position in the order of a single thread: groups first, then operations.
"""

LOOP = _record(
    operations=_ADDRESS,  # of OPERATION records
    operation_count=_NUMBER,
    instances=_ADDRESS,  # of INSTANCE records
    groups=_ADDRESS,  # of GROUP records, which come before the operations
    group_count=_NUMBER,
    tolerance="float64",  # coupling tolerance
    largest=_ADDRESS,  # of the largest absolute values of the signals so far
    signals=_ADDRESS,
    signal_count=_NUMBER,
    observed=_ADDRESS,  # of OBSERVED records
    observed_count=_NUMBER,
    others=_ADDRESS,  # the values after the signals in a row, which the OBSERVED records fill
    other_count=_NUMBER,
    read=_ADDRESS,  # of the positions of the signals that must be finite
    read_count=_NUMBER,
    lanes=_ADDRESS,  # of LANE records
    lane_count=_NUMBER,
    tasks=_ADDRESS,  # of TASK records; none with a single thread
    give_way=_ADDRESS,  # of a C function that lets other threads run
    seconds=_ADDRESS,  # of a C function that returns the wall time in whole seconds
    clock=CLOCK,
    reached=_NUMBER,  # output: the step that failed, or the one after the last that was done
    recorded=_NUMBER,  # output: number of filled rows; other code may write to the PRESENT record
    group=_NUMBER,  # output: the first group that could not do the step in one
    lane=_NUMBER,  # output: the lane of the failure
    apart=(_NUMBER, 8),
    released=_NUMBER,  # number of steps that all lanes may begin
    failed=_NUMBER,  # the first place that failed in the present step, or `NOWHERE`
    given_up=_NUMBER,  # the first group that could not do it in one, or `NOWHERE`
)
"""Inputs and outputs of a loop. Lanes exchange the last three fields."""

BLOCK = _record(values=_ADDRESS, copy=_ADDRESS, count=_NUMBER)
"""Doubles that a repeated step restores, and room for their copy."""

CONTROL = _record(
    instance_count=_NUMBER,
    states=_ADDRESS,  # of the addresses of the saved states of the instances
    blocks=_ADDRESS,  # of BLOCK records
    block_count=_NUMBER,
    power=_ADDRESS,  # of the C function `pow`
    start="float64",  # time at which the run starts
    first_step="float64",
    leap_limit="float64",  # longest step over an event whose error is not checked
    unread_limit="float64",  # see `UNREAD`, `SHORT` and `CRAWLING` in `error_control`; as steps in s
    short_limit="float64",
    crawling_limit="float64",
    tolerance="float64",
    divisor="float64",  # of the difference between a step and two halves
    count=_NUMBER,  # of controlled signals; the following arrays are as long
    judged=_ADDRESS,  # of the positions of these signals
    unread=_ADDRESS,  # of integers that are 1 or 0, as in the next fields
    looked_at=_ADDRESS,
    beside=_ADDRESS,
    instant=_ADDRESS,
    jumped=_ADDRESS,
    jumps=_ADDRESS,  # those of the present trial
    total=_ADDRESS,  # sum of the errors of all steps
    whole=_ADDRESS,  # values after a whole step
    errors=_ADDRESS,
    judged_errors=_ADDRESS,
    rejected_errors=_ADDRESS,
    last_rejected_errors=_ADDRESS,
    largest_values=_ADDRESS,  # per signal, see `Scale`
    floors=_ADDRESS,
    records="bool",  # whether each accepted step has a row
    per_unit="bool",  # whether the error per unit step is controlled
    exponent="float64",  # see `StepControl` for this and the next fields
    smallest="float64",
    largest="float64",
    step="float64",
    last_error="float64",
    accepted=_NUMBER,
    rejected=_NUMBER,
    short_steps=_NUMBER,
    rejected_step="float64",  # NaN without one
    last_rejected_step="float64",
    time="float64",
    point="float64",  # time to reach exactly
    enough="float64",  # time at which to return
    event="bool",  # whether the point is an event
    watched_rows=_ADDRESS,  # time and signals of accepted steps
    watch_room=_NUMBER,  # number of these rows; 0 without `Stepping.watch`
    watched=_NUMBER,  # output: number of filled ones
    tried=_NUMBER,  # output: number of trials
    met="bool",  # output: whether the point is reached
    crawls="bool",  # output: whether many steps were short
    began="float64",  # output: begin of the last step of the algorithm
    end="float64",  # output: end of the last trial
    length="float64",  # output: length of the last trial
)
"""State of `ErrorControl` for `compiled_trials.py`."""

FORWARDED = _record(
    component=_ADDRESS,  # fmi3Instance
    set=_ADDRESS,  # of the FMI function, as in the next fields
    set_count=_NUMBER,  # numbers of value references; an array has one
    get=_ADDRESS,
    get_count=_NUMBER,
    do_step=_ADDRESS,
    step_end=_ADDRESS,  # of the memory of a `StepEnd`
    get_state=_ADDRESS,
    set_state=_ADDRESS,
    setters=_ADDRESS,  # of TYPED records
    setter_count=_NUMBER,
    getters=_ADDRESS,
    getter_count=_NUMBER,
)
"""What `forwarded_calls.py` gets instead of a component, to call functions of FMI 3.0."""

KINDS = (
    *("float64", "float32", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
    "bool",
)
"""The types of values in memory."""

TYPED = _record(
    function=_ADDRESS,
    references=_ADDRESS,  # of value references
    reference_count=_NUMBER,
    memory=_ADDRESS,  # of values of this type
    memory_count=_NUMBER,
    kind=_NUMBER,  # place of the type in `KINDS`
    low="float64",  # the smallest value, and the one after the largest; of integers only
    limit="float64",
    elements=_ADDRESS,  # of the positions in the vector, and then of those in the memory
    places=_ADDRESS,
    count=_NUMBER,  # of elements
)
"""Values of one type that one FMI call sets or gets."""

TIMED = _record(
    component=_ADDRESS,  # fmi2Component
    clock=_ADDRESS,  # of the C function that reads the clock
    now=_ADDRESS,  # of two integers of 64 bits, for the clock
    functions=_ADDRESS,  # of the addresses of FMI functions, in the order of `TimedCall`
    calls=_ADDRESS,  # of their numbers of calls
    ticks=_ADDRESS,  # of the time in them
)
"""What `timed_calls.py` gets instead of a component, to measure the calls of an instance."""


class TimedCall(IntEnum):
    """FMI functions whose calls are measured, by what they do."""

    INPUTS = 0
    DERIVATIVES = 1
    STEP = 2
    OUTPUTS = 3
    SAVE = 4
    RESTORE = 5
    OBSERVED = 6


NOWHERE = 2**62
"""Larger than all places."""
