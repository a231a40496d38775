"""Tables in files, which do not replace files of other programs."""

from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.ownership import OutputFiles
from ..base.signal_types import REAL
from .recorder import Outline
from .row_queue import RowQueue
from .table import Table

_POLARS = {
    "Real": polars.Float64,
    "Integer": polars.Int32,
    "Enumeration": polars.Int32,
    "Boolean": polars.Boolean,
    "String": polars.String,
}


class FileTable(Table):
    """A table in one file, which another thread writes while the run goes on.

    An existing file is replaced if it is empty, if it is an unchanged table of an earlier run, or with
    `overwrite`; see `base.ownership`.

    Attributes:
        batch_rows: number of rows that are worth a batch for the thread.
        batch_seconds: wall time in s after which fewer rows are stored, too.
    """

    batch_rows: int
    batch_seconds: float

    def __init__(self, path: str | Path, overwrite: bool = False) -> None:
        self.path = Path(path)
        folder = self.path.parent
        self._files = OutputFiles(folder, folder, "", lambda _: False, (), overwrite)
        self._queue: RowQueue | None = None

    def __str__(self) -> str:
        return str(self.path)

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Begin a table with the columns of the outline."""
        super().begin(outline, memory)
        self._queue = None

    def append(self, rows: Vector) -> None:
        """Store rows in another thread. Raises OSError, also for earlier rows."""
        self._open_queue().put(rows, self._seen)

    @property
    def schema(self) -> dict[str, type[polars.DataType]]:
        """The types of the columns for polars."""
        return {name: _POLARS[self.types.get(name, REAL).kind] for name in self.names}

    def frame(self, rows: Vector) -> polars.DataFrame:
        """Return rows as a data frame whose columns have the types of their signals."""
        frame = polars.from_numpy(np.ascontiguousarray(rows), schema=self.names)
        return frame.with_columns(
            polars.Series(name, self.texts.decode(frame[name].to_numpy()), polars.String)
            if type_.is_text
            else frame[name].cast(_POLARS[type_.kind])
            for name, type_ in self.types.items()
        )

    @abstractmethod
    def store(self, rows: Vector) -> None:
        """Write rows, which are reused afterwards; may raise OSError. Called in any thread, never in two."""

    @abstractmethod
    def reopen(self, outline: Outline, rows: int) -> None:
        """Continue the table that another process left, after its last whole row. May raise OSError.

        Args:
            outline: names and units of the rows.
            rows: number of rows of the run before the next one that `write` receives.
        """

    @abstractmethod
    def count_stored(self) -> int:
        """Return the number of rows that the table has on disk."""

    @abstractmethod
    def blocks(self) -> Iterator[Vector]:
        """Yield the rows of the whole table as arrays of shape (n, columns), with NaN for texts."""

    def release(self, most: int) -> None:
        """Store all rows but those among the last `most` that were received. Raises OSError."""
        queue = self._open_queue()
        while (stored := queue.stored()) is not None:
            if 2 * (self._seen - stored) > most:
                queue.start()
            if self._seen - stored <= most:
                return
            queue.wait()

    def end(self) -> None:
        """Append the last row if it was not due, and wait until all rows are stored."""
        super().end()
        self.drain()

    def memory(self) -> Any:
        """Wait until all rows are stored, and return how many were received."""
        self.drain()
        return super().memory()

    def drain(self) -> None:
        """Wait until all rows are stored. Raises OSError if some cannot be stored."""
        if self._queue is not None:
            self._queue.drain()

    def _open_queue(self) -> RowQueue:
        if self._queue is None:
            self._queue = RowQueue(len(self.names), self.store, self.batch_rows, self.batch_seconds)
        return self._queue

    def claim(self, continued: bool) -> None:
        """Add the file to the manifest of its folder before it is written.

        Args:
            continued: Whether the run continues an existing file. Otherwise the file is replaced.

        Raises:
            CommandError: The existing file was not written by a run, or was changed since.
            OSError: The manifest cannot be written.
        """
        if not continued:
            self._files.check([self.path.name], "the table")
        self._files.claim([self.path.name])

    def settle(self) -> None:
        """Mark the file as complete in the manifest. May raise OSError."""
        self._files.settle([self.path.name])


def frame_rows(frame: polars.DataFrame) -> Vector:
    """Return a data frame as rows of doubles, with NaN for texts."""
    texts = polars.col(polars.String).is_null().cast(polars.Float64) * float("nan")
    return frame.with_columns(texts).cast(polars.Float64).to_numpy(order="c")
