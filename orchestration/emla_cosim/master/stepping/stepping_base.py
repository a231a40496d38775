"""How a run gets from one communication point to the next: in fixed steps, or as the error allows."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from ...base.arrays import Vector
from ..algorithms.algorithm import Algorithm
from .timing import CommunicationPoints

ROUNDING = 1e-6
"""The part of a step by which times that mean the same may differ."""


class RowSink(Protocol):
    """Where recorded rows go: time in s, then all signals.

    Every `every`-th communication point is recorded.
    """

    every: int

    def room(self, most: int) -> Vector:
        """Free rows to fill, at least one and at most so many, in the order of time."""
        ...

    def commit(self, count: int) -> None:
        """So many of them are filled. May raise RunError."""
        ...


class Stepping(ABC):
    """Drives an algorithm that has been set up through time."""

    def __init__(self, algorithm: Algorithm, times: CommunicationPoints) -> None:
        self.algorithm = algorithm
        self.times = times
        self.watch: Callable[[float, Vector], None] | None = None
        """Told of every point by a stepping that does not record all: its time in s, and the signals."""

    @property
    @abstractmethod
    def time(self) -> float:
        """Where the simulation is, in s."""

    @property
    @abstractmethod
    def steps(self) -> int:
        """Steps done since the start time."""

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether the stop time is reached."""

    def reached(self, until: float) -> bool:
        """Whether the simulation is at a time in s, but for rounding, or at its end."""
        return self.finished or self.time >= until - ROUNDING * self.times.step

    @abstractmethod
    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        """Do at most so many steps, none beyond `until` in s, and record them.

        What was recorded before an error (RunError) stays recorded.
        """

    def report(self) -> dict[str, Any]:
        """How the steps were made, as plain data for run.json."""
        return {"steps": self.steps, **self.algorithm.report()}

    def remarks(self) -> list[str]:
        """Sentences on how the steps were made that a reader of results should know."""
        return []

    def memory(self) -> dict[str, Vector]:
        """What the stepping and its algorithm remember besides the signals, as arrays by name."""
        return self.algorithm.memory()

    def remember(self, memory: Mapping[str, Vector]) -> None:
        """Take over what a stepping of the same kind remembered."""
        self.algorithm.remember(memory)

    def close(self) -> None:  # noqa: B027 - most hold nothing
        """Free what the stepping holds of the instances; never raises."""

    def record(self, rows: RowSink) -> None:
        """Record the present signals as one row."""
        block = rows.room(1)
        block[0, 0] = self.time
        block[0, 1:] = self.algorithm.network.signals
        rows.commit(1)
