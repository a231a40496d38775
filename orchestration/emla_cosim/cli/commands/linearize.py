"""`emla linearize`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.option import LINEARIZE
from ...linearization.folder import BODE, NYQUIST, RECORD, TABLE
from ...linearization.runner import linearize
from ...linearization.summary import format_lines, format_margins, format_point, format_poles
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import SOURCE, read_time

OPTIONS = LINEARIZE
"""Options of the command."""

_WHAT, _OUT = "What is computed", "What comes out"

EXAMPLES = (
    "emla linearize study-drive --open lift --stop-time 1",
    "emla linearize lift --open 'lift.controller.u_q->lift.plant.u_q' --stop-time 1",
    "emla linearize lift --perturb lift.plant.F_L --read lift.plant.x_L --stop-time 1",
    "emla linearize pendulum.fmu --kind me --matrices --perturb torque --read angle --steady",
)
"""Examples in the help."""


def command(
    scenario: Annotated[str, typer.Argument(help=SOURCE)],
    open: Annotated[
        list[str] | None,
        typer.Option(
            help="Open a loop at a connection, on a path inside of a component, or at the measured position "
            "of a JOINT, and compute its margins (repeatable). Default: at the current reference of each "
            "joint.",
            metavar="A.OUTPUT->B.INPUT|JOINT",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    perturb: Annotated[
        list[str] | None,
        typer.Option(
            help="Input of a frequency response, connected or not (repeatable).",
            metavar="COMPONENT.INPUT",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    read: Annotated[
        list[str] | None,
        typer.Option(
            help="Output of a frequency response (repeatable).",
            metavar="COMPONENT.OUTPUT",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            help="Time of the operating point. Default: the stop time less the duration. In s, or with a "
            "unit as in 100ms.",
            metavar="TIME",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    duration: Annotated[
        str | None,
        typer.Option(
            help="Length of the responses. Default: 2000 steps, at most half of the run. In s, or with a "
            "unit as in 100ms.",
            metavar="TIME",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    amplitude: Annotated[
        float | None,
        typer.Option(
            help="Height of the pulses in the unit of the input. Default: the one with the most linear "
            "effect.",
            metavar="NUMBER",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    matrices: Annotated[
        bool,
        typer.Option(
            "--matrices",
            help="Compute state matrices, poles and damping instead, from the inputs of --perturb to the "
            "outputs of --read. All FMUs must run as Model Exchange.",
            rich_help_panel=_WHAT,
        ),
    ] = False,
    steady: Annotated[
        bool,
        typer.Option(
            "--steady",
            help="Compute the matrices at the steady state that is nearest to the state at --at.",
            rich_help_panel=_WHAT,
        ),
    ] = False,
    free: Annotated[
        list[str] | None,
        typer.Option(
            help="Input whose value may change to find the steady state (repeatable).",
            metavar="COMPONENT.INPUT",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(help="Output folder. Default: results/linearize-SCENARIO.", rich_help_panel=_OUT),
    ] = None,
    plots: Annotated[bool, typer.Option(help="Draw Bode and Nyquist plots.", rich_help_panel=_OUT)] = True,
    *,
    given: dict[str, Any],
) -> None:
    """Compute frequency responses and margins of a scenario."""
    place = output or results_folder(f"linearize-{Path(scenario).stem}")
    with BarProgress() as progress:
        result = linearize(
            scenario,
            open=open or (),
            perturb=perturb or (),
            read=read or (),
            at=read_time(at, "--at"),
            duration=read_time(duration, "--duration"),
            amplitude=amplitude,
            matrices=matrices,
            steady=steady,
            free=free or (),
            output=place,
            plots=plots,
            progress=progress,
            **given,
        )
    for table in format_margins(result):
        show(table)
    if result.matrices is not None:
        show(format_point(result, result.matrices))
        show(format_poles(result.matrices))
    pictures = [BODE, *([NYQUIST] if result.margins else [])] if plots else []
    files = ", ".join((RECORD, TABLE, *pictures) if result.responses else (RECORD,))
    for line in (*format_lines(result), f"Wrote {place}/: {files}"):
        print_line(line)
