"""Step sizes chosen by the error: an object that proposes them, and accepts or rejects steps."""

import math
from dataclasses import dataclass

from ...base.errors import RunError

SAFETY = 0.9
LARGEST_GROWTH, LARGEST_CUT = 2.0, 0.2
"""Bounds of the ratio of a step to the one before.

The error of a step says what happened within it. Twice its length looks as far ahead as that; more
would be a guess, and passes over what begins there, such as a valve that opens after a rest.
"""


@dataclass
class StepControl:
    """A PI controller of the step size (Gustafsson).

    `error` in `judge` is relative to what is allowed: 1 is just acceptable. It goes with the power
    `power` of the step. No step is longer than `largest`. Times in s.

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
        """The next step, at most the time that remains; one that would leave a sliver is stretched."""
        step = min(self.step, self.largest)
        if step >= remaining * (1.0 - 1e-9):
            return remaining
        return 0.5 * remaining if 2.0 * step > remaining else step

    def judge(self, step: float, error: float) -> bool:
        """Whether a step with this error stands; sets the size of the next one, or of the next try.

        Raises RunError where the step would have to be smaller than the smallest.
        """
        exponent = 1.0 / self.power
        error = max(error, 1e-10)
        if not error <= 1.0:  # also where it is not a number
            self.rejected += 1
            self._shrink(step, SAFETY * error**-exponent if error < float("inf") else LARGEST_CUT)
            return False
        cut_short = step < self.step  # by a point to be met: its small error is no trend
        growth = SAFETY * error**-exponent
        if not cut_short:
            growth = SAFETY * error ** (-0.7 * exponent) * self.last_error ** (0.4 * exponent)
            self.last_error = error
        proposed = max(step * min(LARGEST_GROWTH, max(LARGEST_CUT, growth)), self.smallest)
        proposed = min(proposed, max(self.largest, step))
        # and one cut very short says little about how long the next may be
        self.step = proposed if step >= 0.5 * self.step else max(proposed, self.step)
        self.accepted += 1
        return True

    def discard(self, step: float) -> None:
        """The step could not be done: half of it is tried next; RunError where that is too small."""
        self.rejected += 1
        self._shrink(step, 0.5)

    def _shrink(self, step: float, factor: float) -> None:
        self.step = step * max(LARGEST_CUT, min(factor, SAFETY))
        if self.step < self.smallest:
            raise RunError(
                f"the error cannot be kept within its tolerance: even a step of {step:.2g} s is too long."
            )
