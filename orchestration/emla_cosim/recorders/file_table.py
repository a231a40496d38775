"""Tables in files, which do not replace files of other programs."""

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.arrays import Vector
from ..base.ownership import OutputFiles
from .recorder import Outline
from .row_queue import RowQueue
from .table import Table


class FileTable(Table):
    """A table in one file, which another thread writes while the run goes on.

    An existing file is replaced if it is empty, if it is an unchanged table of an earlier run, or with
    `overwrite`; see `base.ownership`.
    """

    def __init__(self, path: str | Path, overwrite: bool = False) -> None:
        self.path = Path(path)
        folder = self.path.parent
        self._files = OutputFiles(folder, folder, "", lambda _: False, (), overwrite)
        self._queue: RowQueue | None = None
        self._shared = False

    def __str__(self) -> str:
        return str(self.path)

    def share_memory(self) -> None:
        """Before `begin`: keep rows that wait where another process finds them. Only one table can do so."""
        self._shared = True

    def begin(self, outline: Outline, memory: Any = None) -> None:
        """Begin a table with the columns of the outline."""
        super().begin(outline, memory)
        self._queue = None
        self._has_texts = any(found.is_text for found in self.types.values())

    def append(self, rows: Vector) -> None:
        """Store rows, at once or in another thread. Raises OSError, also for earlier rows."""
        if self._has_texts:  # texts are in this process only
            self.store(rows)
        else:
            self._open_queue().put(rows)

    @abstractmethod
    def store(self, rows: Vector) -> None:
        """Write rows, which are reused afterwards; may raise OSError. Called in any thread, never in two."""

    def progress(self) -> Mapping[str, Any]:
        """Return what `memory` needs to know of the rows that are stored. Called like `store`."""
        return {}

    def end(self) -> None:
        """Append the last row if it was not due, and wait until all rows are stored."""
        super().end()
        self.drain()

    def memory(self) -> Any:
        """Wait until all rows are stored. Return how many there are, and what describes them."""
        self.drain()
        return {**super().memory(), **self.progress()}

    def memory_now(self) -> Any:
        """Return `memory` without waiting: it says which rows wait in shared memory, if they are there."""
        if self._queue is None or not self._queue.is_shared:
            return self.memory()
        progress, waiting = self._queue.list_waiting()
        return {**super().memory(), **progress, "waiting": waiting}

    def recover(self, memory: Any) -> None:
        """After `begin`, store the rows that another process left in shared memory; `memory` says which."""
        if "waiting" in memory:
            queue = self._open_queue()
            queue.put(queue.copy_rows(*memory["waiting"]))

    def drain(self) -> None:
        """Wait until all rows are stored. Raises OSError if some cannot be stored."""
        if self._queue is not None:
            self._queue.drain()

    def _open_queue(self) -> RowQueue:
        if self._queue is None:
            self._queue = RowQueue(len(self.names), self.store, self.progress, self._shared)
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
