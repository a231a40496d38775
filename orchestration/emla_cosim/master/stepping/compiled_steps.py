"""Parts of a step in compiled code, for one thread or several."""

import numpy as np

from ..algorithms.program import Call
from .by_address import doubles, instance_at, observed_at, operation_at, part, positions, present_at, seconds
from .compiled_calls import get_observed, get_outputs, set_inputs, shift, step
from .record_layout import Failure

_SET, _STEP = int(Call.SET), int(Call.STEP)
_NONE = int(Failure.NONE)


@part
def divides(multiple, k):
    """Whether `multiple` divides k. The shortcut saves a division, which takes as long as an FMU call."""
    return multiple == 1 or k % multiple == 0


@part
def point(clock, k):
    """See `Clock.point`."""
    return (clock.first + k * clock.per_step) / clock.denominator


@part
def present_second(loop):
    """Return the number of the present second. A stretch of steps ends with it, however slow they become."""
    return seconds(loop.seconds, (0,))


_FRACTION, _EXPONENT = 52, 0x7FF
"""Number of bits of a double behind its exponent, and those of the exponent, all set if it is not finite."""


@part
def all_finite(loop):
    """Whether all signals that instances read are finite.

    A test of all signals comes first. It has no branches, so the processor tests several at once.
    """
    bits, wrong = positions(loop.signals), 0
    for s in range(loop.signal_count):
        wrong |= ((bits[s] >> _FRACTION) & _EXPONENT) + 1  # larger than the exponent if all its bits are set
    if loop.read_count == 0 or wrong <= _EXPONENT:
        return True
    signals, read = doubles(loop.signals), positions(loop.read)
    for r in range(loop.read_count):  # noqa: SIM110 - compiled
        if not np.isfinite(signals[read[r]]):
            return False
    return True


@part
def record(loop, lane, present, time, rows):
    """Fill the next row with the time, all signals, and the observed variables. Return the failure."""
    for o in range(loop.observed_count):
        observed = observed_at(loop.observed, o)
        failure, status = get_observed(observed, present)
        if failure != _NONE:
            lane.instance, lane.status = observed.instance, status
            return failure
    present.code = 0
    row, signals = loop.recorded * (1 + loop.signal_count + loop.other_count), doubles(loop.signals)
    values, others = doubles(rows), doubles(loop.others)
    values[row] = time
    for s in range(loop.signal_count):
        values[row + 1 + s] = signals[s]
    row += 1 + loop.signal_count
    for s in range(loop.other_count):
        values[row + s] = others[s]
    loop.recorded += 1
    present.rows += 1
    return _NONE


@part
def operate(loop, lane, o, k, time, length):
    """Do operation `o` in step k and return the failure; see `OperationTableAlgorithm.operate`."""
    operation = operation_at(loop.operations, o)
    instance, call = instance_at(loop.instances, operation.instance), operation.call
    present, multiple = present_at(lane.present, 0), instance.multiple
    if not divides(multiple, k + 1):
        return _NONE
    begin, span = time, length
    if multiple > 1:
        begin = point(loop.clock, k + 1 - multiple)
        span = point(loop.clock, k + 1) - begin
    if call == _SET:
        failure, status = set_inputs(instance, present, begin, span)
    elif call == _STEP:
        failure, status = step(instance, present, begin, span)
    else:
        shift(instance, time + length)
        failure, status = get_outputs(instance, present)
    if failure != _NONE:
        lane.instance, lane.status = operation.instance, status
    return failure
