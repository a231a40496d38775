"""Processes of our own: how one ended, and that none outlives its parent."""

import os
import signal
import threading
import time
from collections.abc import Callable

_LOOK = 0.2
"""Seconds between two looks at whether the parent is still there."""


def how_it_ended(code: int) -> str:
    """How a process ended, by its exit code, or minus the signal that ended it."""
    if code >= 0:
        return f"exit code {code}"
    return signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"


def end_with(parent: int, end: Callable[[], None]) -> None:
    """Call `end` when this process has another parent, whatever else it is doing then."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK)
        end()

    threading.Thread(target=watch, daemon=True).start()
