"""`emla repair`."""

from collections import Counter
from dataclasses import dataclass
from filecmp import cmp
from functools import partial
from pathlib import Path
from typing import Any

from rich.markup import escape

from fmu_verify.check import Verdict
from fmu_verify.repair.record import Change
from fmu_verify.repair.repairing import Repair, is_repaired, repair

from ...base.errors import CommandError, CosimError
from ...base.files import check_output_files
from ...base.option import OUTPUT, REPAIR, argument, option, switch
from ...base.output_files import OutputFile
from ...base.wording import format_count, shorten_line
from ...pages.text import make_visible
from ...views.terminal import show, show_file

OPTIONS = REPAIR

EXAMPLES = ("emla repair mine.fmu -o fixed.fmu", "emla repair mine.fmu --dry-run")

_LONGEST = 200
"""Most letters of a text before or after a change."""


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    fmu: Path = argument(help="FMU to repair. It is only read.", metavar="FMU")
    output: Path | None = option(
        None, help="Repaired FMU to write (also -o).", metavar="FILE.fmu", group=OUTPUT, short_flag="-o"
    )
    dry_run: bool = switch("Show the changes, and write nothing.", OUTPUT)


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Mend what is wrong in the text of an FMU and has one remedy; binaries stay as they are."""
    target = None
    if parameters.output is not None:
        check_output_files({parameters.output: "the repaired FMU"}, {parameters.fmu: "the FMU to repair"})
        overwrite = options.get("overwrite", False)
        target = OutputFile(
            parameters.output, "the repaired FMU", partial(_is_ours, parameters.fmu), overwrite
        )
    elif not parameters.dry_run:
        raise CommandError("name the FMU to write with --output, or use --dry-run.")
    repaired = repair(parameters.fmu)
    _show(repaired)
    if target is not None and not parameters.dry_run:
        repaired.save(target)
        show_file(target.path)
    if repaired.remaining:
        count = format_count(len(repaired.remaining), "check still fails", "checks still fail")
        raise CosimError(f"{count}: text alone cannot mend it, or there is more than one remedy.")


def _is_ours(fmu: Path, path: Path) -> bool:
    """Return whether a file is from a repair, which copies an FMU without faults as it is."""
    return is_repaired(path) or (fmu.is_file() and cmp(fmu, path, shallow=False))


def _show(repaired: Repair) -> None:
    """Show the changes, what is left, and the numbers of findings before and after."""
    for change in repaired.changes:
        _show_change(change, repaired.version)
    if not repaired.changes:
        show("Nothing to mend.")
    for finding in repaired.remaining:
        show(f"[bold red]not mended[/] [bold]{finding.check}[/] {_escape(finding.sentence)}", soft_wrap=True)
    for label, examined in (("before", repaired.before), ("after", repaired.after)):
        counts = Counter(finding.verdict for finding in examined.findings)
        show(f"{label}: {', '.join(f'{counts[v]} {v}' for v in Verdict)}", highlight=False)


def _show_change(change: Change, version: int) -> None:
    show(f"[bold]{change.check}[/] {_escape(change.where)}", highlight=False, soft_wrap=True)
    for sign, style, text in (("-", "red", change.before), ("+", "green", change.after)):
        if text:
            show(f"  [{style}]{sign} {_escape(text)}[/]", highlight=False, soft_wrap=True)
    clause = change.find_clause(version)
    show(f'  {clause}: "{clause.sentence}"', style="dim", markup=False, highlight=False, soft_wrap=True)


def _escape(text: str) -> str:
    """Return one line of text from a file, without markup and control characters."""
    return escape(make_visible(shorten_line(text, _LONGEST)))
