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
    "emla export lift control.c --components controller --components observer --precision float",
)
"""Examples in the help."""

_STEPPED = ("algorithm", "extrapolation", "step_multiples", "order", "coupling_tolerance", "outputs")

_NOT_IN = {
    ".ssp": (*_STEPPED, "inputs", "components", "precision"),
    ".fmu": ("components", "precision"),
    ".c": ("inputs", "platform"),
}
"""Options that a kind of file has no place for."""

_KINDS = {".fmu": "the FMU", ".c": "the C file"}
"""What files are called by their ends; all others are packages."""


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
    kind = file.suffix.lower() if file.suffix.lower() in _KINDS else ".ssp"
    if others := [name for name in _NOT_IN[kind] if name in given]:
        flag = list_options()[others[0]].flag
        ends = [end for end, names in _NOT_IN.items() if others[0] not in names]
        what = {".ssp": "an SSP", ".fmu": "an FMU", ".c": "a C file"}[kind]
        raise CommandError(
            f"{what} cannot hold {flag}; leave it out, or export to a file that ends in {' or '.join(ends)}."
        )
    chosen = load(scenario, **given)
    files = {file: _KINDS.get(kind, "the package")}
    if kind == ".c":
        files[file.with_suffix(".h")] = "the header"
    check_output_files(files, {Path(scenario): "the scenario"} | chosen.options.files_read())
    with BarProgress() as progress:
        chosen.export(file, progress)
    for one in files:
        show_file(one)
