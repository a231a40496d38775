"""The compiled stepping loop: many steps of an explicit algorithm per call.

It works on the memory of the algorithm and its network, and calls the FMI functions of the slaves by
address. `loop.py` says what it does.
"""

import ctypes
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ... import black_box
from ...arrays import Vector
from ...errors import RunError
from ..algorithms import extrapolation, sampling
from ..algorithms.explicit import Explicit
from ..algorithms.sampling import Call, Operation
from ..slaves.calls import code_of
from ..slaves.slave import EntryPoints
from . import layout, machine_code
from .layout import INPUT, LOOP, OPERATION, SLAVE, Failure
from .timing import Clock

_CALL_NAMES = {
    Failure.SET_REAL: "setReal",
    Failure.SET_DERIVATIVES: "setRealInputDerivatives",
    Failure.GET_REAL: "getReal",
}


class Kernel:
    """The compiled loop for one algorithm, set up and initialized or not."""

    def __init__(self, algorithm: Explicit, entry_points: Sequence[EntryPoints]) -> None:
        """Collect the records; compiles the loop, or loads what an earlier process compiled.

        Raises ImportError where the loop has to be compiled and numba is not there.
        """
        self._advance = _advance()
        self._algorithm = algorithm
        self._entry_points = entry_points  # owns arrays whose addresses are in the records
        self._present = black_box.present()
        self._operations = np.array(
            [(o.call, o.slave, _code(o)) for o in algorithm.operations], dtype=OPERATION
        )
        self._inputs = _inputs(algorithm)
        self._slaves = _slaves(algorithm, entry_points, self._inputs)
        self._loop = self._whole()

    def run(
        self, first: int, count: int, clock: Clock, every: int, rows: Vector
    ) -> tuple[int, RunError | None]:
        """Do `count` steps from the one numbered `first`.

        The step k begins at the point k of the clock; each `every`-th point fills the next of
        `rows`, time first. Returns how many rows were recorded, and what ended the run in step
        `algorithm.steps`, if anything did.
        """
        self._check_room(rows, (first + count) // every - first // every)
        loop = self._loop
        loop["clock"] = tuple(clock)
        failure = Failure(self._advance(loop.ctypes.data, first, count, every, rows.ctypes.data))
        reached = int(loop["reached"])
        self._algorithm.steps += reached - first
        error = self._error(failure, reached, clock)
        return int(loop["recorded"]), error

    @staticmethod
    def why_not_kept() -> str:
        """Why this process had to compile and could not keep the code; empty if it could."""
        return machine_code.why_not_kept()

    def _check_room(self, rows: Vector, needed: int) -> None:
        """Raise ValueError where the loop would write past the end of the rows, or into gaps."""
        width = 1 + len(self._algorithm.network.signals)
        fits = rows.ndim == 2 and len(rows) >= needed and rows.shape[1] == width
        if not fits or rows.dtype != np.float64 or not rows.flags.c_contiguous:
            raise ValueError(f"the rows have to be {needed} times {width} doubles without gaps")

    def _whole(self) -> Any:
        network, loop = self._algorithm.network, np.zeros((), LOOP)
        loop["operations"], loop["operation_count"] = self._operations.ctypes.data, len(self._operations)
        loop["slaves"] = self._slaves.ctypes.data
        loop["signals"], loop["signal_count"] = network.signals.ctypes.data, len(network.signals)
        loop["read"], loop["read_count"] = network.read.ctypes.data, len(network.read)
        loop["present"] = ctypes.addressof(self._present)
        return loop

    def _error(self, failure: Failure, reached: int, clock: Clock) -> RunError | None:
        network, i = self._algorithm.network, int(self._loop["slave"])
        if failure == Failure.NONE:
            return None
        if failure == Failure.NOT_FINITE:
            return network.not_finite(clock.point(reached + 1))
        slave, status = network.slaves[i], int(self._loop["status"])
        time = clock.point(reached + 1 - int(self._algorithm.multiples[i]))
        call = f"doStep at t = {time:.9g} s" if failure == Failure.DO_STEP else _CALL_NAMES[failure]
        return slave.error(call, status)


@cache
def _advance() -> Any:
    """The loop as a function that releases the interpreter's lock."""

    def generate() -> str:
        from .loop import text

        return text()

    modules = (layout, sampling, extrapolation, black_box)
    files = [Path(str(m.__file__)) for m in modules] + [Path(__file__).with_name("loop.py")]
    address = machine_code.load("advance", b"".join(f.read_bytes() for f in files), generate)
    address_type, number = ctypes.c_ssize_t, ctypes.c_int64
    return ctypes.CFUNCTYPE(number, address_type, number, number, number, address_type)(address)


def _code(operation: Operation) -> int:
    call = {Call.SET: "setReal", Call.STEP: "doStep", Call.GET: "getReal"}[operation.call]
    return code_of(operation.slave, call)


def _inputs(algorithm: Explicit) -> Any:
    """INPUT records of all inputs, slave by slave."""
    network, exchange, history = algorithm.network, algorithm.exchange, algorithm.exchange.history
    sources = np.concatenate([np.empty(0, dtype=np.intp), *network.sources])
    movable = np.concatenate([np.empty(0, dtype=bool), *(s.continuous_inputs for s in network.slaves)])
    owners = exchange.owners[sources]
    records = np.zeros(len(sources), INPUT)
    records["signal"] = _addresses(network.signals, sources)
    records["previous"] = _addresses(history.previous, sources)
    records["at"] = _addresses(history.at, owners)
    records["before"] = _addresses(history.before, owners)
    every = np.arange(len(sources))
    records["taken"], records["taken_at"] = (
        _addresses(history.taken, every),
        _addresses(history.taken_at, every),
    )
    records["factor"] = np.concatenate([np.empty(0), *network.factors])
    records["offset"] = np.concatenate([np.empty(0), *network.offsets])
    records["moves"] = movable & exchange.smooth[sources]
    return records


def _slaves(algorithm: Explicit, points: Sequence[EntryPoints], sources: Any) -> Any:
    """SLAVE records; `sources` are the records of their inputs."""
    network, exchange, history = algorithm.network, algorithm.exchange, algorithm.exchange.history
    every = np.arange(len(points))
    first_inputs = np.array([part.start for part in network.input_parts], dtype=np.intp)
    first_outputs = np.array([part.start for part in network.parts], dtype=np.intp)
    records = np.zeros(len(points), SLAVE)
    for name in ("component", "set_real", "set_real_input_derivatives", "do_step", "get_real"):
        records[name] = [getattr(p, name) for p in points]
    for name in ("input_references", "derivative_orders", "output_references"):
        records[name] = [getattr(p, name).ctypes.data for p in points]
    records["input_count"] = [len(s.inputs) for s in network.slaves]
    records["output_count"] = [len(s.outputs) for s in network.slaves]
    records["sources"] = _addresses(sources, first_inputs)
    records["inputs"] = _addresses(network.inputs, first_inputs)
    records["derivatives"] = _addresses(exchange.derivatives, first_inputs)
    records["outputs"] = _addresses(network.signals, first_outputs)
    records["previous"] = _addresses(history.previous, first_outputs)
    records["at"], records["before"] = _addresses(history.at, every), _addresses(history.before, every)
    records["multiple"], records["mode"] = algorithm.multiples, exchange.modes
    return records


def _addresses(values: Any, positions: Any) -> Any:
    """Where the elements at these positions are in memory."""
    return values.ctypes.data + values.itemsize * positions
