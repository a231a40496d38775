"""Rows of signals, collected in blocks and handed on."""

from typing import Protocol

import numpy as np

from ..master.slave import Vector


class Sink(Protocol):
    """Takes the rows of a run block by block."""

    def write(self, rows: Vector) -> None:
        """Take one row or more (time, then all signals); the array is reused. May raise OSError."""
        ...

    def close(self) -> None:
        """The run is over: finish what is pending. May raise OSError."""
        ...


class Recorder:
    """Copies the network's signals into a preallocated block and passes full blocks to the sinks.

    Memory stays the same however long the run is. `rows` counts the rows taken.
    """

    def __init__(self, signals: Vector, sinks: list[Sink], block_rows: int = 2000) -> None:
        self._signals = signals
        self._sinks = sinks
        self._block = np.empty((block_rows, 1 + len(signals)))
        self._filled = 0
        self.rows = 0

    def record(self, time: float) -> None:
        """Take the present signals as the row of this time in s."""
        row = self._block[self._filled]
        row[0] = time
        row[1:] = self._signals
        self._filled += 1
        self.rows += 1
        if self._filled == len(self._block):
            self._flush()

    def close(self) -> None:
        """Pass on what is left and close the sinks, every one of them. May raise OSError."""
        failure: OSError | None = None
        for finish in (self._flush, *(sink.close for sink in self._sinks)):
            try:
                finish()
            except OSError as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def _flush(self) -> None:
        rows, self._filled = self._block[: self._filled], 0
        if len(rows):
            for sink in self._sinks:
                sink.write(rows)
