"""`emla identify`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CosimError
from ...base.option import SWEEP
from ...identification.folder import CERTAINTY, FIT, HISTORY, PAGE, RECORD, SAMPLES, SCENARIO
from ...identification.loss import LOSSES
from ...identification.plan import load_identification_plan
from ...identification.runner import identify
from ...identification.summary import format_lines, format_tables
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import Scheduler, Workers, pairs

OPTIONS = SWEEP
"""Options of the command."""

_DATA, _SEARCH = "Data", "Estimation"

EXAMPLES = (
    "emla identify lift --input test.csv:lift.disturbance.F_L=Force "
    "--measured test.csv:lift.plant.x_L=position --vary lift.plant.friction.F_C=1:1000",
    "emla identify plan.toml --report",
)
"""Examples in the help."""


def command(
    plan: Annotated[str, typer.Argument(help="Plan (.toml), or a scenario, SSP or FMU as for `emla run`.")],
    given: dict[str, Any],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            help="Unknown parameter and its range; offset(SIGNAL), gain(SIGNAL) and delay(SIGNAL) are those "
            "of a sensor (repeatable).",
            metavar="NAME=LOW:HIGH",
            rich_help_panel=_SEARCH,
        ),
    ] = None,
    measured: Annotated[
        list[str] | None,
        typer.Option(
            help="Measured data: a file, and the columns of signals (repeatable).",
            metavar="FILE:SIGNAL=COLUMN,...",
            rich_help_panel=_DATA,
        ),
    ] = None,
    sigma: Annotated[
        list[str] | None,
        typer.Option(
            help="Standard deviation of a measured signal. Default: that of the residuals (repeatable).",
            metavar="SIGNAL=VALUE",
            rich_help_panel=_DATA,
        ),
    ] = None,
    loss: Annotated[
        str | None,
        typer.Option(
            help=f"Loss function; all but linear bear outliers. One of {', '.join(LOSSES)}. Default: linear.",
            metavar="NAME",
            rich_help_panel=_SEARCH,
        ),
    ] = None,
    starts: Annotated[
        int | None,
        typer.Option(help="Number of starting points. Default: 1.", rich_help_panel=_SEARCH),
    ] = None,
    evaluations: Annotated[
        int | None,
        typer.Option(help="Most iterations from each point. Default: 50.", rich_help_panel=_SEARCH),
    ] = None,
    profile: Annotated[
        list[str] | None,
        typer.Option(
            help="Parameter whose interval is found by profile likelihood (repeatable).",
            metavar="NAME",
            rich_help_panel=_SEARCH,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="Seed of the random starting points. Default: 0.", rich_help_panel=_SEARCH),
    ] = None,
    design: Annotated[
        bool,
        typer.Option(
            "--design", help="Rank the plan's experiments by what they would tell; estimate nothing."
        ),
    ] = False,
    report: Annotated[bool, typer.Option("--report", help=f"Write a page, {PAGE}.")] = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> None:
    """Estimate parameters from measured data."""
    found = load_identification_plan(plan)
    output, plots = given.pop("output", None), given.pop("plots", True)
    place = Path(output or results_folder(f"identify-{found.name}"))
    with BarProgress() as progress:
        result = identify(
            found,
            pairs("--vary", vary or []),
            measured=measured,
            sigma=pairs("--sigma", sigma or []),
            loss=loss,
            starts=starts,
            evaluations=evaluations,
            profile=profile,
            seed=seed,
            design=design or None,
            scheduler=scheduler,
            workers=workers,
            output=place,
            overwrite=given.pop("overwrite", False),
            plots=plots,
            report=report,
            progress=progress,
            **given,
        )
    for part in format_tables(result):
        show(part)
    files = [RECORD]
    if result.estimates:
        files = [SCENARIO, RECORD, SAMPLES, HISTORY, *((FIT, CERTAINTY) if plots and result.fits else ())]
        files += [PAGE] if report and result.fits else []
    for line in (*format_lines(result), f"Wrote {place}/: {', '.join(files)}"):
        print_line(line)
    if not result.complete:
        raise CosimError(f"interrupted; the best values so far are in {place / SCENARIO}.")
