"""`emla trajectory`."""

from pathlib import Path
from typing import Annotated, Any

import typer

from ...base.errors import CosimError
from ...base.option import TRAJECTORY
from ...trajectories.finding import trajectory
from ...trajectories.given import problem_of, with_values
from ...trajectories.pictures import picture_places
from ...trajectories.summary import costs, lines, peaks, remarks
from ...views.bars import BarProgress
from ...views.output_folder import results_folder
from ...views.terminal import say, show
from .options import pairs

OPTIONS = TRAJECTORY
"""Options that the command takes."""

_WHAT, _HOW, _OUT = "What is asked", "How it is found", "What comes out"
_USUAL = trajectory.__kwdefaults__ or {}

EXAMPLES = (
    "emla trajectory",
    "emla trajectory --set t_M=20 --output mine.json",
)
"""Commands that the help shows."""


def command(
    problem: Annotated[
        Path | None,
        typer.Argument(
            help="Problem (.toml) that differs from the paper's: docs/trajectory.md.", metavar="PROBLEM"
        ),
    ] = None,
    set: Annotated[
        list[str] | None,
        typer.Option(
            help="A value of the problem, such as t_M=20, q_E[3]=0.4 or machine.lift_a=1.2 (repeatable).",
            metavar="NAME=VALUE",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    end_speed: Annotated[
        str,
        typer.Option(
            help="How an end speed beyond its bound is read: clip, exempt, decimal, rest.",
            rich_help_panel=_WHAT,
        ),
    ] = _USUAL["end_speed"],
    tie_break: Annotated[
        float,
        typer.Option(
            help="Weight of the joints' own powers beside the square of their sum; 0 is as printed.",
            rich_help_panel=_WHAT,
        ),
    ] = _USUAL["tie_break"],
    degree: Annotated[int, typer.Option(help="Degree of the spline, 3 to 5.", rich_help_panel=_HOW)] = _USUAL[
        "degree"
    ],
    knots: Annotated[
        int, typer.Option(help="Different knots, closer together at both ends.", rich_help_panel=_HOW)
    ] = _USUAL["knots"],
    points: Annotated[
        int, typer.Option(help="Collocation points between two knots.", rich_help_panel=_HOW)
    ] = _USUAL["points"],
    starts: Annotated[
        int, typer.Option(help="Starts, of which the best result counts.", rich_help_panel=_HOW)
    ] = _USUAL["starts"],
    output: Annotated[
        Path | None,
        typer.Option(
            help="The trajectory file. Default: results/trajectory/trajectory.json.", rich_help_panel=_OUT
        ),
    ] = None,
    plots: Annotated[bool, typer.Option(help="Draw plots beside it.", rich_help_panel=_OUT)] = True,
    *,
    given: dict[str, Any],
) -> None:
    """Find the motion of the manipulator that takes least actuator power."""
    asked = with_values(problem_of(problem), pairs("--set", set or []))
    overwrite = given.get("overwrite", False)
    place = output or _usual_place()
    pictures = picture_places(place, plots, problem, overwrite)
    with BarProgress() as progress:
        result = trajectory(
            asked,
            end_speed=end_speed,
            tie_break=tie_break,
            degree=degree,
            knots=knots,
            points=points,
            starts=starts,
            output=place,
            overwrite=overwrite,
            plots=plots,
            progress=progress,
        )
    for remark in remarks(result):
        say(remark)
    show(costs(result))
    show(peaks(result))
    files = ", ".join((str(place), *(path.name for path in pictures)))
    for line in (*lines(result), f"Wrote {files}"):
        say(line)


def _usual_place() -> Path:
    folder = results_folder("trajectory")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CosimError(f"the output folder '{folder}' cannot be written: {error.strerror}.") from error
    return folder / "trajectory.json"
