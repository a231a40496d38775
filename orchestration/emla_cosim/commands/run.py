"""`emla run`."""

from typing import Annotated, Any

import typer

from ..bars import BarProgress
from ..errors import CosimError
from ..loading import load
from ..option import RUN
from ..recorders.progress import ProgressRecorder
from ..results.output_folder import OutputFolder, results_folder
from ..terminal import show_result
from .options import SOURCE

OPTIONS = RUN
"""Options that the command takes."""


def command(scenario: Annotated[str, typer.Argument(help=SOURCE)], given: dict[str, Any]) -> None:
    """Run a scenario into an output folder."""
    chosen = load(scenario, **given)
    options = chosen.options
    with BarProgress() as progress:
        output = OutputFolder(options.output or results_folder(chosen.name), options.output_format)
        with chosen.prepare(progress) as simulation:
            recorders = [*output.recorders(continued=options.resume is not None), ProgressRecorder(progress)]
            result = simulation.attempt(recorders=recorders)
        result, pictures = output.keep(result, options.plots, progress)
    show_result(result, chosen.notes, output, pictures)
    if result.problem is not None:
        raise CosimError(f"{result.problem} What was computed is in {output.path}.")
