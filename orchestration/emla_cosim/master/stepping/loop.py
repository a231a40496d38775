"""The stepping loop that is compiled: many steps of an explicit algorithm per call.

It works through the same table of operations as `Explicit`, on the same memory, and gives the same
bits. It is imported only where it has to be compiled.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import cfunc, from_dtype, njit, types
from numba.extending import intrinsic

from ..algorithms.extrapolation import Mode
from ..algorithms.sampling import Call
from .layout import INPUT, LOOP, OPERATION, PRESENT, SLAVE, Failure

_SET, _STEP, _GET = int(Call.SET), int(Call.STEP), int(Call.GET)
_HOLD, _MIDDLE, _LINE = int(Mode.HOLD), int(Mode.MIDDLE), int(Mode.LINE)
_NONE, _NOT_FINITE = int(Failure.NONE), int(Failure.NOT_FINITE)
_SET_REAL, _SET_DERIVATIVES = int(Failure.SET_REAL), int(Failure.SET_DERIVATIVES)
_DO_STEP, _GET_REAL = int(Failure.DO_STEP), int(Failure.GET_REAL)
_OK, _WARNING = 0, 1
_NO_WAY_BACK = 1


# ---- memory and functions by address -----------------------------------------------------------


def _records(layout: np.dtype) -> Any:
    """A function that gives the record number i of those that begin at an address, in place."""
    kind = from_dtype(layout)

    @intrinsic
    def record(typing_context: Any, address: Any, i: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            first = builder.inttoptr(values[0], context.get_value_type(kind))
            return builder.gep(first, [values[1]])

        return kind(types.intp, types.intp), generate

    return record


def _numbers(kind: types.Type) -> Any:
    """A function that gives the numbers that begin at an address."""

    @intrinsic
    def numbers(typing_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.intp), generate

    return numbers


def _caller(*argument_types: types.Type) -> Any:
    """A function that calls the address of a C function with these arguments and an int result."""

    @intrinsic
    def call(typing_context: Any, address: Any, arguments: Any) -> Any:
        signature = types.int32(types.intp, types.Tuple(argument_types))

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function, packed = values
            prototype = ir.FunctionType(
                context.get_value_type(types.int32), [context.get_value_type(t) for t in argument_types]
            )
            given = [builder.extract_value(packed, i) for i in range(len(argument_types))]
            return builder.call(builder.inttoptr(function, prototype.as_pointer()), given)

        return signature, generate

    return call


_loop, _operation, _slave, _input = (_records(r) for r in (LOOP, OPERATION, SLAVE, INPUT))
_present = _records(PRESENT)
_doubles, _positions = _numbers(types.float64), _numbers(types.intp)
_exchange = _caller(types.intp, types.intp, types.uintp, types.intp)
_derive = _caller(types.intp, types.intp, types.uintp, types.intp, types.intp)
_do_step = _caller(types.intp, types.float64, types.float64, types.int32)

_options = {"nogil": True, "error_model": "numpy"}
_part = njit(forceinline=True, **_options)


# ---- the loop ----------------------------------------------------------------------------------


@_part
def _divides(multiple, k):
    """Whether k is a multiple; a division would take as long as a call of an FMU."""
    return multiple == 1 or k % multiple == 0


@_part
def _point(clock, k):
    """See `Clock.point`."""
    return (clock.first + k * clock.per_step) / clock.denominator


@_part
def _is_bad(status):
    """Whether a status is worse than a warning, or none of the standard's."""
    return status > _WARNING or status < _OK


@_part
def _compute_inputs(slave, time, length):
    """See `Exchange.pass_inputs`."""
    inputs, derivatives = _doubles(slave.inputs), _doubles(slave.derivatives)
    middle = 0.5 * length if slave.mode == _MIDDLE else 0.0
    for j in range(slave.input_count):
        source = _input(slave.sources, j)
        signal = _doubles(source.signal)[0]
        if slave.mode == _HOLD:
            inputs[j] = source.factor * signal + source.offset
            continue
        newest = _doubles(source.at)[0]
        earlier, then = _doubles(source.previous)[0], _doubles(source.before)[0]
        if slave.multiple > 1:
            taken, taken_at = _doubles(source.taken), _doubles(source.taken_at)
            if taken_at[0] < then:
                earlier, then = taken[0], taken_at[0]
            taken[0], taken_at[0] = signal, newest
        span = newest - then
        slope = 0.0
        if source.moves and span > 0.0:
            slope = (signal - earlier) / span
        inputs[j] = source.factor * (signal + (time - newest + middle) * slope) + source.offset
        derivatives[j] = source.factor * slope


@_part
def _set(slave, present, time, length):
    """Give a slave its inputs for the step from `time` of this length."""
    references, count = slave.input_references, slave.input_count
    if count == 0:
        return _NONE, _OK
    _compute_inputs(slave, time, length)
    status = _exchange(slave.set_real, (slave.component, references, count, slave.inputs))
    if _is_bad(status):
        return _SET_REAL, status
    if slave.mode == _LINE:
        orders, values = slave.derivative_orders, slave.derivatives
        present.code += 1  # see `CALLS`
        status = _derive(
            slave.set_real_input_derivatives, (slave.component, references, count, orders, values)
        )
        if _is_bad(status):
            return _SET_DERIVATIVES, status
    return _NONE, _OK


@_part
def _step(slave, present, time, length):
    """Let a slave do its step."""
    present.time = time
    status = _do_step(slave.do_step, (slave.component, time, length, _NO_WAY_BACK))
    return _DO_STEP if _is_bad(status) else _NONE, status


@_part
def _get(slave, time):
    """Read the outputs of `time`; the present ones become the previous, see `Exchange.shift`."""
    count, outputs, previous = slave.output_count, _doubles(slave.outputs), _doubles(slave.previous)
    for s in range(count):
        previous[s] = outputs[s]
    at = _doubles(slave.at)
    _doubles(slave.before)[0] = at[0]
    at[0] = time
    if count == 0:
        return _NONE, _OK
    status = _exchange(slave.get_real, (slave.component, slave.output_references, count, slave.outputs))
    return _GET_REAL if _is_bad(status) else _NONE, status


@_part
def _all_finite(loop):
    signals, read = _doubles(loop.signals), _positions(loop.read)
    for r in range(loop.read_count):  # noqa: SIM110 - compiled
        if not np.isfinite(signals[read[r]]):
            return False
    return True


@_part
def _record(loop, time, rows):
    """Fill the next row: time, then all signals."""
    row, signals = loop.recorded * (1 + loop.signal_count), _doubles(loop.signals)
    values = _doubles(rows)
    values[row] = time
    for s in range(loop.signal_count):
        values[row + 1 + s] = signals[s]
    loop.recorded += 1
    _present(loop.present, 0).recorded = loop.recorded


@_part
def _advance(loop, k, time, step):
    """Step k: all its operations; returns the failure."""
    present = _present(loop.present, 0)
    for o in range(loop.operation_count):
        operation = _operation(loop.operations, o)
        slave, call = _slave(loop.slaves, operation.slave), operation.call
        multiple = slave.multiple
        if not _divides(multiple, k + 1):
            continue
        begin, length = time, step
        if multiple > 1:
            begin = _point(loop.clock, k + 1 - multiple)
            length = _point(loop.clock, k + 1) - begin
        present.code = operation.code
        if call == _SET:
            failure, status = _set(slave, present, begin, length)
        elif call == _STEP:
            failure, status = _step(slave, present, begin, length)
        else:
            failure, status = _get(slave, time + step)
        if failure != _NONE:
            loop.slave, loop.status = operation.slave, status
            return failure
    present.code = 0
    return _NONE if _all_finite(loop) else _NOT_FINITE


@cfunc(types.int64(types.intp, types.int64, types.int64, types.int64, types.intp), **_options)
def advance(address, first, count, every, rows):
    """Do `count` steps from the one numbered `first`; returns the failure.

    `address` is that of a LOOP record, `rows` that of the doubles to record to, row by row; each
    `every`-th point fills one.
    """
    loop = _loop(address, 0)
    loop.recorded = 0
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
