"""Run the compiled trials of `ErrorControl`: many trial steps per call."""

import ctypes
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import RunError
from ..algorithms.explicit import Explicit
from ..algorithms.scale import Scale
from ..algorithms.strong import Strong
from ..instances.fmu_instance import EntryPoints
from .compiled_functions import compiled_address
from .controlled_signals import ControlledSignals, TrialState
from .loop_errors import check_room, left_exception_error
from .record_layout import BLOCK, CONTROL, LOOP, Failure
from .records import (
    add_undo,
    group_records,
    input_records,
    instance_records,
    lane_records,
    observed_records,
    operation_records,
)

_CALL_NAMES = {
    Failure.SET_REAL: "setReal",
    Failure.SET_DERIVATIVES: "setRealInputDerivatives",
    Failure.GET_REAL: "getReal",
    Failure.GET_STATE: "getFMUstate",
    Failure.SET_STATE: "setFMUstate",
    Failure.OBSERVE: "getting recorded variables",
}


WATCHED = 500
"""Largest number of steps in a call if `Stepping.watch` gets each of them."""


@dataclass
class Trials:
    """What came out of a call.

    Attributes:
        tried: number of trials.
        met: whether the point is reached.
        crawls: whether many steps were short.
        recorded: number of filled rows.
        watched: time and signals of each accepted step, if they are watched.
        needs_python: whether Python must do the next trial.
        length: length of the last trial in s.
        failure: error of the last trial, or None.
    """

    tried: int
    met: bool
    crawls: bool
    recorded: int
    watched: Vector
    length: float
    needs_python: bool = False
    failure: RunError | None = None


class TrialKernel:
    """The compiled trials for one algorithm, after its `setup`."""

    def __init__(self, algorithm: Explicit | Strong, entry_points: Sequence[EntryPoints]) -> None:
        """Fill the records, and load the loop from the cache or compile it; ImportError without numba."""
        self._try_steps = _try_steps()
        self._algorithm = algorithm
        self._held: list[Any] = [entry_points]  # owners of memory whose addresses are in the records
        self._states = np.zeros(len(entry_points), dtype=np.uintp)
        """Addresses of the saved states of instances."""
        self._loop = self._whole(entry_points)
        self._lane_records = lane_records([[]], self._keep)
        self._loop["lanes"], self._loop["lane_count"] = self._lane_records.ctypes.data, 1
        self._instance_records["no_way_back"] = 0  # each step may be repeated
        self._control = np.zeros((), CONTROL)
        self._saved = np.zeros(len(entry_points), dtype=np.uintp)
        """Addresses of the states of the instances at the begin of a trial."""

    def prepare(
        self,
        signals: ControlledSignals,
        scale: Scale,
        tolerance: float,
        start: float,
        first_step: float,
        limits: Sequence[float],
    ) -> None:
        """Fill in what stays the same during a run.

        Args:
            signals: The controlled signals.
            scale: Sizes of the signals.
            tolerance: Allowed error.
            start: Start time in s.
            first_step: First trial step in s.
            limits: Steps in s, see `leap_limit` and the next fields in `CONTROL`.
        """
        keep, control, algorithm = self._keep, self._control, self._algorithm
        self._present = [algorithm.network.signals, *algorithm.kept.values()]
        self._copies = [np.empty_like(values) for values in self._present]
        pairs = zip(self._present, self._copies, strict=True)
        rows = [(values.ctypes.data, copy.ctypes.data, len(values)) for values, copy in pairs]
        blocks = keep(np.array(rows, dtype=BLOCK))
        control["blocks"], control["block_count"] = blocks.ctypes.data, len(blocks)
        control["instance_count"], control["states"] = len(self._saved), self._saved.ctypes.data
        control["power"] = _power()
        control["start"], control["first_step"], control["tolerance"] = start, first_step, tolerance
        for name, limit in zip(
            ("leap_limit", "unread_limit", "short_limit", "crawling_limit"), limits, strict=True
        ):
            control[name] = limit
        control["divisor"] = 2.0**algorithm.accuracy - 1.0
        count = len(signals.judged)
        control["count"] = count
        control["judged"] = keep(np.ascontiguousarray(signals.judged, dtype=np.intp)).ctypes.data
        control["total"] = keep(signals.total).ctypes.data
        self._flags: dict[str, Any] = {}
        for name in ("unread", "looked_at", "beside", "instant", "jumped", "jumps"):
            self._flags[name] = np.zeros(count, dtype=np.intp)
            control[name] = self._flags[name].ctypes.data
        self.use(signals)
        for name in ("whole", "errors", "judged_errors"):
            control[name] = keep(np.zeros(count)).ctypes.data
        self._rejected, self._last_rejected = np.zeros(count), np.zeros(count)
        control["rejected_errors"] = self._rejected.ctypes.data
        control["last_rejected_errors"] = self._last_rejected.ctypes.data
        control["largest_values"] = keep(scale.largest).ctypes.data
        control["floors"] = keep(scale.floor).ctypes.data
        self._watched = np.zeros((0, 1 + len(algorithm.network.signals)))

    def use(self, signals: ControlledSignals) -> None:
        """Use other flags of the same signals."""
        for name in ("unread", "looked_at", "beside", "instant"):
            self._flags[name][:] = getattr(signals, name)

    def try_steps(
        self,
        state: TrialState,
        per_unit: bool,
        target: tuple[float, bool, float],
        most: int,
        rows: Vector | None,
        watches: bool,
    ) -> Trials:
        """Try steps to a point of time, for a second of wall time at most.

        Args:
            state: Input and output.
            per_unit: Whether the error per unit step is controlled.
            target: Time to reach exactly, in s, whether it is an event, and a time in s at which to return.
            most: Largest number of trials.
            rows: Output: a row for each accepted step; None for no rows.
            watches: Whether to return time and signals of each accepted step.

        Raises:
            PythonExceptionError: An FMU left an exception of Python.
        """
        if rows is not None:
            check_room(self._algorithm.network, rows, 1)
        if watches and not len(self._watched):
            self._watched = np.zeros((WATCHED, self._watched.shape[1]))
        control, algorithm, sizes = self._control, self._algorithm, state.control
        control["records"], control["per_unit"] = rows is not None, per_unit
        control["exponent"], control["smallest"] = 1.0 / sizes.power, sizes.smallest
        control["largest"], control["step"], control["last_error"] = (
            sizes.largest,
            sizes.step,
            sizes.last_error,
        )
        control["accepted"], control["rejected"] = sizes.accepted, sizes.rejected
        control["short_steps"], control["time"] = state.short_steps, state.time
        control["point"], control["event"], control["enough"] = target
        control["watched_rows"] = self._watched.ctypes.data
        control["watch_room"] = len(self._watched) if watches else 0
        self._flags["jumped"][:] = state.jumped
        control["rejected_step"] = _put(state.rejected, self._rejected)
        control["last_rejected_step"] = _put(state.last_rejected, self._last_rejected)
        self._lane_records["sweeps"] = 0
        place, room = (0, 0) if rows is None else (rows.ctypes.data, len(rows))
        accepted = sizes.accepted
        self._lane_records["status"] = 0
        try:
            code = self._try_steps(self._loop.ctypes.data, control.ctypes.data, most, room, place)
        except SystemError as error:
            raise self._python_error(error, state.time, float(control["end"])) from error
        failure = Failure(code)
        if isinstance(algorithm, Strong):
            algorithm.sweeps_elsewhere += int(self._lane_records["sweeps"].sum())
        sizes.step, sizes.last_error = float(control["step"]), float(control["last_error"])
        sizes.accepted, sizes.rejected = int(control["accepted"]), int(control["rejected"])
        algorithm.steps += 2 * (sizes.accepted - accepted)
        state.time, state.short_steps = float(control["time"]), int(control["short_steps"])
        state.jumped = self._flags["jumped"] != 0
        state.rejected = _get(float(control["rejected_step"]), self._rejected)
        state.last_rejected = _get(float(control["last_rejected_step"]), self._last_rejected)
        return Trials(
            tried=int(control["tried"]),
            met=bool(control["met"]),
            crawls=bool(control["crawls"]),
            recorded=int(self._loop["recorded"]),
            watched=self._watched[: int(control["watched"])],
            length=float(control["length"]),
            needs_python=failure == Failure.NOT_IN_ONE,
            failure=self._trial_error(failure),
        )

    def restore(self) -> None:
        """Restore the state from the begin of the last trial; InstanceError if an FMU refuses it."""
        for instance, state in zip(self._algorithm.network.instances, self._saved, strict=True):
            instance.restore(ctypes.c_void_p(int(state)))
        for copy, present in zip(self._copies, self._present, strict=True):
            present[:] = copy

    def close(self) -> None:
        """Free saved states; never raises."""
        for states in (self._saved, self._states):
            for instance, state in zip(self._algorithm.network.instances, states, strict=True):
                if state:
                    instance.forget(ctypes.c_void_p(int(state)))
            states[:] = 0

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

    def _call_error(self, failure: Failure, time: float) -> RunError:
        """Return the error of a call that failed, in a step that begins at a time in s."""
        lane = self._lane_records[0]
        instance, status = self._algorithm.network.instances[int(lane["instance"])], int(lane["status"])
        call = f"doStep at t = {time:.9g} s" if failure == Failure.DO_STEP else _CALL_NAMES[failure]
        return instance.error(call, status)

    def _python_error(self, error: SystemError, begin: float, end: float) -> RunError:
        """Return the error for an exception of Python that an FMU left between two times in s."""
        lane, network = self._lane_records[0], self._algorithm.network
        failed = int(lane["instance"]), int(lane["status"])
        return left_exception_error(network, error, begin, end, *failed)

    def _trial_error(self, failure: Failure) -> RunError | None:
        if failure in (Failure.NONE, Failure.LATE, Failure.NOT_IN_ONE):
            return None
        if failure == Failure.NOT_FINITE:
            return self._algorithm.network.find_nonfinite_signal(float(self._control["end"]))
        return self._call_error(failure, float(self._control["began"]))


def _put(rejected: tuple[float, Vector] | None, errors: Vector) -> float:
    """Copy the errors of a rejected step, and return its length in s; NaN without one."""
    if rejected is None:
        return np.nan
    errors[:] = rejected[1]
    return rejected[0]


def _get(step: float, errors: Vector) -> tuple[float, Vector] | None:
    return None if np.isnan(step) else (step, errors.copy())


_ADDRESS, _NUMBER = ctypes.c_ssize_t, ctypes.c_int64


@cache
def _try_steps() -> Callable[..., int]:
    """Return the compiled trials as a function that releases the interpreter's lock."""
    prototype = ctypes.CFUNCTYPE(_NUMBER, _ADDRESS, _ADDRESS, _NUMBER, _NUMBER, _ADDRESS)
    return prototype(compiled_address("try_steps", "compiled_trials", ("error_control", "step_control")))


@cache
def _power() -> int:
    """Return the address of the C function `pow`, which Python uses too."""
    return c_address("ucrtbase" if os.name == "nt" else None, "pow")


@cache
def _seconds() -> int:
    """Return the address of the C function `time`: it takes far less time than finer clocks."""
    return c_address(*(("msvcrt", "_time64") if os.name == "nt" else (None, "time")))


def c_address(library: str | None, name: str) -> int:
    """Return the address of a C function of the system."""
    return ctypes.cast(getattr(ctypes.CDLL(library), name), ctypes.c_void_p).value or 0
