"""Run the stepper in C: many steps of a program per call."""

import ctypes
import threading
from collections.abc import Sequence

import numpy as np

from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.instance import FINE
from ...fmu.python_exceptions import REMEDY, describe_left_exception, uses_python
from ...sandbox import black_box
from ...stepper.layout import Failure
from ...stepper.library import StepperLibrary
from ..algorithms.operation_table import OperationTableAlgorithm
from ..algorithms.quasi_newton import NoAgreementError
from ..instances.call_codes import decode_call
from ..instances.described_instance import DescribedInstance
from ..instances.fmu_instance import EntryPoints, PythonExceptionError
from .stepper_tables import StepperTables
from .timing import Clock

_MOST_NAMES = 4
"""Most names of components in a message."""

_CALL_NAMES = {
    Failure.SET: "setReal",
    Failure.DERIVATIVES: "setRealInputDerivatives",
    Failure.GET: "getReal",
    Failure.SAVE: "getFMUstate",
    Failure.RESTORE: "setFMUstate",
    Failure.OBSERVE: "getting recorded variables",
}

_ENDS = (Failure.NONE, Failure.LATE, Failure.INTERRUPTED)
"""What is no failure."""


class NativeLoop:
    """The stepper in C for one algorithm, after its `setup`.

    Args:
        algorithm: The algorithm.
        points: Addresses of the FMI functions, per instance.
        library: The functions in C.
    """

    def __init__(
        self, algorithm: OperationTableAlgorithm, points: Sequence[EntryPoints], library: StepperLibrary
    ) -> None:
        self._algorithm, self._library = algorithm, library
        self._tables = StepperTables(algorithm, points)
        self._stepper, self._stop = self._tables.stepper, ctypes.c_int32()
        self._stepper.stop = ctypes.addressof(self._stop)

    def why_not_kept(self) -> str:
        """Return why the stepper could not be kept in the cache; empty if it was."""
        return self._library.why_not_kept

    def run(
        self, first: int, count: int, clock: Clock, every: int, rows: Vector
    ) -> tuple[int, RunError | None]:
        """Do steps, and record rows. They end after a second of wall time, or with a signal such as Ctrl-C.

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
        self._check_room(rows, (first + count) // every - first // every)
        stepper, algorithm, library = self._stepper, self._algorithm, self._library
        stepper.clock[:] = clock
        self._stop.value = 0
        is_main = threading.current_thread() is threading.main_thread()
        if is_main:
            library.catch_interrupts(ctypes.addressof(self._stop))
        try:
            failure = library.run(ctypes.addressof(stepper), first, count, every, rows.ctypes.data)
        except SystemError as error:
            end = min(stepper.reached + 1, first + count)
            raise self._python_error(error, clock.point(first), clock.point(end)) from error
        finally:
            if is_main:
                library.release_interrupts()
        algorithm.steps += stepper.reached - first
        algorithm.sweeps_elsewhere += stepper.sweeps
        return int(stepper.recorded), self._error(Failure(failure), clock)

    def close(self) -> None:
        """Free saved states; never raises."""
        for instance, state in zip(self._algorithm.network.instances, self._tables.states, strict=True):
            if state:
                instance.forget(ctypes.c_void_p(int(state)))
        self._tables.states[:] = 0

    def _check_room(self, rows: Vector, needed: int) -> None:
        """Raise ValueError if the stepper would write past the end of the rows, or into gaps."""
        network = self._algorithm.network
        width = 1 + len(network.signals) + len(network.observer.values)
        fits = rows.ndim == 2 and len(rows) >= needed and rows.shape[1] == width
        if not fits or rows.dtype != np.float64 or not rows.flags.c_contiguous:
            raise ValueError(f"rows must have at least {needed} times {width} contiguous doubles")

    def _error(self, failure: Failure, clock: Clock) -> RunError | None:
        stepper, network = self._stepper, self._algorithm.network
        if failure in _ENDS:
            return None
        if failure == Failure.NOT_FINITE:
            return network.find_nonfinite_signal(clock.point(stepper.reached + 1))
        if failure == Failure.NO_AGREEMENT:
            group, n = self._algorithm.groups[stepper.group], stepper.group_sweeps
            gap = self._tables.residuals[stepper.group].reshape(-1, len(group.coupling_variables))[n - 1]
            error = group.failure_error(stepper.time, stepper.length, NoAgreementError(gap.copy(), n))
            assert isinstance(error, RunError)
            return error
        step = f"doStep at t = {stepper.time:.9g} s"
        call = step if failure == Failure.STEP else _CALL_NAMES[failure]
        return network.instances[stepper.instance].error(call, stepper.status)

    def _python_error(self, error: SystemError, begin: float, end: float) -> RunError:
        """Return the error for an exception of Python that an FMU left between two times in s.

        The exception hides what the stepper returned. If a call failed, the stepper still has its status.
        """
        left, activity, stepper = describe_left_exception(error), black_box.current_activity(), self._stepper
        instances = self._algorithm.network.instances
        if stepper.status not in FINE:
            instance, (_, call) = instances[stepper.instance], decode_call(activity)
            failed = str(instance.error(call, stepper.status))
            return RunError(
                f"{failed} A Python exception was left: {left}. {REMEDY}", component=instance.name
            )
        activity.recorded = 0
        named = [x for x in instances if isinstance(x, DescribedInstance) and uses_python(x.file.library)]
        names = [x.name for x in named or instances]
        return PythonExceptionError(
            " or ".join(names) if len(names) <= _MOST_NAMES else f"one of {len(names)} FMUs",
            f"a call between t = {begin:.9g} s and t = {end:.9g} s",
            left,
            [],
            "To find the call, run with `--no-kernel`.",
        )
