"""The interface of everything that does the steps of a run."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from ...base.arrays import Vector
from ..algorithms.algorithm import Algorithm
from .timing import CommunicationPoints

if TYPE_CHECKING:  # commands that only list options do not load fmpy
    from .native_loop import NativeLoop

ROUNDING = 1e-6
"""Times that differ by less than this fraction of a step are equal."""

LONGEST = 1.0
"""Wall time in s after which `Stepping.advance` returns after the next step: so an interrupt ends a run."""


class RowSink(Protocol):
    """Takes recorded rows: time in s, then all signals, then the observed variables.

    Every `steps_per_row`-th communication point is recorded.
    """

    steps_per_row: int

    def room(self, most: int) -> Vector:
        """Return free rows to fill in the order of time: at least one, at most `most`."""
        ...

    def commit(self, count: int) -> None:
        """Take the first `count` of the free rows as filled. May raise RunError."""
        ...


class Stepping(ABC):
    """Base class of steppings: drives an algorithm through time.

    Args:
        algorithm: algorithm after its `setup`.
        times: start time, stop time and step size, in s.

    Raises:
        RunError: the C code cannot be built on this machine.

    Attributes:
        loop: stepper in C.
    """

    def __init__(self, algorithm: Algorithm, times: CommunicationPoints) -> None:
        self.algorithm, self.loop = algorithm, _make_loop(algorithm)
        self.times = times

    @property
    @abstractmethod
    def time(self) -> float:
        """Current time in s."""

    @property
    @abstractmethod
    def steps(self) -> int:
        """Number of steps since the start time."""

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether the stop time is reached."""

    def reached(self, until: float) -> bool:
        """Return whether a time in s is reached, except for rounding, or the run is at its end."""
        return self.finished or self.time >= until - ROUNDING * self.times.step

    @abstractmethod
    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        """Do steps and record them, for about `LONGEST`. Rows before an error stay recorded.

        Args:
            rows: receives the rows.
            most: largest number of steps.
            until: time in s that no step exceeds.

        Raises:
            RunError: a step failed.
        """

    def report(self) -> dict[str, Any]:
        """Return how the steps were made, as plain data for run.json."""
        entries, reason = {"steps": self.steps, **self.algorithm.report()}, self.loop.why_not_kept()
        return entries | ({"compiled_code_not_kept": reason} if reason else {})

    def notes(self) -> list[str]:
        """Return what a reader should know before the run, without full stops."""
        return []

    def remarks(self) -> list[str]:
        """Return notes on the steps that a reader of the results needs."""
        return self.algorithm.remarks()

    def state_dict(self) -> dict[str, Vector]:
        """Return what steps have changed, as arrays by name."""
        return self.algorithm.state_dict()

    def load_state_dict(self, state: Mapping[str, Vector]) -> None:
        """Continue from what `state_dict` returned in a stepping of the same class."""
        self.algorithm.load_state_dict(state)

    def close(self) -> None:
        """Free what the stepping holds of the FMU instances; never raises."""
        self.loop.close()

    def record(self, rows: RowSink, due: bool = True) -> None:
        """Record the current signals and observed values as one row; texts only if it is `due`.

        Initialization has read the observed values of the first row, before it set inputs once more.
        """
        network = self.algorithm.network
        if self.steps:
            network.observer.read(due)
        block = rows.room(1)
        block[0, 0] = self.time
        block[0, 1 : 1 + len(network.signals)] = network.signals
        block[0, 1 + len(network.signals) :] = network.observer.values
        rows.commit(1)


def _make_loop(algorithm: Algorithm) -> "NativeLoop":
    """Return the loop in C for an algorithm after its `setup`.

    Raises:
        RunError: The C code cannot be built on this machine.
    """
    from ...stepper.library import require_stepper
    from .native_loop import NativeLoop
    from .stepper_tables import list_entry_points

    library = require_stepper()
    return NativeLoop(algorithm, list_entry_points(algorithm), library)
