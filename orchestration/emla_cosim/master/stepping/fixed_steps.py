"""Steps of one length."""

import math
import time
from functools import partial
from typing import TYPE_CHECKING, Any

from ...base.errors import CommandError
from ...sandbox.crash_page import THREADS
from ..algorithms.algorithm import Algorithm
from ..algorithms.operation_table import OperationTableAlgorithm
from .compilation import BACKENDS, PYTHON, C, make_loop
from .sharing import Sharing
from .stepping_base import LONGEST, ROUNDING, RowSink, Stepping
from .timing import CommunicationPoints

if TYPE_CHECKING:
    from .kernel import Kernel
    from .switching_loop import SwitchingLoop


class FixedSteps(Stepping):
    """Steps from one communication point to the next, in Python or in compiled code.

    Compiled code needs FMUs in this process.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        times: CommunicationPoints,
        compiled: bool = True,
        threads: int | None = 1,
        backend: str = "",
    ) -> None:
        """Prepare for a run.

        Args:
            algorithm: An algorithm after `setup`.
            times: The communication points.
            compiled: Whether to compile the steps if possible.
            threads: Number of threads in compiled code; None uses up to one per core if measurements show
                that this is faster.
            backend: One of `BACKENDS`. Default: the first one that can do the steps.

        Raises:
            CommandError: The number of threads is not supported, or the backend cannot do the steps.
        """
        super().__init__(algorithm, times)
        if threads is not None and not 1 <= threads <= THREADS:
            raise CommandError(f"the number of threads must be from 1 to {THREADS}, not {threads}.")
        if backend not in ("", *BACKENDS):
            raise CommandError(f"there is no backend '{backend}'; choose from {', '.join(BACKENDS)}.")
        if backend == C and threads not in (None, 1):
            raise CommandError(f"the backend '{C}' steps in one thread, not in {threads}.")
        threads = 1 if backend == C else threads
        self._kernel = make_loop(algorithm, backend) if compiled else None
        if self._kernel is None and backend not in ("", PYTHON):
            raise CommandError(f"the backend '{backend}' cannot do these steps; leave it out.")
        self._sharing: Sharing | None = None
        if threads != 1 and self._kernel is not None and self._kernel.can_share:
            assert isinstance(algorithm, OperationTableAlgorithm)
            self._sharing = Sharing(self._kernel, algorithm, threads)

    @property
    def is_compiled(self) -> bool:
        """Whether compiled code does the steps."""
        return self._kernel is not None

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
        return 0.0 if self._kernel is None else self._kernel.seconds_beside

    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        """Do at most `most` steps, none beyond `until` in s, and record them."""
        last = min(self.algorithm.steps + most, self._last(until))
        if self._kernel is None:
            self._advance_here(rows, last)
        elif self._sharing is None:
            self._advance_compiled(self._kernel, rows, last)
        else:
            while self._advance_measured(self._kernel, self._sharing, rows, last):
                pass

    def reached(self, until: float) -> bool:
        """Whether no step is left before a time in s."""
        return self.algorithm.steps >= self._last(until)

    def report(self) -> dict[str, Any]:
        """Add whether compiled code did the steps, and the use of threads, to the report."""
        found = super().report()
        if isinstance(self.algorithm, OperationTableAlgorithm) and not self.algorithm.has_own_step:
            found["compiled"] = self.is_compiled
            found |= self._sharing.report() if self._sharing is not None else {"threads": 1}
        if self._kernel is not None and (reason := self._kernel.why_not_kept()):
            found["compiled_code_not_kept"] = reason
        return found

    def close(self) -> None:
        """Free the saved states."""
        if self._kernel is not None:
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

    def _advance_compiled(self, kernel: "Kernel | SwitchingLoop", rows: RowSink, last: int) -> None:
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

    def _advance_measured(
        self, kernel: "Kernel | SwitchingLoop", sharing: Sharing, rows: RowSink, last: int
    ) -> bool:
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
