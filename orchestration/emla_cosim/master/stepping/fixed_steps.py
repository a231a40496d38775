"""Steps of one length."""

from functools import partial
from typing import TYPE_CHECKING

from ..algorithms.algorithm import Algorithm
from .compilation import compile_kernel
from .stepping import Rows, Stepping
from .timing import Timing

if TYPE_CHECKING:
    from .kernel import Kernel


class FixedSteps(Stepping):
    """Steps from one communication point to the next.

    Compiled where `compiled` is wanted and possible: an explicit algorithm on FMUs, with numba.
    """

    def __init__(self, algorithm: Algorithm, times: Timing, compiled: bool = True) -> None:
        super().__init__(algorithm, times)
        self._kernel = compile_kernel(algorithm) if compiled else None

    @property
    def compiled(self) -> bool:
        """Whether compiled code does the steps."""
        return self._kernel is not None

    @property
    def time(self) -> float:
        """Where the simulation is, in s."""
        return self.times.point(self.algorithm.steps)

    @property
    def steps(self) -> int:
        """Steps done since the start time."""
        return self.algorithm.steps

    @property
    def finished(self) -> bool:
        """Whether the stop time is reached."""
        return self.algorithm.steps >= self.times.steps

    def advance(self, rows: Rows, most: int) -> None:
        """Do at most so many steps and record them."""
        if self._kernel is None:
            self._advance_here(rows, most)
        else:
            self._advance_compiled(self._kernel, rows, most)

    def _advance_here(self, rows: Rows, most: int) -> None:
        algorithm, times = self.algorithm, self.times
        for k in range(algorithm.steps, min(algorithm.steps + most, times.steps)):
            algorithm.step(times.point(k), times.span(k, 1), partial(times.span, k))
            if (failure := algorithm.network.not_finite(times.point(k + 1))) is not None:
                algorithm.steps = k  # as in compiled code: the step does not count
                raise failure
            if (k + 1) % rows.every == 0:
                self.record(rows)

    def _advance_compiled(self, kernel: "Kernel", rows: Rows, most: int) -> None:
        first, times, every = self.algorithm.steps, self.times, rows.every
        last = min(first + most, times.steps)
        block = rows.room(max(last // every - first // every, 1))
        fitting = (first // every + len(block) + 1) * every - 1
        count = min(last, fitting) - first
        recorded, failure = kernel.run(first, count, times.clock, every, block)
        if recorded:
            rows.commit(recorded)
        if failure is not None:
            raise failure
