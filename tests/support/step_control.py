"""Propose step sizes, and accept or reject steps by their error: the oracle for `control.h`."""

import math
from dataclasses import dataclass

from emla_cosim.base.errors import RunError

SAFETY = 0.9
LARGEST_GROWTH, LARGEST_CUT = 2.0, 0.2
"""Bounds of the ratio of a step to the previous one.

The error of a step describes what happened within it. A step of twice the length looks just as far ahead.
A longer one could pass over something that begins there, such as a valve that opens after a rest.
"""


@dataclass
class StepControl:
    """A PI controller of the step size (Gustafsson).

    Args:
        step: The next step in s.
        power: The error is proportional to this power of the step.
        smallest: Smallest step in s.
        largest: Longest step in s.
        accepted: Number of accepted steps.
        rejected: Number of rejected steps.
        last_error: Error of the last step, relative to the allowed error.

    K. Gustafsson: Control theoretic techniques for stepsize selection in explicit Runge-Kutta
    methods, ACM Trans. Math. Softw. 17 (1991), doi:10.1145/210232.210242.
    """

    step: float
    power: int
    smallest: float
    largest: float = math.inf
    accepted: int = 0
    rejected: int = 0
    last_error: float = 1.0

    def propose(self, remaining: float) -> float:
        """Return the next step in s, at most the remaining time, and stretched if it would leave a sliver."""
        step = min(self.step, self.largest)
        if step >= remaining * (1.0 - 1e-9):
            return remaining
        return 0.5 * remaining if 2.0 * step > remaining else step

    def judge(self, step: float, error: float) -> bool:
        """Return whether to accept a step, and set the size of the next trial.

        Args:
            step: Length of the step in s.
            error: Error relative to the allowed error: up to 1 is accepted.

        Raises:
            RunError: The next trial would be smaller than the smallest step.
        """
        exponent = 1.0 / self.power
        error = max(error, 1e-10)
        if not error <= 1.0:  # NaN, too
            self.rejected += 1
            self._shrink(step, SAFETY * error**-exponent if error < float("inf") else LARGEST_CUT)
            return False
        cut_short = step < self.step  # to end at a given point: its small error is no trend
        growth = SAFETY * error**-exponent
        if not cut_short:
            growth = SAFETY * error ** (-0.7 * exponent) * self.last_error ** (0.4 * exponent)
            self.last_error = error
        proposed = max(step * min(LARGEST_GROWTH, max(LARGEST_CUT, growth)), self.smallest)
        proposed = min(proposed, max(self.largest, step))
        # a step that was cut very short says little about the next one
        self.step = proposed if step >= 0.5 * self.step else max(proposed, self.step)
        self.accepted += 1
        return True

    def discard(self, step: float) -> None:
        """Halve a step that an FMU discarded; RunError if the result is too small."""
        self.rejected += 1
        self._shrink(step, 0.5)

    def _shrink(self, step: float, factor: float) -> None:
        self.step = step * max(LARGEST_CUT, min(factor, SAFETY))
        if self.step < self.smallest:
            raise RunError(f"the error exceeds its tolerance even with a step of {step:.2g} s.")
