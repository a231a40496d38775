"""The loop over communication steps."""

from collections.abc import Callable
from dataclasses import dataclass

from ..errors import CommandError
from .algorithm import Algorithm
from .gauss_seidel import GaussSeidel
from .jacobi import Jacobi
from .network import Network

ALGORITHMS: dict[str, Callable[[], Algorithm]] = {"jacobi": Jacobi, "gauss-seidel": GaussSeidel}
"""Algorithms by name."""

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
        return self.start + self.steps * self.step


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


def simulate(
    network: Network,
    algorithm: Algorithm,
    times: Timing,
    record: Callable[[float], None],
    interrupted: Callable[[], bool],
) -> int:
    """Initialize the network and step it to the end; returns the number of steps done.

    `record` is called with the time in s at every communication point, the initial one
    included, when the network's signals hold the outputs there. Stops early when `interrupted`
    says so. Raises SlaveError and RunError.
    """
    algorithm.setup(network)
    algorithm.initialize(times.start, times.stop)
    record(times.start)
    start, h, step = times.start, times.step, algorithm.step
    for k in range(times.steps):
        if interrupted():
            return k
        step(start + k * h, h)
        record(start + (k + 1) * h)
    return times.steps
