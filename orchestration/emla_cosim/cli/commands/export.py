"""`emla export`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.files import check_output_files
from ...base.option import EXPORT, argument
from ...run.scenarios.scenario import FMU, SSP, C, find_kind, refuse_unsuited
from ...study.loading import load
from ...views.terminal import BarProgress, show_file
from ..command import scenario

OPTIONS = EXPORT

EXAMPLES = (
    "emla export study study.ssp",
    "emla export lift lift.ssp --set lift.plant.motor.R_s=0.2 --platform win64",
    "emla export lift lift.fmu --platform linux64 --platform win64 --outputs 'lift.plant.*'",
    "emla export lift lift.fmu --fmi 3",
    "emla export lift control.c --components controller --components observer --precision float",
)

_KINDS = {SSP: "the package", FMU: "the FMU", C: "the C file"}
"""What messages call the written file."""


@dataclass(frozen=True)
class Parameters:
    """Arguments of the command."""

    scenario: str = scenario()
    file: Path = argument(help="SSP, FMU or C file to write.", metavar="FILE.ssp|FILE.fmu|FILE.c")


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Export a scenario as an SSP or as one FMU, or components as plain C.

    See docs/containers.md for an FMU, and docs/c-code.md for C.
    """
    file = parameters.file
    kind = find_kind(file)
    refuse_unsuited(kind, options)
    exported = load(parameters.scenario, **options)
    files = {file: _KINDS[kind]}
    if kind == C:
        files[file.with_suffix(".h")] = "the header"
    check_output_files(files, {Path(parameters.scenario): "the scenario"} | exported.options.files_read())
    with BarProgress() as progress:
        exported.export(file, progress)
    for path in files:
        show_file(path)
