"""The buffer that passes the rows of a run to its recorders, and its file, which outlives a process."""

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from mmap import mmap
from pathlib import Path
from typing import Any

import numpy as np

from ..base import crash_page
from ..base.arrays import Vector
from ..base.files import UNFINISHED, mark_of_process
from ..base.units import LinearTransformation
from .recorder import Recorder, recording

BLOCK_ROWS, BLOCK_SIZE = 4000, 2**22
"""Number of rows in a block for the recorders, and its largest size in bytes."""

RING_SIZE, LEAST_BLOCKS = 2**24, 4
"""Size in bytes of a buffer that another process can read, and the least number of its blocks."""


class RowBuffer:
    """A buffer of rows that the stepping fills. Full blocks are passed to the recorders.

    If a recorder has memory for it that outlives the process, the buffer is a ring there. It keeps rows until
    the recorders have stored them, and `crash_page` has the number of all rows so far.

    Args:
        width: Number of values in a row.
        recorders: The recorders.
        steps_per_row: Every n-th communication point is recorded.
        block_rows: Largest number of rows in a block.
        transformations: Transformations of signals that recorders get in another unit, by position.
        texts: Positions in a row of Strings. A row that has one is passed on at once, because another process
            that finishes this run has no texts.
        map_rows: Returns memory of a size in bytes that outlives the process, or None.
    """

    def __init__(
        self,
        width: int,
        recorders: Sequence[Recorder],
        steps_per_row: int = 1,
        block_rows: int = BLOCK_ROWS,
        transformations: Mapping[int, LinearTransformation] | None = None,
        texts: Sequence[int] = (),
        map_rows: Callable[[int], Any] = lambda size: None,
    ) -> None:
        self.steps_per_row = steps_per_row
        self._recorders, self._transformations, self._texts = recorders, transformations or {}, list(texts)
        self._block = max(min(block_rows, BLOCK_SIZE // (8 * width)), 1)
        blocks = max(RING_SIZE // (8 * width * self._block), LEAST_BLOCKS)
        mapped_rows = map_rows(blocks * self._block * width * 8)
        self._is_mapped = mapped_rows is not None
        rows = np.empty(self._block * width) if mapped_rows is None else np.frombuffer(mapped_rows)
        self._ring = rows.reshape(-1, width)
        self._activity = crash_page.current_activity()
        self._filled = self._passed = 0
        """Numbers of rows that are complete, and that the recorders have, since the beginning."""
        self._activity.rows = self._filled

    def room(self, most: int) -> Vector:
        """Return free rows to fill: at least one, at most `most`."""
        first = self._filled % len(self._ring)
        return self._ring[first : first + min(most, self._block - first % self._block)]

    def commit(self, count: int) -> None:
        """Take the first `count` of the free rows as filled. Raises RecordingError."""
        self._filled += count
        self._activity.rows = self._filled  # compiled code may have counted them, too
        is_full = self._filled % self._block == 0
        last = self._ring[(self._filled - 1) % len(self._ring)]
        if is_full or (self._texts and np.isfinite(last[self._texts]).any()):
            self.flush()
        if is_full and self._is_mapped:  # the next block may overwrite only what is stored
            self._call_each(lambda recorder: recorder.release(len(self._ring) - self._block))

    def flush(self) -> None:
        """Pass the filled rows to the recorders. Raises RecordingError."""
        self._activity.rows = self._filled
        count = self._filled - self._passed
        if not count:
            return
        first, self._passed = self._passed % len(self._ring), self._filled
        rows = convert_rows(self._ring[first : first + count], self._transformations).view()
        rows.flags.writeable = False  # all recorders get the same array
        self._call_each(lambda recorder: recorder.write(rows))

    def end(self) -> None:
        """Pass the remaining rows to the recorders, and end all of them. Raises RecordingError."""
        try:
            self.flush()
        finally:
            self._call_each(lambda recorder: recorder.end())

    def _call_each(self, call: Callable[[Recorder], None]) -> None:
        """Do a call with every recorder, also after a failure, then raise the first failure."""
        failure: BaseException | None = None
        for recorder in self._recorders:
            try:
                with recording(recorder):
                    call(recorder)
            except BaseException as error:
                failure = failure or error
        if failure is not None:
            raise failure


def convert_rows(rows: Vector, transformations: Mapping[int, LinearTransformation]) -> Vector:
    """Return rows with these signals in the units of results, in new memory if there are such signals."""
    if transformations:
        rows = rows.copy()
    for signal, transformation in transformations.items():
        column = rows[:, 1 + signal]
        column[:] = transformation.factor * column + transformation.offset
    return rows


_ZEROS = bytes(2**20)


class RowFile:
    """A hidden file in an output folder. After its processes were killed, `remove_unfinished` removes it.

    Args:
        folder: The folder.
        size: Size in bytes.

    Attributes:
        path: the file.
        memory: its content.

    Raises:
        OSError: There is no space, or the file system has no shared memory.
    """

    def __init__(self, folder: Path, size: int) -> None:
        descriptor, name = tempfile.mkstemp(prefix=f"{UNFINISHED}{mark_of_process()}-", dir=folder)
        self.path = Path(name)
        try:
            _allocate(descriptor, size)
            self.memory = mmap(descriptor, size)
        except BaseException:
            self.remove()
            raise
        finally:
            os.close(descriptor)

    def remove(self) -> None:
        """Remove the file; its memory can be used until the process ends."""
        self.path.unlink(missing_ok=True)


def _allocate(descriptor: int, size: int) -> None:
    """Reserve space on the disk: a process that writes to memory without any is killed."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
        return
    remaining = size
    while remaining:
        remaining -= os.write(descriptor, _ZEROS[: min(remaining, len(_ZEROS))])


def read_rows(path: Path, width: int, count: int) -> tuple[int, Vector]:
    """Return the last rows of a run that an ended process left.

    The first one may be overwritten in part; the recorders have stored it then.

    Args:
        path: The file.
        width: Number of values in a row.
        count: Number of rows of the run.

    Returns:
        The number of rows before them, and an array of shape (n, width).

    Raises:
        OSError: The file cannot be read.
    """
    ring = np.fromfile(path).reshape(-1, width)
    first = max(count - len(ring), 0)
    return first, ring[np.arange(first, count) % len(ring)]
