"""Tables in files, which another thread writes while the steps continue."""

import threading
import time
from abc import abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars

from ..base.arrays import REAL, Vector
from ..base.output_files import OutputFile, has_record
from .recorder import RunLayout
from .table import Table

_POLARS = {
    "Real": polars.Float64,
    "Integer": polars.Int32,
    "Enumeration": polars.Int32,
    "Boolean": polars.Boolean,
    "String": polars.String,
}

_MOST_VALUES = 2**20
"""Number of values that may wait while others are stored."""


class FileTable(Table):
    """A table in one file. Rows wait in memory until another thread stores a batch of them.

    An existing file is replaced if it is empty, if it is `results` in the folder of a run, if `is_ours`
    recognizes it, or with `overwrite`.

    Attributes:
        batch_rows: number of rows that are worth a batch for the thread.
        batch_seconds: wall time in s after which fewer rows are stored, too.
    """

    batch_rows: int
    batch_seconds: float

    def __init__(self, path: str | Path, overwrite: bool = False) -> None:
        self.path, self._overwrite = Path(path), overwrite
        self._waiting, self._waiting_count = list[Vector](), 0
        """Rows that wait, and their number."""
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None
        self._stored = 0
        """Value of `_row_count` with the last stored row."""
        self._started_at = time.monotonic()

    def __str__(self) -> str:
        return str(self.path)

    def begin(self, layout: RunLayout, state: Any = None) -> None:
        """Begin a table with the columns of the layout."""
        super().begin(layout, state)
        self._waiting, self._waiting_count, self._failure, self._stored = [], 0, None, self._row_count

    def check_file(self) -> OutputFile:
        """Return the file, which may be replaced. Raises CommandError if it may not; see the class."""

        def is_ours(path: Path) -> bool:
            return (path.stem == "results" and has_record(path.parent, "run.json")) or self.is_ours(path)

        return OutputFile(self.path, "the table", is_ours, self._overwrite)

    @abstractmethod
    def is_ours(self, path: Path) -> bool:
        """Return whether a run wrote this file. Called after `begin` of this class; may raise OSError."""

    def append(self, rows: Vector) -> None:
        """Keep a copy of rows until another thread stores them. Raises the error of an earlier batch."""
        self._raise_failure()
        self._waiting.append(rows.copy())
        self._waiting_count += len(rows)
        is_full = self._waiting_count * len(self.names) >= _MOST_VALUES
        if is_full:  # a disk that is slower than the steps must not fill the memory
            self._wait_for_thread()
        waited_s = time.monotonic() - self._started_at
        if is_full or self._waiting_count >= self.batch_rows or waited_s >= self.batch_seconds:
            self._store_in_thread()

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
        """Write rows; may raise OSError. Called in any thread, never in two."""

    @abstractmethod
    def reopen(self, layout: RunLayout, rows: int) -> None:
        """Continue the table that another process left, after its last whole row. May raise OSError.

        Args:
            layout: names and units of the rows.
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
        while self._waiting_count or self._is_busy():
            if 2 * (self._row_count - self._stored) > most:
                self._store_in_thread()
            if self._row_count - self._stored <= most:
                return
            self._wait_for_thread()
            self._raise_failure()

    def end(self) -> None:
        """Append the last row if it was not due, and wait until all rows are stored."""
        super().end()
        self.drain()

    def state_dict(self) -> Any:
        """Wait until all rows are stored, and return how many were received."""
        self.drain()
        return super().state_dict()

    def drain(self) -> None:
        """Wait until all rows are stored. Raises OSError if some cannot be stored."""
        self._wait_for_thread()
        self._store_in_thread()
        self._wait_for_thread()
        self._raise_failure()

    def _store_in_thread(self) -> None:
        """Let another thread store all waiting rows, unless it still stores others."""
        if self._is_busy() or not self._waiting_count:
            return
        rows, self._waiting, self._waiting_count = self._waiting, [], 0
        self._started_at = time.monotonic()
        thread = threading.Thread(target=self._store, args=(rows, self._row_count), daemon=True)
        try:
            thread.start()
        except RuntimeError:  # the system has no thread left
            self._store(rows, self._row_count)
        else:
            self._thread = thread

    def _store(self, blocks: list[Vector], row_count: int) -> None:
        """Store rows, and keep the error if that fails. After an error nothing is stored any more."""
        try:
            if self._failure is None:
                self.store(np.concatenate(blocks))
                self._stored = row_count
        except BaseException as error:
            self._failure = error

    def _is_busy(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def _wait_for_thread(self) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure


def frame_rows(frame: polars.DataFrame) -> Vector:
    """Return a data frame as rows of doubles, with NaN for texts."""
    texts = polars.col(polars.String).is_null().cast(polars.Float64) * float("nan")
    return frame.with_columns(texts).cast(polars.Float64).to_numpy(order="c")
