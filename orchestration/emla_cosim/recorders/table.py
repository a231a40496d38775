"""Recorders of tables: every n-th row of selected signals, and the last row."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..base.arrays import SignalType, Vector
from .recorder import Recorder, RunLayout


class Table(Recorder):
    """Base class of recorders that keep every n-th row, and the last one, of the selected signals.

    A file format implements `open`, `append` and `read`, and its constructor takes the path of the file.
    """

    types: Mapping[str, SignalType] = {}
    """Types of the columns by name; Real for those without an entry."""

    names: list[str]
    """Names of the columns, `time` first."""

    key = "table"

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Begin a table with the columns of the layout."""
        self.names = ["time", *(layout.names[i] for i in layout.recorded)]
        self._columns = [0, *(1 + i for i in layout.recorded)]
        self._has_all_signals = list(layout.recorded) == list(range(len(layout.names)))
        self.types = {n: t for n, t in layout.types.items() if n in self.names}
        self.texts = layout.texts
        self._steps_per_row = layout.steps_per_row
        self._row_count = int(state["rows"]) if state is not None else 0
        self._last: Vector | None = None

    def write(self, rows: Vector) -> None:
        """Append the rows that are due."""
        due = rows[-self._row_count % self._steps_per_row :: self._steps_per_row]
        self._last = None
        self._row_count += len(rows)
        if len(due):
            self.append(due if self._has_all_signals else due[:, self._columns])
        pending = (self._row_count - 1) % self._steps_per_row != 0
        self._last = np.ascontiguousarray(rows[-1:, self._columns]) if pending else None

    def end(self) -> None:
        """Append the last row if it was not due."""
        last, self._last = self._last, None
        if last is not None:
            self.append(last)

    def state_dict(self) -> Any:
        """Return the number of rows received."""
        return {"rows": self._row_count}

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


class TimeSeries(Table):
    """Recorder that keeps a table in memory.

    Examples:
        >>> import emla_cosim as ec
        >>> table = ec.TimeSeries()
        >>> result = ec.load("lift", stop_time=0.01).prepare().run(recorders=[table])
        >>> table.rows.shape[0]
        11
    """

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Begin an empty table, also in a run that continues another one."""
        super().begin(layout, state)
        self._blocks: list[Vector] = []

    def append(self, rows: Vector) -> None:
        """Keep a copy of these rows."""
        self._blocks.append(rows.copy())

    @property
    def rows(self) -> Vector:
        """All rows as an array of shape (rows, columns), time in s first."""
        if len(self._blocks) != 1:
            self._blocks = [np.concatenate([np.empty((0, len(self.names))), *self._blocks])]
        return self._blocks[0]

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, Vector]:
        """Return columns by name, without those that the table does not have; see `Table.read`."""
        rows, stride = self.rows, 1
        if most is not None:
            stride = max(-(-len(rows) // most), 1)
        position = {name: i for i, name in enumerate(self.names)}
        columns = {n: rows[::stride, position[n]] for n in names if n in position}
        texts = {
            n: self.texts.decode(v) for n, v in columns.items() if n in self.types and self.types[n].is_text
        }
        return columns | texts
