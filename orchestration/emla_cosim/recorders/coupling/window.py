"""The steps of a run, block by block, with what came before each."""

from typing import Any

import numpy as np

from ...arrays import Indices, Vector
from .steps import Steps

BEFORE = 3
"""Points before a block that are kept: those of the last step, and of what its slope comes from."""


class Window:
    """Makes steps of rows that come in blocks, the time in s first; only some columns are needed.

    `first` is the number of the first step that the present rows end, `count` how many they end.
    """

    def __init__(self, columns: Indices, memory: Any = None) -> None:
        """Begin, or go on from what `memory` gave."""
        self.first = self.count = 0
        self._columns = columns
        self._last: Vector = np.empty((0, len(columns)))  # the points before `_rows`
        self._rows: Vector = np.empty((0, len(columns)))
        if memory is not None:
            self.first = int(memory["step"])
            self._last = np.array(memory["last"], dtype=float).reshape(-1, len(columns))

    @property
    def time(self) -> float:
        """The time of the last row in s; before all times without one."""
        return float(self._last[-1, 0]) if len(self._last) else -np.inf

    def show(self, rows: Vector) -> None:
        """Take the next rows."""
        if not len(self._last):
            self._last, rows = rows[[0] * BEFORE][:, self._columns], rows[1:]
        self._rows, self.count = rows, len(rows)

    def steps(self, which: Indices, columns: Indices, ago: int = 0) -> Steps:
        """Return some of the steps, by their position, with some of the needed columns, by their position.

        Where it is 1 `ago`, the steps before them instead.
        """
        first = BEFORE - 2 - ago
        return Steps(*(self._picked(which + first + place, columns) for place in range(3)))

    def leave(self) -> None:
        """The present rows go; the last of them stay."""
        every = np.arange(len(self._columns))
        points = self.count + np.arange(BEFORE)
        self._last, self._rows = self._picked(points, every), self._rows[:0]
        self.first, self.count = self.first + self.count, 0

    def memory(self) -> dict[str, Any]:
        """Plain data from which another one can go on."""
        return {"step": self.first, "last": self._last.tolist()}

    def _picked(self, points: Indices, columns: Indices) -> Vector:
        """Points by their position: those from before, then the rows."""
        early = points < BEFORE
        if not len(self._rows):
            return self._last[np.ix_(points, columns)]
        found = self._rows[np.ix_(np.maximum(points - BEFORE, 0), self._columns[columns])]
        if early.any():
            found[early] = self._last[np.ix_(points[early], columns)]
        return found
