"""A table in memory."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base.arrays import Vector
from .recorder import Outline
from .table import Table


class TimeSeries(Table):
    """Recorder that keeps a table in memory.

    Examples:
        >>> import emla_cosim as ec
        >>> table = ec.TimeSeries()
        >>> result = ec.load("lift", stop_time=0.01).prepare().run(recorders=[table])
        >>> table.rows.shape[0]
        11
    """

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Begin an empty table, also in a run that continues another one."""
        super().begin(outline, memory)
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
        rows, every = self.rows, 1
        if most is not None:
            every = max(-(-len(rows) // most), 1)
        position = {name: i for i, name in enumerate(self.names)}
        found = {n: rows[::every, position[n]] for n in names if n in position}
        texts = {
            n: self.texts.decode(v) for n, v in found.items() if n in self.types and self.types[n].is_text
        }
        return found | texts
