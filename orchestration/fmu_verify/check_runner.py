"""Run checks of one subject in a subprocess."""

import re
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from emla_cosim.fmu.load_diagnosis import explain_python_needs
from emla_cosim.fmu.python_exceptions import REMEDY

from .catalogue import RECORDED
from .check import Check
from .findings import Finding
from .host.fresh_process import EndedError
from .scratch import list_writable, use_scratch
from .settings import Settings
from .subprocess_run import run_each_in_subprocess
from .terms import in_terms_of
from .verdict import (
    LEAVES_EXCEPTION,
    RETURNS,
    CheckOutcome,
    NotRunError,
    Verdict,
    blocked,
    failed,
    is_own_rule,
    noted,
    skipped,
)

_LICENSE = re.compile(r"licen[sc]e", re.IGNORECASE)
"""A word in messages of FMUs that do not run without a license of their tool."""

_MOST_MEMORY = 2**62
"""Largest limit of memory in bytes that systems take."""


def run_check(check: Check, subject: Any, settings: Settings) -> Finding:
    """Run a check within the limits of the settings."""
    return next(run_checks([check], subject, settings))


def run_checks(checks: Sequence[Check], subject: Any, settings: Settings) -> Iterator[Finding]:
    """Run checks in sequence in one process. Start a new process if a check ends it.

    The limits of the first check apply to all.
    """
    seconds, memory = (
        checks[0].time_factor * settings.seconds,
        min(round(checks[0].memory_factor * settings.memory), _MOST_MEMORY),
    )
    began = time.monotonic()
    items, places = [(check, subject) for check in checks], list_writable(subject, checks[0] is RECORDED)
    outcomes = run_each_in_subprocess(_do, items, seconds, memory, places)
    for check, outcome in zip(checks, outcomes, strict=True):
        ended = time.monotonic()
        yield make_finding(check, outcome, ended - began, _version(subject))
        began = ended


def skip_blocked(check: Check, needed: Finding, version: int = 2) -> Finding:
    """Return the finding for a check that needs one that failed or was skipped."""
    reason = needed.sentence  # already names the first cause if `needed` was blocked itself
    if needed.verdict == Verdict.FAILED:
        reason = f"It needs {needed.check}, which failed."
    elif not reason.startswith("It needs "):
        reason = f"It needs {needed.check}, which was skipped: {reason}"
    not_applicable = needed.verdict == Verdict.SKIPPED and not needed.outcome.blocked
    return make_finding(check, replace(blocked(reason), blocked=not not_applicable), version=version)


def make_finding(check: Check, outcome: CheckOutcome, seconds: float = 0.0, version: int = 2) -> Finding:
    """Return an outcome together with the title, clause and hint of its check, for a version of FMI."""
    check = check.of(version)
    if check.advisory and outcome.verdict == Verdict.FAILED:
        outcome = (
            replace(noted(outcome.sentence), details=outcome.details)
            if is_own_rule(check.clause)
            else replace(outcome, verdict=Verdict.WARNING, clause=None)
        )
    clause, hint = outcome.clause or check.clause, outcome.hint or check.hint
    return Finding(check.name, check.title, outcome, clause, hint, seconds, check.done)


def _do(check: Check, subject: Any) -> CheckOutcome:
    use_scratch(subject)
    outcome = _examine(check, subject)
    with suppress(Exception):  # it cannot be read
        _ = subject.tree
    if (version := _version(subject)) != 2 and outcome.clause is None:
        outcome = replace(outcome, clause=check.clause)
    return in_terms_of(version, outcome)


def _version(subject: Any) -> int:
    """Return the version of FMI of an FMU as far as it is known; 2 for a system."""
    return getattr(subject, "known_version", 2)


def _examine(check: Check, subject: Any) -> CheckOutcome:
    from .host.hosted_instance import CallError  # loads fmpy.fmi2

    if check.only_for not in (0, _version(subject)):
        return skipped(f"FMI {_version(subject)}.0 does not have it.")
    try:
        return check.examine(subject)
    except CallError as error:
        if _LICENSE.search(str(error)):
            said = f"It needs a license that this machine lacks. {error}"
            return blocked(said, hint="Verify it where its license is installed.", gaps=(said,))
        hint = explain_python_needs(subject.folder, [str(error)]) if check.name == "instance.created" else ""
        hint = hint or (REMEDY if error.clause == LEAVES_EXCEPTION else "")
        return failed(str(error), clause=error.clause or (None if error.has_status else RETURNS), hint=hint)
    except NotRunError as error:
        return blocked(str(error), gaps=(str(error),))
    except EndedError as error:
        return failed(str(error), clause=RETURNS)
