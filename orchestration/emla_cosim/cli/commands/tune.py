"""`emla tune`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CosimError
from ...base.option import SWEEP
from ...sweeps.distributions import FORMS
from ...tuning.folder import BEST, HISTORY, PICTURE, RECORD
from ...tuning.plan import load_tuning_plan
from ...tuning.result import TuneResult
from ...tuning.runner import tune
from ...tuning.summary import format_lines, format_summary
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import PLAN, Scheduler, Workers, pairs

OPTIONS = SWEEP
"""Options of the command."""

_WANTED, _TRIED = "Objective", "Search"

EXAMPLES = (
    "emla tune rsba-tilt",
    "emla tune lift --vary lift.controller.k_1=10:1000 --objective lift.position_error_m",
)
"""Examples in the help."""


def command(
    plan: Annotated[str, typer.Argument(help=PLAN)],
    given: dict[str, Any],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Gain and its range, as {FORMS}; the search in LOW:HIGH is logarithmic (repeatable).",
            metavar="NAME=RANGE",
            rich_help_panel=_TRIED,
        ),
    ] = None,
    derive: Annotated[
        list[str] | None,
        typer.Option(
            help="Start value computed from the varied gains (repeatable).",
            metavar="NAME=EXPRESSION",
            rich_help_panel=_TRIED,
        ),
    ] = None,
    objective: Annotated[
        str | None,
        typer.Option(
            help="Expression over metrics to minimise, such as tilt.position_error_m.",
            metavar="EXPRESSION",
            rich_help_panel=_WANTED,
        ),
    ] = None,
    metric: Annotated[
        list[str] | None,
        typer.Option(
            help="Additional metric over signals (repeatable).",
            metavar="'NAME = EXPRESSION'",
            rich_help_panel=_WANTED,
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Fail if the objective with the validation seeds is worse by more than this fraction. "
            "Default: no limit.",
            metavar="NUMBER",
            rich_help_panel=_WANTED,
        ),
    ] = None,
    evaluations: Annotated[
        int | None, typer.Option(help="Number of gain sets to try. Default: 200.", rich_help_panel=_TRIED)
    ] = None,
    training: Annotated[
        int | None, typer.Option(help="Number of seeds to tune with. Default: 2.", rich_help_panel=_TRIED)
    ] = None,
    validation: Annotated[
        int | None,
        typer.Option(help="Number of other seeds to validate with. Default: 4.", rich_help_panel=_TRIED),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of random numbers. Default: 0.", rich_help_panel=_TRIED)
    ] = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> None:
    """Tune gains of a scenario's controllers."""
    found = load_tuning_plan(plan)
    output, plots = given.pop("output", None), given.pop("plots", True)
    place = Path(output or results_folder(f"tune-{found.name}"))
    overwrite = given.pop("overwrite", False)
    with BarProgress() as progress:
        result = tune(
            found,
            pairs("--vary", vary or []),
            objective=objective,
            require=given.pop("require", None),
            derive=pairs("--derive", derive or []),
            metrics=metric,
            evaluations=evaluations,
            training=training,
            validation=validation,
            seed=seed,
            tolerance=tolerance,
            scheduler=scheduler,
            workers=workers,
            output=place,
            overwrite=overwrite,
            plots=plots,
            progress=progress,
            **given,
        )
    _show(result, place, plots)
    if not result.complete:
        raise CosimError(f"interrupted; the best gains so far are in {place / BEST}.")
    if (problem := result.problem()) is not None:
        raise CosimError(problem)


def _show(result: TuneResult, place: Path, plots: bool) -> None:
    """Show tables, a summary and the files."""
    for part in format_summary(result):
        show(part)
    files = [BEST, RECORD, HISTORY, *([PICTURE] if plots else [])]
    for line in (*format_lines(result), f"emla run {place / BEST}", f"Wrote {place}/: {', '.join(files)}"):
        print_line(line)
