"""`emla verify`."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Column, Table

from ...base.errors import CommandError, CosimError, check_choice
from ...base.files import check_output_files
from ...base.option import VERIFY
from ...base.ownership import IsOurs, check_replaceable
from ...base.progress import Progress
from ...base.wording import format_count
from ...fmu.models import FLAVOURS, MODELS, build, documents_root
from ...recorders.tubes.tolerance import read_tolerances
from ...sandbox.interruption import catch_interrupts
from ...verification.catalogue import CHECKS
from ...verification.findings import Examined
from ...verification.marks import is_json, is_junit, is_page
from ...verification.references.excitation import SHAPES
from ...verification.repetition import format_command
from ...verification.report import Report
from ...verification.runner import verify
from ...verification.settings import Recording, Settings
from ...verification.verdict import Verdict
from ...views.pages.text import make_visible
from ...views.progress_bars import BarProgress
from ...views.terminal import show
from .options import pairs

OPTIONS = VERIFY
"""Options of the command."""

_WHAT, _OUT, _MAKE = "What is checked", "What comes out", "Make references"
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
"""Examples in the help."""


def command(
    given: dict[str, Any],
    files: Annotated[
        list[str] | None, typer.Argument(help="FMUs, SSPs, and folders of them.", metavar="[FILE]...")
    ] = None,
    all_: Annotated[
        bool,
        typer.Option("--all", help="Verify all built-in models, in both flavours.", rich_help_panel=_WHAT),
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="Check, group or pattern of checks to run (repeatable). Default: all.",
            metavar="CHECK",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    skip: Annotated[
        list[str] | None,
        typer.Option(
            help="Check, group or pattern of checks to leave out (repeatable).",
            metavar="CHECK",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    fail_on: Annotated[
        list[str] | None,
        typer.Option(
            help="Fail also for `warning` or `skip` (repeatable). Default: failed checks only.",
            metavar="VERDICT",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    must_run: Annotated[
        list[str] | None,
        typer.Option(
            help="Check, group or pattern of checks that must not be skipped (repeatable).",
            metavar="CHECK",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    explain: Annotated[
        bool,
        typer.Option(
            help="Explain each check: the clause, what was done, what came back, how to repeat it.",
            rich_help_panel=_OUT,
        ),
    ] = False,
    list_: Annotated[
        bool, typer.Option("--list", help="List all checks and exit.", rich_help_panel=_WHAT)
    ] = False,
    reference: Annotated[
        Path | None,
        typer.Option(
            help="Folder of reference files; for a system, of results. Default: beside each FMU.",
            metavar="FOLDER",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            help="Tolerance relative to a signal's range (repeatable). Default: 1e-3.",
            metavar="[PATTERN=]NUMBER",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(help="Time limit of one check in s.", rich_help_panel=_WHAT)
    ] = Settings.seconds,
    memory: Annotated[
        float, typer.Option(help="Memory limit of one check in MiB.", rich_help_panel=_WHAT)
    ] = Settings.memory / 2**20,
    junit: Annotated[
        Path | None, typer.Option(help="Write a JUnit XML report.", metavar="FILE", rich_help_panel=_OUT)
    ] = None,
    json: Annotated[
        Path | None, typer.Option(help="Write a JSON report.", metavar="FILE", rich_help_panel=_OUT)
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(help="Write a report as an HTML page.", metavar="FILE", rich_help_panel=_OUT),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            help="Run the FMU and write reference files to this folder.",
            metavar="FOLDER",
            rich_help_panel=_MAKE,
        ),
    ] = None,
    input_: Annotated[
        Path | None,
        typer.Option(
            "--input", help="Inputs of the reference run.", metavar="FILE.csv", rich_help_panel=_MAKE
        ),
    ] = None,
    excite: Annotated[
        str,
        typer.Option(help=f"Shape of the inputs without a file: {', '.join(SHAPES)}.", rich_help_panel=_MAKE),
    ] = "steps",
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="Start value of the reference run (repeatable).",
            metavar="VARIABLE=VALUE",
            rich_help_panel=_MAKE,
        ),
    ] = None,
    stop_time: Annotated[
        float | None, typer.Option(help="Stop time of the reference run in s.", rich_help_panel=_MAKE)
    ] = None,
    step_size: Annotated[
        float | None,
        typer.Option(help="Communication step of the reference run in s.", rich_help_panel=_MAKE),
    ] = None,
) -> None:
    """Verify FMUs and SSPs."""
    if list_:
        show(_catalogue(), asked_for=True)
        return
    check_choice("shape", excite, SHAPES)
    recording, overwrite = None, given.get("overwrite", False)
    if record is not None:
        recording = Recording(
            record, input_, excite, stop_time, step_size, pairs("--set", set_ or []), overwrite
        )
    elif any((input_, stop_time, step_size, set_)):
        raise CommandError("--input, --set, --stop-time and --step-size need --record.")
    named = {file: Path(file) for file in files or []}
    reports: list[tuple[Path | None, str, IsOurs]] = [
        (junit, "the JUnit report", is_junit),
        (json, "the JSON report", is_json),
        (html, "the page", is_page),
    ]
    _check_places(reports, named.values(), overwrite)
    with catch_interrupts() as interrupted, BarProgress() as progress:
        ours = _ours(progress) if all_ else {}
        known = documents_root() / "fmus" if all_ and reference is None else reference
        report = verify(
            named | ours,
            reference=known,
            only=only or [],
            skip=skip or [],
            tolerance=read_tolerances(tolerance or []),
            seconds=seconds,
            memory=memory,
            record=recording,
            fail_on=fail_on or [],
            must_run=must_run or [],
            progress=progress,
            interrupted=interrupted,
        )
    for save, path in ((report.save_junit, junit), (report.save_json, json), (report.save_html, html)):
        if path is not None:
            save(path, overwrite)
    if recording is not None:
        _show_recorded(report)
    else:
        _show(report, explain)
    if not report.passed:
        raise CosimError(_describe_verdict(report))


def _describe_verdict(report: Report) -> str:
    """Return why the report is not passed."""
    if not report.complete:
        return "interrupted before all checks were done; the reports have what was finished."
    failures = len(report.failures)
    others = sum(bool(one.objections) for one in report.examined)
    said = [f"{format_count(failures, 'check')} failed"] if failures else []
    said += [f"{format_count(others, 'FMU')} did not pass for other reasons"] if others else []
    return f"{'; '.join(said)}."


def _check_places(
    reports: Iterable[tuple[Path | None, str, IsOurs]], files: Iterable[Path], overwrite: bool
) -> None:
    """Raise CommandError if a report cannot be written, or would replace another file."""
    used = dict.fromkeys(files, "the file to verify")
    for path, what, is_ours in reports:
        if path is not None:
            check_output_files({path: what}, used)
            check_replaceable(path, what, is_ours, overwrite)
            used[path] = what


def _ours(progress: Progress) -> dict[str, Path]:
    """Return the FMUs of all built-in models, by model and flavour."""
    progress.begin("building", len(MODELS) * len(FLAVOURS))
    found = {}
    for flavour in FLAVOURS:
        for model in MODELS:
            found[f"{model} ({flavour})"] = build(model, flavour, [])
            progress.advance(1)
    return found


def _catalogue() -> Table:
    table = Table(Column("check", no_wrap=True), "question", "source", title="Checks", title_justify="left")
    for check in CHECKS:
        table.add_row(check.name, escape(check.title), escape(str(check.clause)))
    return table


def _show(report: Report, explain: bool) -> None:
    """Show failures and warnings with the clauses of the standard, then a row for each FMU.

    With `explain`, show all findings, and what was done.
    """
    for examined in report.examined:
        for verdict in (
            Verdict.FAILED,
            Verdict.WARNING,
            *((Verdict.PASSED, Verdict.SKIPPED) if explain else ()),
        ):
            _show_findings(examined, verdict, explain)
        for objection in examined.objections:
            said = f"{_text(examined.label)}: [{_STYLE[Verdict.FAILED]}]not passed[/] {_text(objection)}"
            show(said, highlight=False, soft_wrap=True)
        for gap in examined.not_examined:
            said = f"{_text(examined.label)}: [dim]not examined[/] {_text(gap)}"
            show(said, highlight=False, soft_wrap=True)
    table = Table(Column("", overflow="fold"), *(str(v) for v in Verdict), "time / s")
    for examined in report.examined:
        counts = (_count(len(examined.of(v)), v) for v in Verdict)
        table.add_row(_text(examined.label), *counts, f"{examined.seconds:.1f}")
    show(table)


def _show_recorded(report: Report) -> None:
    """Show the reference files, or why they could not be written."""
    for examined in report.examined:
        for found in examined.findings:
            show(f"{_text(examined.label)}: {_text(found.sentence)}", highlight=False, soft_wrap=True)


def _text(text: str) -> str:
    """Escape markup and control characters in text from files."""
    return escape(make_visible(text))


def _count(count: int, verdict: Verdict) -> str:
    return f"[{_STYLE[verdict]}]{count}[/]" if count else ""


def _show_findings(examined: Examined, verdict: Verdict, explain: bool) -> None:
    for found in examined.of(verdict):
        name = f"[{_STYLE[verdict]}]{verdict}[/] [bold]{found.check}[/]"
        show(f"{_text(examined.label)}: {name} {_text(found.sentence)}", highlight=False, soft_wrap=True)
        more = [d for d in found.outcome.details if d.rstrip(".") not in found.sentence]
        most = len(more) if explain else _MOST_DETAILS
        for detail in more[:most]:
            show(f"    {_text(detail)}", highlight=False, soft_wrap=True)
        if len(more) > most:
            show(f"    and {len(more) - most} more", highlight=False)
        lines = [f'{found.clause}: "{found.clause.sentence}"'] if verdict == Verdict.FAILED or explain else []
        lines += [f"What was done: {found.done}"] if explain else []
        lines += [found.hint] if verdict == Verdict.FAILED or (explain and verdict == Verdict.WARNING) else []
        lines += [f"Repeat it: {make_visible(format_command(examined, found))}"] if lines else []
        for line in lines:
            show(f"    {line}", style="dim", markup=False, highlight=False, soft_wrap=True)


_MOST_DETAILS = 5
"""Most further details to show of one finding."""
