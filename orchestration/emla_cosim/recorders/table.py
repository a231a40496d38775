"""Recorders of tables: every n-th row of selected signals, and the last row."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base.arrays import Vector
from .recorder import Outline, Recorder


class Table(Recorder):
    """Keep every n-th row, and the last row, of the recorded signals.

    A file format implements `open`, `append` and `read`. Its constructor takes the path of the file.
    """

    names: list[str]
    """Names of the columns, `time` first."""

    key = "table"
    quick_memory = True
    """Whether `memory` is fast."""

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Begin a table, or continue from a `memory`, whose rows count."""
        self.names = ["time", *(outline.names[i] for i in outline.recorded)]
        self._columns = [0, *(1 + i for i in outline.recorded)]
        self._whole = len(outline.recorded) == len(outline.names)
        self._every = outline.every
        self._seen = int(memory["rows"]) if memory is not None else 0
        self._last: Vector | None = None

    def write(self, rows: Vector) -> None:
        """Append the rows that are due."""
        due = rows[-self._seen % self._every :: self._every]
        self._last = None
        if len(due):
            self.append(due if self._whole else due[:, self._columns])
        self._seen += len(rows)
        pending = (self._seen - 1) % self._every != 0
        self._last = np.ascontiguousarray(rows[-1:, self._columns]) if pending else None

    def end(self) -> None:
        """Append the last row if it was not due."""
        last, self._last = self._last, None
        if last is not None:
            self.append(last)

    def memory(self) -> Any:
        """Return the number of rows so far, due or not."""
        return {"rows": self._seen}

    @abstractmethod
    def append(self, rows: Vector) -> None:
        """Append these rows, time first. May raise OSError."""

    def open(self) -> None:
        """Read the column names from the file of an earlier run, before `read`. May raise OSError."""
        raise NotImplementedError(f"{type(self).__name__} has no method 'open'")

    @abstractmethod
    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Return columns by name, without those that the table does not have. May raise OSError.

        Args:
            names: Names of the columns.
            most: If the table has more rows, only every n-th row may be returned.
        """
