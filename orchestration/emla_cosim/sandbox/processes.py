"""Processes of our own: how one ended, and that none outlives its parent."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

LOOK = 0.2
"""Seconds between two looks at whether the parent is still there."""


def describe_exit(code: int) -> str:
    """How a process ended, by its exit code, or minus the signal that ended it."""
    if code >= 0:
        return f"exit code {code}"
    return signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"


def watch_parent(parent: int, end: Callable[[], None]) -> None:
    """Call `end` when this process has another parent, whatever else it is doing then."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK)
        end()

    threading.Thread(target=watch, daemon=True).start()


def make_environment() -> dict[str, str]:
    """The environment of a process that finds what this one finds.

    Each folder once, and none that is gone: FMUs leave theirs behind, and the system limits the length.
    """
    folders = dict.fromkeys(folder or str(Path.cwd()) for folder in sys.path)
    return {**os.environ, "PYTHONPATH": os.pathsep.join(x for x in folders if Path(x).exists())}


def count_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
