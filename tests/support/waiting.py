"""Waiting for what a process does, however long the machine takes for it."""

import time
from collections.abc import Callable
from pathlib import Path


def wait_for(is_true: Callable[[], object], seconds: float = 60.0) -> None:
    """Look again and again until it is true; AssertionError where it never is."""
    until = time.monotonic() + seconds
    while not is_true():
        assert time.monotonic() < until, "it never came"
        time.sleep(0.01)


def has_rows(table: Path) -> bool:
    """Whether a results.csv has rows by now, so that a run that writes it has done many steps."""
    return table.exists() and table.stat().st_size > 10_000
