"""`emla verify`."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Column, Table

from fmu_verify.catalogue import CHECKS
from fmu_verify.check import Verdict
from fmu_verify.findings import Examined, format_command
from fmu_verify.references.recording import SHAPES
from fmu_verify.report import Report
from fmu_verify.report_files import REPORT_FILES
from fmu_verify.settings import Recording, Settings

from ...base.errors import CommandError, CosimError, check_choice
from ...base.extras import has_extra, require_extra
from ...base.files import check_output_files
from ...base.interruption import catch_interrupts
from ...base.option import OUTPUT, VERIFY, argument, option, switch
from ...base.progress import Progress
from ...base.tolerances import Tolerance, read_tolerances
from ...base.wording import format_count
from ...fmu.models import FLAVOURS, MODELS, build, documents_root
from ...pages.text import make_visible
from ...verification import verify
from ...views.terminal import BarProgress, show

OPTIONS = VERIFY

_CHECKED, _RECORDED = "What is checked", "Make references"
_STYLE = {
    Verdict.PASSED: "green",
    Verdict.WARNING: "yellow",
    Verdict.FAILED: "bold red",
    Verdict.SKIPPED: "dim",
}

EXAMPLES = (
    "emla verify mine.fmu --html report.html",
    "emla verify mine.fmu --record references --stop-time 1",
)

_record_option = partial(option, group=_RECORDED)
_output_option = partial(option, group=OUTPUT)
_check_option = partial(option, group=_CHECKED)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    files: Sequence[str] = argument([], help="FMUs, SSPs, and folders of them.", metavar="FILE")
    all: bool = switch("Verify all built-in models, in both flavours.", _CHECKED)
    only: Sequence[str] = _check_option(
        [], help="Check, group or pattern of checks to run (repeatable). Default: all.", metavar="CHECK"
    )
    skip: Sequence[str] = _check_option(
        [], help="Check, group or pattern of checks to leave out (repeatable).", metavar="CHECK"
    )
    fail_on: Sequence[str] = _check_option(
        [],
        help="Fail also for `warning` or `skip` (repeatable). Default: failed checks only.",
        metavar="VERDICT",
    )
    must_run: Sequence[str] = _check_option(
        [], help="Check, group or pattern of checks that must not be skipped (repeatable).", metavar="CHECK"
    )
    list: bool = switch("List all checks and exit.", _CHECKED)
    reference: Path | None = _check_option(
        help="Folder of reference files; for a system, of results. Default: beside each FMU.",
        metavar="FOLDER",
    )
    tolerance: Mapping[str, Tolerance] = _check_option(
        {},
        help="Tolerance relative to a signal's range (repeatable). Default: 1e-3.",
        metavar="[PATTERN=]NUMBER",
        parse=read_tolerances,
    )
    seconds: float = _check_option(Settings.seconds, help="Time limit of one check.", unit="s")
    memory: float = _check_option(Settings.memory / 2**20, help="Memory limit of one check in MiB.")
    explain: bool = _output_option(
        False, help="Explain each check: the clause, what was done, what came back, how to repeat it."
    )
    junit: Path | None = _output_option(help="Write a JUnit XML report.", metavar="FILE")
    json: Path | None = _output_option(help="Write a JSON report.", metavar="FILE")
    html: Path | None = _output_option(help="Write a report as an HTML page.", metavar="FILE")
    sarif: Path | None = _output_option(help="Write a SARIF report, for code scanning.", metavar="FILE")
    badge: Path | None = _output_option(help="Write the verdict as an SVG image.", metavar="FILE")
    record: Path | None = _record_option(
        help="Run the FMU and write reference files to this folder.", metavar="FOLDER"
    )
    input: Path | None = _record_option(help="Inputs of the reference run.", metavar="FILE.csv")
    excite: str = _record_option(
        "steps", help=f"Shape of the inputs without a file: {', '.join(SHAPES)}.", metavar="SHAPE"
    )
    set: Mapping[str, str] = _record_option(
        {}, help="Start value of the reference run (repeatable).", metavar="VARIABLE=VALUE"
    )
    stop_time: float | None = _record_option(help="Stop time of the reference run.", unit="s")
    step_size: float | None = _record_option(help="Communication step of the reference run.", unit="s")


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Verify FMUs and SSPs."""
    if parameters.list:
        table = Table(
            Column("check", no_wrap=True), "question", "source", title="Checks", title_justify="left"
        )
        for check in CHECKS:
            table.add_row(check.name, escape(check.title), escape(str(check.clause)))
        show(table, asked_for=True)
        return
    check_choice("shape", parameters.excite, SHAPES)
    if parameters.html is not None:
        require_extra("plots", "--html")
    recording, overwrite = None, options.get("overwrite", False)
    experiment = parameters.stop_time, parameters.step_size, dict(parameters.set)
    if parameters.record is not None:
        recording = Recording(parameters.record, parameters.input, parameters.excite, *experiment, overwrite)
    elif parameters.input or any(experiment):
        raise CommandError("--input, --set, --stop-time and --step-size need --record.")
    files = {file: Path(file) for file in parameters.files}
    reports = {kind: path for kind in REPORT_FILES if (path := getattr(parameters, kind)) is not None}
    # before checks that take minutes
    _check_report_files(reports, files.values(), overwrite)
    with catch_interrupts() as interrupted, BarProgress() as progress:
        built_in_files = _build_built_in(progress) if parameters.all else {}
        references = (
            documents_root() / "fmus"
            if parameters.all and parameters.reference is None
            else parameters.reference
        )
        report = verify(
            files | built_in_files,
            reference=references,
            only=parameters.only,
            skip=parameters.skip,
            tolerance=parameters.tolerance,
            seconds=parameters.seconds,
            memory=parameters.memory,
            record=recording,
            fail_on=parameters.fail_on,
            must_run=parameters.must_run,
            progress=progress,
            interrupted=interrupted,
        )
    for kind, path in reports.items():
        REPORT_FILES[kind].save(report, path, overwrite)
    if recording is not None:
        _show_recorded(report)
    else:
        _show(report, parameters.explain)
    if not report.passed:
        raise CosimError(_describe_verdict(report))


def _describe_verdict(report: Report) -> str:
    """Return why the report is not passed."""
    if not report.complete:
        return "interrupted before all checks were done; the reports have what was finished."
    failures = len(report.failures)
    objected = sum(bool(examined.objections) for examined in report.examined)
    reasons = [f"{format_count(failures, 'check')} failed"] if failures else []
    reasons += [f"{format_count(objected, 'FMU')} did not pass for other reasons"] if objected else []
    return f"{'; '.join(reasons)}."


def _check_report_files(reports: Mapping[str, Path], files: Iterable[Path], overwrite: bool) -> None:
    """Raise CommandError if a report cannot be written, or would replace another file."""
    used = dict.fromkeys(files, "the file to verify")
    for kind, path in reports.items():
        check_output_files({path: REPORT_FILES[kind].subject}, used)
        REPORT_FILES[kind].check(path, overwrite)
        used[path] = REPORT_FILES[kind].subject


def _build_built_in(progress: Progress) -> dict[str, Path]:
    """Build the FMUs of all built-in models, and return them by model and flavour.

    Without the extra `build`, these are the native ones only.
    """
    flavours = FLAVOURS if has_extra("build") else FLAVOURS[:1]
    if flavours != FLAVOURS:
        progress.note("Note: only native FMUs are verified, because those of PythonFMU need the extra build.")
    progress.begin("building", len(MODELS) * len(flavours))
    paths = {}
    for flavour in flavours:
        for model in MODELS:
            paths[f"{model} ({flavour})"] = build(model, flavour, [])
            progress.advance(1)
    return paths


def _show(report: Report, explain: bool) -> None:
    """Show failures and warnings with the clauses of the standard, then a row for each FMU.

    With `explain`, show all findings, and what was done.
    """
    for examined in report.examined:
        more = (Verdict.PASSED, Verdict.SKIPPED) if explain else ()
        for verdict in (Verdict.FAILED, Verdict.WARNING, *more):
            _show_findings(examined, verdict, explain)
        remarks = [f"[{_STYLE[Verdict.FAILED]}]not passed[/] {_escape(x)}" for x in examined.objections]
        remarks += [f"[dim]not examined[/] {_escape(x)}" for x in examined.not_examined]
        for remark in remarks:
            show(f"{_escape(examined.label)}: {remark}", highlight=False, soft_wrap=True)
    table = Table(Column("", overflow="fold"), *(str(v) for v in Verdict), "time / s")
    for examined in report.examined:
        counts = (_format_count(len(examined.of(v)), v) for v in Verdict)
        table.add_row(_escape(examined.label), *counts, f"{examined.seconds:.1f}")
    show(table)


def _show_recorded(report: Report) -> None:
    """Show the reference files, or why they could not be written."""
    for examined in report.examined:
        for finding in examined.findings:
            show(f"{_escape(examined.label)}: {_escape(finding.sentence)}", highlight=False, soft_wrap=True)


def _escape(text: str) -> str:
    """Escape markup and control characters in text from files."""
    return escape(make_visible(text))


def _format_count(count: int, verdict: Verdict) -> str:
    return f"[{_STYLE[verdict]}]{count}[/]" if count else ""


def _show_findings(examined: Examined, verdict: Verdict, explain: bool) -> None:
    """Show the findings of one verdict with their details, and what helps to understand and repeat them."""
    for finding in examined.of(verdict):
        name = f"[{_STYLE[verdict]}]{verdict}[/] [bold]{finding.check}[/]"
        show(
            f"{_escape(examined.label)}: {name} {_escape(finding.sentence)}", highlight=False, soft_wrap=True
        )
        more = [d for d in finding.outcome.details if d.rstrip(".") not in finding.sentence]
        most = len(more) if explain else _MOST_DETAILS
        for detail in more[:most]:
            show(f"    {_escape(detail)}", highlight=False, soft_wrap=True)
        if len(more) > most:
            show(f"    and {len(more) - most} more", highlight=False)
        lines = (
            [f'{finding.clause}: "{finding.clause.sentence}"'] if verdict == Verdict.FAILED or explain else []
        )
        lines += [f"What was done: {finding.done}"] if explain else []
        lines += (
            [finding.hint] if verdict == Verdict.FAILED or (explain and verdict == Verdict.WARNING) else []
        )
        lines += [f"Repeat it: {make_visible(format_command(examined, finding))}"] if lines else []
        for line in lines:
            show(f"    {line}", style="dim", markup=False, highlight=False, soft_wrap=True)


_MOST_DETAILS = 5
"""Most further details to show of one finding."""
