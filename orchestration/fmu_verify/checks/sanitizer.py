"""Check the memory accesses, leaks and arithmetic of FMUs with C sources, in a build with sanitizers."""

from collections.abc import Sequence
from functools import partial

from ..check import CheckOutcome, check, quote, skipped, unjudged
from ..messages import Breach, Problem, judge_problems
from ..sanitizer.run import TIME_FACTOR, SanitizedRun, format_bytes, run_sanitized
from ..subject import Subject

_check = partial(
    check,
    needs=("description.schema",),
    time_factor=TIME_FACTOR,
    memory_factor=2.0**24,  # AddressSanitizer reserves 2^44 addresses; what it uses has a limit of its own
)

_OUTSIDE = quote("sanitizer.address")
_LIFETIME = quote("sanitizer.lifetime")
_FREE = quote("sanitizer.free")
# what each error of AddressSanitizer violates; all others are accesses outside of an object
_CLAUSES = {
    "heap-use-after-free": _LIFETIME,
    "stack-use-after-return": _LIFETIME,
    "stack-use-after-scope": _LIFETIME,
    "SEGV": quote("sanitizer.invalid"),
    "double-free": _FREE,
    "bad-free": _FREE,
}

_ENDED = skipped("It needs sanitizer.address, which failed: the run ended there.")


@_check("sanitizer.address")
def address(subject: Subject) -> CheckOutcome:
    """Run a build of the sources with AddressSanitizer through all phases of two instances."""
    run = run_sanitized(subject)
    if not run.has_address:
        return _skip_without_build(run, "AddressSanitizer")
    problems = [Breach(fault.sentence, _CLAUSES.get(fault.kind, _OUTSIDE)) for fault in run.memory_faults]
    return _judge_run(run, problems, "A build of the sources with AddressSanitizer reports nothing.")


@_check("sanitizer.leaks", clause=quote("shared.freed"))
def leaks(subject: Subject) -> CheckOutcome:
    """Check which memory nothing points to after the instances were freed."""
    run = run_sanitized(subject)
    if not run.has_address:
        return _skip_without_build(run, "LeakSanitizer")
    if run.memory_faults:
        return _ENDED
    if not run.judges_leaks and not run.leaks:
        return unjudged("The run with LeakSanitizer did not come to its end.")
    problems = [
        f"{leak.source_line} allocates {format_bytes(leak.size)} that are never freed." for leak in run.leaks
    ]
    return judge_problems(problems, "After the instances were freed, no memory is left.")


@_check("sanitizer.undefined", advisory=True)
def undefined(subject: Subject) -> CheckOutcome:
    """Run a build of the sources with UBSan through all phases of two instances."""
    run = run_sanitized(subject)
    if run.missing:
        return _skip_without_build(run, "UndefinedBehaviorSanitizer")
    if run.memory_faults and not run.undefined:
        return _ENDED
    return _judge_run(run, run.undefined, "A build of the sources with UBSan reports nothing.")


def _judge_run(run: SanitizedRun, problems: Sequence[Problem], fine: str) -> CheckOutcome:
    """Return the outcome of a run with a sanitizer. One that makes no step shows only what is wrong."""
    if not problems and not run.ran:
        reason = next(iter(run.gaps), "The build of its sources makes no step.")
        return skipped(f"The build of its sources does not run. {reason}", gaps=run.gaps)
    return judge_problems(problems, fine, gaps=run.gaps)


def _skip_without_build(run: SanitizedRun, sanitizer: str) -> CheckOutcome:
    """Return the outcome where there is no build with a sanitizer."""
    reason = run.missing or f"The compiler of this machine has no {sanitizer}."
    return skipped(reason, gaps=(reason,) if run.has_sources else ())
