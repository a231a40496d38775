"""`emla plot`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...base.errors import CommandError
from ...base.files import check_output_files
from ...base.option import OTHER_OPTIONS, PLOT, argument, option
from ...base.output_files import OutputFile
from ...recorders.registry import TABLES
from ...run.output_options import PLOT_FORMATS
from ...study.registration import register
from ...views.plots.overlay import overlay_runs, read_traces
from ...views.plots.stacked import SCREEN
from ...views.plots.style import is_picture, save
from ...views.terminal import print_line, show_file

register()

OPTIONS = PLOT

_plot_option = partial(option, group=OTHER_OPTIONS)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    runs: Sequence[Path] = argument(
        help=f"Output folders of runs, or tables ({', '.join(f'.{name}' for name in TABLES)}).", metavar="RUN"
    )
    signals: Sequence[str] = _plot_option(
        [],
        help="Signals to plot; * matches any text (repeatable). Default: positions and references of "
        "joints, or all.",
        metavar="PATTERN",
    )
    output: Path = _plot_option(
        Path("plot.png"), help="Plot file to write: .png, .pdf or .svg. Default: plot.png.", metavar="FILE"
    )
    start: float | None = _plot_option(help="First time to plot.", flag="--from", unit="s")
    stop: float | None = _plot_option(help="Last time to plot.", flag="--to", unit="s")
    title: str | None = _plot_option(
        help="Title. Default: the names of the runs; on paper none.", metavar="TEXT"
    )
    layout: str = _plot_option(
        SCREEN,
        help="Size of the figure: screen, or one-column and two-columns for papers (88 and 181 mm wide).",
        metavar="LAYOUT",
    )


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Plot signals of runs over time: one run by unit, several runs overlaid with a panel per signal."""
    output = parameters.output
    if (form := output.suffix.lower()[1:]) not in PLOT_FORMATS:
        raise CommandError(f"the plot file '{output}' must end in .png, .pdf or .svg.")
    traces = read_traces(parameters.runs)
    check_output_files({output: "the plot"}, {file: "read" for run in traces for file in run.files})
    # checked before anything is drawn
    file = OutputFile(output, "the plot", is_picture, options.get("overwrite", False))
    overlay = overlay_runs(
        traces, parameters.signals, parameters.start, parameters.stop, parameters.title, parameters.layout
    )
    with file.open() as stream:
        save(overlay.figure, stream, form)
    for note in overlay.notes:
        print_line(f"Note: {note}")
    show_file(output)
