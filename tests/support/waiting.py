"""Wait for what a process does, also on a busy machine."""

import time
from collections.abc import Callable
from pathlib import Path


def wait_for(is_true: Callable[[], object], seconds: float = 300.0) -> None:
    """Wait until it is true. AssertionError after so many seconds."""
    until = time.monotonic() + seconds
    while not is_true():
        assert time.monotonic() < until, f"not true after {seconds:.0f} s"
        time.sleep(0.01)


def has_rows(table: Path) -> bool:
    """Whether a results.csv has rows by now, so that a run that writes it has done many steps."""
    return table.exists() and table.stat().st_size > 10_000
