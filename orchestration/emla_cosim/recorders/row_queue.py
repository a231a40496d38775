"""Rows of a table on their way to a thread that stores them, so that the steps go on meanwhile."""

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.arrays import Vector
from ..sandbox import black_box
from .recorder import BLOCK_ROWS, BLOCK_SIZE

BATCH = 2000
"""Number of rows that are worth a batch: with fewer, most of the time goes into the columns, not the rows."""

_BLOCKS = 3
"""Size of the ring in blocks of rows: one that is stored, one that waits, and one that comes. If these do not
fit into the memory that is shared, none waits.
"""

_LONGEST = 0.2
"""Wall time in s after which fewer rows are stored too."""


class RowQueue:
    """A ring of rows, of which one batch at a time is stored in another thread.

    Only the thread of the run calls its methods. If the ring is full, they wait.

    Args:
        width: Number of values in a row.
        store: Stores rows of shape (n, width), which it must not keep. Called in another thread, or in the
            caller's. May raise OSError.
        progress: Returns what describes the rows that are stored; called after `store`, in the same thread.
        shared: Whether another process shall read the rows that wait, in the memory that outlives this one.
    """

    def __init__(
        self,
        width: int,
        store: Callable[[Vector], None],
        progress: Callable[[], Any],
        shared: bool = False,
    ) -> None:
        self._store, self._progress = store, progress
        self._block = max(min(BLOCK_ROWS, BLOCK_SIZE // (8 * width)), 1)
        block, blocks = self._block * width * 8, _BLOCKS
        memory = black_box.reserve_table(blocks * block) if shared else None
        if shared and memory is None:  # wide rows
            blocks = _BLOCKS - 1
            memory = black_box.reserve_table(blocks * block)
        self.is_shared = memory is not None
        """Whether another process can read the rows that wait."""
        rows = np.empty(blocks * block // 8) if memory is None else np.frombuffer(memory)
        self._ring = rows.reshape(-1, width)
        self._count = 0
        """Number of rows so far."""
        self._started = 0
        """Number of rows that are stored, or are being stored."""
        self._stored: tuple[int, Any] = (0, progress())
        """Number of stored rows, and what describes them."""
        self._thread: threading.Thread | None = None
        self._at = time.monotonic()
        self._failure: BaseException | None = None
        self._failed = False

    def put(self, rows: Vector) -> None:
        """Copy rows into the ring. Raises what `store` raised; after that, rows are ignored."""
        self._raise_failure()
        while len(rows) and not self._failed:
            free = len(self._ring) - (self._count - self._stored[0])
            if free == 0:
                self._wait(len(self._ring) - self._block)
                continue
            place = self._count % len(self._ring)
            count = min(free, len(rows), len(self._ring) - place)
            self._ring[place : place + count] = rows[:count]
            self._count += count
            rows = rows[count:]
        waiting = self._count - self._started
        if waiting and (waiting >= min(BATCH, self._block) or time.monotonic() - self._at >= _LONGEST):
            self._start()

    def drain(self) -> None:
        """Wait until all rows are stored. Raises what `store` raised, if that was not raised before."""
        self._join()
        if self._started < self._count and not self._failed:
            self._started = self._count
            self._store_rows(self._stored[0], self._count)
        self._raise_failure()

    def list_waiting(self) -> tuple[Any, tuple[int, int]]:
        """Return what another process needs to store the rows that wait.

        These rows stay in the ring until one more block of `BLOCK_ROWS` rows is put.

        Returns:
            What describes the stored rows, and the numbers of the first row that waits and of the next one.
        """
        self._wait(len(self._ring) - self._block)  # the next block fits in beside those that wait
        self._raise_failure()
        stored, progress = self._stored
        return progress, (stored, self._count)

    def copy_rows(self, first: int, last: int) -> Vector:
        """Return rows that another process left in this memory, by the numbers from `list_waiting`."""
        return self._ring[np.arange(first, last) % len(self._ring)]

    def _wait(self, most: int) -> None:
        """Wait until at most `most` rows wait."""
        while self._count - self._stored[0] > most and not self._failed:
            self._start()
            self._join()

    def _start(self) -> None:
        """Store all rows that wait in another thread, unless it is still storing others."""
        if self._failed or (self._thread is not None and self._thread.is_alive()):
            return
        self._join()
        first, self._started, self._at = self._stored[0], self._count, time.monotonic()
        thread = threading.Thread(target=self._store_rows, args=(first, self._count), daemon=True)
        try:
            thread.start()
        except RuntimeError:  # the system has no thread left
            self._store_rows(first, self._count)
        else:
            self._thread = thread

    def _join(self) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _store_rows(self, first: int, last: int) -> None:
        try:
            while first < last:
                place = first % len(self._ring)
                count = min(last - first, len(self._ring) - place)
                self._store(self._ring[place : place + count])
                first += count
                self._stored = (first, self._progress())
        except BaseException as error:
            self._failure, self._failed = error, True

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
