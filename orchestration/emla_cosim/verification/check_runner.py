"""One check asked of one subject, in a process of its own, and what it found."""

import time
from collections.abc import Iterator, Sequence
from typing import Any

from .check import Check
from .findings import Finding
from .host.fresh_process import EndedError
from .settings import Settings
from .subprocess_run import run_each_in_subprocess
from .verdict import CheckOutcome, Verdict, failed, skipped


def run_check(check: Check, subject: Any, settings: Settings) -> Finding:
    """Do a check, within the limits of the settings."""
    return next(run_checks([check], subject, settings))


def run_checks(checks: Sequence[Check], subject: Any, settings: Settings) -> Iterator[Finding]:
    """Do checks one after the other in one process, a new one where one of them ends it.

    The first one's limits hold for all.
    """
    seconds, memory = (
        checks[0].time_factor * settings.seconds,
        round(checks[0].memory_factor * settings.memory),
    )
    began = time.monotonic()
    outcomes = run_each_in_subprocess(_do, [(check, subject) for check in checks], seconds, memory)
    for check, outcome in zip(checks, outcomes, strict=True):
        ended = time.monotonic()
        yield make_finding(check, outcome, ended - began)
        began = ended


def skip_blocked(check: Check, needed: Finding) -> Finding:
    """What is said of a check that needs one that did not pass."""
    told = needed.sentence  # which says it already where that was blocked itself
    if needed.verdict == Verdict.FAILED:
        told = f"It needs {needed.check}, which failed."
    elif not told.startswith("It needs "):
        told = f"It needs {needed.check}, which was skipped: {told}"
    return make_finding(check, skipped(told))


def make_finding(check: Check, outcome: CheckOutcome, seconds: float = 0.0) -> Finding:
    """An outcome with what its check rests on."""
    return Finding(check.name, check.title, outcome, check.clause, outcome.hint or check.hint, seconds)


def _do(check: Check, subject: Any) -> CheckOutcome:
    from .host.hosted_instance import CallError  # which loads fmpy's part for FMI 2.0

    try:
        return check.examine(subject)
    except (CallError, EndedError) as error:
        return failed(str(error))
