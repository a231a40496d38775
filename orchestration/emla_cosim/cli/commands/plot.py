"""`emla plot`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CommandError
from ...base.files import check_output_files, report_write_errors, write_atomically
from ...base.option import PLOT
from ...base.ownership import check_replaceable, refuse_others
from ...recorders.registry import TABLES
from ...run.plot_formats import PLOT_FORMATS
from ...study.registration import register
from ...views.plots.overlay import overlay_runs, read_traces
from ...views.plots.stacked import SCREEN
from ...views.plots.style import is_picture, save
from ...views.terminal import print_line, show_file
from .options import read_time

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
    output: Annotated[
        Path, typer.Option(help="Plot file to write: .png, .pdf or .svg.", metavar="FILE")
    ] = Path("plot.png"),
    begin: Annotated[
        str | None,
        typer.Option("--from", help="First time to plot, in s or with a unit.", metavar="TIME"),
    ] = None,
    end: Annotated[
        str | None,
        typer.Option("--to", help="Last time to plot, in s or with a unit.", metavar="TIME"),
    ] = None,
    title: Annotated[
        str | None,
        typer.Option(help="Title. Default: the names of the runs; on paper none.", metavar="TEXT"),
    ] = None,
    layout: Annotated[
        str,
        typer.Option(
            help="Size of the figure: screen, or one-column and two-columns for papers (88 and 181 mm wide).",
            metavar="LAYOUT",
        ),
    ] = SCREEN,
    *,
    given: dict[str, Any],
) -> None:
    """Plot signals of runs over time: one run by unit, several runs overlaid with a panel per signal."""
    if (form := output.suffix.lower()[1:]) not in PLOT_FORMATS:
        raise CommandError(f"the plot file '{output}' must end in .png, .pdf or .svg.")
    found = read_traces(runs)
    check_output_files({output: "the plot"}, {file: "read" for run in found for file in run.files})
    overwrite = given.get("overwrite", False)
    check_replaceable(output, "the plot", is_picture, overwrite)
    start, stop = read_time(begin, "--from"), read_time(end, "--to")
    overlay = overlay_runs(found, signals or [], start, stop, title, layout)
    check = refuse_others(is_picture, overwrite)
    with report_write_errors(output.parent), write_atomically(output, check) as stream:
        save(overlay.figure, stream, form)
    for note in overlay.notes:
        print_line(f"Note: {note}")
    show_file(output)
