"""The compiled stepping loop for one thread: many steps of an algorithm per call.

It does the same as `Explicit` and `Strong` in Python, on the same memory, with the same bits. It is
imported only to be compiled.
"""

from numba import cfunc, types

from .by_address import OPTIONS, lane_at, loop_at, part, present_at
from .compiled_groups import advance_group, see
from .compiled_steps import all_finite, divides, operate, point, present_second, record
from .record_layout import Failure

_NONE, _NOT_FINITE, _NOT_IN_ONE, _LATE = (
    int(f) for f in (Failure.NONE, Failure.NOT_FINITE, Failure.NOT_IN_ONE, Failure.LATE)
)


@part
def _advance(loop, lane, k, time, length):
    """Do step k: all groups, then all operations. Return the failure."""
    if loop.group_count > 0:
        see(loop)
    for g in range(loop.group_count):
        failure = advance_group(loop, lane, g, time, length)
        if failure == _NOT_IN_ONE:
            loop.group = g
        if failure != _NONE:
            return failure
    for o in range(loop.operation_count):
        failure = operate(loop, lane, o, k, time, length)
        if failure != _NONE:
            return failure
    present_at(lane.present, 0).code = 0
    return _NONE if all_finite(loop) else _NOT_FINITE


@cfunc(types.int64(types.intp, types.int64, types.int64, types.int64, types.intp), **OPTIONS)
def advance(address, first, count, every, rows):
    """Do steps and return the failure; they end with the present second of wall time.

    Args:
        address: Address of a LOOP record.
        first: Number of the first step.
        count: Number of steps.
        every: Every `every`-th communication point is recorded.
        rows: Address of the doubles for the recorded rows.
    """
    loop = loop_at(address, 0)
    lane = lane_at(loop.lanes, 0)
    loop.recorded, loop.lane = 0, 0
    next_time, began = point(loop.clock, first), present_second(loop)
    for k in range(first, first + count):
        loop.reached = k
        time, next_time = next_time, point(loop.clock, k + 1)
        failure = _advance(loop, lane, k, time, next_time - time)
        if failure != _NONE:
            return failure
        if divides(every, k + 1):
            failure = record(loop, lane, present_at(lane.present, 0), next_time, rows)
            if failure != _NONE:
                loop.reached = k + 1
                return failure
        if present_second(loop) != began:
            loop.reached = k + 1
            return _LATE
    loop.reached = first + count
    return _NONE


def text(name: str) -> str:
    """Return LLVM's text of `advance`, with this name."""
    return advance.inspect_llvm().replace(advance.native_name, name)
