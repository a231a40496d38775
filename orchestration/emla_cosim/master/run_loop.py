"""The loop over a whole run: stretches of steps, and what happens between them."""

import math
import time
from collections.abc import Callable

from .stepping.pacing import Pacing
from .stepping.stepping_base import RowSink, Stepping

STRETCH = 0.05
"""Wall time in s between two looks at the world outside; steps per stretch are chosen for it."""

MOST_STEPS = 2**20
"""Steps in a stretch, at the most."""


def simulate(
    stepping: Stepping,
    rows: RowSink,
    interrupted: Callable[[], bool] = lambda: False,
    pacing: Pacing | None = None,
    between: Callable[[], None] = lambda: None,
    until: float = math.inf,
) -> None:
    """Step until a time in s, the end, or until `interrupted` says so, calling `between` from time to time.

    The point where the stepping is at the call should have been recorded already. Raises
    InstanceError and RunError from the slaves, and what `rows` raises.
    """
    most = 1
    while not (stepping.reached(until) or interrupted()):
        began = time.perf_counter()
        count = most if pacing is None else min(most, pacing.steps(stepping.times.step))
        stepping.advance(rows, count, until)
        took = time.perf_counter() - began
        if took < 0.5 * STRETCH:
            most = min(2 * most, MOST_STEPS)
        elif took > 2.0 * STRETCH:
            most = max(most // 2, 1)
        if pacing is not None:
            pacing.wait(stepping.time, interrupted)
        between()
