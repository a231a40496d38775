"""What the compiled loops work on: records in memory, one per operation, instance, connected input and group.

Addresses point to doubles unless said otherwise. `loop.py` and `parallel_loop.py` read these records,
`records.py` fills them.
"""

from enum import IntEnum

import numpy as np

from ...sandbox.black_box import Activity


class Failure(IntEnum):
    """What ended the loop before its last step.

    An FMI function, a signal that is not finite, or a group of instances that does not come through the
    step in one: it is then where the step began, and those before it have done the step.
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


_ADDRESS, _NUMBER = "intp", "int64"


def _record(**fields: str | np.dtype | tuple[str, int]) -> np.dtype:
    layout = [(n, *f) if isinstance(f, tuple) else (n, f) for n, f in fields.items()]
    return np.dtype(layout, align=True)


CLOCK = _record(first="float64", per_step="float64", denominator="float64")
"""See `timing.Clock`."""

PRESENT = np.dtype(Activity)
"""See `Activity`."""

OPERATION = _record(call=_NUMBER, instance=_NUMBER)
"""A `Call`, and the position of the instance."""

INPUT = _record(
    signal=_ADDRESS,  # that drives the input
    previous=_ADDRESS,  # the value of that signal one communication point earlier
    at=_ADDRESS,  # when the signal was new
    before=_ADDRESS,  # when the previous one was
    taken=_ADDRESS,  # what the instance took of the signal last, if it steps rarely
    taken_at=_ADDRESS,  # when that was new
    factor="float64",
    offset="float64",
    moves="bool",  # whether signal and input are continuous
)

INSTANCE = _record(
    code=_NUMBER,  # by which `Activity` knows it, without a call
    component=_ADDRESS,  # of the instance
    set_real=_ADDRESS,  # of this FMI function, as the next five
    set_real_input_derivatives=_ADDRESS,
    do_step=_ADDRESS,
    get_real=_ADDRESS,
    get_state=_ADDRESS,
    set_state=_ADDRESS,
    input_references=_ADDRESS,  # of value references, as FMI functions take them
    derivative_orders=_ADDRESS,  # of C ints
    output_references=_ADDRESS,
    input_count=_NUMBER,
    output_count=_NUMBER,
    sources=_ADDRESS,  # of the first of its INPUT records
    inputs=_ADDRESS,
    derivatives=_ADDRESS,
    outputs=_ADDRESS,
    previous=_ADDRESS,  # the outputs one communication point earlier
    at=_ADDRESS,  # when the outputs were new
    before=_ADDRESS,  # when the previous ones were
    multiple=_NUMBER,
    mode=_NUMBER,  # a `Mode`
    rare="bool",  # whether it takes inputs more rarely than others give outputs
    no_way_back="int32",  # whether it will not be set to an earlier state
    state=_ADDRESS,  # of the address of its saved state
    undo=_ADDRESS,  # room for what is behind `previous` and `before`
)

GROUP = _record(
    members=_ADDRESS,  # of the positions of its instances, in order
    member_count=_NUMBER,
    saved="bool",  # whether they are brought back to where a step began
    cut_count=_NUMBER,  # values that the group has to agree on
    cut=_ADDRESS,  # of their INPUT records, as if somebody read them untransformed
    positions=_ADDRESS,  # of their positions among the signals
    floors=_ADDRESS,  # of what their sizes are at least
    jacobian=_ADDRESS,  # this and what follows: see `quasi_newton.improve`
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
    tasks=_ADDRESS,  # of the places of its tasks, in the order in which it does them
    task_count=_NUMBER,
    present=_ADDRESS,  # of a PRESENT record
    sweeps=_NUMBER,  # answer: how often groups were stepped to agree
    instance=_NUMBER,  # answer: the instance that failed
    status=_NUMBER,  # answer: what its FMI function returned
    failed=_NUMBER,  # the place of its first task that failed in the present step, or `NOWHERE`
    failure=_NUMBER,  # the `Failure` then
    failed_instance=_NUMBER,  # and what `instance` and `status` were
    failed_status=_NUMBER,
    reached=_NUMBER,  # steps that it is through with; others wait for it
    apart=(_NUMBER, 5),  # so that a core that writes to one record does not slow down who reads the next
)
"""One thread's part of the work, and what it answers."""

TASK = _record(
    waits=_ADDRESS,  # of the places of tasks of other lanes that come before it in every step
    wait_count=_NUMBER,
    through=_NUMBER,  # steps that it is through with; others wait for it
    done=_NUMBER,  # steps in which it was done; a step that fails has tasks that are left out
    apart=(_NUMBER, 4),
)
"""A group, or an operation, that one of several threads does.

A task's place is where it comes when one thread does everything: groups first, then operations.
"""

LOOP = _record(
    operations=_ADDRESS,  # of OPERATION records
    operation_count=_NUMBER,
    instances=_ADDRESS,  # of INSTANCE records
    groups=_ADDRESS,  # of GROUP records, which come before the operations
    group_count=_NUMBER,
    tolerance="float64",  # to which groups agree
    largest=_ADDRESS,  # of the largest absolute values that signals had so far
    signals=_ADDRESS,
    signal_count=_NUMBER,
    read=_ADDRESS,  # of positions of the signals that have to be finite
    read_count=_NUMBER,
    lanes=_ADDRESS,  # of LANE records
    lane_count=_NUMBER,
    tasks=_ADDRESS,  # of TASK records; none where one thread does everything
    give_way=_ADDRESS,  # of a C function by which a thread that waits lets others run
    clock=CLOCK,
    reached=_NUMBER,  # answer: the step that failed, or the one after the last
    recorded=_NUMBER,  # answer: how many rows were filled; others may write to the PRESENT record
    group=_NUMBER,  # answer: the first group that did not come through the step
    lane=_NUMBER,  # answer: the lane in which something failed
    apart=(_NUMBER, 8),
    released=_NUMBER,  # steps that all lanes may begin
    failed=_NUMBER,  # the first place that failed in the present step, or `NOWHERE`
    given_up=_NUMBER,  # the first group that did not come through it, or `NOWHERE`
)
"""What a loop is called with, and its answers. The last three are what lanes tell each other."""

NOWHERE = 2**62
"""A place beyond all others."""
