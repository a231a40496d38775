"""Steps of one length."""

import math
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.errors import CommandError
from ...sandbox.black_box import THREADS
from ..algorithms.algorithm import Algorithm
from ..algorithms.operation_table import OperationTableAlgorithm
from .compilation import make_loop
from .sharing import Sharing
from .stepping_base import LONGEST, ROUNDING, RowSink, Stepping
from .timing import CommunicationPoints

if TYPE_CHECKING:
    from .native_loop import NativeLoop
    from .switching_loop import SwitchingLoop


class FixedSteps(Stepping):
    """Steps from one communication point to the next, in C."""

    def __init__(self, algorithm: Algorithm, times: CommunicationPoints, threads: int | None = 1) -> None:
        """Prepare for a run.

        Args:
            algorithm: An algorithm after `setup`.
            times: The communication points.
            threads: Number of threads; None uses up to one per core if measurements show that this is faster.

        Raises:
            CommandError: The number of threads is not supported.
            RunError: The C code cannot be built on this machine.
        """
        super().__init__(algorithm, times)
        if threads is not None and not 1 <= threads <= THREADS:
            raise CommandError(f"the number of threads must be from 1 to {THREADS}, not {threads}.")
        assert isinstance(algorithm, OperationTableAlgorithm)
        self._kernel = make_loop(algorithm)
        self._sharing: Sharing | None = None
        if threads != 1 and self._kernel.can_share:
            self._sharing = Sharing(self._kernel, algorithm, threads)

    @property
    def time(self) -> float:
        """Present simulation time in s."""
        return self.times.point(self.algorithm.steps)

    @property
    def steps(self) -> int:
        """Steps done since the start time."""
        return self.algorithm.steps

    @property
    def finished(self) -> bool:
        """Whether the stop time is reached."""
        return self.algorithm.steps >= self.times.steps

    @property
    def seconds_beside(self) -> float:
        """Wall time in s that further threads took for steps."""
        return self._kernel.seconds_beside

    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        """Do at most `most` steps, none beyond `until` in s, and record them."""
        last = min(self.algorithm.steps + most, self._last(until))
        if self._sharing is None:
            self._advance_compiled(self._kernel, rows, last)
        else:
            while self._advance_measured(self._kernel, self._sharing, rows, last):
                pass

    def allow_way_back(self) -> None:
        """Tell FMUs in each step that a state from before it may be restored."""
        self._native.allow_way_back()

    def repeat_step(self, i: int, j: int, offset: float) -> None:
        """Do one step without recording it, with an offset to input j of instance i in its unit.

        Raises:
            RunError: The step failed.
        """
        network, first = self.algorithm.network, self.algorithm.steps
        nowhere = np.empty((0, 1 + len(network.signals) + len(network.observer.values)))
        self._native.offset_input(i, j, offset)
        try:
            _, failure = self._native.run(first, 1, self.times.clock, first + 2, nowhere)
        finally:
            self._native.offset_input(i, j, 0.0)
        if failure is not None:
            raise failure

    @property
    def _native(self) -> "NativeLoop":
        return self._kernel.native

    def reached(self, until: float) -> bool:
        """Whether no step is left before a time in s."""
        return self.algorithm.steps >= self._last(until)

    def report(self) -> dict[str, Any]:
        """Add the use of threads to the report."""
        found = super().report()
        found |= self._sharing.report() if self._sharing is not None else {"threads": 1}
        if reason := self._kernel.why_not_kept():
            found["compiled_code_not_kept"] = reason
        return found

    def close(self) -> None:
        """Free the saved states."""
        self._kernel.close()

    def _last(self, until: float) -> int:
        """Return the number of the last communication point up to a time in s, apart from rounding."""
        ahead = (min(until, self.times.stop) - self.times.start) / self.times.step
        return min(self.times.steps, math.floor(ahead + ROUNDING))

    def _advance_here(self, rows: RowSink, last: int) -> None:
        algorithm, times = self.algorithm, self.times
        ends = time.monotonic() + LONGEST
        for k in range(algorithm.steps, last):
            algorithm.step(times.point(k), times.span(k, 1), partial(times.stretch, k + 1))
            if (failure := algorithm.network.find_nonfinite_signal(times.point(k + 1))) is not None:
                algorithm.steps = k  # a failed step does not count, as in compiled code
                raise failure
            if (k + 1) % rows.every == 0:
                self.record(rows, algorithm.network.observer.is_due(k + 1))
            if time.monotonic() > ends:
                return

    def _advance_compiled(self, kernel: "SwitchingLoop", rows: RowSink, last: int) -> None:
        first, times, every = self.algorithm.steps, self.times, rows.every
        observer = self.algorithm.network.observer
        if observer.strings:  # compiled code cannot read texts
            last = min(last, observer.next_due(first))
        block = rows.room(max(last // every - first // every, 1))
        fitting = (first // every + len(block) + 1) * every - 1
        count = min(last, fitting) - first
        recorded, failure = kernel.run(first, count, times.clock, every, block)
        if recorded and failure is None and observer.is_due(self.algorithm.steps):
            observer.read()
            block[recorded - 1, -len(observer.values) :] = observer.values
        if recorded:
            rows.commit(recorded)
        if failure is not None:
            raise failure
        if kernel.needs_python:
            self._advance_here(rows, self.algorithm.steps + 1)

    def _advance_measured(self, kernel: "SwitchingLoop", sharing: Sharing, rows: RowSink, last: int) -> bool:
        """Do one measurement's steps. Return whether more steps remain, and room for their rows."""
        first = self.algorithm.steps
        if sharing.observing:
            with sharing.observed():
                self._advance_here(rows, first + 1)
            return first + 1 < last
        began, count = time.perf_counter(), sharing.next(last - first)
        self._advance_compiled(kernel, rows, first + count)
        sharing.did(self.algorithm.steps - first, time.perf_counter() - began)
        return first + count == self.algorithm.steps < last
