"""Run the stepper in C: many steps of a program per call."""

import ctypes
import math
import threading
import time
from collections.abc import Collection, Iterable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from ...base import crash_page
from ...base.arrays import Vector
from ...base.errors import RunError
from ...stepper.layout import DIVISION, Control, Failure, Halves, Stepper
from ...stepper.layout import Call as StepperCall
from ...stepper.library import StepperLibrary, address_of_clock
from ..algorithms.algorithm import Algorithm
from ..algorithms.program import Call, StepTask
from ..coupling.halved_program import HalvedProgram, halve
from ..instances.fmu_instance import EntryPoints
from ..instances.measured_calls import KINDS, Calls
from .lane_threads import LaneThreads
from .loop_errors import check_room, make_python_exception_error
from .saved_states import SavedStates
from .stepper_tables import StepperTables
from .timing import Clock

_CALL_NAMES = {
    Failure.SET: "setReal",
    Failure.DERIVATIVES: "setRealInputDerivatives",
    Failure.GET: "getReal",
    Failure.SAVE: "getFMUstate",
    Failure.RESTORE: "setFMUstate",
    Failure.OBSERVE: "getting recorded variables",
}

_PROGRAM_CALLS = {
    Failure.SET: Call.SET,
    Failure.DERIVATIVES: Call.SET,
    Failure.STEP: Call.STEP,
    Failure.GET: Call.GET,
}
"""The call of a program that failed; states and recorded variables have none."""

_NORMAL_ENDS = (Failure.NONE, Failure.LATE, Failure.INTERRUPTED)
"""Results that are not failures."""


class NativeLoop:
    """The stepper in C for one algorithm, after its `setup`.

    Args:
        algorithm: The algorithm.
        points: Addresses of the FMI functions, per instance.
        library: The functions in C.

    Attributes:
        is_shared: Whether `run` uses all threads, after `share_out` among several.
        extra_thread_seconds: Wall time in s that further threads took for steps.
        divisions: Steps that instances discarded and did in parts, as DIVISION records, shape (instances,).
    """

    def __init__(self, algorithm: Algorithm, points: Sequence[EntryPoints], library: StepperLibrary) -> None:
        self._algorithm, self._library = algorithm, library
        self._tables = StepperTables(algorithm, points)
        self._groups, self._halving = algorithm.groups, ()
        self._entry_points, self._calls = points, [p.calls for p in points]
        in_groups = [o for group in algorithm.groups for o in group.operations]
        order = [*in_groups, *algorithm.operations]
        self._call_order = {(o.call, o.instance): position for position, o in enumerate(order)}
        self._stepper, self._stop = self._tables.stepper, ctypes.c_int32()
        self._stepper.stop = ctypes.addressof(self._stop)
        self.divisions = np.zeros(len(points), DIVISION)
        # C takes the minimum
        self.divisions["shortest"] = np.inf
        self._stepper.divisions = self.divisions.ctypes.data
        self._lanes: LaneThreads | None = None
        self.is_shared, self.extra_thread_seconds = False, 0.0

    def why_not_kept(self) -> str:
        """Return why the stepper could not be kept in the cache; empty if it was."""
        return self._library.why_not_kept

    def run(
        self, first: int, count: int, clock: Clock, steps_per_row: int, rows: Vector
    ) -> tuple[int, RunError | None]:
        """Do steps, and record rows. They end after a second of wall time, or with a signal such as Ctrl-C.

        Args:
            first: Number of the first step. Step k begins at point k of the clock.
            count: Number of steps.
            clock: The communication points.
            steps_per_row: Every `steps_per_row`-th point is recorded.
            rows: Output: time, all signals and all observed variables, shape (rows, values).

        Returns:
            The number of recorded rows, and the error in step `algorithm.steps`, or None.

        Raises:
            PythonExceptionError: An FMU left an exception of Python. The rows of this call are lost, because
                nothing shows after which of its steps that happened.
        """
        check_room(self._algorithm.network, rows, (first + count) // steps_per_row - first // steps_per_row)
        stepper, algorithm = self._stepper, self._algorithm
        stepper.clock[:] = clock
        run_in_one_thread, start = partial(self._library.run, ctypes.addressof(stepper)), time.perf_counter()
        run = self._lanes.run if self._lanes is not None and self.is_shared else run_in_one_thread
        try:
            failure = self._call(run, first, count, steps_per_row, rows.ctypes.data)
        except SystemError as error:
            end = min(stepper.reached + 1, first + count)
            raise self._make_python_error(error, clock.point(first), clock.point(end)) from error
        self.extra_thread_seconds += (self.threads - 1) * (time.perf_counter() - start)
        algorithm.steps += stepper.reached - first
        return int(stepper.recorded), self._make_error(failure, clock.point(stepper.reached + 1))

    def tighten_coupling_tolerance(self, tolerance: float) -> None:
        """Let values that loops exchange agree to at least this fraction of each signal's size."""
        self._stepper.coupling_tolerance = min(self._stepper.coupling_tolerance, tolerance)

    def repeat(
        self, first: int, count: int, clock: Clock, program: HalvedProgram | None = None
    ) -> tuple[Vector, RunError | None]:
        """Do steps for an estimate: without recorded variables, threads and measurements.

        Args:
            first: Number of the first step.
            count: Number of steps.
            clock: The communication points.
            program: Operations of a step and their parts. Default: those of the algorithm.

        Returns:
            The signals after each step, shape (steps, signals), and the error that ended the steps early;
            None without one.

        Raises:
            RunError: Ctrl-C was pressed.
        """
        rows = np.empty((count, 1 + len(self._algorithm.network.signals)))
        saved_stepper, efforts = Stepper.from_buffer_copy(self._stepper), self.measured
        stepper, recorded, failure = self._stepper, 0, Failure.LATE
        stepper.observer_count = stepper.observed_count = 0
        # the last slot: it names calls in a crash, without counting rows of the run
        activity = crash_page.current_activity(crash_page.THREADS - 1)
        stepper.activity = ctypes.addressof(activity)
        stepper.clock[:] = clock
        halves, states = Halves(), None
        if program is not None:
            states = self._set_up_halved_steps(program, halves)
            run = partial(self._library.run_halves, ctypes.addressof(stepper), ctypes.addressof(halves))
        else:
            run = partial(self._library.run, ctypes.addressof(stepper))
        self.measure(())
        try:
            next_step = first
            while failure == Failure.LATE and next_step < first + count:
                address = rows.ctypes.data + recorded * rows.itemsize * rows.shape[1]
                arguments = (1, address) if program is None else (address,)  # each step has a row
                failure = self._call(run, next_step, first + count - next_step, *arguments)
                next_step, recorded = int(stepper.reached), recorded + int(stepper.recorded)
            if failure == Failure.INTERRUPTED:
                raise RunError("the estimate was interrupted.")
            return rows[:recorded, 1:], self._make_error(failure, clock.point(next_step + 1))
        finally:
            activity.code = 0
            if states is not None:
                states.free(self._algorithm.network.instances)
            self.measure(efforts)
            ctypes.memmove(ctypes.addressof(stepper), ctypes.addressof(saved_stepper), ctypes.sizeof(Stepper))

    def _set_up_halved_steps(self, program: HalvedProgram, halves: Halves) -> SavedStates:
        """Fill in how steps are done in halves, and return the places of states, which the caller frees."""
        stepper, network, states = self._stepper, self._algorithm.network, self.make_states()
        buffer = np.zeros(2 * (len(network.signals) + len(network.instances)))
        self._halving = groups, _ = np.concatenate([self._tables.groups, program.group_records]), buffer
        stepper.operations, stepper.operation_count = program.operations.ctypes.data, len(program.operations)
        stepper.groups, stepper.group_count = groups.ctypes.data, len(groups)
        halves.parts, halves.continuous = program.parts.ctypes.data, program.continuous.ctypes.data
        halves.states, halves.kept = states.records.ctypes.data, buffer.ctypes.data
        halves.continuous_count, halves.instance_count = len(program.continuous), len(network.instances)
        return states

    def halve(self, sampling: Collection[int]) -> HalvedProgram | None:
        """Return the program of the algorithm in halves; see `halved_program.halve`."""
        program = halve(self._algorithm, self._tables.operations, sampling)
        if program is not None:
            self._groups = [*self._algorithm.groups, *program.groups]
            program.group_records = self._tables.list_groups(program.groups)
        return program

    def control(self, control: Control, most: int, rows: Vector | None) -> tuple[Failure, RunError | None]:
        """Try steps under error control.

        Args:
            control: The record with the goal, the tolerances and the results.
            most: Largest number of trials.
            rows: Output: a row for each accepted step, as for `run`; None for no rows.

        Returns:
            Why it ended, and the error of the last trial; None without one.

        Raises:
            PythonExceptionError: As for `run`.
        """
        address, row_count = (None, 0) if rows is None else (rows.ctypes.data, len(rows))
        if rows is not None:
            check_room(self._algorithm.network, rows, 1)
        start_time, accepted = control.time, control.accepted
        try:
            addresses = ctypes.addressof(self._stepper), ctypes.addressof(control)
            failure = self._call(self._library.control, *addresses, most, row_count, address)
        except SystemError as error:
            raise self._make_python_error(error, start_time, control.end) from error
        # each accepted step consists of two halves
        self._algorithm.steps += 2 * (control.accepted - accepted)
        return failure, None if failure == Failure.TOO_SHORT else self._make_error(failure, control.end)

    def _call(self, function: Any, *arguments: Any) -> Failure:
        """Call a function of the stepper, which ends with a signal such as Ctrl-C."""
        self._stop.value = 0
        is_main = threading.current_thread() is threading.main_thread()
        if is_main:  # handlers of Python run in the main thread only
            self._library.catch_interrupts(ctypes.addressof(self._stop))
        try:
            return Failure(function(*arguments))
        finally:
            if is_main:
                self._library.release_interrupts()
            self._algorithm.sweeps += self._stepper.sweeps

    def _make_python_error(self, error: SystemError, begin: float, end: float) -> RunError:
        network, stepper = self._algorithm.network, self._stepper
        return make_python_exception_error(network, error, begin, end, stepper.instance, stepper.status)

    @property
    def threads(self) -> int:
        """Number of threads in `run`."""
        return len(self._lanes.lanes) if self.is_shared and self._lanes is not None else 1

    @property
    def why_one_thread(self) -> str:
        """Return why threads cannot share the steps; empty if they can."""
        if not self._algorithm.is_plain:
            return "the program of the algorithm combines vectors, or solves loops between other calls"
        if self._tables.passing is not None:
            return "Strings or Binary values are passed on in Python"
        if self._algorithm.split_steps:
            return "FMUs in other processes already step at the same time"
        return ""

    @cached_property
    def tasks(self) -> list[StepTask]:
        """The tasks of a step, one for each operation in C, if threads can share them."""
        return self._algorithm.tasks()

    @cached_property
    def first_lane_only(self) -> set[int]:
        """Instances that only the thread that calls `run` may call: others must not run at the same time."""
        instances = self._algorithm.network.instances
        return {
            i
            for i, (instance, calls) in enumerate(zip(instances, self._calls, strict=True))
            if calls is not None or not instance.runs_beside_others
        }

    def share_out(self, lanes: Sequence[Sequence[int]]) -> None:
        """Do the tasks of steps in threads from now on, one per lane of task numbers; see `LaneThreads`.

        Raises:
            RunError: The system provides too few threads.
        """
        if self._lanes is None or self._lanes.lanes != [list(lane) for lane in lanes]:
            self._end_lanes()
            if len(lanes) > 1:
                self._lanes = LaneThreads(self._library, self._stepper, self.tasks, lanes)
        self.is_shared = self._lanes is not None

    def _end_lanes(self) -> None:
        if self._lanes is not None:
            self._lanes.close()
        self._lanes, self.is_shared = None, False

    def measure(self, positions: Iterable[int]) -> None:
        """Measure the calls of the instances at these positions from now on, and of no others."""
        efforts, effort_addresses = self.efforts, self._tables.instances["effort"]
        efforts["now"] = address_of_clock(self._library)
        effort_addresses[:] = 0
        for i in positions:
            effort_addresses[i] = efforts.ctypes.data + i * efforts.itemsize

    @property
    def measured(self) -> list[int]:
        """Positions of the instances that are measured."""
        return np.flatnonzero(self._tables.instances["effort"]).tolist()

    @property
    def efforts(self) -> Any:
        """The calls so far while they were measured, as EFFORT records, shape (instances,)."""
        return self._tables.efforts

    def start_profile(self) -> None:
        """Measure from now on the calls of all instances but those whose methods Python calls."""
        self.efforts["counts"] = self.efforts["nanoseconds"] = 0
        self.measure(i for i, calls in enumerate(self._calls) if calls is None)

    def profile(self) -> list[dict[str, Calls]]:
        """Return these calls by what they do, per instance."""
        return [
            {
                kind: Calls(int(count), 1e-9 * float(nanoseconds))
                for kind, count, nanoseconds in zip(
                    KINDS, effort["counts"], effort["nanoseconds"], strict=True
                )
                if calls is None
            }
            for effort, calls in zip(self.efforts, self._calls, strict=True)
        ]

    def allow_way_back(self) -> None:
        """Tell FMUs in each step that a state from before it may be restored."""
        self._tables.instances["has_no_way_back"] = 0

    def divide_steps(self, i: int) -> bool:
        """Let instance i do the steps that it discards in parts; return False if a group steps it."""
        operations = self._tables.operations
        for call, divided in {
            StepperCall.STEP: StepperCall.DIVIDE,
            StepperCall.END: StepperCall.END_DIVIDED,
        }.items():
            operations["call"][(operations["call"] == call) & (operations["target"] == i)] = divided
        return bool(((operations["call"] == StepperCall.DIVIDE) & (operations["target"] == i)).any())

    def offset_input(self, i: int, j: int, offset: float) -> None:
        """Add an offset to input j of instance i from now on, in its unit, instead of an earlier one."""
        network = self._algorithm.network
        index = network.input_parts[i].start + j
        self._tables.inputs["offset"][index] = network.offsets[i][j] + offset

    @property
    def failed_instance(self) -> int:
        """Position of the instance whose call failed last."""
        return int(self._stepper.instance)

    @property
    def failed_length(self) -> float:
        """Length in s of the step that failed last, which may be a part of one."""
        return float(self._stepper.length)

    @property
    def recorded(self) -> int:
        """Number of rows of the last call."""
        return int(self._stepper.recorded)

    def close(self) -> None:
        """Free saved states and end threads; never raises."""
        self._end_lanes()
        self._tables.states.free(self._algorithm.network.instances)

    def make_states(self) -> SavedStates:
        """Return further places for states that C saves; the caller frees the states."""
        return SavedStates(self._entry_points)

    def _make_error(self, failure: Failure, end: float) -> RunError | None:
        """Return the error of a run whose last step ends at `end` s, or raise any other exception."""
        if failure in _NORMAL_ENDS:
            return None
        error = self._find_python_error(failure) or self._make_failure_error(failure, end)
        if error is not None and not isinstance(error, RunError):
            raise error
        return error

    def _find_python_error(self, failure: Failure) -> BaseException | None:
        """Wait for steps under way, and return the first exception in the order of the program, or None."""
        failed, instances = self._stepper.instance, self._algorithm.network.instances
        error, first_order = None, math.inf
        if failure == Failure.STEP and failed == len(instances):
            assert self._tables.passing is not None
            return self._tables.passing.error
        if failure == Failure.STEP or failure in _CALL_NAMES:
            calls = self._calls[failed]
            error = None if calls is None else calls.error
        if failure in _PROGRAM_CALLS:
            first_order = self._call_order[_PROGRAM_CALLS[failure], failed]
        for i, instance in enumerate(instances):
            try:
                if instance.is_under_way:
                    instance.end_step()
            except RunError as step_error:
                if (call_order := self._call_order[Call.STEP, i]) < first_order:
                    error, first_order = step_error, call_order
        return error

    def _make_failure_error(self, failure: Failure, end: float) -> RunError | None:
        """Return the error of a failed call, of a signal that is not finite, or of a loop."""
        stepper, network = self._stepper, self._algorithm.network
        if failure == Failure.NOT_FINITE:
            return network.find_nonfinite_signal(end)
        if failure == Failure.NO_AGREEMENT:
            group, n = self._groups[stepper.group], stepper.group_sweeps
            gap = self._tables.residuals[stepper.group].reshape(-1, len(group.coupling_variables))[n - 1]
            return group.make_disagreement_error(stepper.time, stepper.length, gap, n)
        step = f"doStep at t = {stepper.time:.9g} s"
        call = step if failure == Failure.STEP else _CALL_NAMES[failure]
        return network.instances[stepper.instance].error(call, stepper.status)
