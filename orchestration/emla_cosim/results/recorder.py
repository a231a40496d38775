"""Rows of signals, collected in blocks and handed on."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from ..master.slaves.slave import Vector
from ..units import LinearTransformation


class Sink(Protocol):
    """Takes the rows of a run block by block."""

    def write(self, rows: Vector) -> None:
        """Take one row or more (time, then all signals); the array is reused. May raise OSError."""
        ...

    def close(self) -> None:
        """The run is over: finish what is pending. May raise OSError."""
        ...


class Selection:
    """Passes on some of the signals only, by position."""

    def __init__(self, sink: Sink, signals: Sequence[int]) -> None:
        self._sink = sink
        self._columns = [0, *(1 + i for i in signals)]

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        self._sink.write(rows[:, self._columns])

    def close(self) -> None:
        """The run is over."""
        self._sink.close()


class Recorder:
    """Rows of `width` numbers for the stepping to fill; full blocks go to the sinks.

    Every `every`-th communication point is to be recorded. Memory stays the same however long the
    run is. `shown` has signals, by position, that are passed on in another unit.
    """

    def __init__(
        self,
        width: int,
        sinks: list[Sink],
        every: int = 1,
        block_rows: int = 2000,
        shown: Mapping[int, LinearTransformation] | None = None,
    ) -> None:
        self.every = every
        self._sinks = sinks
        self._shown = shown or {}
        self._block = np.empty((block_rows, width))
        self._filled = 0

    def room(self, most: int) -> Vector:
        """Free rows to fill, at least one and at most so many."""
        return self._block[self._filled : self._filled + most]

    def commit(self, count: int) -> None:
        """So many of them are filled. May raise OSError from a sink."""
        self._filled += count
        if self._filled == len(self._block):
            self.flush()

    def flush(self) -> None:
        """Pass on what is there. May raise OSError from a sink."""
        rows, self._filled = self._block[: self._filled], 0
        if len(rows):
            for signal, transformation in self._shown.items():
                column = rows[:, 1 + signal]
                column[:] = transformation.factor * column + transformation.offset
            for sink in self._sinks:
                sink.write(rows)

    def close(self) -> None:
        """Pass on what is left and close the sinks, every one of them. May raise OSError."""
        failure: OSError | None = None
        for finish in (self.flush, *(sink.close for sink in self._sinks)):
            try:
                finish()
            except OSError as error:
                failure = failure or error
        if failure is not None:
            raise failure
