"""`emla export`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.files import check_output_files
from ...base.option import EXPORT
from ...run.scenarios.exported_files import FMU, SSP, C, find_kind, refuse_unsuited
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
    "emla export lift lift.fmu --fmi 3",
    "emla export lift control.c --components controller --components observer --precision float",
)
"""Examples in the help."""

_KINDS = {SSP: "the package", FMU: "the FMU", C: "the C file"}
"""What messages call the written file."""


def command(
    scenario: Annotated[str, typer.Argument(help=SOURCE)],
    file: Annotated[
        Path, typer.Argument(help="SSP, FMU or C file to write.", metavar="FILE.ssp|FILE.fmu|FILE.c")
    ],
    given: dict[str, Any],
) -> None:
    """Export a scenario as an SSP or as one FMU, or components as plain C.

    See docs/containers.md for an FMU, and docs/c-code.md for C.
    """
    kind = find_kind(file)
    refuse_unsuited(kind, given)
    chosen = load(scenario, **given)
    files = {file: _KINDS[kind]}
    if kind == C:
        files[file.with_suffix(".h")] = "the header"
    check_output_files(files, {Path(scenario): "the scenario"} | chosen.options.files_read())
    with BarProgress() as progress:
        chosen.export(file, progress)
    for one in files:
        show_file(one)
