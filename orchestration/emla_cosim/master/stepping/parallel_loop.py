"""The compiled stepping loop for several threads. Each does the tasks of its lane in every step, in order.

A task waits until the tasks that it depends on are finished, in any lane. All lanes meet at the end
of a step, so rows and failures are the same as with one thread. The module is imported only to be compiled.
"""

from numba import cfunc, types

from .by_address import (
    OPTIONS,
    count_to,
    counted,
    give_way,
    lane_at,
    loop_at,
    lower,
    part,
    pause,
    positions,
    present_at,
    task_at,
)
from .compiled_groups import advance_group, see
from .compiled_steps import all_finite, divides, operate, point, present_second, record
from .record_layout import LANE, LOOP, NOWHERE, TASK, Failure

_NONE, _NOT_FINITE, _NOT_IN_ONE, _LATE = (
    int(f) for f in (Failure.NONE, Failure.NOT_FINITE, Failure.NOT_IN_ONE, Failure.LATE)
)
_RELEASED, _FAILED, _GIVEN_UP = (
    int(LOOP.fields[name][1])  # type: ignore[index]
    for name in ("released", "failed", "given_up")
)
_LANE, _REACHED = int(LANE.itemsize), int(LANE.fields["reached"][1])  # type: ignore[index]
_TASK, _THROUGH = int(TASK.itemsize), int(TASK.fields["through"][1])  # type: ignore[index]

_SPINS = 200
"""Number of checks before a waiting thread lets others run: about ten microseconds."""


@part
def _wait(loop, counter, least):
    """Wait until other threads have raised a counter to `least`."""
    tries = 0
    while counted(counter) < least:
        tries += 1
        if tries < _SPINS:
            pause()
        else:
            give_way(loop.give_way, ())


@part
def _note(lane, address, place, failure):
    """Record a failed task. Later tasks are skipped; the first failed place counts."""
    if failure == _NOT_IN_ONE:
        lower(address + _GIVEN_UP, place)
        return
    lower(address + _FAILED, place)
    if place < lane.failed:
        lane.failed, lane.failure = place, failure
        lane.failed_instance, lane.failed_status = lane.instance, lane.status


@part
def _do(loop, address, lane, place, k, time, length):
    """Wait for the tasks that the task at a place depends on, then do it."""
    task = task_at(loop.tasks, place)
    waits = positions(task.waits)
    for w in range(task.wait_count):
        _wait(loop, loop.tasks + waits[w] * _TASK + _THROUGH, k + 1)
    if counted(address + _FAILED) > place and counted(address + _GIVEN_UP) > place:
        if place < loop.group_count:
            failure = advance_group(loop, lane, place, time, length)
        else:
            failure = operate(loop, lane, place - loop.group_count, k, time, length)
        if failure == _NONE:
            task.done = k + 1
        else:
            _note(lane, address, place, failure)
    count_to(loop.tasks + place * _TASK + _THROUGH, k + 1)


@part
def _judge(loop, address):
    """Return the failure of a step that all lanes have finished."""
    for n in range(loop.lane_count):
        lane = lane_at(loop.lanes, n)
        if lane.failed < NOWHERE and lane.failed == counted(address + _FAILED):
            loop.lane, lane.instance, lane.status = n, lane.failed_instance, lane.failed_status
            return lane.failure
    if counted(address + _GIVEN_UP) < NOWHERE:
        return _NOT_IN_ONE
    return _NONE if all_finite(loop) else _NOT_FINITE


@cfunc(types.int64(types.intp, types.int64, types.int64, types.int64, types.int64, types.intp), **OPTIONS)
def advance_lane(address, n, first, count, every, rows):
    """Do the tasks of lane n in several steps. The first lane returns the failure.

    The steps end with the present second of wall time.

    Call this for all lanes, each in a thread of its own.

    Args:
        address: Address of a LOOP record.
        n: Number of the lane.
        first: Number of the first step.
        count: Number of steps.
        every: Every `every`-th communication point is recorded.
        rows: Address of the doubles for the recorded rows.
    """
    loop = loop_at(address, 0)
    lane, leads = lane_at(loop.lanes, n), n == 0
    present, tasks = present_at(lane.present, 0), positions(lane.tasks)
    next_time, began = point(loop.clock, first), present_second(loop)
    for k in range(first, first + count):
        time, next_time = next_time, point(loop.clock, k + 1)
        if leads:
            loop.reached = k
            if loop.group_count > 0:
                see(loop)
            count_to(address + _RELEASED, k + 1)
        else:
            _wait(loop, address + _RELEASED, k + 1)
            if counted(address + _RELEASED) == NOWHERE:
                return _NONE
        for t in range(lane.task_count):
            _do(loop, address, lane, tasks[t], k, time, next_time - time)
        present.code = 0
        if not leads:
            count_to(loop.lanes + n * _LANE + _REACHED, k + 1)
            continue
        for other in range(1, loop.lane_count):
            _wait(loop, loop.lanes + other * _LANE + _REACHED, k + 1)
        failure = _judge(loop, address)
        if failure != _NONE:
            count_to(address + _RELEASED, NOWHERE)
            return failure
        if divides(every, k + 1):
            failure = record(loop, lane, present, next_time, rows)
            if failure != _NONE:
                loop.lane, loop.reached = 0, k + 1
                count_to(address + _RELEASED, NOWHERE)
                return failure
        if present_second(loop) != began:
            loop.reached = k + 1
            count_to(address + _RELEASED, NOWHERE)
            return _LATE
    if leads:
        loop.reached = first + count
    return _NONE


def text(name: str) -> str:
    """Return LLVM's text of `advance_lane`, with this name."""
    return advance_lane.inspect_llvm().replace(advance_lane.native_name, name)
