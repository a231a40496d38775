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
"""Options of the command."""

EXAMPLES = (
    "emla export study study.ssp",
    "emla export lift lift.ssp --set lift.plant.motor.R_s=0.2 --platform win64",
)
"""Examples in the help."""


def command(
    scenario: Annotated[str, typer.Argument(help=SOURCE)],
    file: Annotated[Path, typer.Argument(help="Package to write.", metavar="FILE.ssp")],
    given: dict[str, Any],
) -> None:
    """Export a scenario as an SSP package."""
    chosen = load(scenario, **given)
    check_output_files({file: "the package"}, {Path(scenario): "the scenario"} | chosen.options.files_read())
    with BarProgress() as progress:
        chosen.export(file, progress)
    show_file(file)
