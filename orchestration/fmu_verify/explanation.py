"""What reports say of an FMU and of a finding: a short name, an explanation, the command to repeat it."""

import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from .findings import Examined, Finding
from .settings import Settings


def shorten_names(names: Sequence[str]) -> list[str]:
    """Shorten paths to the last parts that distinguish them."""
    paths = [Path(name) for name in names]
    short_names = [path.name for path in paths]
    for depth in range(2, max((len(p.parts) for p in paths), default=0) + 1):
        count = Counter(short_names)
        clashes = {n for n, k in count.items() if k > 1}
        short_names = [
            "/".join(p.parts[-depth:]) if n in clashes else n for p, n in zip(paths, short_names, strict=True)
        ]
    return short_names


def explain_finding(examined: Examined, finding: Finding, most: int | None = None) -> str:
    """Return message, at most `most` details, clause, what was done, hint and the command to repeat it."""
    details = list(finding.outcome.details[:most])
    if more := len(finding.outcome.details) - len(details):
        details.append(f"and {more} more")
    clause = f"{finding.clause}: \u201c{finding.clause.sentence}\u201d"
    procedure = f"What was done: {finding.done}" if finding.done else ""
    repeat = f"Repeat it: {format_command(examined, finding)}"
    parts = (finding.sentence, "\n".join(details), clause, procedure, finding.hint, repeat)
    return "\n\n".join(part for part in parts if part)


def list_options(settings: Settings) -> tuple[str, ...]:
    """Return the options of `emla verify` that change what a check finds, if they are not the defaults."""
    plain = Settings()
    options: list[str] = []
    if settings.reference is not None:
        options += ["--reference", str(settings.reference)]
    for pattern, tolerance in settings.tolerance.items():
        parts = [f"{name}:{value!r}" for name, value in vars(tolerance).items() if value is not None]
        options += ["--tolerance", f"{pattern}={','.join(parts)}"] if parts else []
    if settings.seconds != plain.seconds:
        options += ["--seconds", f"{settings.seconds:g}"]
    if settings.memory != plain.memory:
        options += ["--memory", f"{settings.memory / 2**20:g}"]
    return tuple(options)


def format_command(examined: Examined, finding: Finding) -> str:
    """Return the command that repeats a check and explains what it finds."""
    only = [] if finding.check.startswith("system.") else ["--only", finding.check]
    file = f"./{examined.file}" if str(examined.file).startswith("-") else str(examined.file)  # no option
    return shlex.join(["emla", "verify", file, *only, "--explain", *examined.options])
