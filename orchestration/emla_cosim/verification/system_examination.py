"""Run the checks of a whole system."""

import time
from collections.abc import Callable
from pathlib import Path

from .catalogue import SYSTEM
from .check_runner import run_check
from .checks.systems import WholeSystem
from .confinement import list_gaps
from .findings import Examined, Finding
from .gate import find_objections
from .settings import Settings


def examine_system(
    path: Path, settings: Settings, scratch: Path, progress: Callable[[Finding], None]
) -> Examined:
    """Run a system in a scratch folder. Compare it with an earlier run if the settings name one."""
    began = time.monotonic()
    runs, agrees = SYSTEM
    check = agrees if settings.reference is not None else runs
    found = run_check(check, WholeSystem(path, settings, scratch), settings)
    progress(found)
    seconds = time.monotonic() - began
    return Examined(
        path,
        {},
        (found,),
        seconds,
        objections=find_objections((found,), settings),
        not_examined=tuple(list_gaps()),
    )
