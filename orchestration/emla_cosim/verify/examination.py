"""All checks of one FMU, each in its turn, in a process of its own."""

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from ..patterns import fits
from .apart import apart
from .catalogue import CHECKS
from .check import Check
from .report import Examined, Finding
from .subject import Subject
from .verdict import Outcome, Verdict, failed, skipped

_HARMLESS = "description.readable"
"""The check after which the model description can be read here, once for all later checks."""


def examined(subject: Subject, told: Callable[[str], None] = lambda _: None) -> Examined:
    """Examine an FMU; `told` is called with the name of each check before it is done."""
    began = time.monotonic()
    wanted = chosen(subject.settings.only, subject.settings.skip)
    findings: dict[str, Finding] = {}
    for check in _with_needs(wanted):
        told(check.name)
        findings[check.name] = _finding(check, subject, findings)
        if check.name == _HARMLESS and findings[check.name].verdict == Verdict.PASSED:
            with suppress(Exception):  # it was read in another process, but this one is another
                _ = subject.tree, subject.description
    names = {c.name for c in wanted}
    shown = tuple(f for f in findings.values() if f.check in names)
    return Examined(subject.path, _facts(subject), shown, time.monotonic() - began)


def chosen(only: Sequence[str], skip: Sequence[str]) -> list[Check]:
    """The checks that these names and patterns mean, in the order of the catalogue."""
    return [
        c
        for c in CHECKS
        if (not only or any(_means(p, c) for p in only)) and not any(_means(p, c) for p in skip)
    ]


def _means(pattern: str, check: Check) -> bool:
    return check.group == pattern or fits(check.name, pattern)


def _with_needs(wanted: Sequence[Check]) -> Iterator[Check]:
    """The checks and all that they need, in the order of the catalogue."""
    names = {c.name for c in wanted}
    for check in reversed(CHECKS):  # what is needed stands before
        if check.name in names:
            names.update(check.needs)
    return (c for c in CHECKS if c.name in names)


def _finding(check: Check, subject: Subject, before: dict[str, Finding]) -> Finding:
    began = time.monotonic()
    missing = [n for n in check.needs if before[n].verdict in (Verdict.FAILED, Verdict.SKIPPED)]
    outcome = _blocked(before[missing[0]]) if missing else _outcome(check, subject)
    seconds = time.monotonic() - began
    return Finding(check.name, check.title, outcome, check.clause, outcome.hint or check.hint, seconds)


def _blocked(needed: Finding) -> Outcome:
    how = "failed" if needed.verdict == Verdict.FAILED else "was skipped"
    return skipped(f"It needs {needed.check}, which {how}.")


def _outcome(check: Check, subject: Subject) -> Outcome:
    settings = subject.settings
    try:
        return apart(_do, (check, subject), check.patience * settings.seconds, settings.memory)
    except Exception as error:  # a slip of ours is told, and costs nobody the rest of the report
        return failed(f"The check itself went wrong: {type(error).__name__}: {error}.")


def _do(check: Check, subject: Subject) -> Outcome:
    from .host.afresh import EndedError
    from .host.instance import CallError  # which loads fmpy's part for FMI 2.0

    try:
        return check.examine(subject)
    except (CallError, EndedError) as error:
        return failed(str(error))


def _facts(subject: Subject) -> dict[str, str]:
    """What a person wants to know of it first."""
    facts = {}
    with suppress(OSError):
        facts["SHA-256"] = _sha256(subject.path)
        facts["size"] = f"{subject.path.stat().st_size / 1024:,.0f} KiB"
    if "description" in vars(subject):
        with suppress(Exception):
            description = subject.description
            facts["model"] = str(description.modelName)
            facts["FMI"] = str(description.fmiVersion)
            facts["kinds"] = " and ".join(subject.kinds)
            facts["made by"] = str(description.generationTool or "an unnamed tool")
            facts["variables"] = str(len(description.modelVariables))
            folders = sorted(p.name for p in (subject.folder / "binaries").glob("*"))
            facts["platforms"] = ", ".join(folders) or "none"
    return {name: facts[name] for name in sorted(facts)}


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
