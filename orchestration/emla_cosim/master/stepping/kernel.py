"""The compiled stepping loop: many steps of an algorithm per call.

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
from ..algorithms import extrapolation, quasi_newton, sampling, strong
from ..algorithms.explicit import Explicit
from ..algorithms.strong import Strong
from ..slaves import calls
from ..slaves.slave import EntryPoints
from . import layout, machine_code
from .layout import LOOP, Failure
from .records import add_undo, group_records, input_records, operation_records, slave_records
from .timing import Clock

_CALL_NAMES = {
    Failure.SET_REAL: "setReal",
    Failure.SET_DERIVATIVES: "setRealInputDerivatives",
    Failure.GET_REAL: "getReal",
    Failure.GET_STATE: "getFMUstate",
    Failure.SET_STATE: "setFMUstate",
}
_TEXTS = ("loop.py", "by_address.py", "compiled_calls.py", "compiled_groups.py")
"""Modules that are compiled, and imported only then."""


class Kernel:
    """The compiled loop for one algorithm, set up and initialized or not."""

    def __init__(self, algorithm: Explicit | Strong, entry_points: Sequence[EntryPoints]) -> None:
        """Collect the records; compiles the loop, or loads what an earlier process compiled.

        Raises ImportError where the loop has to be compiled and numba is not there.
        """
        self._advance = _advance()
        self._algorithm = algorithm
        self._present = black_box.present()
        self._held: list[Any] = [entry_points]  # owners of memory whose addresses are in the records
        self._states = np.zeros(len(entry_points), dtype=np.uintp)
        """Addresses of the saved states of slaves."""
        self._loop = self._whole(entry_points)

    def run(
        self, first: int, count: int, clock: Clock, every: int, rows: Vector
    ) -> tuple[int, RunError | None]:
        """Do `count` steps from the one numbered `first`.

        The step k begins at the point k of the clock; each `every`-th point fills the next of
        `rows`, time first. Returns how many rows were recorded, and what ended the run in step
        `algorithm.steps`, if anything did. Where nothing did, and less than all steps are done, the
        algorithm in Python is to do the next one: it knows how much of it is done.
        """
        self._check_room(rows, (first + count) // every - first // every)
        loop = self._loop
        loop["clock"] = tuple(clock)
        failure = Failure(self._advance(loop.ctypes.data, first, count, every, rows.ctypes.data))
        reached = int(loop["reached"])
        self._algorithm.steps += reached - first
        if isinstance(self._algorithm, Strong):
            self._algorithm.sweeps += int(loop["sweeps"])
            if failure == Failure.NOT_IN_ONE:
                self._algorithm.begun = int(loop["group"])
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

    def close(self) -> None:
        """Free the saved states; never raises."""
        for slave, state in zip(self._algorithm.network.slaves, self._states, strict=True):
            if state:
                slave.forget(ctypes.c_void_p(int(state)))
        self._states[:] = 0

    def _keep(self, values: Any) -> Any:
        self._held.append(values)
        return values

    def _whole(self, points: Sequence[EntryPoints]) -> Any:
        algorithm, network, loop, keep = (
            self._algorithm,
            self._algorithm.network,
            np.zeros((), LOOP),
            self._keep,
        )
        operations, inputs = keep(operation_records(algorithm)), keep(input_records(algorithm))
        groups, scale = [], None
        if isinstance(algorithm, Strong):
            groups, scale = algorithm.groups, algorithm.scale
            loop["tolerance"], loop["largest"] = algorithm.coupling_tolerance, scale.largest.ctypes.data
        saved = {i for group in groups if group.start is not None for i in group.members}
        slaves = keep(slave_records(algorithm, points, inputs, self._states, saved))
        add_undo(slaves, keep)
        loop["groups"] = keep(group_records(algorithm, groups, scale, keep)).ctypes.data
        loop["group_count"] = len(groups)
        loop["operations"], loop["operation_count"] = operations.ctypes.data, len(operations)
        loop["slaves"] = slaves.ctypes.data
        loop["signals"], loop["signal_count"] = network.signals.ctypes.data, len(network.signals)
        loop["read"], loop["read_count"] = network.read.ctypes.data, len(network.read)
        loop["present"] = ctypes.addressof(self._present)
        return loop

    def _error(self, failure: Failure, reached: int, clock: Clock) -> RunError | None:
        network, i = self._algorithm.network, int(self._loop["slave"])
        if failure in (Failure.NONE, Failure.NOT_IN_ONE):
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

    modules = (layout, calls, sampling, strong, quasi_newton, extrapolation, black_box)
    files = [Path(str(m.__file__)) for m in modules] + [Path(__file__).with_name(name) for name in _TEXTS]
    address = machine_code.load("advance", b"".join(f.read_bytes() for f in files), generate)
    address_type, number = ctypes.c_ssize_t, ctypes.c_int64
    return ctypes.CFUNCTYPE(number, address_type, number, number, number, address_type)(address)
