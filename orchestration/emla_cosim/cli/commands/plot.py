"""`emla plot`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CommandError
from ...base.files import check_output_files, report_write_errors, write_atomically
from ...base.option import PLOT
from ...base.ownership import check_replaceable
from ...base.quantities import parse_quantity, parse_unit_name
from ...recorders.registry import TABLES
from ...study.registration import register
from ...views.plots.overlay import overlay_runs, read_traces
from ...views.plots.style import is_picture, save
from ...views.terminal import print_line, show_file

register()

OPTIONS = PLOT
"""Options of the command."""


def command(
    runs: Annotated[
        list[Path],
        typer.Argument(
            help=f"Output folders of runs, or tables ({', '.join(f'.{name}' for name in TABLES)}).",
            metavar="RUN",
        ),
    ],
    signals: Annotated[
        list[str] | None,
        typer.Option(
            help="Signals to plot; * matches any text (repeatable). Default: positions and references of "
            "joints, or all.",
            metavar="PATTERN",
        ),
    ] = None,
    output: Annotated[Path, typer.Option(help="Plot file to write.", metavar="FILE.png")] = Path("plot.png"),
    begin: Annotated[
        str | None,
        typer.Option("--from", help="First time to plot, in s or with a unit.", metavar="TIME"),
    ] = None,
    end: Annotated[
        str | None,
        typer.Option("--to", help="Last time to plot, in s or with a unit.", metavar="TIME"),
    ] = None,
    *,
    given: dict[str, Any],
) -> None:
    """Plot signals of runs over time: one run by unit, several runs overlaid with a panel per signal."""
    if output.suffix.lower() != ".png":
        raise CommandError(f"the plot file '{output}' must end in .png.")
    found = read_traces(runs)
    check_output_files({output: "the plot"}, {file: "read" for run in found for file in run.files})
    check_replaceable(output, "the plot", is_picture, given.get("overwrite", False))
    overlay = overlay_runs(found, signals or [], _seconds("--from", begin), _seconds("--to", end))
    with report_write_errors(output.parent), write_atomically(output) as stream:
        save(overlay.figure, stream)
    for note in overlay.notes:
        print_line(f"Note: {note}")
    show_file(output)


def _seconds(flag: str, text: str | None) -> float | None:
    return None if text is None else parse_quantity(text, flag).in_unit(parse_unit_name("s", flag), flag)
