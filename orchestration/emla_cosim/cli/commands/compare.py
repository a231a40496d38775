"""`emla compare`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CommandError, CosimError
from ...base.option import COMPARE
from ...base.wording import format_count
from ...comparison import certificates
from ...comparison.data import CERTIFICATE, STABILITY, TABLES
from ...comparison.folder import CSV, MARKDOWN, RECORD, CompareFolder
from ...comparison.result import CompareResult
from ...comparison.runner import RESOLUTION, SEEDS, compare
from ...comparison.tables import describe_lost_joints
from ...study.joint_certificates import build_certificate_table
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import Scheduler, Workers

OPTIONS = COMPARE
"""Options that the command takes."""

_MOST_LOST = 12
"""So many lines on joints that were not held are shown; the file has all."""

_WHO = "What is compared"

EXAMPLES = (
    "emla compare study --controllers rsba,foc",
    "emla compare study --table paper",
)
"""Commands that the help shows."""


def command(
    scenario: Annotated[str, typer.Argument(help="Name of a built-in scenario, or scenario file (.toml).")],
    given: dict[str, Any],
    controllers: Annotated[
        str | None,
        typer.Option(
            help="Controllers: names, FILE.fmu or FILE.py:BLOCK. Default: all that `emla list` shows.",
            metavar="NAME,...",
            rich_help_panel=_WHO,
        ),
    ] = None,
    gains: Annotated[
        str | None,
        typer.Option(
            help="Sets of gains: SET for all that have it, CONTROLLER/SET for one, recommended, or all. "
            "Default: the recommended set of each controller.",
            metavar="SET,...",
            rich_help_panel=_WHO,
        ),
    ] = None,
    table: Annotated[
        str | None,
        typer.Option(
            help="paper: the paper's tables beside ours, of all sets. robustness: under many circumstances, "
            "with the sets robust and rule, too. stability: maps over delay and parameters. certificate: "
            "what the proof says of RSBA's sets.",
            metavar="|".join((*TABLES, CERTIFICATE)),
            rich_help_panel=_WHO,
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            help="Runs where anything is random, each with a seed that no tuning used; 0: one run with the "
            f"seeds of the scenario. Default: {SEEDS}; for {STABILITY} 0.",
            metavar="N",
            rich_help_panel=_WHO,
        ),
    ] = None,
    reserves: Annotated[
        str | None,
        typer.Option(
            help="Parts of current and voltage that every controller keeps in reserve, such as 0.02,0.2. "
            "Default: those of its gains.",
            metavar="CURRENT,VOLTAGE",
            rich_help_panel=_WHO,
        ),
    ] = None,
    resolution: Annotated[
        int | None,
        typer.Option(
            help=f"Points along each axis of the maps of {STABILITY}. Default: {RESOLUTION}.",
            rich_help_panel=_WHO,
        ),
    ] = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> None:
    """Run a scenario with several controllers side by side, into an output folder."""
    output, plots = given.pop("output", None), given.pop("plots", True)
    place = Path(output or results_folder(Path(scenario).stem))
    overwrite = given.get("overwrite", False)
    if table == CERTIFICATE:
        _check_certificate(controllers, seeds, reserves, resolution, scheduler, workers)
        _certify(scenario, _split_names(gains), certificates.CertificateFolder(place, overwrite), given)
        return
    folder = CompareFolder(place, overwrite)
    if plots:
        folder.check_files(folder.pictures)
    with BarProgress() as progress:
        result = compare(
            scenario,
            _split_names(controllers),
            gains=_split_names(gains),
            table=table,
            seeds=seeds,
            reserves=_numbers(reserves),
            resolution=resolution,
            scheduler=scheduler,
            workers=workers,
            output=place,
            progress=progress,
            **given,
        )
        pictures = folder.draw_result(result) if plots else []
    _show(result, place, pictures)
    if not result.complete:
        raise CosimError(f"interrupted; what was computed is in {place}.")


def _check_certificate(controllers: str | None, *others: Any) -> None:
    """Raise CommandError for what a certificate has no use for."""
    if controllers not in (None, "rsba"):
        raise CommandError(f"the proof is of rsba alone; there is no certificate of {controllers}.")
    if any(other is not None for other in others):
        raise CommandError(
            "a certificate takes no seeds, reserves, resolution, scheduler or workers: it runs a set at a "
            "time."
        )


def _certify(
    scenario: str,
    gains: Sequence[str] | None,
    folder: certificates.CertificateFolder,
    given: dict[str, Any],
) -> None:
    """Certify RSBA's sets of gains in runs of the scenario, and show and write what came out."""
    with BarProgress() as progress, folder.alone():
        found = certificates.certify_gains(scenario, gains, progress, **given)
        folder.keep(found)
    for one in found:
        if one.problem is None:
            show(build_certificate_table(one.joints, one.gains))
        else:
            print_line(f"{one.gains}: {one.problem}")
    print_line(f"Wrote {folder.path}/: {certificates.CSV}, {certificates.MARKDOWN}")


def _split_names(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",")]


def _numbers(text: str | None) -> list[float] | None:
    """Return the numbers of an option; CommandError for what is none."""
    try:
        return None if text is None else [float(part) for part in text.split(",")]
    except ValueError:
        raise CommandError(
            f"the reserves are '{text}'; they must be two numbers, parts of current and voltage, such as "
            "0.02,0.2."
        ) from None


def _show(result: CompareResult, place: Path, pictures: Sequence[Path]) -> None:
    """Show what was not held, first and in words; then the tables, and where everything is."""
    lines = describe_lost_joints(result)
    if lines:
        show(f"[bold red]Not held: {result.lost.height} of {result.rows.height}.[/]", highlight=False)
        shown = lines[:_MOST_LOST]
        if len(lines) > len(shown):
            shown.append(f"and {len(lines) - len(shown)} more, in {place / MARKDOWN}")
        for line in shown:
            print_line(line)
    for grid in result.grids:
        show(grid.rich())
        for sentence in grid.under:
            print_line(sentence)
    for note in result.notes:
        print_line(note)
    print_line(f"{format_count(result.rows['run'].n_unique(), 'run')} in {result.wall_s:.0f} s")
    print_line(f"Wrote {place}/: {CSV}, {MARKDOWN}, {RECORD}")
    if pictures:
        print_line(f"Pictures: {', '.join(path.name for path in pictures)}")
