"""`emla compare`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...analyses.compare import certificates
from ...analyses.compare.data import CERTIFICATE, STABILITY, TABLES
from ...analyses.compare.folder import CSV, MARKDOWN, RECORD, CompareFolder
from ...analyses.compare.result import CompareResult
from ...analyses.compare.runner import RESOLUTION, SEEDS, compare
from ...analyses.compare.tables import describe_lost_joints
from ...base.errors import CommandError, CosimError
from ...base.option import COMPARE, argument, option
from ...base.wording import format_count
from ...study.joint_certificates import build_certificate_table
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import scheduler, workers

OPTIONS = COMPARE

_MOST_LOST = 12
"""Most joints that were not held to show; the file has all of them."""

EXAMPLES = (
    "emla compare study --controllers rsba,foc",
    "emla compare study --table paper",
)


def _split_names(text: str) -> list[str]:
    return [part.strip() for part in text.split(",")]


def _read_reserves(text: str) -> list[float]:
    """Read the two numbers of an option. Raise CommandError for any other text."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise CommandError(
            f"the reserves are '{text}'; they must be two numbers, fractions of current and voltage, such "
            "as 0.02,0.2."
        ) from None


_who = partial(option, group="What is compared")


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    scenario: str = argument(
        help="Name of a built-in scenario, or scenario file (.toml).", metavar="SCENARIO"
    )
    controllers: Sequence[str] | None = _who(
        help="Controllers: names, FILE.fmu or FILE.py:BLOCK. Default: all in `emla list`.",
        metavar="NAME,...",
        parse=_split_names,
    )
    gains: Sequence[str] | None = _who(
        help="Gain sets: SET for all controllers that have it, CONTROLLER/SET for one, recommended, "
        "or all. Default: the recommended set of each controller.",
        metavar="SET,...",
        parse=_split_names,
    )
    table: str | None = _who(
        help="paper: the paper's tables beside ours, all gain sets. robustness: many variants, with "
        "the gain sets robust and rule too. stability: maps over delay and parameters. "
        "margins: stability margins of each joint's loops. "
        "certificate: the stability proof of RSBA's gain sets.",
        metavar="|".join((*TABLES, CERTIFICATE)),
    )
    seeds: int | None = _who(
        help="Number of runs with random effects, with seeds that no tuning used; 0: one run with the "
        f"scenario's seeds. Default: {SEEDS}; for {STABILITY} 0."
    )
    reserves: Sequence[float] | None = _who(
        help="Fractions of current and voltage that every controller keeps in reserve, such as "
        "0.02,0.2. Default: those of its gain set.",
        metavar="CURRENT,VOLTAGE",
        parse=_read_reserves,
    )
    resolution: int | None = _who(
        help=f"Points along each axis of the maps of {STABILITY}. Default: {RESOLUTION}."
    )
    scheduler: str | None = scheduler()
    workers: int | None = workers()


def command(chosen: Parameters, given: dict[str, Any]) -> None:
    """Compare several controllers in the same scenario."""
    output, plots = given.pop("output", None), given.pop("plots", True)
    place = Path(output or results_folder(Path(chosen.scenario).stem))
    overwrite = given.get("overwrite", False)
    if chosen.table == CERTIFICATE:
        _check_certificate(chosen)
        _certify(chosen.scenario, chosen.gains, certificates.CertificateFolder(place, overwrite), given)
        return
    folder = CompareFolder(place, overwrite)
    with BarProgress() as progress:
        result = compare(output=place, progress=progress, **vars(chosen), **given)
        pictures = folder.draw_result(result) if plots else []
    _show(result, place, pictures)
    if not result.complete:
        raise CosimError(f"interrupted; results so far are in {place}.")


def _check_certificate(chosen: Parameters) -> None:
    """Raise CommandError for options that a certificate does not support."""
    if chosen.controllers not in (None, ["rsba"]):
        names = ",".join(chosen.controllers)
        raise CommandError(f"--table certificate supports only the controller rsba, not {names}.")
    others = chosen.seeds, chosen.reserves, chosen.resolution, chosen.scheduler, chosen.workers
    if any(other is not None for other in others):
        raise CommandError(
            "--table certificate does not support --seeds, --reserves, --resolution, --scheduler "
            "and --workers."
        )


def _certify(
    scenario: str,
    gains: Sequence[str] | None,
    folder: certificates.CertificateFolder,
    given: dict[str, Any],
) -> None:
    """Certify RSBA's gain sets in runs of the scenario; show and write the certificate."""
    with BarProgress() as progress, folder.alone():
        found = certificates.certify_gains(scenario, gains, progress, **given)
        folder.keep(found)
    for one in found:
        if one.problem is None:
            show(build_certificate_table(one.joints, one.gains))
        else:
            print_line(f"{one.gains}: {one.problem}")
    print_line(f"Wrote {folder.path}/: {certificates.CSV}, {certificates.MARKDOWN}")


def _show(result: CompareResult, place: Path, pictures: Sequence[Path]) -> None:
    """Show the joints that were not held, then the tables and the files."""
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
        print_line(f"Plots: {', '.join(path.name for path in pictures)}")
