"""Run the steps of a whole simulation in stretches, with pauses for checkpoints, progress and real time."""

import math
import time
from collections.abc import Callable

from ..base.errors import CommandError
from .stepping.stepping_base import RowSink, Stepping

SHORTEST_WAIT = 1e-3
"""Wall time in s between two comparisons with the clock, unless steps are longer."""

_LARGEST_STRIDE = 2**31
"""Largest number of steps between two comparisons."""

_LONGEST_SLEEP = 0.1


class Pacing:
    """Wait until real time has reached the simulated time.

    A point that is reached too late is an overrun. No steps are skipped; later points catch up.

    Args:
        factor: Simulated seconds per second of real time.
    """

    def __init__(self, factor: float) -> None:
        if not 0.0 < factor < float("inf"):
            raise CommandError(f"the real-time factor {factor:g} must be a positive number.")
        self.factor = factor
        self.points = 0
        """Points compared so far."""
        self.overruns = 0
        """Points that were reached too late."""
        self.worst = 0.0
        """The longest delay of a point behind its time on the clock, in s."""
        self._start = (0.0, 0.0)

    def begin(self, simulated: float) -> None:
        """Start the clock now, at this simulated time in s."""
        self._start = (simulated, time.perf_counter())

    def report(self) -> dict[str, float]:
        """Return how well the run kept the pace, for metrics.json."""
        return {
            "factor": self.factor,
            "points": self.points,
            "overruns": self.overruns,
            "worst_delay_s": self.worst,
        }

    def steps(self, step: float) -> int:
        """Return the number of steps of this length in s between two comparisons with the clock."""
        return max(1, round(min(SHORTEST_WAIT * self.factor / step, _LARGEST_STRIDE)))

    def wait(self, simulated: float, interrupted: Callable[[], bool]) -> None:
        """Wait until the clock reaches this simulated time in s, or until `interrupted` returns true."""
        start, start_time = self._start
        due = start_time + (simulated - start) / self.factor
        delay = time.perf_counter() - due
        self.points += 1
        if delay > 0.0:
            self.overruns += 1
            self.worst = max(self.worst, delay)
        while (rest := due - time.perf_counter()) > 0.0 and not interrupted():
            # short naps, so that an interruption is noticed
            time.sleep(min(rest, _LONGEST_SLEEP))


STRETCH = 0.05
"""Target wall time of a stretch, in s; sets the number of steps in each. one of `LONGEST` is the limit."""

MOST_STEPS = 2**20
"""Largest number of steps in a stretch."""


def simulate(
    stepping: Stepping,
    rows: RowSink,
    interrupted: Callable[[], bool] = lambda: False,
    pacing: Pacing | None = None,
    between: Callable[[], None] = lambda: None,
    until: float = math.inf,
    longest: int = MOST_STEPS,
) -> None:
    """Step until a time, the end of the run, or an interruption.

    Args:
        stepping: What does the steps. Its present point must have been recorded already.
        rows: Takes the rows.
        interrupted: Return whether to stop.
        pacing: Holds the run back to a multiple of real time; None runs at full speed.
        between: Called after each stretch of steps.
        until: Time in s at which to stop.
        longest: Largest number of steps in a stretch; `interrupted` is called after each stretch.

    Raises:
        InstanceError: A call of an FMU failed.
        RunError: A step failed for another reason. Errors of `rows` are passed on, too.
    """
    most = 1
    while not (stepping.reached(until) or interrupted()):
        start_time, first_step = time.perf_counter(), stepping.steps
        count = most if pacing is None else min(most, pacing.steps(stepping.times.step))
        stepping.advance(rows, count, until)
        elapsed = time.perf_counter() - start_time
        # long stretches cost little, but checkpoints, progress and Ctrl-C wait for their ends
        if elapsed < 0.5 * STRETCH:
            most = min(2 * most, longest)
        elif elapsed > 2.0 * STRETCH:
            most = max(min(most, stepping.steps - first_step) // 2, 1)
        if pacing is not None:
            pacing.wait(stepping.time, interrupted)
        between()
