"""Run the steps of a whole simulation in stretches, with pauses for checkpoints and progress."""

import math
import time
from collections.abc import Callable

from .stepping.pacing import Pacing
from .stepping.stepping_base import RowSink, Stepping

STRETCH = 0.05
"""Target wall time of a stretch, in s; sets the number of steps in each. `LONGEST` is the limit."""

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
        if elapsed < 0.5 * STRETCH:
            most = min(2 * most, longest)
        elif elapsed > 2.0 * STRETCH:
            most = max(min(most, stepping.steps - first_step) // 2, 1)
        if pacing is not None:
            pacing.wait(stepping.time, interrupted)
        between()
