"""Error control in compiled code: many trial steps of an algorithm per call.

It does the same as `ErrorControl._try_step` and `StepControl` in Python, on the same memory, with the same
bits. It is imported only to be compiled. Python does the trials that need more, such as loops that do not
converge in one step. After a failure the instances are as the call left them.
"""

import numpy as np
from numba import cfunc, types

from .by_address import (
    OPTIONS,
    block_at,
    control_at,
    copy_state,
    doubles,
    instance_at,
    lane_at,
    loop_at,
    part,
    positions,
    power,
    present_at,
)
from .compiled_calls import is_bad
from .compiled_groups import advance_group, see
from .compiled_steps import all_finite, operate, present_second, record
from .error_control import BENT, CRAWLING_STEPS, EARLY, ROUNDING_ERROR
from .record_layout import Failure
from .step_control import LARGEST_CUT, LARGEST_GROWTH, SAFETY

_NONE, _NOT_FINITE, _NOT_IN_ONE, _LATE = (
    int(f) for f in (Failure.NONE, Failure.NOT_FINITE, Failure.NOT_IN_ONE, Failure.LATE)
)
_GET_STATE, _SET_STATE = int(Failure.GET_STATE), int(Failure.SET_STATE)
_WHOLE = 0


@part
def _take(loop, lane, control):
    """See `Snapshot.take`. Return the failure."""
    present = present_at(lane.present, 0)
    for i in range(control.instance_count):
        instance = instance_at(loop.instances, i)
        present.code = instance.code_save
        status = copy_state(instance.get_state, (instance.component, control.states + 8 * i))
        if is_bad(status):
            lane.instance, lane.status = i, status
            return _GET_STATE
    for b in range(control.block_count):
        block = block_at(control.blocks, b)
        values, copy = doubles(block.values), doubles(block.copy)
        for v in range(block.count):
            copy[v] = values[v]
    return _NONE


@part
def _restore(loop, lane, control):
    """See `Snapshot.restore`. Return the failure."""
    present = present_at(lane.present, 0)
    for i in range(control.instance_count):
        instance = instance_at(loop.instances, i)
        present.code = instance.code_restore
        status = copy_state(instance.set_state, (instance.component, positions(control.states)[i]))
        if is_bad(status):
            lane.instance, lane.status = i, status
            return _SET_STATE
    for b in range(control.block_count):
        block = block_at(control.blocks, b)
        values, copy = doubles(block.values), doubles(block.copy)
        for v in range(block.count):
            values[v] = copy[v]
    return _NONE


@part
def _see(loop, control):
    """See `Scale.see`."""
    signals, largest = doubles(loop.signals), doubles(control.largest_values)
    for s in range(loop.signal_count):
        size = abs(signals[s])
        if size > largest[s] and np.isfinite(size):
            largest[s] = size


@part
def _advance(loop, lane, time, length):
    """Do a step of the algorithm. Return the failure."""
    if loop.group_count > 0:
        see(loop)
    for g in range(loop.group_count):
        failure = advance_group(loop, lane, g, time, length)
        if failure != _NONE:
            return failure
    for o in range(loop.operation_count):
        failure = operate(loop, lane, o, 0, time, length)
        if failure != _NONE:
            return failure
    return _NONE


@part
def _try_doubled_step(loop, lane, control, end):
    """See `ErrorControl._try_doubled_step`. Return the failure."""
    signals, judged = doubles(loop.signals), positions(control.judged)
    whole, errors = doubles(control.whole), doubles(control.errors)
    middle = control.time + 0.5 * (end - control.time)
    for turn in range(3):
        begin = control.time if turn < 2 else middle
        length = (end if turn == _WHOLE else middle) - control.time if turn < 2 else end - middle
        control.began = begin
        failure = _advance(loop, lane, begin, length)
        if failure == _NONE and turn == _WHOLE:
            for j in range(control.count):
                whole[j] = signals[judged[j]]
            failure = _restore(loop, lane, control)
        if failure != _NONE:
            return failure
    largest, floors, unread = (
        doubles(control.largest_values),
        doubles(control.floors),
        positions(control.unread),
    )
    for j in range(control.count):
        signal = judged[j]
        difference = (signals[signal] - whole[j]) / control.divisor
        error = abs(difference) / (largest[signal] + floors[signal])
        errors[j] = 0.0 if unread[j] and not np.isfinite(error) else error
    return _NONE


@part
def _all_errors_finite(control):
    errors = doubles(control.errors)
    for j in range(control.count):  # noqa: SIM110 - compiled
        if not np.isfinite(errors[j]):
            return False
    return True


@part
def _largest_share(control, step):
    """Compare the errors with the tolerance, as `ErrorControl._try_step` does. Return the largest share."""
    errors, judged_errors = doubles(control.errors), doubles(control.judged_errors)
    first, last = doubles(control.rejected_errors), doubles(control.last_rejected_errors)
    jumped, jumps = positions(control.jumped), positions(control.jumps)
    looked_at, beside, instant = (
        positions(control.looked_at),
        positions(control.beside),
        positions(control.instant),
    )
    allowed = control.tolerance
    if control.per_unit:
        passed = control.time - control.start + step + EARLY * control.first_step
        allowed = max(control.tolerance * step / passed, ROUNDING_ERROR)
    bent = max(BENT * control.tolerance, allowed)
    can_jump = step <= 0.5 * control.rejected_step  # not if it is NaN
    can_bend = not np.isnan(control.last_rejected_step)
    largest = 0.0
    for j in range(control.count):
        error = errors[j]
        jump = can_jump and error > allowed and error > 0.9 * first[j] and not jumped[j]
        if step < control.unread_limit and beside[j]:
            jump = True
        jumps[j] = jump
        judged = 0.0 if jump or not looked_at[j] else error
        judged_errors[j] = judged
        once = instant[j] != 0 or step < control.short_limit
        if can_bend and error > 0.6 * step / control.last_rejected_step * last[j]:
            once = True
        share = judged / (bent if once else allowed)
        if share > largest or np.isnan(share):  # nothing is larger than NaN
            largest = share
    return largest


@part
def _raise_to(control, base, exponent):
    return power(control.power, (base, exponent))


@part
def _judge(control, step, error):
    """See `StepControl.judge`. Return 1 for an accepted step, 0 for a rejected one, -1 if it is too short."""
    exponent = control.exponent
    if error < 1e-10:
        error = 1e-10
    if not error <= 1.0:  # NaN, too
        factor = SAFETY * _raise_to(control, error, -exponent) if error < np.inf else LARGEST_CUT
        shorter = step * max(LARGEST_CUT, min(factor, SAFETY))
        if shorter < control.smallest:
            return -1
        control.rejected += 1
        control.step = shorter
        return 0
    if step < control.step:
        growth = SAFETY * _raise_to(control, error, -exponent)
    else:
        growth = SAFETY * _raise_to(control, error, -0.7 * exponent)
        growth = growth * _raise_to(control, control.last_error, 0.4 * exponent)
        control.last_error = error
    proposed = max(step * min(LARGEST_GROWTH, max(LARGEST_CUT, growth)), control.smallest)
    proposed = min(proposed, max(control.largest, step))
    control.step = proposed if step >= 0.5 * control.step else max(proposed, control.step)
    control.accepted += 1
    return 1


@part
def _accept(control, step):
    """Keep what the next steps need to know of an accepted one."""
    total, judged_errors = doubles(control.total), doubles(control.judged_errors)
    jumped, jumps = positions(control.jumped), positions(control.jumps)
    beside, instant = positions(control.beside), positions(control.instant)
    control.rejected_step = control.last_rejected_step = np.nan
    for j in range(control.count):
        jumped[j] = jumps[j] != 0 and not beside[j]
        total[j] += 0.0 if instant[j] and control.per_unit else judged_errors[j]
    control.short_steps = control.short_steps + 1 if step < control.crawling_limit else 0
    control.crawls = control.per_unit and control.short_steps == CRAWLING_STEPS


@part
def _reject(control, step):
    """Keep what the next trial needs to know of a rejected one."""
    errors = doubles(control.errors)
    first, last = doubles(control.rejected_errors), doubles(control.last_rejected_errors)
    is_first = np.isnan(control.rejected_step)
    for j in range(control.count):
        last[j] = errors[j]
        if is_first:
            first[j] = errors[j]
    control.last_rejected_step = step
    if is_first:
        control.rejected_step = step


@part
def _propose(control):
    """See `StepControl.propose`."""
    remaining, step = control.point - control.time, min(control.step, control.largest)
    if step >= remaining * (1.0 - 1e-9):
        return remaining
    return 0.5 * remaining if 2.0 * step > remaining else step


@part
def _try_step(loop, lane, control, step, end, leap):
    """See `ErrorControl._try_step`. Return the failure, and whether the step was accepted."""
    sweeps = lane.sweeps
    failure = _take(loop, lane, control)
    if failure != _NONE:
        return failure, False
    _see(loop, control)
    failure = _try_doubled_step(loop, lane, control, end)
    verdict, is_python = 0, failure == _NOT_IN_ONE
    if failure != _NONE and not is_python:
        return failure, False
    if not is_python:
        if leap and _all_errors_finite(control):
            control.rejected_step = control.last_rejected_step = np.nan
            control.accepted += 1
            return _NONE, True
        verdict = _judge(control, step, _largest_share(control, step))
        is_python = verdict < 0
    if verdict == 1:
        _accept(control, step)
        return _NONE, True
    failure = _restore(loop, lane, control)
    if is_python:
        lane.sweeps = sweeps
        return _NOT_IN_ONE if failure == _NONE else failure, False
    if failure == _NONE:
        _reject(control, step)
    return failure, False


@part
def _show(loop, control):
    """Keep the time and the signals of a step for `Stepping.watch`."""
    signals, rows = doubles(loop.signals), doubles(control.watched_rows)
    row = control.watched * (1 + loop.signal_count)
    rows[row] = control.time
    for s in range(loop.signal_count):
        rows[row + 1 + s] = signals[s]
    control.watched += 1


@cfunc(types.int64(types.intp, types.intp, types.int64, types.int64, types.intp), **OPTIONS)
def try_steps(address, control_address, most, room, rows):
    """Try steps to a point of time, and return the failure; they end with the present second of wall time.

    Args:
        address: Address of a LOOP record.
        control_address: Address of a CONTROL record.
        most: Largest number of trials.
        room: Number of free rows, if each accepted step has one.
        rows: Address of the doubles for these rows.
    """
    loop, control = loop_at(address, 0), control_at(control_address, 0)
    lane = lane_at(loop.lanes, 0)
    loop.recorded, control.tried, control.watched, control.met, control.crawls = 0, 0, 0, False, False
    began = present_second(loop)
    while control.tried < most:
        step = _propose(control)
        met = step == control.point - control.time
        end = control.point if met else control.time + step
        control.end, control.length = end, step
        leap = control.event and met and step <= control.leap_limit
        failure, accepted = _try_step(loop, lane, control, step, end, leap)
        if failure == _NOT_IN_ONE:
            return failure
        control.tried += 1
        present_at(lane.present, 0).code = 0
        if failure != _NONE:
            return failure
        if accepted:
            if not all_finite(loop):
                return _NOT_FINITE
            control.time = end
            if control.watch_room > 0:
                _show(loop, control)
            control.met = met
            if control.records:
                failure = record(loop, lane, present_at(lane.present, 0), end, rows)
                if failure != _NONE:
                    return failure
            if (
                met
                or control.crawls
                or control.time >= control.point
                or control.time >= control.enough
                or (control.records and loop.recorded == room)
                or (control.watch_room > 0 and control.watched == control.watch_room)
            ):
                return _NONE
        if present_second(loop) != began:
            return _LATE
    return _NONE


def text(name: str) -> str:
    """Return LLVM's text of `try_steps`, with this name."""
    return try_steps.inspect_llvm().replace(try_steps.native_name, name)
