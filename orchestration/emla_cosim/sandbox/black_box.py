"""A record of what a process is doing, in memory that can outlive the process.

An FMU can end its process in any call. Another process that shares this memory then knows which call it was,
and has the rows that were not written yet and the last message.
"""

import ctypes
import math
import os
import tempfile
from mmap import mmap
from pathlib import Path
from typing import Any


class Activity(ctypes.Structure):
    """The current activity of a thread. Of all threads but the first, only `code` and `time` are used.

    Attributes:
        code: Which instance executes which call; 0 for none.
        time: The time in s at which its doStep begins.
        filled: The number of rows that wait to be written.
        recorded: The number of rows that were added since compiled code was called.
        room: The bytes of this memory that hold the rows; 0 if they are elsewhere.
        told: The lengths of the messages in bytes.
        ended: 1 if the process ended normally.
    """

    _fields_ = (
        ("code", ctypes.c_int64),
        ("time", ctypes.c_double),
        ("filled", ctypes.c_int64),
        ("recorded", ctypes.c_int64),
        ("room", ctypes.c_int64),
        ("told", 2 * ctypes.c_int64),
        ("ended", ctypes.c_int64),
    )
    code: int
    time: float
    filled: int
    recorded: int
    room: int
    told: Any
    ended: int


SIZE = 64 * 2**20
"""Bytes of memory, enough for everything; the system provides only the pages that are used."""

THREADS = 32
"""The largest number of threads that can record their activity."""

RUN, MEMORY = 0, 1
"""The two messages: on the run, and the state of its recorders."""

_MESSAGES, _LONGEST, _ROWS, _TABLE = 2**12, 2**23 - 2**12, 2**24, 2**25
_APART = _MESSAGES // THREADS

LONGEST_NOTE = 2**12
"""Bytes of a message that fits into the smallest memory."""

_BLANK = bytes(_MESSAGES + LONGEST_NOTE)
"""Memory for the activities of threads and a short message, without rows."""


def _map_activities(memory: Any) -> list[Activity]:
    """Return the activities of all threads, at the beginning of a memory of zeros."""
    presents = [Activity.from_buffer(memory, _APART * thread) for thread in range(THREADS)]
    for each in presents:
        each.time = math.nan
    return presents


class _Box:
    """The memory of this process, private until it is shared."""

    memory: Any = None
    presents = _map_activities(bytearray(_BLANK))


def current_activity(thread: int = 0) -> Activity:
    """Return the activity of a thread of this process; that of the first describes the process too."""
    return _Box.presents[thread]


def list_busy_activities() -> list[Activity]:
    """Return the activities of all threads that execute a call of an FMU."""
    return [each for each in _Box.presents if each.code]


def use_shared_memory(memory: Any) -> None:
    """Use this memory, all zeros, from now on; objects from `current_activity` still use the previous one."""
    _Box.memory, _Box.presents = memory, _map_activities(memory)


def share_file(path: Path) -> None:
    """Use the memory of a `BlackBoxFile` from now on."""
    with path.open("r+b") as stream:
        use_shared_memory(mmap(stream.fileno(), 0))


def is_shared() -> bool:
    """Return whether another process can read messages."""
    return _Box.memory is not None


def write_message(content: bytes, which: int = RUN) -> bool:
    """Replace the last message of a kind.

    Args:
        content: The message.
        which: `RUN` or `MEMORY`.

    Returns:
        Whether the message fits; otherwise there is none.
    """
    told = current_activity().told
    told[which] = 0
    first = _MESSAGES + which * _LONGEST
    if is_shared() and len(content) <= min(_LONGEST, len(_Box.memory) - first):
        _Box.memory[first : first + len(content)] = content
        told[which] = len(content)
    return told[which] == len(content)


def read_message(which: int = RUN) -> bytes:
    """Return the last message of a kind, empty if there is none."""
    first = _MESSAGES + which * _LONGEST
    return _Box.memory[first : first + current_activity().told[which]] if is_shared() else b""


def reserve_rows(size: int) -> memoryview:
    """Return memory for `size` bytes of rows, shared if there is enough."""
    fits = is_shared() and _ROWS + size <= min(_TABLE, len(_Box.memory))
    current_activity().room = size if fits else 0
    return memoryview(_Box.memory)[_ROWS : _ROWS + size] if fits else memoryview(bytearray(size))


def reserve_table(size: int) -> memoryview | None:
    """Return shared memory for `size` bytes of rows that a table stores later; None if there is not enough.

    All callers in a process get the same memory.
    """
    fits = is_shared() and _TABLE + size <= len(_Box.memory)
    return memoryview(_Box.memory)[_TABLE : _TABLE + size] if fits else None


class BlackBoxFile:
    """A file that another process uses as its memory, see `share_file`, and this process reads."""

    def __init__(self) -> None:
        descriptor, name = tempfile.mkstemp(prefix="emla-call-")
        self.path = Path(name)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(_BLANK)

    def present(self) -> Activity:
        """Return the current or last activity of the process."""
        return Activity.from_buffer_copy(self.path.read_bytes())

    def message(self) -> bytes:
        """Return the last message, empty if there is none or the process is just writing one."""
        content = self.path.read_bytes()
        return content[_MESSAGES:][: Activity.from_buffer_copy(content).told[RUN]]

    def close(self) -> None:
        """Remove the file."""
        self.path.unlink(missing_ok=True)
