"""All checks of one FMU, each in its turn, in a process of its own."""

import difflib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress

from ..base.errors import CommandError
from ..base.files import hash_file
from ..base.patterns import matches_pattern
from .catalogue import CHECKS, READING, RECORDED
from .check import Check
from .check_runner import run_checks, skip_blocked
from .findings import Examined, Finding
from .settings import Settings
from .subject import Subject
from .verdict import Verdict

_READ_AFTER = {"description.readable": ("tree", "description"), "description.schema": ("declared",)}
"""What of a subject is read here, once for all later checks, after a check that passed."""


def examine_fmu(subject: Subject, told: Callable[[str], None] = lambda _: None) -> Examined:
    """Examine an FMU; `told` is called with the name of each check when it is done."""
    began = time.monotonic()
    findings: dict[str, Finding] = {}
    for together in _group_checks(select_needed_checks(subject.settings)):
        for found in _findings(together, subject, findings):
            told(found.check)
            findings[found.check] = found
            for name in _READ_AFTER.get(found.check, ()) if found.verdict == Verdict.PASSED else ():
                with suppress(Exception):  # it was read in another process, but this one is another
                    getattr(subject, name)
    names = {c.name for c in select_checks(subject.settings)} | _find_failed(findings, subject.settings)
    shown = tuple(f for f in findings.values() if f.check in names)
    return Examined(subject.path, _facts(subject), shown, time.monotonic() - began)


def select_checks(settings: Settings) -> list[Check]:
    """The checks that the settings mean, in the order of the catalogue."""
    if settings.recording is not None:
        return [RECORDED]
    return [
        c
        for c in CHECKS
        if (not settings.only or any(_is_match(p, c) for p in settings.only))
        and not any(_is_match(p, c) for p in settings.skip)
    ]


def check_names(patterns: Iterable[str]) -> None:
    """Raise CommandError for a name or pattern that means no check."""
    for pattern in patterns:
        if not any(_is_match(pattern, c) for c in CHECKS):
            names = [c.name for c in CHECKS]
            near = difflib.get_close_matches(pattern, names, n=3, cutoff=0.4)
            meant = f"did you mean {' or '.join(near)}?" if near else "`emla verify --list` shows them."
            raise CommandError(f"there is no check '{pattern}'; {meant}", name=pattern, choices=names)


def _is_match(pattern: str, check: Check) -> bool:
    return check.group == pattern or matches_pattern(check.name, pattern)


def select_needed_checks(settings: Settings) -> list[Check]:
    """The checks that the settings mean, and all that these need, in the order of the catalogue."""
    names = {c.name for c in select_checks(settings)}
    for check in (RECORDED, *reversed(CHECKS)):  # what is needed stands before
        if check.name in names:
            names.update(check.needs)
    return [c for c in (*CHECKS, RECORDED) if c.name in names]


def _find_failed(findings: Mapping[str, Finding], settings: Settings) -> set[str]:
    """Checks that failed and are to be told of, asked for or not: what needs them says nothing."""
    failed = {name for name, f in findings.items() if f.verdict == Verdict.FAILED}
    return failed - {c.name for c in CHECKS if any(_is_match(p, c) for p in settings.skip)}


def _group_checks(checks: Sequence[Check]) -> Iterator[list[Check]]:
    """The checks, those that may share a process together."""
    reading = [c for c in checks if c in READING]
    for check in checks:
        if check not in READING:
            yield [check]
        elif check is reading[0]:
            yield reading


def _findings(checks: Sequence[Check], subject: Subject, before: Mapping[str, Finding]) -> Iterator[Finding]:
    """What is found by checks, but for those that need one that did not pass."""
    known, ready = dict(before), []
    for check in checks:
        if (missing := _missing(check, known)) is not None:
            known[check.name] = skip_blocked(check, missing)
        else:
            ready.append(check)
    found = {f.check: f for f in run_checks(ready, subject, subject.settings)} if ready else {}
    for check in checks:
        if check.name in found:  # what it needs may be one of these
            missing = _missing(check, known)
            known[check.name] = skip_blocked(check, missing) if missing is not None else found[check.name]
        yield known[check.name]


def _missing(check: Check, before: Mapping[str, Finding]) -> Finding | None:
    """What a check needs and did not pass; what is not known yet may."""
    needed = (before[name] for name in check.needs if name in before)
    return next((f for f in needed if f.verdict in (Verdict.FAILED, Verdict.SKIPPED)), None)


def _facts(subject: Subject) -> dict[str, str]:
    """What a person wants to know of it first."""
    facts = {}
    with suppress(OSError):
        facts["SHA-256"] = hash_file(subject.path)
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
