"""The stepping loop that is compiled: many steps of an algorithm per call.

It does what `Explicit` and `Strong` do in Python, on the same memory, and gives the same bits. It is
imported only where it has to be compiled.
"""

import numpy as np
from numba import cfunc, types

from ..algorithms.sampling import Call
from .by_address import OPTIONS, doubles, loop_at, operation_at, part, positions, present_at, slave_at
from .compiled_calls import get_outputs, set_inputs, shift, step
from .compiled_groups import advance_group, see
from .layout import Failure

_SET, _STEP = int(Call.SET), int(Call.STEP)
_NONE, _NOT_FINITE = int(Failure.NONE), int(Failure.NOT_FINITE)


@part
def _divides(multiple, k):
    """Whether k is a multiple; a division would take as long as a call of an FMU."""
    return multiple == 1 or k % multiple == 0


@part
def _point(clock, k):
    """See `Clock.point`."""
    return (clock.first + k * clock.per_step) / clock.denominator


@part
def _all_finite(loop):
    signals, read = doubles(loop.signals), positions(loop.read)
    for r in range(loop.read_count):  # noqa: SIM110 - compiled
        if not np.isfinite(signals[read[r]]):
            return False
    return True


@part
def _record(loop, time, rows):
    """Fill the next row: time, then all signals."""
    row, signals = loop.recorded * (1 + loop.signal_count), doubles(loop.signals)
    values = doubles(rows)
    values[row] = time
    for s in range(loop.signal_count):
        values[row + 1 + s] = signals[s]
    loop.recorded += 1
    present_at(loop.present, 0).recorded = loop.recorded


@part
def _operate(loop, k, present, time, length):
    """All operations of step k; the failure. See `Sampling.operate`."""
    for o in range(loop.operation_count):
        operation = operation_at(loop.operations, o)
        slave, call = slave_at(loop.slaves, operation.slave), operation.call
        multiple = slave.multiple
        if not _divides(multiple, k + 1):
            continue
        begin, span = time, length
        if multiple > 1:
            begin = _point(loop.clock, k + 1 - multiple)
            span = _point(loop.clock, k + 1) - begin
        if call == _SET:
            failure, status = set_inputs(slave, present, begin, span)
        elif call == _STEP:
            failure, status = step(slave, present, begin, span)
        else:
            shift(slave, time + length)
            failure, status = get_outputs(slave, present)
        if failure != _NONE:
            loop.slave, loop.status = operation.slave, status
            return failure
    return _NONE


@part
def _advance(loop, k, time, length):
    """Step k: all groups, then all operations; the failure."""
    present = present_at(loop.present, 0)
    if loop.group_count > 0:
        see(loop)
    for g in range(loop.group_count):
        failure = advance_group(loop, g, present, time, length)
        if failure != _NONE:
            return failure
    failure = _operate(loop, k, present, time, length)
    if failure != _NONE:
        return failure
    present.code = 0
    return _NONE if _all_finite(loop) else _NOT_FINITE


@cfunc(types.int64(types.intp, types.int64, types.int64, types.int64, types.intp), **OPTIONS)
def advance(address, first, count, every, rows):
    """Do `count` steps from the one numbered `first`; returns the failure.

    `address` is that of a LOOP record, `rows` that of the doubles to record to, row by row; each
    `every`-th point fills one.
    """
    loop = loop_at(address, 0)
    loop.recorded, loop.sweeps = 0, 0
    next_time = _point(loop.clock, first)
    for k in range(first, first + count):
        loop.reached = k
        time, next_time = next_time, _point(loop.clock, k + 1)
        failure = _advance(loop, k, time, next_time - time)
        if failure != _NONE:
            return failure
        if _divides(every, k + 1):
            _record(loop, next_time, rows)
    loop.reached = first + count
    return _NONE


def text() -> str:
    """LLVM's text of `advance`, under this name."""
    return advance.inspect_llvm().replace(advance.native_name, "advance")
