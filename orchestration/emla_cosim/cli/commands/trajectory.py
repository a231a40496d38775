"""`emla trajectory`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CosimError
from ...base.option import TRAJECTORY
from ...trajectories.payload_file import payload_place
from ...trajectories.pictures import picture_places
from ...trajectories.problem import load_problem, override_values
from ...trajectories.runner import trajectory
from ...trajectories.summary import format_clearances, format_costs, format_lines, format_peaks, remarks
from ...views.output_folder import results_folder
from ...views.progress_bars import BarProgress
from ...views.terminal import print_line, show
from .options import pairs

OPTIONS = TRAJECTORY
"""Options of the command."""

_WHAT, _HOW, _OUT = "Problem", "Optimisation", "What comes out"
_DEFAULT_PATH = trajectory.__kwdefaults__ or {}

EXAMPLES = (
    "emla trajectory",
    "emla trajectory --set t_M=20 --output mine.json",
)
"""Examples in the help."""


def command(
    problem: Annotated[
        Path | None,
        typer.Argument(
            help="Problem file (.toml) with changes to the paper's problem; see docs/trajectory.md.",
            metavar="PROBLEM",
        ),
    ] = None,
    set: Annotated[
        list[str] | None,
        typer.Option(
            help="Set a value of the problem, such as t_M=20, q_E[3]=0.4, machine.lift_a=1.2, "
            "tip_E=3.2,0.5 or via[1].tip=2.6,-0.4 (repeatable).",
            metavar="NAME=VALUE",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    end_speed: Annotated[
        str,
        typer.Option(
            help="Treatment of end speeds beyond their bounds: clip, exempt, decimal or rest.",
            rich_help_panel=_WHAT,
        ),
    ] = _DEFAULT_PATH["end_speed"],
    tie_break: Annotated[
        float,
        typer.Option(
            help="Weight of the joints' individual powers beside the square of their sum; 0 as in the paper.",
            rich_help_panel=_WHAT,
        ),
    ] = _DEFAULT_PATH["tie_break"],
    degree: Annotated[
        int, typer.Option(help="Degree of the spline, 3 to 5.", rich_help_panel=_HOW)
    ] = _DEFAULT_PATH["degree"],
    knots: Annotated[
        int,
        typer.Option(
            help="Number of distinct knots, denser at both ends; at most 49 minus the degree.",
            rich_help_panel=_HOW,
        ),
    ] = _DEFAULT_PATH["knots"],
    points: Annotated[
        int, typer.Option(help="Number of collocation points between two knots.", rich_help_panel=_HOW)
    ] = _DEFAULT_PATH["points"],
    subdivisions: Annotated[
        int,
        typer.Option(
            help="Number of parts of each span at whose control points strokes and speeds are bounded; more "
            "parts cost less power, and more time to solve.",
            rich_help_panel=_HOW,
        ),
    ] = _DEFAULT_PATH["subdivisions"],
    starts: Annotated[
        int, typer.Option(help="Number of starts; the best result is kept.", rich_help_panel=_HOW)
    ] = _DEFAULT_PATH["starts"],
    output: Annotated[
        Path | None,
        typer.Option(
            help="Trajectory file to write. Default: results/trajectory/trajectory.json.",
            rich_help_panel=_OUT,
        ),
    ] = None,
    plots: Annotated[
        bool, typer.Option(help="Draw plots beside the trajectory file.", rich_help_panel=_OUT)
    ] = True,
    *,
    given: dict[str, Any],
) -> None:
    """Find the motion of the manipulator with the least actuator power."""
    asked = override_values(load_problem(problem), pairs("--set", set or []))
    overwrite = given.get("overwrite", False)
    place = output or _default_path()
    pictures = picture_places(place, plots, problem, overwrite)
    payload = payload_place(place, asked, overwrite)
    with BarProgress() as progress:
        result = trajectory(
            asked,
            end_speed=end_speed,
            tie_break=tie_break,
            degree=degree,
            knots=knots,
            points=points,
            subdivisions=subdivisions,
            starts=starts,
            output=place,
            overwrite=overwrite,
            plots=plots,
            progress=progress,
        )
    for remark in remarks(result):
        print_line(remark)
    show(format_costs(result))
    show(format_peaks(result))
    files = ", ".join((str(place), *(path.name for path in (payload, *pictures) if path is not None)))
    for line in (*format_clearances(result), *format_lines(result), f"Wrote {files}"):
        print_line(line)


def _default_path() -> Path:
    folder = results_folder("trajectory")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CosimError(f"the output folder '{folder}' cannot be written: {error.strerror}.") from error
    return folder / "trajectory.json"
