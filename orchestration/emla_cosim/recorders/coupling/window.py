"""Select steps from blocks of rows, with the points before each step."""

from typing import Any

import numpy as np

from ...base.arrays import Indices, Vector, read_stored_array
from .steps import Steps

EVERY_STEP, THINNED = 500, 31
"""The first `EVERY_STEP` steps are all used, then every `THINNED`-th, with `THINNED` times the weight."""

POINTS = 5
"""Points per step: its end, its begin, and three before, for the two previous steps and their slopes."""


class Window:
    """Select steps of rows (time in s first) with some columns, and keep them until `take`."""

    def __init__(self, columns: Indices, memory: Any = None) -> None:
        """Begin, or continue from a `memory`."""
        self._columns = columns
        self._number = 0  # of the step that the next row ends
        self._last: Vector = np.empty((0, len(columns)))  # the points before the next row
        self._points, self._counts = list[Vector](), list[Vector]()
        self.waiting = 0
        """Number of steps that wait for `take`."""
        if memory is not None:
            self._number = int(memory["step"])
            self._last = _points(memory["last"], POINTS - 1, columns)

    @property
    def time(self) -> float:
        """Time of the last row in s; minus infinity without one."""
        return float(self._last[-1, 0]) if len(self._last) else -np.inf

    def show(self, rows: Vector) -> None:
        """Select steps of the next rows."""
        if not len(self._last):
            self._last, rows = rows[[0] * (POINTS - 1)][:, self._columns], rows[1:]
        every = np.arange(len(rows))
        number = self._number + every
        chosen = every[(number < EVERY_STEP) | (number % THINNED == 0)]
        if len(chosen):
            self._points.append(self._picked(rows, chosen[:, None] + np.arange(POINTS)))
            self._counts.append(np.where(number[chosen] < EVERY_STEP, 1.0, float(THINNED)))
            self.waiting += len(chosen)
        self._last = self._picked(rows, len(rows) + np.arange(POINTS - 1))
        self._number += len(rows)

    def take(self) -> tuple[Steps, Steps, Steps]:
        """Return the waiting steps, the steps before them, and the steps before those."""
        points, counts = np.concatenate(self._points), np.concatenate(self._counts)
        self._points, self._counts, self.waiting = [], [], 0
        three, two, one, begin, end = points.transpose(1, 0, 2)
        return Steps(one, begin, end, counts), Steps(two, one, begin, counts), Steps(three, two, one, counts)

    def memory(self) -> dict[str, Any]:
        """Return the state as plain data, from which another object can continue; call `take` before."""
        return {"step": self._number, "last": self._last.tolist()}

    def _picked(self, rows: Vector, points: Indices) -> Vector:
        """Return points by position: first those from earlier rows, then the rows."""
        early = points < POINTS - 1
        if early.all():
            return self._last[points]
        found = rows[np.maximum(points - (POINTS - 1), 0)[..., None], self._columns]
        if early.any():
            found[early] = self._last[points[early]]
        return found


class EveryStep:
    """Keep all steps of rows (time in s first) with some columns, until `take`."""

    def __init__(self, columns: Indices, memory: Any = None) -> None:
        """Begin, or continue from a `memory`."""
        self._columns = columns
        self._rows = [np.empty((0, len(columns))) if memory is None else _points(memory, 2, columns)]
        self.waiting = 0
        """Number of steps that wait for `take`."""

    def show(self, rows: Vector) -> None:
        """Take the next rows."""
        if not len(self._rows[0]):
            self._rows = [rows[[0, 0]][:, self._columns]]  # there is no step before the first
            rows = rows[1:]
        self._rows.append(rows[:, self._columns])
        self.waiting += len(rows)

    def take(self) -> Steps:
        """Return the waiting steps."""
        rows = np.concatenate(self._rows)
        self._rows, self.waiting = [rows[-2:]], 0
        return Steps(rows[:-2], rows[1:-1], rows[2:], np.ones(len(rows) - 2))

    def memory(self) -> Any:
        """Return the state as plain data, from which another object can continue; call `take` before."""
        return self._rows[0].tolist()


def _points(memory: Any, count: int, columns: Indices) -> Vector:
    """Return the points before the next row from a memory, which may have none."""
    return read_stored_array(memory, (count, len(columns)), (0, len(columns)))
