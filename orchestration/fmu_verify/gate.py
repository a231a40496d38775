"""Decide whether an FMU passes although no check failed."""

from collections.abc import Iterator, Sequence
from enum import StrEnum

from emla_cosim.base.wording import matches_pattern

from .check import Check
from .findings import Finding
from .settings import Settings
from .verdict import Verdict


class Strictness(StrEnum):
    """What makes an FMU fail in addition to failed checks."""

    WARNING = "warning"
    SKIP = "skip"


_VERDICTS = {Strictness.WARNING: Verdict.WARNING, Strictness.SKIP: Verdict.SKIPPED}


def is_selected_by(pattern: str, check: str) -> bool:
    """Return whether a name, group or pattern selects a check."""
    return check.partition(".")[0] == pattern or matches_pattern(check, pattern)


def find_objections(findings: Sequence[Finding], settings: Settings) -> tuple[str, ...]:
    """Return why an FMU does not pass, in addition to its failed checks."""
    return tuple(_yield_objections(findings, settings))


def _yield_objections(findings: Sequence[Finding], settings: Settings) -> Iterator[str]:
    # a check that needs a failed one is not a reason of its own
    failed = {f"It needs {f.check}, which failed." for f in findings if f.verdict == Verdict.FAILED}
    if blocked := [f for f in findings if f.outcome.blocked and f.sentence not in failed]:
        count = "1 check" if len(blocked) == 1 else f"{len(blocked)} checks"
        yield f"{count} could not run. {blocked[0].check}: {blocked[0].sentence}"
    for strictness in settings.fail_on:
        if checks := [f.check for f in findings if f.verdict == _VERDICTS[Strictness(strictness)]]:
            word = "warned" if strictness == Strictness.WARNING else "was skipped"
            more = f", and {len(checks) - 1} more" if len(checks) > 1 else ""
            yield f"--fail-on {strictness}: {checks[0]} {word}{more}."
    for pattern in settings.must_run:
        for f in findings:
            if f.verdict == Verdict.SKIPPED and is_selected_by(pattern, f.check):
                yield f"--must-run {pattern}: {f.check} was skipped. {f.sentence}"


def list_unselected(patterns: Sequence[str], selected: Sequence[Check]) -> list[str]:
    """Return the patterns of `--must-run` that select no check that runs."""
    return [p for p in patterns if not any(is_selected_by(p, c.name) for c in selected)]
