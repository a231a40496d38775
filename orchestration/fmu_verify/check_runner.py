"""Run checks of one subject in a subprocess."""

import re
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

from emla_cosim.fmu.load_diagnosis import explain_python_needs
from emla_cosim.fmu.python_exceptions import REMEDY

from .catalogue import RECORDED
from .check import (
    LEAVES_EXCEPTION,
    RETURNS,
    Check,
    CheckOutcome,
    NotRunError,
    Verdict,
    blocked,
    failed,
    is_own_rule,
    noted,
    skipped,
    translate_outcome,
)
from .confinement import prepare_writable_folders, use_scratch
from .findings import Finding
from .settings import Settings
from .subprocess_run import CheckProcess, EndedError

_LICENSE = re.compile(r"licen[sc]e", re.IGNORECASE)
"""A word in messages of FMUs that do not run without a license of their tool."""

_MOST_MEMORY = 2**62
"""Largest limit of memory in bytes that systems take."""


class CheckRunner:
    """Runs checks of one subject, each within the limits of the settings.

    Checks share a process until one of them loads the FMU or ends it.
    """

    def __init__(self, subject: Any, settings: Settings) -> None:
        self.subject, self._settings = subject, settings
        self._process: CheckProcess | None = None

    def run(self, check: Check) -> Finding:
        """Run a check."""
        start = time.monotonic()
        seconds = check.time_factor * self._settings.seconds
        memory = min(round(check.memory_factor * self._settings.memory), _MOST_MEMORY)
        outcome = self.call(check, seconds, memory)
        return make_finding(check, outcome, time.monotonic() - start, _read_version(self.subject))

    def call(self, check: Check, seconds: float, memory: int) -> CheckOutcome:
        """Return the outcome of a check in a process with these limits in s and bytes."""
        records = check is RECORDED
        # a limit of memory cannot be raised, and only a recording may write to the folder of references
        if self._process is not None and (records or self._process.memory != memory):
            self.close()
        if self._process is None:
            folders = prepare_writable_folders(self.subject, records)
            self._process = CheckProcess(do_check, (self.subject,), memory, folders)
        outcome = self._process.call((check,), seconds)
        if not self._process.can_continue:
            self.close()
        return outcome

    def close(self) -> None:
        """End the process. The next check gets another one, with what the subject has read until then."""
        if self._process is not None:
            self._process.close()
            self._process = None


def skip_blocked(check: Check, needed: Finding, version: int = 2) -> Finding:
    """Return the finding for a check that needs one that failed or was skipped.

    It is blocked, unless the needed one does not apply to the FMU.
    """
    reason = needed.sentence  # already names the first cause if `needed` was blocked itself
    if needed.verdict == Verdict.FAILED:
        reason = f"It needs {needed.check}, which failed."
    elif not reason.startswith("It needs "):
        reason = f"It needs {needed.check}, which was skipped: {reason}"
    not_applicable = needed.verdict == Verdict.SKIPPED and not needed.outcome.blocked
    return make_finding(check, replace(blocked(reason), blocked=not not_applicable), version=version)


def make_finding(check: Check, outcome: CheckOutcome, seconds: float = 0.0, version: int = 2) -> Finding:
    """Return an outcome together with the title, clause and hint of its check, for a version of FMI.

    The failure of an advisory check becomes a warning, or a note if the clause is a rule of this program.
    """
    check = check.of(version)
    if check.advisory and outcome.verdict == Verdict.FAILED:
        outcome = (
            replace(noted(outcome.sentence), details=outcome.details)
            if is_own_rule(check.clause)
            else replace(outcome, verdict=Verdict.WARNING, clause=None)
        )
    clause, hint = outcome.clause or check.clause, outcome.hint or check.hint
    return Finding(check.name, check.title, outcome, clause, hint, seconds, check.procedure)


def do_check(subject: Any, check: Check) -> CheckOutcome:
    """Run a check in this process, which works in the scratch folder from then on. Return the outcome.

    Its texts are in the terms of the FMU's version of FMI.
    """
    use_scratch(subject)
    outcome = _call_examine(check, subject)
    with suppress(Exception):  # it cannot be read
        _ = subject.tree
    if (version := _read_version(subject)) != 2 and outcome.clause is None:
        outcome = replace(outcome, clause=check.clause)
    return translate_outcome(version, outcome)


def _read_version(subject: Any) -> int:
    """Return the version of FMI of an FMU as far as it is known; 2 for a system."""
    return getattr(subject, "known_version", 2)


def _call_examine(check: Check, subject: Any) -> CheckOutcome:
    """Return the outcome of a check; failed calls and what keeps it from running become outcomes, too."""
    from .host.hosted_instance import CallError  # loads fmpy.fmi2

    if check.only_for not in (0, _read_version(subject)):
        return skipped(f"FMI {_read_version(subject)}.0 does not have it.")
    try:
        return check.examine(subject)
    except CallError as error:
        if _LICENSE.search(str(error)):
            message = f"It needs a license that this machine lacks. {error}"
            return blocked(message, hint="Verify it where its license is installed.", gaps=(message,))
        hint = explain_python_needs(subject.folder, [str(error)]) if check.name == "instance.created" else ""
        hint = hint or (REMEDY if error.clause == LEAVES_EXCEPTION else "")
        return failed(str(error), clause=error.clause or (None if error.has_status else RETURNS), hint=hint)
    except NotRunError as error:
        return blocked(str(error), gaps=(str(error),))
    except EndedError as error:
        return failed(str(error), clause=RETURNS)
