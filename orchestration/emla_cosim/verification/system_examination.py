"""The examination of a whole system, as that of an FMU is in `examination`."""

import time
from collections.abc import Callable
from pathlib import Path

from .catalogue import SYSTEM
from .check_runner import run_check
from .checks.systems import WholeSystem
from .findings import Examined
from .settings import Settings


def examine_system(path: Path, settings: Settings, told: Callable[[str], None]) -> Examined:
    """Run a system, and hold it against a run that was kept where the settings name one."""
    began = time.monotonic()
    runs, agrees = SYSTEM
    check = agrees if settings.reference is not None else runs
    told(check.name)
    found = run_check(check, WholeSystem(path, settings), settings)
    return Examined(path, {}, (found,), time.monotonic() - began)
