"""`emla export`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CommandError
from ...base.files import check_output_files
from ...base.option import EXPORT
from ...run.options import list_options
from ...study.loading import load
from ...views.progress_bars import BarProgress
from ...views.terminal import show_file
from .options import SOURCE

OPTIONS = EXPORT
"""Options of the command."""

EXAMPLES = (
    "emla export study study.ssp",
    "emla export lift lift.ssp --set lift.plant.motor.R_s=0.2 --platform win64",
    "emla export lift lift.fmu --platform linux64 --platform win64 --outputs 'lift.plant.*'",
)
"""Examples in the help."""

_OF_FMUS = (
    "algorithm",
    "extrapolation",
    "step_multiples",
    "order",
    "coupling_tolerance",
    "inputs",
    "outputs",
)
"""Options that an SSP has no place for."""


def command(
    scenario: Annotated[str, typer.Argument(help=SOURCE)],
    file: Annotated[Path, typer.Argument(help="SSP or FMU to write.", metavar="FILE.ssp|FILE.fmu")],
    given: dict[str, Any],
) -> None:
    """Export a scenario as an SSP, or as one FMU that steps its components; see docs/containers.md."""
    if file.suffix.lower() != ".fmu" and (others := [name for name in _OF_FMUS if name in given]):
        flag = list_options()[others[0]].flag
        raise CommandError(f"an SSP cannot hold {flag}; leave it out, or export to a file that ends in .fmu.")
    chosen = load(scenario, **given)
    what = "the FMU" if file.suffix.lower() == ".fmu" else "the package"
    check_output_files({file: what}, {Path(scenario): "the scenario"} | chosen.options.files_read())
    with BarProgress() as progress:
        chosen.export(file, progress)
    show_file(file)
