"""Helpers for child processes: environment, exit status, and the end of their parent."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

LOOK = 0.2
"""Seconds between two checks that the parent is alive."""


def describe_exit(code: int) -> str:
    """Return how a process ended, from its exit code or the negative signal number."""
    if code >= 0:
        return f"exit code {code}"
    return signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"


def watch_parent(parent: int, end: Callable[[], None]) -> None:
    """Start a thread that calls `end` when the parent of this process has ended.

    Args:
        parent: The process id of the parent.
        end: Called from the thread, whatever this process is doing.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK)
        end()

    threading.Thread(target=watch, daemon=True).start()


def make_environment() -> dict[str, str]:
    """Return the environment of a child process that can import what this one can.

    Each folder is listed once, and removed folders are left out: FMUs leave theirs behind, and the system
    limits the length.
    """
    folders = dict.fromkeys(folder or str(Path.cwd()) for folder in sys.path)
    return {**os.environ, "PYTHONPATH": os.pathsep.join(x for x in folders if Path(x).exists())}


def count_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
