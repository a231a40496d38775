"""Propose step sizes, and accept or reject steps by their error: the oracle for `control.h`."""

import math
from dataclasses import dataclass

from emla_cosim.base.errors import RunError

SAFETY = 0.9
LARGEST_GROWTH, LARGEST_CUT = 2.0, 0.2


@dataclass
class StepControl:
    """The controller for a step whose error is proportional to a power of it; see `control.h`."""

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
        """Return whether a step is accepted, by its error relative to the allowed one."""
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
