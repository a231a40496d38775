"""Run the compiled stepping loops: many steps of an algorithm per call, in one thread or in several.

The loops (`loop.py` and `parallel_loop.py`) use the memory of the algorithm and its network, and call the
FMI functions of the instances by address.
"""

import ctypes
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import RunError
from ..algorithms.explicit import Explicit
from ..algorithms.strong import Strong
from ..algorithms.tasks import StepTask
from ..instances.fmu_instance import EntryPoints
from . import machine_code
from .compiled_functions import compiled_address
from .loop_errors import check_room, left_exception_error
from .record_layout import LOOP, NOWHERE, Failure
from .records import (
    add_undo,
    group_records,
    input_records,
    instance_records,
    lane_records,
    observed_records,
    operation_records,
    task_records,
)
from .timing import Clock

_CALL_NAMES = {
    Failure.SET_REAL: "setReal",
    Failure.SET_DERIVATIVES: "setRealInputDerivatives",
    Failure.GET_REAL: "getReal",
    Failure.GET_STATE: "getFMUstate",
    Failure.SET_STATE: "setFMUstate",
    Failure.OBSERVE: "getting recorded variables",
}


class Kernel:
    """The compiled loop for one algorithm, after its `setup`. It uses one thread until `share_out`."""

    can_share = True
    """Whether several threads can share the steps."""

    def __init__(self, algorithm: Explicit | Strong, entry_points: Sequence[EntryPoints]) -> None:
        """Fill the records, and load the loop from the cache or compile it.

        Args:
            algorithm: An algorithm after `setup`.
            entry_points: Addresses of the FMI functions, per instance.

        Raises:
            ImportError: The loop must be compiled, and numba is missing.
        """
        self._advance = _advance()
        self._algorithm = algorithm
        self._held: list[Any] = [entry_points]  # owners of memory whose addresses are in the records
        self._states = np.zeros(len(entry_points), dtype=np.uintp)
        """Addresses of the saved states of instances."""
        self._loop = self._whole(entry_points)
        self._threads: ThreadPoolExecutor | None = None
        self.together = False
        """Whether `run` uses all lanes, after `share_out` among several."""
        self.needs_python = False
        """Whether compiled code cannot do the step after `run`."""
        self.seconds_beside = 0.0
        """Wall time in s of all threads but the one that calls `run`."""
        self.share_out([], [[]])

    def share_out(self, work: Sequence[StepTask], lanes: Sequence[Sequence[int]]) -> None:
        """Share the steps among threads: one per lane, the first lane in the thread that calls `run`.

        Args:
            work: The tasks of a step.
            lanes: Places of the tasks of each lane. Each task is in one lane, after the tasks of this lane
                that it depends on. With one lane nothing is shared.

        Raises:
            RunError: The loop for several threads cannot be compiled.
        """
        if len(lanes) > 1:
            try:
                self._advance_lane, self._loop["give_way"] = _advance_lane(), _give_way()
            except (ImportError, OSError) as error:
                raise RunError(
                    f"the loop for several threads cannot be compiled: {error}. Set one thread."
                ) from error
        self._lane_records = lane_records(lanes, self._keep)
        self._task_records = task_records(work, lanes, self._keep)
        loop = self._loop
        loop["lanes"], loop["lane_count"] = self._lane_records.ctypes.data, len(lanes)
        loop["tasks"] = self._task_records.ctypes.data
        self._end_threads()
        self.together = len(lanes) > 1
        if self.together:
            self._threads = ThreadPoolExecutor(len(lanes) - 1, "lane")

    def _end_threads(self) -> None:
        if self._threads is not None:
            self._threads.shutdown()
            self._threads = None

    @property
    def threads(self) -> int:
        """Number of threads in `run`."""
        return len(self._lane_records) if self.together else 1

    def handover(self, steps: int = 1000) -> float:
        """Return the seconds that the lanes need to synchronize in an empty step. No state changes."""
        loop, lanes = self._loop, self._lane_records
        kept, checked = lanes["task_count"].copy(), int(loop["read_count"])
        lanes["task_count"], loop["read_count"], loop["clock"] = 0, 0, (0.0, 0.0, 1.0)
        try:
            began = time.perf_counter()
            self._run_threads(0, steps, steps + 1, 0)
            return (time.perf_counter() - began) / int(loop["reached"])
        finally:
            lanes["task_count"], loop["read_count"] = kept, checked

    def run(
        self, first: int, count: int, clock: Clock, every: int, rows: Vector
    ) -> tuple[int, RunError | None]:
        """Do steps, and record rows. They end after a second of wall time at the latest.

        If `needs_python` is true afterwards, do the next step with the algorithm in Python. The algorithm
        knows which groups have done that step already.

        Args:
            first: Number of the first step. Step k begins at point k of the clock.
            count: Number of steps.
            clock: The communication points.
            every: Every `every`-th point is recorded.
            rows: Output: time, all signals and all observed variables, shape (rows, values).

        Returns:
            The number of recorded rows, and the error in step `algorithm.steps`; None without one.

        Raises:
            PythonExceptionError: An FMU left an exception of Python. The rows of this call are lost, because
                nothing shows after which of its steps that happened.
        """
        check_room(self._algorithm.network, rows, (first + count) // every - first // every)
        loop, algorithm = self._loop, self._algorithm
        loop["clock"] = tuple(clock)
        steps = first, count, every, rows.ctypes.data
        self._lane_records["sweeps"] = 0
        self._lane_records["status"] = 0
        try:
            failure = Failure(self._run_threads(*steps) if self.together else self._run_single_thread(*steps))
        except SystemError as error:
            end = min(int(loop["reached"]) + 1, first + count)
            raise self._python_error(error, clock.point(first), clock.point(end)) from error
        reached = int(loop["reached"])
        algorithm.steps += reached - first
        if isinstance(algorithm, Strong):
            algorithm.sweeps_elsewhere += int(self._lane_records["sweeps"].sum())
            if failure == Failure.NOT_IN_ONE:
                algorithm.done = self._groups_done(reached)
        self.needs_python = failure == Failure.NOT_IN_ONE
        error = self._error(failure, reached, clock)
        return int(loop["recorded"]), error

    def _run_single_thread(self, first: int, count: int, every: int, rows: int) -> int:
        return self._advance(self._loop.ctypes.data, first, count, every, rows)

    def _run_threads(self, first: int, count: int, every: int, rows: int) -> int:
        """Run all lanes at once; RunError if the system provides too few threads."""
        assert self._threads is not None
        loop, lanes, work = self._loop, self._lane_records, self._task_records
        lanes["failed"], lanes["reached"] = NOWHERE, first
        work["through"], work["done"] = first, 0
        loop["recorded"], loop["released"], loop["failed"], loop["given_up"] = 0, first, NOWHERE, NOWHERE
        steps, others = (first, count, every, rows), list[Future[int]]()
        began = time.perf_counter()
        try:
            for n in range(1, len(lanes)):
                others.append(self._threads.submit(self._advance_lane, loop.ctypes.data, n, *steps))
            failure = self._advance_lane(loop.ctypes.data, 0, *steps)
        except RuntimeError as error:
            raise RunError(
                f"the system cannot start {len(lanes)} threads for FMUs: {error}. Set fewer threads."
            ) from error
        finally:
            loop["released"] = NOWHERE  # ends lanes that wait for a step that will not begin
            wait(others)
            self.seconds_beside += (time.perf_counter() - began) * len(others)
        for other in others:
            other.result()  # SystemError if an FMU left an exception in that thread
        return failure

    def _groups_done(self, reached: int) -> set[int]:
        """Return the groups that have done the step after the first `reached` steps."""
        if not self.together:
            return set(range(int(self._loop["group"])))
        done = self._task_records["done"][: int(self._loop["group_count"])]
        return set(np.flatnonzero(done == reached + 1).tolist())

    @staticmethod
    def why_not_kept() -> str:
        """Return why compiled code could not be cached; empty if it was cached, or nothing was compiled."""
        return machine_code.why_not_kept()

    def close(self) -> None:
        """Free saved states and end threads; never raises."""
        for instance, state in zip(self._algorithm.network.instances, self._states, strict=True):
            if state:
                instance.forget(ctypes.c_void_p(int(state)))
        self._states[:] = 0
        self._end_threads()

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
        instances = keep(instance_records(algorithm, points, inputs, self._states, saved))
        add_undo(instances, keep)
        self._instance_records = instances
        loop["groups"] = keep(group_records(algorithm, groups, scale, keep)).ctypes.data
        loop["group_count"] = len(groups)
        loop["operations"], loop["operation_count"] = operations.ctypes.data, len(operations)
        loop["instances"] = instances.ctypes.data
        loop["seconds"] = _seconds()
        loop["signals"], loop["signal_count"] = network.signals.ctypes.data, len(network.signals)
        observer = network.observer
        observed = keep(observed_records(network, keep))
        loop["observed"], loop["observed_count"] = observed.ctypes.data, len(observed)
        loop["others"], loop["other_count"] = observer.values.ctypes.data, len(observer.values)
        loop["read"], loop["read_count"] = network.read.ctypes.data, len(network.read)
        return loop

    def _error(self, failure: Failure, reached: int, clock: Clock) -> RunError | None:
        network, lane = self._algorithm.network, self._lane_records[int(self._loop["lane"])]
        if failure in (Failure.NONE, Failure.LATE, Failure.NOT_IN_ONE):
            return None
        if failure == Failure.NOT_FINITE:
            return network.find_nonfinite_signal(clock.point(reached + 1))
        multiple = int(self._algorithm.multiples[int(lane["instance"])])
        return self._call_error(failure, clock.point(reached + 1 - multiple))

    def _call_error(self, failure: Failure, time: float) -> RunError:
        """Return the error of a call that failed, in a step that begins at a time in s."""
        lane = self._lane_records[int(self._loop["lane"])]
        instance, status = self._algorithm.network.instances[int(lane["instance"])], int(lane["status"])
        call = f"doStep at t = {time:.9g} s" if failure == Failure.DO_STEP else _CALL_NAMES[failure]
        return instance.error(call, status)

    def _python_error(self, error: SystemError, begin: float, end: float) -> RunError:
        """Return the error for an exception of Python that an FMU left between two times in s."""
        thread = int(self._loop["lane"])
        lane, network = self._lane_records[thread], self._algorithm.network
        failed = int(lane["instance"]), int(lane["status"])
        return left_exception_error(network, error, begin, end, *failed, thread)


_ADDRESS, _NUMBER = ctypes.c_ssize_t, ctypes.c_int64


@cache
def _advance() -> Callable[..., int]:
    """Return the loop for one thread as a function that releases the interpreter's lock."""
    prototype = ctypes.CFUNCTYPE(_NUMBER, _ADDRESS, _NUMBER, _NUMBER, _NUMBER, _ADDRESS)
    return prototype(compiled_address("advance", "loop"))


@cache
def _advance_lane() -> Callable[..., int]:
    """Return the loop for several threads as a function that releases the interpreter's lock."""
    prototype = ctypes.CFUNCTYPE(_NUMBER, _ADDRESS, _NUMBER, _NUMBER, _NUMBER, _NUMBER, _ADDRESS)
    return prototype(compiled_address("advance_lane", "parallel_loop"))


@cache
def _give_way() -> int:
    """Return the address of the C function that lets other threads run."""
    library, name = ("kernel32", "SwitchToThread") if os.name == "nt" else (None, "sched_yield")
    return c_address(library, name)


@cache
def _seconds() -> int:
    """Return the address of the C function `time`: it takes far less time than finer clocks."""
    return c_address(*(("msvcrt", "_time64") if os.name == "nt" else (None, "time")))


def c_address(library: str | None, name: str) -> int:
    """Return the address of a C function of the system."""
    return ctypes.cast(getattr(ctypes.CDLL(library), name), ctypes.c_void_p).value or 0
