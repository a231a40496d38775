"""Run all checks of one FMU."""

import difflib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, suppress

from emla_cosim.base.errors import CommandError
from emla_cosim.base.files import hash_file

from .catalogue import CHECKS, RECORDED, VITAL
from .check import Check
from .check_runner import CheckRunner, skip_blocked
from .findings import Examined, Finding
from .gate import find_objections, is_selected_by
from .host.experiment import FEWEST_STEPS
from .settings import Settings
from .subject import Subject
from .subprocess_run import ERROR_OF_CHECK
from .unexamined import list_unexamined
from .verdict import Verdict

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
                new = _find(check, runner, {**earlier, **findings})
                finding = finding or new
            if check.name not in earlier:
                progress(finding)
            findings[finding.check] = finding
            if _take_over(finding, subject):
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


def _take_over(finding: Finding, subject: Subject) -> bool:
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


def _find(check: Check, runner: CheckRunner, before: Mapping[str, Finding]) -> Finding:
    """Run a check. Skip it if it needs one which failed or was skipped."""
    subject = runner.subject
    if (missing := _find_missing_need(check, before, subject.settings.skip)) is None:
        finding = runner.run(check)
        if (missing := _find_hindering(check, finding, before)) is None:
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


def _find_hindering(check: Check, finding: Finding, before: Mapping[str, Finding]) -> Finding | None:
    """Return a failed check without which this one, which was tried all the same, went wrong."""
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
