"""Keep blocks of rows until their steps are summed up."""

from typing import Any

import numpy as np

from ...base.arrays import Indices, Vector, read_stored_array
from .steps import Steps


class EveryStep:
    """Keep all steps of rows (time in s first) with some columns, until `take`."""

    def __init__(self, columns: Indices, memory: Any = None) -> None:
        """Begin, or continue from a `memory`."""
        self._columns, count = columns, len(columns)
        before = np.empty((0, count)) if memory is None else read_stored_array(memory, (2, count), (0, count))
        self._rows = [before]
        self.waiting = 0
        """Number of steps that wait for `take`."""

    @property
    def time(self) -> float:
        """Time of the last row in s; minus infinity without one."""
        return float(self._rows[-1][-1, 0]) if len(self._rows[-1]) else -np.inf

    def show(self, rows: Vector) -> None:
        """Take the next rows."""
        if not len(self._rows[0]):
            self._rows = [rows[[0, 0]][:, self._columns]]  # there is no step before the first
            rows = rows[1:]
        if len(rows):
            self._rows.append(rows[:, self._columns])
        self.waiting += len(rows)

    def take(self) -> Steps:
        """Return the waiting steps."""
        rows = np.concatenate(self._rows)
        self._rows, self.waiting = [rows[-2:]], 0
        return Steps(rows[:-2], rows[1:-1], rows[2:])

    def memory(self) -> Any:
        """Return the state as plain data, from which another object can continue; call `take` before."""
        return self._rows[0].tolist()
