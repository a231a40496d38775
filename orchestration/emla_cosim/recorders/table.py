"""Recorders of tables: every n-th row of selected signals, and the last row."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..base.arrays import Vector
from ..base.signal_types import SignalType
from .recorder import Outline, Recorder


class Table(Recorder):
    """Base class of recorders that keep every n-th row, and the last one, of the selected signals.

    A file format implements `open`, `append` and `read`, and its constructor takes the path of the file.

    Attributes:
        names: names of the columns, `time` first.
        types: types of the columns by name; Real for those without an entry.
    """

    types: Mapping[str, SignalType] = {}
    """Types of the columns by name; Real for those without an entry."""

    names: list[str]
    """Names of the columns, `time` first."""

    key = "table"

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Begin a table with the columns of the outline."""
        self.names = ["time", *(outline.names[i] for i in outline.recorded)]
        self._columns = [0, *(1 + i for i in outline.recorded)]
        self._whole = list(outline.recorded) == list(range(len(outline.names)))
        self.types = {n: t for n, t in outline.types.items() if n in self.names}
        self.texts = outline.texts
        self._every = outline.every
        self._seen = int(memory["rows"]) if memory is not None else 0
        self._last: Vector | None = None

    def write(self, rows: Vector) -> None:
        """Append the rows that are due."""
        due = rows[-self._seen % self._every :: self._every]
        self._last = None
        self._seen += len(rows)
        if len(due):
            self.append(due if self._whole else due[:, self._columns])
        pending = (self._seen - 1) % self._every != 0
        self._last = np.ascontiguousarray(rows[-1:, self._columns]) if pending else None

    def end(self) -> None:
        """Append the last row if it was not due."""
        last, self._last = self._last, None
        if last is not None:
            self.append(last)

    def memory(self) -> Any:
        """Return the number of rows received."""
        return {"rows": self._seen}

    @abstractmethod
    def append(self, rows: Vector) -> None:
        """Append rows; may raise OSError.

        Args:
            rows: array of shape (n, columns), time in s first.
        """

    def open(self) -> None:
        """Read the names of the columns from an existing file; may raise OSError."""
        raise NotImplementedError(f"{type(self).__name__} has no method 'open'")

    @abstractmethod
    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Return columns by name; names without a column are left out. May raise OSError.

        Args:
            names: names of columns.
            most: of a table with more rows, return only every n-th row. Default: all rows.

        Returns:
            An array of shape (rows,) by name: of doubles, or of texts for a String.
        """
