"""Rows of a table on their way to a thread that stores them, so that the steps go on meanwhile."""

import threading
import time
from collections.abc import Callable

import numpy as np

from ..base.arrays import Vector

_MOST_VALUES = 2**20
"""Number of values that may wait while others are stored."""


class RowQueue:
    """Rows that wait, of which one batch at a time is stored in another thread.

    Only the thread of the run calls its methods. If too many rows wait, they wait too.

    Args:
        width: Number of values in a row.
        store: Stores rows of shape (n, width), which it must not keep. Called in another thread or the
            caller's; may raise OSError.
        batch: Number of rows that are worth a batch.
        seconds: Wall time in s after which fewer rows are stored too.
    """

    def __init__(self, width: int, store: Callable[[Vector], None], batch: int, seconds: float) -> None:
        self._store, self._batch, self._seconds = store, batch, seconds
        rows = max(_MOST_VALUES // width, 1)
        self._waiting, self._other = np.empty((rows, width)), np.empty((rows, width))
        """Memory of rows that wait, and of those that are being stored."""
        self._count = 0
        """Number of rows that wait."""
        self._received = self._stored = 0
        self._thread: threading.Thread | None = None
        self._at = time.monotonic()
        self._failure: BaseException | None = None
        self._failed = False

    def put(self, rows: Vector, received: int) -> None:
        """Copy rows. Raises what `store` raised; after that, rows are ignored.

        Args:
            rows: array of shape (n, width).
            received: The number of rows of the run with these, and with those that are not stored.
        """
        self._raise_failure()
        while len(rows) and not self._failed:
            count = min(len(rows), len(self._waiting) - self._count)
            self._waiting[self._count : self._count + count] = rows[:count]
            self._count, rows = self._count + count, rows[count:]
            if self._count == len(self._waiting):
                self._join()
                self.start()
        self._received = received
        if self._count >= self._batch or time.monotonic() - self._at >= self._seconds:
            self.start()

    def stored(self) -> int | None:
        """Return the number of rows of the run up to the last batch; None if no row waits."""
        return self._stored if self._count or self._is_busy() else None

    def start(self) -> None:
        """Store all rows that wait in another thread, unless it is still storing others."""
        if self._is_busy() or not self._count:
            return
        self._join()
        rows, received = self._waiting[: self._count], self._received
        self._waiting, self._other = self._other, self._waiting
        self._count, self._at = 0, time.monotonic()
        thread = threading.Thread(target=self._store_rows, args=(rows, received), daemon=True)
        try:
            thread.start()
        except RuntimeError:  # the system has no thread left
            self._store_rows(rows, received)
        else:
            self._thread = thread

    def wait(self) -> None:
        """Wait until a batch is stored. Raises what `store` raised."""
        self.start()
        self._join()
        self._raise_failure()

    def drain(self) -> None:
        """Wait until all rows are stored. Raises what `store` raised, if that was not raised before."""
        while self.stored() is not None and not self._failed:
            self.wait()
        self._join()
        self._raise_failure()

    def _is_busy(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def _join(self) -> None:
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _store_rows(self, rows: Vector, received: int) -> None:
        try:
            if not self._failed:
                self._store(rows)
                self._stored = received
        except BaseException as error:
            self._failure, self._failed = error, True

    def _raise_failure(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
