"""A file of rows in memory: when the process that fills it has ended, another one reads them."""

import os
import tempfile
from mmap import mmap
from pathlib import Path

import numpy as np

from ..base.arrays import Vector
from ..base.files import UNFINISHED, mark_of_process

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
    left = size
    while left:
        left -= os.write(descriptor, _ZEROS[: min(left, len(_ZEROS))])


def read_rows(path: Path, width: int, count: int) -> tuple[int, Vector]:
    """Return the last rows of a run that an ended process left. The first may be incomplete if it is stored.

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
