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
    short: float = 0.0

    def propose(self, remaining: float) -> float:
        """Return the next step in s, at most the remaining time, and stretched if it would leave a sliver."""
        step = min(self.step, self.largest)
        if step >= remaining * (1.0 - 1e-9):
            return remaining
        return 0.5 * remaining if 2.0 * step > remaining else step

    def judge(self, step: float, error: float, short_error: float | None = None) -> bool:
        """Return whether a step is accepted, by its error relative to the allowed one.

        The step after it may stay `short` if `short_error` is that of a step of this length.
        """
        short_error = error if short_error is None else short_error
        compared = error if step > self.short else short_error
        if not compared <= 1.0:  # NaN, too
            self.rejected += 1
            finite = compared < float("inf")
            self._shrink(step, SAFETY * compared ** -(1.0 / self.power) if finite else LARGEST_CUT)
            if step > self.short:
                self.step = max(self.step, min(SAFETY * step, self.short))
            return False
        error = max(error, 1e-10)
        growth = self._growth(error)
        if (
            step >= self.step
        ):  # else it was cut to end at a given point: its small error says nothing about the next step
            exponent = 1.0 / self.power
            growth = SAFETY * error ** (-0.7 * exponent) * self.last_error ** (0.4 * exponent)
            growth = min(LARGEST_GROWTH, max(LARGEST_CUT, growth))
            self.last_error = error
        at_least = min(self.short, step * self._growth(max(short_error, 1e-10)))
        proposed = max(step * growth, at_least, self.smallest)
        proposed = min(proposed, max(self.largest, step))
        # a step that was cut very short says little about the next one
        self.step = proposed if step >= 0.5 * self.step else max(proposed, self.step)
        self.accepted += 1
        return True

    def _growth(self, error: float) -> float:
        return min(LARGEST_GROWTH, max(LARGEST_CUT, SAFETY * error ** -(1.0 / self.power)))

    def discard(self, step: float) -> None:
        """Halve a step that an FMU discarded; RunError if the result is too small."""
        self.rejected += 1
        self._shrink(step, 0.5)

    def _shrink(self, step: float, factor: float) -> None:
        self.step = step * max(LARGEST_CUT, min(factor, SAFETY))
        if self.step < self.smallest:
            raise RunError(f"the error exceeds its tolerance even with a step of {step:.2g} s.")
