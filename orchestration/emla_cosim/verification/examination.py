"""Run all checks of one FMU."""

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
"""Attributes of a subject to read once for all later checks, after a check that passed."""


def examine_fmu(subject: Subject, progress: Callable[[str], None] = lambda _: None) -> Examined:
    """Examine an FMU. Call `progress` with the name of each completed check."""
    began = time.monotonic()
    findings: dict[str, Finding] = {}
    for together in _group_checks(select_needed_checks(subject.settings)):
        for found in _findings(together, subject, findings):
            progress(found.check)
            findings[found.check] = found
            for name in _READ_AFTER.get(found.check, ()) if found.verdict == Verdict.PASSED else ():
                with suppress(Exception):  # reading may fail here although it worked in the check's process
                    getattr(subject, name)
    names = {c.name for c in select_checks(subject.settings)} | _find_failed(findings, subject.settings)
    shown = tuple(f for f in findings.values() if f.check in names)
    return Examined(subject.path, _facts(subject), shown, time.monotonic() - began)


def select_checks(settings: Settings) -> list[Check]:
    """Return the checks that the settings select, in the order of the catalogue."""
    if settings.recording is not None:
        return [RECORDED]
    return [
        c
        for c in CHECKS
        if (not settings.only or any(_is_match(p, c) for p in settings.only))
        and not any(_is_match(p, c) for p in settings.skip)
    ]


def check_names(patterns: Iterable[str]) -> None:
    """Raise CommandError for a name or pattern that matches no check."""
    for pattern in patterns:
        if not any(_is_match(pattern, c) for c in CHECKS):
            names = [c.name for c in CHECKS]
            near = difflib.get_close_matches(pattern, names, n=3, cutoff=0.4)
            meant = f"did you mean {' or '.join(near)}?" if near else "`emla verify --list` lists all checks."
            raise CommandError(f"there is no check '{pattern}'; {meant}", name=pattern, choices=names)


def _is_match(pattern: str, check: Check) -> bool:
    return check.group == pattern or matches_pattern(check.name, pattern)


def select_needed_checks(settings: Settings) -> list[Check]:
    """Return the selected checks and all that they need, in the order of the catalogue."""
    names = {c.name for c in select_checks(settings)}
    for check in (RECORDED, *reversed(CHECKS)):  # needed checks come first in CHECKS
        if check.name in names:
            names.update(check.needs)
    return [c for c in (*CHECKS, RECORDED) if c.name in names]


def _find_failed(findings: Mapping[str, Finding], settings: Settings) -> set[str]:
    """Return failed checks to report even if not selected: the checks that need them are only skipped."""
    failed = {name for name, f in findings.items() if f.verdict == Verdict.FAILED}
    return failed - {c.name for c in CHECKS if any(_is_match(p, c) for p in settings.skip)}


def _group_checks(checks: Sequence[Check]) -> Iterator[list[Check]]:
    """Yield groups of checks that can share a process."""
    reading = [c for c in checks if c in READING]
    for check in checks:
        if check not in READING:
            yield [check]
        elif check is reading[0]:
            yield reading


def _findings(checks: Sequence[Check], subject: Subject, before: Mapping[str, Finding]) -> Iterator[Finding]:
    """Run checks. Skip those that need a check which failed or was skipped."""
    known, ready = dict(before), []
    for check in checks:
        if (missing := _missing(check, known)) is not None:
            known[check.name] = skip_blocked(check, missing)
        else:
            ready.append(check)
    found = {f.check: f for f in run_checks(ready, subject, subject.settings)} if ready else {}
    for check in checks:
        if check.name in found:  # a needed check may be in the same group
            missing = _missing(check, known)
            known[check.name] = skip_blocked(check, missing) if missing is not None else found[check.name]
        yield known[check.name]


def _missing(check: Check, before: Mapping[str, Finding]) -> Finding | None:
    """Return a needed check that failed or was skipped, among those that have run."""
    needed = (before[name] for name in check.needs if name in before)
    return next((f for f in needed if f.verdict in (Verdict.FAILED, Verdict.SKIPPED)), None)


def _facts(subject: Subject) -> dict[str, str]:
    """Return facts about the FMU for the top of its report."""
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
