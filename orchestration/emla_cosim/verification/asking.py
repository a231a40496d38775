"""One check asked of one subject, in a process of its own, and what it found."""

import time
from collections.abc import Iterator, Sequence
from typing import Any

from .apart import apart_each
from .check import Check
from .findings import Finding
from .host.afresh import EndedError
from .settings import Settings
from .verdict import Outcome, Verdict, failed, skipped


def asked(check: Check, subject: Any, settings: Settings) -> Finding:
    """Do a check, within the limits of the settings."""
    return next(asked_each([check], subject, settings))


def asked_each(checks: Sequence[Check], subject: Any, settings: Settings) -> Iterator[Finding]:
    """Do checks one after the other in one process, a new one where one of them ends it.

    The first one's limits hold for all.
    """
    seconds, memory = checks[0].patience * settings.seconds, round(checks[0].room * settings.memory)
    began = time.monotonic()
    outcomes = apart_each(_do, [(check, subject) for check in checks], seconds, memory)
    for check, outcome in zip(checks, outcomes, strict=True):
        ended = time.monotonic()
        yield finding(check, outcome, ended - began)
        began = ended


def blocked(check: Check, needed: Finding) -> Finding:
    """What is said of a check that needs one that did not pass."""
    told = needed.sentence  # which says it already where that was blocked itself
    if needed.verdict == Verdict.FAILED:
        told = f"It needs {needed.check}, which failed."
    elif not told.startswith("It needs "):
        told = f"It needs {needed.check}, which was skipped: {told}"
    return finding(check, skipped(told))


def finding(check: Check, outcome: Outcome, seconds: float = 0.0) -> Finding:
    """An outcome with what its check rests on."""
    return Finding(check.name, check.title, outcome, check.clause, outcome.hint or check.hint, seconds)


def _do(check: Check, subject: Any) -> Outcome:
    from .host.instance import CallError  # which loads fmpy's part for FMI 2.0

    try:
        return check.examine(subject)
    except (CallError, EndedError) as error:
        return failed(str(error))
