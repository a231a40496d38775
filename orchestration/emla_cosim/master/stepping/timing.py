"""Compute the communication points of a run."""

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

from ...base.errors import CommandError

MAXIMUM_STEPS = 10**10

_COARSE = 1e-2
"""Largest spacing of doubles at the run's times, as a fraction of a step."""

_LARGEST = 2**53
"""Doubles represent every integer up to here."""


class Clock(NamedTuple):
    """Points in time at equal distances: (first + k * per_step) / denominator, in s.

    With integers only the division rounds, so a point is the double nearest to the true time.
    """

    first: float
    per_step: float
    denominator: float

    def point(self, k: int) -> float:
        """Return point k in s, computed without summation."""
        return (self.first + k * self.per_step) / self.denominator


def make_clock(start: float, step: float) -> Clock:
    """Return the points `start + k * step` for k up to `MAXIMUM_STEPS`, in s.

    `start` and `step` represent the shortest decimal numbers that give these doubles: 1e-4 is exactly one
    ten-thousandth, although no double is. Numbers without a short decimal form, such as 1/3, represent
    themselves. The points do not depend on the length of the run, so you can continue it later.
    """
    origin, distance = Fraction(repr(float(start))), Fraction(repr(float(step)))
    denominator = math.lcm(origin.denominator, distance.denominator)
    first, per_step = int(origin * denominator), int(distance * denominator)
    if max(denominator, abs(first) + MAXIMUM_STEPS * per_step) > _LARGEST:
        return Clock(float(start), float(step), 1.0)
    return Clock(float(first), float(per_step), float(denominator))


@dataclass(frozen=True)
class CommunicationPoints:
    """Communication points `start + k * step` for k = 0 ... steps, in s; see `clock`."""

    start: float
    step: float
    steps: int

    @cached_property
    def clock(self) -> Clock:
        """Communication points, also beyond the last one."""
        return make_clock(self.start, self.step)

    @property
    def stop(self) -> float:
        """Last communication point in s."""
        return self.point(self.steps)

    def point(self, k: int) -> float:
        """Return communication point k in s."""
        return self.clock.point(k)


def make_communication_points(
    stop_time: float, step_size: float, start_time: float = 0.0
) -> CommunicationPoints:
    """Return the communication points from start to stop; times in s.

    If both are equal, there is one point, and no step.

    Raises:
        CommandError: A time is invalid, or the span is not a whole number of steps.
    """
    if not 0.0 < step_size < float("inf"):
        raise CommandError(f"the step size {step_size:.12g} s must be a positive number of seconds.")
    span = stop_time - start_time
    if math.isfinite(span):  # from the decimal numbers, because doubles far from zero are coarse
        span = float(Fraction(repr(float(stop_time))) - Fraction(repr(float(start_time))))
    if not 0.0 <= span < float("inf"):
        raise CommandError(
            f"the stop time {stop_time:.12g} s must be finite, and not before the start time "
            f"{start_time:.12g} s."
        )
    if span / step_size > MAXIMUM_STEPS:
        raise CommandError(
            f"{span:.12g} s in steps of {step_size:.12g} s are more than {MAXIMUM_STEPS:g} steps. "
            "Set a larger step size."
        )
    steps = round(span / step_size)
    # 0.3 s is a whole number of steps of 0.1 s up to rounding errors only
    if (steps == 0 and span > 0.0) or abs(steps * step_size - span) > 1e-9 * span:
        whole_steps = max(int(span / step_size), 1)
        raise CommandError(
            f"the stop time {stop_time:.12g} s is not a whole number of steps of {step_size:.12g} s; "
            f"{start_time + whole_steps * step_size:.12g} s would be."
        )
    latest = max(abs(start_time), abs(stop_time))
    if math.ulp(latest) > _COARSE * step_size:
        raise CommandError(
            f"numbers near t = {latest:.12g} s are too coarse for steps of {step_size:.12g} s. "
            "Start nearer to 0 s."
        )
    return CommunicationPoints(start_time, step_size, steps)
