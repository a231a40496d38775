"""Run all checks of one FMU, decide whether it passes, and list what could not be judged."""

import difflib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from enum import StrEnum

import fmpy

from emla_cosim.base.errors import CommandError
from emla_cosim.base.files import hash_file
from emla_cosim.base.wording import matches_pattern

from .catalogue import CHECKS, RECORDED, VITAL
from .check import Check, Verdict
from .check_runner import CheckRunner, skip_blocked
from .confinement import list_confinement_gaps
from .declarations import DeclaredVariable
from .findings import Examined, Finding
from .host.experiment import FEWEST_STEPS
from .libraries import list_platforms
from .messages import join_few_names
from .settings import Settings
from .subject import Subject
from .subprocess_run import ERROR_OF_CHECK

_NOT_COMPARED = (
    "Whether the values of outputs are right, and follow the inputs as intended: there is no reference to "
    "compare with (--reference)."
)


def list_unexamined(subject: Subject, findings: Mapping[str, Finding]) -> tuple[str, ...]:
    """Return what was not judged, as sentences, by all findings, also those that the report leaves out."""
    return (
        *_find_uncompared_values(findings),
        *_find_not_run(findings.values()),
        *(f"{f.check}: {gap}" for f in findings.values() for gap in f.outcome.gaps),
        *_find_other_platforms(subject),
        *_find_parts_of_version_3(subject),
        *(list_confinement_gaps() if "run.completes" in findings else ()),
    )


def _find_uncompared_values(findings: Mapping[str, Finding]) -> Iterator[str]:
    """Yield that nothing was compared with a reference, if the FMU runs."""
    ran, compared = findings.get("run.completes"), findings.get("reference.agrees")
    was_compared = compared is not None and compared.verdict in (Verdict.PASSED, Verdict.FAILED)
    was_compared = was_compared or any(f.outcome.figures.get("compared") for f in findings.values())
    if ran is not None and ran.verdict in (Verdict.PASSED, Verdict.WARNING) and not was_compared:
        yield _NOT_COMPARED


def _find_not_run(findings: Iterable[Finding]) -> Iterator[str]:
    """Yield the checks that apply, but could not run, by reason."""
    reasons: dict[str, list[str]] = {}
    for f in findings:
        if f.outcome.blocked and not f.outcome.gaps:
            reasons.setdefault(f.sentence, []).append(f.check)
    for reason, names in reasons.items():
        yield f"{join_few_names(names)}: {reason}"


def _find_parts_of_version_3(subject: Subject) -> Iterator[str]:
    """Yield what FMI 3.0 has and no check that calls the FMU uses."""
    if subject.known_version != 3 or "declared" not in vars(subject):
        return
    predicates: dict[str, Callable[[DeclaredVariable], bool]] = {
        "Values of Binary variables": lambda v: v.type == "Binary",
        "Values of arrays of Strings": lambda v: v.type == "String" and bool(v.dimensions),
        "Other values of structural parameters": lambda v: v.causality == "structuralParameter",
        "Values during intermediate updates": lambda v: (
            v.own_attributes.get("intermediateUpdate") in ("true", "1")
        ),
    }
    for label, is_unexamined in predicates.items():
        if names := [v.name for v in subject.declared.variables if is_unexamined(v)]:
            yield f"{label} were not examined: {join_few_names(names)}."


def _find_other_platforms(subject: Subject) -> Iterator[str]:
    """Yield the platforms whose binaries were only read."""
    this_platform = (fmpy.platform, fmpy.platform_tuple)
    if platforms := [p.name for p in list_platforms(subject) if p.name not in this_platform]:
        names = join_few_names(platforms)
        yield f"Binaries for {names} were read, but not run on this {fmpy.platform} machine."


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
    """Yield blocked checks, and what the settings do not accept, as messages."""
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


_READ_AFTER = {"description.readable": ("tree", "description"), "description.schema": ("declared",)}
"""Attributes of a subject to read once for all later checks, after a check that passed."""

# The check that unpacks the FMU. It runs again when an examination is resumed.
_UNPACKS = "archive.safe"


def examine_fmu(
    subject: Subject,
    progress: Callable[[Finding], None] = lambda _: None,
    earlier_findings: Sequence[Finding] = (),
) -> Examined:
    """Examine an FMU.

    Args:
        subject: The FMU.
        progress: Called with the finding of each completed check.
        earlier_findings: Findings of an earlier examination, whose process ended. These checks do not
            run again.
    """
    start = time.monotonic()
    earlier = {f.check: f for f in earlier_findings}
    findings: dict[str, Finding] = {}
    with closing(CheckRunner(subject, subject.settings)) as runner:
        for check in select_needed_checks(subject.settings):
            finding = earlier.get(check.name)
            if finding is None or check.name == _UNPACKS:
                new = _run_or_skip(check, runner, {**earlier, **findings})
                finding = finding or new
            if check.name not in earlier:
                progress(finding)
            findings[finding.check] = finding
            if _prepare_later_checks(finding, subject):
                runner.close()
    # failed checks are reported even if not selected: the checks that need them are only skipped
    skip = subject.settings.skip
    failed = {name for name, f in findings.items() if f.verdict == Verdict.FAILED}
    failed = {name for name in failed if not any(is_selected_by(p, name) for p in skip)}
    names = {c.name for c in select_checks(subject.settings)} | failed
    other_version = {c.name for c in CHECKS if c.only_for not in (0, subject.known_version)}
    reported = tuple(f for f in findings.values() if f.check in (names - other_version or names))
    return Examined(
        subject.path,
        _collect_facts(subject),
        reported,
        time.monotonic() - start,
        objections=(
            *find_objections(reported, subject.settings),
            *_find_missing_in_version(subject, other_version, reported),
        ),
        not_examined=list_unexamined(subject, findings),
    )


def _find_missing_in_version(
    subject: Subject, other_version: Iterable[str], reported: Sequence[Finding]
) -> Iterator[str]:
    """Yield checks that must run, but are of what another version of FMI has."""
    for pattern in subject.settings.must_run:
        is_missing = any(is_selected_by(pattern, name) for name in other_version)
        if is_missing and not any(is_selected_by(pattern, f.check) for f in reported):
            yield f"--must-run {pattern}: FMI {subject.known_version}.0 does not have what it is about."


def _prepare_later_checks(finding: Finding, subject: Subject) -> bool:
    """Read what later checks need, and limit their runs, after a check that passed; return whether it did."""
    if finding.verdict != Verdict.PASSED:
        return False
    names = _READ_AFTER.get(finding.check, ())
    for name in names:
        with suppress(Exception):  # reading may fail here although it worked in the check's process
            getattr(subject, name)
    if finding.check == "run.completes":
        subject.most_steps = max(FEWEST_STEPS, finding.outcome.figures["steps"])
        return True
    return bool(names)


def select_checks(settings: Settings) -> list[Check]:
    """Return the checks that the settings select, in the order of the catalogue."""
    if settings.recording is not None:
        return [RECORDED]
    return [
        c
        for c in CHECKS
        if (not settings.only or any(is_selected_by(p, c.name) for p in settings.only))
        and not any(is_selected_by(p, c.name) for p in settings.skip)
    ]


def check_names(patterns: Iterable[str]) -> None:
    """Raise CommandError for a name or pattern that matches no check."""
    for pattern in patterns:
        if not any(is_selected_by(pattern, c.name) for c in CHECKS):
            names = [c.name for c in CHECKS]
            near = difflib.get_close_matches(pattern, names, n=3, cutoff=0.4)
            advice = "`emla verify --list` lists all checks."
            advice = f"did you mean {' or '.join(near)}?" if near else advice
            raise CommandError(f"there is no check '{pattern}'; {advice}", name=pattern, choices=names)


def select_needed_checks(settings: Settings) -> list[Check]:
    """Return the selected checks and all that they need, in the order of the catalogue."""
    names = {c.name for c in select_checks(settings)}
    for check in (RECORDED, *reversed(CHECKS)):  # needed checks come first in CHECKS
        if check.name in names:
            names.update(check.needs)
    return [c for c in (*CHECKS, RECORDED) if c.name in names]


def _run_or_skip(check: Check, runner: CheckRunner, before: Mapping[str, Finding]) -> Finding:
    """Run a check. Skip it if it needs one which failed or was skipped."""
    subject = runner.subject
    if (missing := _find_missing_need(check, before, subject.settings.skip)) is None:
        finding = runner.run(check)
        if (missing := _find_cause_of_error(check, finding, before)) is None:
            return finding
    return skip_blocked(check, missing, subject.known_version)


def _find_missing_need(check: Check, before: Mapping[str, Finding], skip: Sequence[str]) -> Finding | None:
    """Return a needed check that failed or was skipped, among those that have run.

    A failed check that `skip` leaves out does not excuse those that need it, unless it is vital for them.
    """
    needed = [before[name] for name in check.needs if name in before]
    for finding in needed:
        is_ignored = finding.check not in VITAL and any(is_selected_by(p, finding.check) for p in skip)
        failed = finding.verdict == Verdict.FAILED and finding.outcome.blocks and not is_ignored
        if failed or finding.verdict == Verdict.SKIPPED:
            return finding
    return None


def _find_cause_of_error(check: Check, finding: Finding, before: Mapping[str, Finding]) -> Finding | None:
    """Return a failed check without which this one, which was tried all the same, went wrong, or None."""
    if not finding.sentence.startswith(ERROR_OF_CHECK):
        return None
    needed = list(check.needs)
    for name in needed:  # grows: also what those need
        needed += next((c.needs for c in CHECKS if c.name == name), ())
    return next((before[n] for n in needed if n in before and before[n].verdict == Verdict.FAILED), None)


def _collect_facts(subject: Subject) -> dict[str, str]:
    """Return facts about the FMU for the top of its report."""
    facts = {}
    with suppress(OSError):
        facts["SHA-256"] = hash_file(subject.path)
        facts["size"] = f"{subject.path.stat().st_size / 1024:.0f} KiB"
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
