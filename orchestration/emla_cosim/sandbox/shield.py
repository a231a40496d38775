"""A process between an unreliable one and its parent: it receives what is meant for the parent."""

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

_END_SIGNAL, _SUBREAPER = 1, 36
"""Options of prctl."""


def shield(release: Callable[[], object]) -> None:
    """Continue in a child of this process. This process waits for it, and ends in the same way.

    A signal that the child sends to its parent ends this process only. Processes that the child leaves
    behind become children of this one, which ends them.

    Args:
        release: Called in this process, to close what only the child should have open.
    """
    if sys.platform != "linux":
        return
    adopt_orphans()
    child = os.fork()
    if child == 0:
        return
    release()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    end_children()
    if code < 0:
        with contextlib.suppress(OSError, ValueError):
            signal.signal(-code, signal.SIG_DFL)
        _disable_core_file()
        os.kill(os.getpid(), -code)
    os._exit(code)


def _disable_core_file() -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def end_with_parent() -> None:
    """Let the system end this process as soon as its parent ends, if it supports that."""
    _control(_END_SIGNAL, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)


def adopt_orphans() -> None:
    """Become the parent of processes that descendants leave behind, if the system supports it."""
    _control(_SUBREAPER, 1)


def _control(option: int, value: int) -> None:
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError, OSError):
            ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def list_children() -> list[int]:
    """Return the ids of the child processes of this process, also of those that have ended."""
    own, found = os.getpid(), []
    for entry in Path("/proc").iterdir() if Path("/proc/self/stat").exists() else ():
        if entry.name.isdigit():
            with contextlib.suppress(OSError, IndexError, ValueError):
                status = (entry / "stat").read_text(errors="replace")
                if int(status.rpartition(")")[2].split()[1]) == own:
                    found.append(int(entry.name))
    return found


def end_children() -> None:
    """End all child processes of this process, and those that they leave to it."""
    while children := list_children():
        for one in children:
            with contextlib.suppress(OSError):
                os.kill(one, signal.SIGKILL)
                os.waitpid(one, 0)
