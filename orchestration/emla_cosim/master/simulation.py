"""The loop over a whole run: stretches of steps, and what happens between them."""

import time
from collections.abc import Callable

from .algorithms.algorithm import Algorithm
from .algorithms.gauss_seidel import GaussSeidel
from .algorithms.jacobi import Jacobi
from .algorithms.strong import Strong
from .stepping.pacing import Pacing
from .stepping.stepping import Rows, Stepping

ALGORITHMS: dict[str, type[Algorithm]] = {"jacobi": Jacobi, "gauss-seidel": GaussSeidel, "strong": Strong}
"""Algorithms by name."""

STRETCH = 0.05
"""Wall time in s between two looks at the world outside; steps per stretch are chosen for it."""

MOST_STEPS = 2**20
"""Steps in a stretch, at the most."""


def simulate(
    stepping: Stepping,
    rows: Rows,
    interrupted: Callable[[], bool] = lambda: False,
    pacing: Pacing | None = None,
    between: Callable[[], None] = lambda: None,
) -> None:
    """Step to the end, or until `interrupted` says so, calling `between` from time to time.

    The point where the stepping is at the call should have been recorded already. Raises
    SlaveError and RunError from the slaves, and OSError from `rows`.
    """
    most = 1
    while not (stepping.finished or interrupted()):
        began = time.perf_counter()
        stepping.advance(rows, most if pacing is None else min(most, pacing.steps(stepping.times.step)))
        took = time.perf_counter() - began
        if took < 0.5 * STRETCH:
            most = min(2 * most, MOST_STEPS)
        elif took > 2.0 * STRETCH:
            most = max(most // 2, 1)
        if pacing is not None:
            pacing.wait(stepping.time, interrupted)
        between()
