"""Simulated time held back to the pace of real time."""

import time
from collections.abc import Callable

from ...base.errors import CommandError

SHORTEST_WAIT = 1e-3
"""Wall time in s between two points at which time is compared, unless steps are longer."""

_MOST_STEPS = 2**31
"""So many steps are done at once at most, however fast the pace."""

_NAP = 0.1


class Pacing:
    """Waits until real time has come to where the simulation is.

    `factor` says how many seconds of simulation make one second on the clock. A point that is
    reached too late is an overrun; nothing is left out, later points try to catch up.
    """

    def __init__(self, factor: float) -> None:
        if not 0.0 < factor < float("inf"):
            raise CommandError(f"the real-time factor {factor:g} must be a positive number.")
        self.factor = factor
        self.points = 0
        """Points compared so far."""
        self.overruns = 0
        """Points that were reached too late."""
        self.worst = 0.0
        """The longest delay of a point behind its time on the clock, in s."""
        self._start = (0.0, 0.0)

    def begin(self, simulated: float) -> None:
        """The clock starts now, at this simulated time in s."""
        self._start = (simulated, time.perf_counter())

    def report(self) -> dict[str, float]:
        """How well the pace was kept, as metrics.json has it."""
        return {
            "factor": self.factor,
            "points": self.points,
            "overruns": self.overruns,
            "worst_delay_s": self.worst,
        }

    def steps(self, step: float) -> int:
        """Steps of this length in s to do between two points."""
        return max(1, round(min(SHORTEST_WAIT * self.factor / step, _MOST_STEPS)))

    def wait(self, simulated: float, interrupted: Callable[[], bool]) -> None:
        """Wait for the clock to reach this simulated time in s, or for an interruption."""
        origin, began = self._start
        due = began + (simulated - origin) / self.factor
        delay = time.perf_counter() - due
        self.points += 1
        if delay > 0.0:
            self.overruns += 1
            self.worst = max(self.worst, delay)
        while (rest := due - time.perf_counter()) > 0.0 and not interrupted():
            time.sleep(min(rest, _NAP))
