"""`emla size`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CommandError, RunError, join_names
from ...base.option import SIZE
from ...base.quantities import read_quantity
from ...sizing.folder import CYCLES, PAGE, RECORD, TABLE
from ...sizing.pictures import list_pictures
from ...sizing.runner import LEAD_IN, size
from ...sizing.summary import format_lines, format_tables
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import SOURCE, read_time

OPTIONS = SIZE
"""Options of the command."""

_WHAT, _OUT = "What is required", "What comes out"

EXAMPLES = (
    "emla size prototype --actuator prototype=docs/actuator.toml",
    "emla size prototype --actuator prototype=a.toml,b.toml,c.toml --life 20000h --report",
    "emla size study --actuator lift=a.toml,b.toml --actuator tilt=c.toml,d.toml",
    "emla size mine.toml --cycle 4s --ambient 95degF",
)
"""Examples in the help."""


def command(
    scenario: Annotated[str, typer.Argument(help=SOURCE)],
    cycle: Annotated[
        str | None,
        typer.Option(
            help="Length of the cycle, which ends at the stop time and repeats. Default: the period of the "
            "reference, otherwise the whole run. In s, or with a unit as in 500ms.",
            metavar="TIME",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    lead_in: Annotated[
        str | None,
        typer.Option(
            help="Time before the start time, in which the joints settle; it does not count. Default: 1 s. "
            "In s, or with a unit as in 500ms.",
            metavar="TIME",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    ambient: Annotated[
        str,
        typer.Option(
            help="Temperature around the motors, such as 40degC or 104degF.",
            metavar="TEMPERATURE",
            rich_help_panel=_WHAT,
        ),
    ] = "40degC",
    life: Annotated[
        str | None,
        typer.Option(
            help="Time for which the cycle is to repeat, such as 20000h. Without it, the screw's life has "
            "no verdict.",
            metavar="TIME",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option(help="Output folder. Default: results/size-SCENARIO.", rich_help_panel=_OUT)
    ] = None,
    plots: Annotated[bool, typer.Option(help="Draw plots of each joint.", rich_help_panel=_OUT)] = True,
    report: Annotated[
        bool, typer.Option("--report", help="Write a page with all results, size.html.", rich_help_panel=_OUT)
    ] = False,
    *,
    given: dict[str, Any],
) -> None:
    """Examine whether actuators do the job of a scenario."""
    place = output or results_folder(f"size-{Path(scenario).stem}")
    actuators, candidates = _split_candidates(given.pop("actuator", None) or {})
    if actuators:
        given["actuator"] = actuators
    before = read_time(lead_in, "--lead-in")
    with BarProgress() as progress:
        result = size(
            scenario,
            candidates=candidates,
            cycle=read_time(cycle, "--cycle"),
            lead_in=LEAD_IN if before is None else before,
            ambient=read_quantity(ambient, "--ambient", "K", readings=("degC", "degF", "K")),
            life=None if life is None else read_quantity(life, "--life", "s", readings=("h", "s")),
            output=place,
            plots=plots,
            report=report,
            progress=progress,
            **given,
        )
    for table in format_tables(result):
        show(table)
    files = [RECORD, TABLE, CYCLES, *(list_pictures(result) if plots else []), *([PAGE] if report else [])]
    for line in (*format_lines(result), f"Wrote {place}/: {', '.join(files)}"):
        print_line(line)
    if unjudged := result.unjudged:
        names = join_names(dict.fromkeys(one.joint for one in unjudged))
        raise RunError(f"no verdict on {names}: see above why.")


def _split_candidates(given: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, list[str]]]:
    """Return the actuators of joints with one file, and the files of joints with several."""
    files = {joint: [part for part in str(one).split(",") if part] for joint, one in given.items()}
    if none := [joint for joint, one in files.items() if not one]:
        raise CommandError(f"--actuator {none[0]}={given[none[0]]} names no file.")
    return (
        {joint: one[0] for joint, one in files.items() if len(one) == 1},
        {joint: one for joint, one in files.items() if len(one) > 1},
    )
