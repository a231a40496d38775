"""Run the checks of a whole system."""

import time
from collections.abc import Callable
from pathlib import Path

from .catalogue import SYSTEM
from .check_runner import run_check
from .checks.systems import WholeSystem
from .findings import Examined
from .settings import Settings


def examine_system(path: Path, settings: Settings, progress: Callable[[str], None]) -> Examined:
    """Run a system, and compare it with an earlier run if the settings name one."""
    began = time.monotonic()
    runs, agrees = SYSTEM
    check = agrees if settings.reference is not None else runs
    progress(check.name)
    found = run_check(check, WholeSystem(path, settings), settings)
    return Examined(path, {}, (found,), time.monotonic() - began)
