"""Communication points of a run."""

from dataclasses import dataclass

from ...errors import CommandError

MAXIMUM_STEPS = 10**10


@dataclass(frozen=True)
class Timing:
    """Communication points `start + k * step` for k = 0 ... steps, in s."""

    start: float
    step: float
    steps: int

    @property
    def stop(self) -> float:
        """The last communication point in s."""
        return self.point(self.steps)

    def point(self, k: int) -> float:
        """The communication point k in s: computed, never added up."""
        return self.start + k * self.step


def timing(stop_time: float, step_size: float, start_time: float = 0.0) -> Timing:
    """Communication points from start to stop, in s.

    Raises CommandError where times make no sense or the span is not a whole number of steps.
    """
    if not 0.0 < step_size < float("inf"):
        raise CommandError(f"the step size {step_size:g} s must be a positive number of seconds.")
    span = stop_time - start_time
    if not 0.0 < span < float("inf"):
        raise CommandError(
            f"the stop time {stop_time:g} s must be a finite number of seconds after {start_time:g} s."
        )
    if span / step_size > MAXIMUM_STEPS:
        raise CommandError(f"{span:g} s in steps of {step_size:g} s are more than {MAXIMUM_STEPS:g} steps.")
    steps = round(span / step_size)
    if steps == 0 or abs(steps * step_size - span) > 1e-9 * span:
        whole = max(int(span / step_size), 1)
        raise CommandError(
            f"the stop time {stop_time:g} s is not a whole number of steps of {step_size:g} s; "
            f"{start_time + whole * step_size:g} s would be."
        )
    return Timing(start_time, step_size, steps)
