"""What a process was doing, in memory that can outlive it.

An FMU may end its process in any call. Whoever shares this memory knows then which call it was, has the
rows that were not written yet, and the last message.
"""

import ctypes
import math
import os
import tempfile
from mmap import mmap
from pathlib import Path
from typing import Any


class Activity(ctypes.Structure):
    """What goes on now.

    `code` says which slave does which call (0: none), `time` in s when its doStep begins. `filled` rows
    wait to be written, and `recorded` more came since compiled code was called; they are in `room` bytes
    of this memory, or elsewhere if that is 0. `told` is how long the messages are in bytes, and `ended`
    is 1 when the process came to an end of its own. Of threads beside the first only `code` and `time` count.
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
"""Bytes of memory that has room for everything; only what is used costs anything."""

THREADS = 32
"""So many threads can say what they do."""

RUN, MEMORY = 0, 1
"""The two messages: about the run, and what its recorders remember."""

_MESSAGES, _LONGEST, _ROWS = 2**12, 2**23 - 2**12, 2**24
_APART = _MESSAGES // THREADS

LONGEST_NOTE = 2**12
"""Bytes of a message that also the smallest memory has room for."""

_BLANK = bytes(_MESSAGES + LONGEST_NOTE)
"""Memory that has room for what threads say and for a short message, but for no rows."""


def _map_activities(memory: Any) -> list[Activity]:
    """Where every thread says what it does, at the beginning of a memory of zeros."""
    presents = [Activity.from_buffer(memory, _APART * thread) for thread in range(THREADS)]
    for each in presents:
        each.time = math.nan
    return presents


class _Box:
    """The memory of this process: its own, until it is shared."""

    memory: Any = None
    presents = _map_activities(bytearray(_BLANK))


def current_activity(thread: int = 0) -> Activity:
    """Where a thread of this process says what goes on; the first says it of the process as well."""
    return _Box.presents[thread]


def list_busy_activities() -> list[Activity]:
    """What all threads say that are in a call of a slave."""
    return [each for each in _Box.presents if each.code]


def use_shared_memory(memory: Any) -> None:
    """Use this memory, all zeros, from now on; who took `current_activity` before does not."""
    _Box.memory, _Box.presents = memory, _map_activities(memory)


def share_file(path: Path) -> None:
    """Use the memory of a `BlackBoxFile` from now on."""
    with path.open("r+b") as stream:
        use_shared_memory(mmap(stream.fileno(), 0))


def is_shared() -> bool:
    """Whether somebody may read a message."""
    return _Box.memory is not None


def write_message(content: bytes, which: int = RUN) -> bool:
    """Leave a message in place of the last one of its kind; none where it is too long. Whether it fits."""
    told = current_activity().told
    told[which] = 0
    first = _MESSAGES + which * _LONGEST
    if is_shared() and len(content) <= min(_LONGEST, len(_Box.memory) - first):
        _Box.memory[first : first + len(content)] = content
        told[which] = len(content)
    return told[which] == len(content)


def read_message(which: int = RUN) -> bytes:
    """The last message; empty if there is none."""
    first = _MESSAGES + which * _LONGEST
    return _Box.memory[first : first + current_activity().told[which]] if is_shared() else b""


def reserve_rows(size: int) -> memoryview:
    """Memory for so many bytes of rows, shared where it is large enough."""
    fits = is_shared() and _ROWS + size <= len(_Box.memory)
    current_activity().room = size if fits else 0
    return memoryview(_Box.memory)[_ROWS : _ROWS + size] if fits else memoryview(bytearray(size))


class BlackBoxFile:
    """A file that another process uses as its memory, see `share_file`, and that is read here."""

    def __init__(self) -> None:
        descriptor, name = tempfile.mkstemp(prefix="emla-call-")
        self.path = Path(name)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(_BLANK)

    def present(self) -> Activity:
        """What the process is doing, or was doing when it ended."""
        return Activity.from_buffer_copy(self.path.read_bytes())

    def message(self) -> bytes:
        """The last message; empty if there is none, or the next one is just being left."""
        content = self.path.read_bytes()
        return content[_MESSAGES:][: Activity.from_buffer_copy(content).told[RUN]]

    def close(self) -> None:
        """Remove it."""
        self.path.unlink(missing_ok=True)
