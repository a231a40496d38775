"""`emla export`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.files import check_output_files
from ...base.option import EXPORT
from ...study.loading import load
from ...views.progress_bars import BarProgress
from ...views.terminal import show_file
from .options import SOURCE

OPTIONS = EXPORT
"""Options that the command takes."""

EXAMPLES = (
    "emla export study study.ssp",
    "emla export lift lift.ssp --set lift.plant.motor.R_s=0.2 --platform win64",
)
"""Commands that the help shows."""


def command(
    scenario: Annotated[str, typer.Argument(help=SOURCE)],
    file: Annotated[Path, typer.Argument(help="The package to write.", metavar="FILE.ssp")],
    given: dict[str, Any],
    nested: Annotated[
        bool, typer.Option(help="One system per joint; libcosim and Ecos read flat systems only.")
    ] = False,
) -> None:
    """Write a scenario as an SSP package."""
    chosen = load(scenario, **given)
    check_output_files({file: "the package"}, {Path(scenario): "the scenario"} | chosen.options.files_read())
    with BarProgress() as progress:
        chosen.export(file, nested, progress)
    show_file(file)
