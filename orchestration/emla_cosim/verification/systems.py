"""The examination of a whole system, as that of an FMU is in `examination`."""

import time
from collections.abc import Callable
from pathlib import Path

from .asking import asked
from .catalogue import SYSTEM
from .checks.systems import WholeSystem
from .findings import Examined
from .settings import Settings


def examined_system(path: Path, settings: Settings, told: Callable[[str], None]) -> Examined:
    """Run a system, and hold it against a run that was kept where the settings name one."""
    began = time.monotonic()
    runs, agrees = SYSTEM
    check = agrees if settings.reference is not None else runs
    told(check.name)
    found = asked(check, WholeSystem(path, settings), settings)
    return Examined(path, {}, (found,), time.monotonic() - began)
