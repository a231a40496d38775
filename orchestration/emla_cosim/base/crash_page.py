"""A page of memory on what a process is doing, which can outlive the process.

An FMU can end its process in any call. Another process that shares this page then knows which call it was,
how many rows were complete, and where to find what else it needs. C code writes to the page, see `stepper.h`.
"""

import ctypes
import math
import os
import tempfile
from enum import IntEnum
from mmap import mmap
from pathlib import Path
from typing import Any


class Activity(ctypes.Structure):
    """The current activity of a thread. Of all threads but the first, only `code` and `time` are used.

    Attributes:
        code: Which instance executes which call; 0 for none.
        time: The time in s at which its doStep begins.
        rows: The number of complete rows of the run.
        stage: A `Stage` of the run.
        noted: The length of the note in bytes.
        ended: 1 if the process ended normally.
    """

    _fields_ = (
        ("code", ctypes.c_int64),
        ("time", ctypes.c_double),
        ("rows", ctypes.c_int64),
        ("stage", ctypes.c_int64),
        ("noted", ctypes.c_int64),
        ("ended", ctypes.c_int64),
    )
    code: int
    time: float
    rows: int
    stage: int
    noted: int
    ended: int


class Stage(IntEnum):
    """How far a run came."""

    PREPARING = 0
    STEPPING = 1
    ROWS_WRITTEN = 2
    FILES_WRITTEN = 3


THREADS = 32
"""The largest number of threads that can record their activity."""

LONGEST_NOTE = 2**12
"""The largest length of a note in bytes."""

_ACTIVITIES = 2**12
_DISTANCE = _ACTIVITIES // THREADS

SIZE = _ACTIVITIES + LONGEST_NOTE
"""Bytes of memory."""


def _map_activities(content: Any) -> list[Activity]:
    """Return the activities of all threads, at the beginning of a memory of zeros."""
    activities = [Activity.from_buffer(content, _DISTANCE * thread) for thread in range(THREADS)]
    for activity in activities:
        activity.time = math.nan
    return activities


class _Page:
    """The page of this process, private until it is shared."""

    content: Any = bytearray(SIZE)
    activities = _map_activities(content)
    is_shared = False


def current_activity(thread: int = 0) -> Activity:
    """Return the activity of a thread of this process; that of the first describes the process too."""
    return _Page.activities[thread]


def list_busy_activities() -> list[Activity]:
    """Return the activities of all threads that execute a call of an FMU."""
    return [activity for activity in _Page.activities if activity.code]


def share_file(path: Path) -> None:
    """Use a `CrashPageFile` from now on; objects from `current_activity` still use the previous page."""
    with path.open("r+b") as stream:
        _Page.content = mmap(stream.fileno(), 0)
    _Page.activities, _Page.is_shared = _map_activities(_Page.content), True


def is_shared() -> bool:
    """Return whether another process can read the page."""
    return _Page.is_shared


def write_note(text: str) -> None:
    """Replace the note; a long one is cut off. While it is written, there is none."""
    content = text.encode("utf-8", "surrogateescape")[:LONGEST_NOTE]
    activity = current_activity()
    activity.noted = 0
    _Page.content[_ACTIVITIES : _ACTIVITIES + len(content)] = content
    activity.noted = len(content)


def read_note() -> str:
    """Return the note of this process or one that shares the page, empty without one."""
    return _decode_note(_Page.content, current_activity())


def _decode_note(page: Any, activity: Activity) -> str:
    if not 0 <= activity.noted <= LONGEST_NOTE:  # an FMU wrote to the page
        return ""
    return bytes(page[_ACTIVITIES:][: activity.noted]).decode("utf-8", "replace")


class CrashPageFile:
    """A file that another process uses as its page, see `share_file`, and this process reads."""

    def __init__(self) -> None:
        descriptor, name = tempfile.mkstemp(prefix=".emla-call-")
        self.path = Path(name)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(bytes(SIZE))

    def activity(self) -> Activity:
        """Return the current or last activity of the process."""
        return Activity.from_buffer_copy(self.path.read_bytes())

    def note(self) -> str:
        """Return the last note, empty if there is none or the process is just writing one."""
        content = self.path.read_bytes()
        return _decode_note(content, Activity.from_buffer_copy(content))

    def close(self) -> None:
        """Remove the file."""
        self.path.unlink(missing_ok=True)
