"""The compiled stepping loop: many steps of an explicit algorithm per call.

It works through the same table of operations as `Explicit`, on the same memory, and calls the
FMI functions of the slaves by address. The machine code is cached on disk.
"""

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from ...errors import RunError
from ..algorithms.explicit import Call, Explicit
from ..algorithms.extrapolation import Mode
from ..slaves.slave import EntryPoints, Vector
from .timing import Clock

_SET, _STEP, _GET = int(Call.SET), int(Call.STEP), int(Call.GET)
_HOLD, _MIDDLE, _LINE = int(Mode.HOLD), int(Mode.MIDDLE), int(Mode.LINE)
_DONE, _SET_REAL, _SET_DERIVATIVES, _DO_STEP, _GET_REAL, _NOT_FINITE = range(6)
_CALL_NAMES = {_SET_REAL: "setReal", _SET_DERIVATIVES: "setRealInputDerivatives", _GET_REAL: "getReal"}
_WARNING = 1
_NO_WAY_BACK = 1


class Tables(NamedTuple):
    """All that the loop needs, as arrays.

    One element per operation: `calls`, `targets`. One per slave: `multiples`, `modes`, the
    addresses, and where its inputs and outputs begin and end. One per input: `sources`,
    `factors`, `offsets`, `movable`, `inputs`, `derivatives`. One per signal: `owners`, `smooth`,
    `signals`, `previous`. `read` lists the signals that have to be finite.

    Indices are unsigned, because every access with a signed one would be checked for its sign.
    """

    calls: Any
    targets: Any
    multiples: Any
    modes: Any
    components: Any
    set_real: Any
    get_real: Any
    do_step: Any
    set_derivatives: Any
    input_references: Any
    output_references: Any
    derivative_orders: Any
    input_addresses: Any
    derivative_addresses: Any
    output_addresses: Any
    input_begins: Any
    input_ends: Any
    output_begins: Any
    output_ends: Any
    sources: Any
    factors: Any
    offsets: Any
    movable: Any
    inputs: Any
    derivatives: Any
    owners: Any
    smooth: Any
    signals: Any
    previous: Any
    at: Any
    before: Any
    read: Any


class Kernel:
    """The compiled loop for one algorithm, set up and initialized or not."""

    def __init__(self, algorithm: Explicit, entry_points: list[EntryPoints]) -> None:
        """Collect the tables; compiles, or loads what an earlier process compiled."""
        self._algorithm = algorithm
        self._entry_points = entry_points  # owns the arrays whose addresses are in the tables
        self._tables = _tables(algorithm, entry_points)
        rows = np.empty((1, 1 + len(algorithm.network.signals)))
        _run(self._tables, 0, 0, Clock(0.0, 1.0, 1.0), 1, rows)

    def run(
        self, first: int, count: int, clock: Clock, every: int, rows: Vector
    ) -> tuple[int, RunError | None]:
        """Do `count` steps from the one numbered `first`.

        The step k begins at the point k of the clock; each `every`-th point fills the next of
        `rows`, time first. Returns how many rows were recorded, and what ended the run in step
        `algorithm.steps`, if anything did.
        """
        reached, recorded, code, detail = _run(self._tables, first, count, clock, every, rows)
        self._algorithm.steps += reached - first
        return recorded, self._error(code, detail, clock.point(reached), clock.point(reached + 1))

    def _error(self, code: int, detail: tuple[int, int], time: float, end: float) -> RunError | None:
        if code == _DONE:
            return None
        network = self._algorithm.network
        if code == _NOT_FINITE:
            return network.not_finite(end)
        i, status = detail
        slave = network.slaves[i]
        if code == _DO_STEP:
            return slave.error(f"doStep at t = {time:.9g} s", status)
        return slave.error(_CALL_NAMES[code], status)


def _tables(algorithm: Explicit, points: list[EntryPoints]) -> Tables:
    network, exchange = algorithm.network, algorithm.exchange

    def addresses(values: list[int]) -> Any:
        return np.array(values, dtype=np.intp)

    def indices(values: Any) -> Any:
        return np.array(values, dtype=np.uintp)

    def elements(values: Vector, parts: list[slice]) -> Any:
        return addresses([values.ctypes.data + values.itemsize * part.start for part in parts])

    movable = [np.empty(0, dtype=bool), *(slave.continuous_inputs for slave in network.slaves)]
    return Tables(
        calls=np.array([o.call for o in algorithm.operations], dtype=np.int64),
        targets=indices([o.slave for o in algorithm.operations]),
        multiples=algorithm.multiples,
        modes=np.array(exchange.modes, dtype=np.int64),
        components=addresses([p.component for p in points]),
        set_real=addresses([p.set_real for p in points]),
        get_real=addresses([p.get_real for p in points]),
        do_step=addresses([p.do_step for p in points]),
        set_derivatives=addresses([p.set_real_input_derivatives for p in points]),
        input_references=addresses([p.input_references.ctypes.data for p in points]),
        output_references=addresses([p.output_references.ctypes.data for p in points]),
        derivative_orders=addresses([p.derivative_orders.ctypes.data for p in points]),
        input_addresses=elements(network.inputs, network.input_parts),
        derivative_addresses=elements(exchange.derivatives, network.input_parts),
        output_addresses=elements(network.signals, network.parts),
        input_begins=indices([part.start for part in network.input_parts]),
        input_ends=indices([part.stop for part in network.input_parts]),
        output_begins=indices([part.start for part in network.parts]),
        output_ends=indices([part.stop for part in network.parts]),
        sources=indices([s for sources in network.sources for s in sources]),
        factors=np.concatenate([np.empty(0), *network.factors]),
        offsets=np.concatenate([np.empty(0), *network.offsets]),
        movable=np.concatenate(movable),
        inputs=network.inputs,
        derivatives=exchange.derivatives,
        owners=indices(exchange.owners),
        smooth=exchange.smooth,
        signals=network.signals,
        previous=exchange.history.previous,
        at=exchange.history.at,
        before=exchange.history.before,
        read=indices(network.read),
    )


def _caller(*argument_types: types.Type) -> Any:
    """A function that calls the address of a C function with these arguments and an int result."""

    @intrinsic
    def call(typing_context: Any, address: Any, arguments: Any) -> Any:
        signature = types.int32(types.intp, arguments)

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function, packed = values
            prototype = ir.FunctionType(
                context.get_value_type(types.int32), [context.get_value_type(t) for t in argument_types]
            )
            given = [
                context.cast(builder, builder.extract_value(packed, i), signature.args[1].types[i], t)
                for i, t in enumerate(argument_types)
            ]
            return builder.call(builder.inttoptr(function, prototype.as_pointer()), given)

        return signature, generate

    return call


_exchange = _caller(types.intp, types.intp, types.uintp, types.intp)
_derive = _caller(types.intp, types.intp, types.uintp, types.intp, types.intp)
_step = _caller(types.intp, types.float64, types.float64, types.int32)


def _compiled(function: Any, **options: Any) -> Any:
    options |= {"nogil": True, "error_model": "numpy"}
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # no folder to keep the machine code in
        return njit(**options)(function)


def _inlined(function: Any) -> Any:
    """A part of the loop: as a call of its own it would count references to all tables every time."""
    return _compiled(function, inline="always")


@_inlined
def _divides(multiple, k):
    """Whether k is a multiple; a division would take as long as a call of an FMU."""
    return multiple == 1 or k % multiple == 0


@_inlined
def _point(clock, k):
    """See `Clock.point`."""
    return (clock.first + k * clock.per_step) / clock.denominator


@_compiled
def _run(tables, first, count, clock, every, rows):
    """The loop; returns steps reached, rows filled, and what failed: code and (slave, status).

    All tables are taken out first: each access to a table within the loop would count references.
    """
    (
        calls, targets, multiples, modes,
        components, set_real, get_real, do_step, set_derivatives,
        input_references, output_references, derivative_orders,
        input_addresses, derivative_addresses, output_addresses,
        input_begins, input_ends, output_begins, output_ends,
        sources, factors, offsets, movable, inputs, derivatives,
        owners, smooth, signals, previous, at, before, read,
    ) = tables  # fmt: skip
    row = 0
    next_time = _point(clock, first)
    for k in range(first, first + count):
        time, next_time = next_time, _point(clock, k + 1)
        step = next_time - time
        for o in range(len(calls)):
            call, i = calls[o], targets[o]
            multiple = multiples[i]
            if not _divides(multiple, k + 1 if call == _GET else k):
                continue
            component = components[i]
            length = step if multiple == 1 else _point(clock, k + multiple) - time
            if call == _STEP:
                status = _step(do_step[i], (component, time, length, _NO_WAY_BACK))
                if status > _WARNING:
                    return k, row, _DO_STEP, (np.intp(i), status)
                continue
            if call == _SET:  # see Exchange.pass_inputs
                begin, end, mode = input_begins[i], input_ends[i], modes[i]
                if begin == end:
                    continue
                middle = 0.5 * length if mode == _MIDDLE else 0.0
                for j in range(begin, end):
                    s = sources[j]
                    if mode == _HOLD:
                        inputs[j] = factors[j] * signals[s] + offsets[j]
                        continue
                    newest = at[owners[s]]
                    span = newest - before[owners[s]]
                    slope = 0.0
                    if movable[j] and smooth[s] and span > 0.0:
                        slope = (signals[s] - previous[s]) / span
                    inputs[j] = factors[j] * (signals[s] + (time - newest + middle) * slope) + offsets[j]
                    derivatives[j] = factors[j] * slope
                status = _exchange(
                    set_real[i], (component, input_references[i], end - begin, input_addresses[i])
                )
                if status > _WARNING:
                    return k, row, _SET_REAL, (np.intp(i), status)
                if mode == _LINE:
                    status = _derive(
                        set_derivatives[i],
                        (
                            component,
                            input_references[i],
                            end - begin,
                            derivative_orders[i],
                            derivative_addresses[i],
                        ),
                    )
                    if status > _WARNING:
                        return k, row, _SET_DERIVATIVES, (np.intp(i), status)
                continue
            begin, end = output_begins[i], output_ends[i]
            for s in range(begin, end):  # see Exchange.shift
                previous[s] = signals[s]
            before[i] = at[i]
            at[i] = time + step
            if begin < end:
                status = _exchange(
                    get_real[i], (component, output_references[i], end - begin, output_addresses[i])
                )
                if status > _WARNING:
                    return k, row, _GET_REAL, (np.intp(i), status)
        for s in read:
            if not np.isfinite(signals[s]):
                return k, row, _NOT_FINITE, (0, 0)
        if _divides(every, k + 1):
            rows[row, 0] = next_time
            rows[row, 1:] = signals
            row += 1
    return first + count, row, _DONE, (0, 0)
