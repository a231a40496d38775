"""The command that repeats one check of a report by hand."""

import shlex
from pathlib import Path

from emla_cosim.base.tubes.tolerance import Tolerance

from .findings import Examined, Finding
from .settings import Settings


def list_options(settings: Settings) -> tuple[str, ...]:
    """Return the options of `emla verify` that change what a check finds, if they are not the defaults."""
    plain = Settings()
    options: list[str] = []
    if settings.reference is not None:
        options += ["--reference", str(settings.reference)]
    for pattern, tolerance in settings.tolerance.items():
        if parts := _format_tolerance(tolerance):
            options += ["--tolerance", f"{pattern}={parts}"]
    if settings.seconds != plain.seconds:
        options += ["--seconds", f"{settings.seconds:g}"]
    if settings.memory != plain.memory:
        options += ["--memory", f"{settings.memory / 2**20:g}"]
    return tuple(options)


def format_command(examined: Examined, finding: Finding) -> str:
    """Return the command that repeats a check and explains what it finds."""
    only = [] if finding.check.startswith("system.") else ["--only", finding.check]
    return shlex.join(["emla", "verify", _safe(examined.file), *only, "--explain", *examined.options])


def _safe(path: Path) -> str:
    """Return a path that is not taken for an option."""
    return f"./{path}" if str(path).startswith("-") else str(path)


def _format_tolerance(tolerance: Tolerance) -> str:
    return ",".join(f"{name}:{value!r}" for name, value in vars(tolerance).items() if value is not None)
