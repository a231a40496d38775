"""`emla trajectory`."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ...analyses.trajectory.problem import load_problem
from ...analyses.trajectory.report import MotionFiles, build_report
from ...analyses.trajectory.runner import trajectory
from ...base.files import report_write_errors
from ...base.option import OUTPUT, TRAJECTORY, argument, option, switch
from ...views.output_folder import results_folder
from ...views.terminal import BarProgress, print_line
from .analysis import show_report

OPTIONS = TRAJECTORY

_PROBLEM, _OPTIMISATION = "Problem", "Optimisation"
# those of the function, so that the command and Python have the same ones
_DEFAULTS = trajectory.__kwdefaults__ or {}

EXAMPLES = (
    "emla trajectory",
    "emla trajectory --set t_M=20 --output mine.json",
    "emla trajectory crane --set q_E=0.4,0.4,0.6 --set t_M=12",
)

_optimisation_option = partial(option, group=_OPTIMISATION)
_problem_option = partial(option, group=_PROBLEM)


@dataclass(frozen=True)
class Parameters:
    """Arguments and options of the command."""

    problem: Path | None = argument(
        None,
        help="Problem file (.toml), or a machine by name or file. Default: the paper's problem.",
        metavar="PROBLEM",
    )
    set: Mapping[str, str] = _problem_option(
        {},
        help="Set a value of the problem, such as t_M=20, q_E[3]=0.4, machine.lift.a=1.2, "
        "tip_E=3.2,0.5 or via[1].tip=2.6,-0.4 (repeatable).",
        metavar="NAME=VALUE",
    )
    end_speed: str = _problem_option(
        _DEFAULTS["end_speed"],
        help="Treatment of end speeds beyond their bounds: clip, exempt, decimal or rest.",
    )
    tie_break: float = _problem_option(
        _DEFAULTS["tie_break"],
        help="Weight of the joints' individual powers beside the square of their sum; 0 as in the paper.",
    )
    degree: int = _optimisation_option(_DEFAULTS["degree"], help="Degree of the spline, 3 to 5.")
    knots: int = _optimisation_option(
        _DEFAULTS["knots"], help="Number of distinct knots, denser at both ends; at most 49 minus the degree."
    )
    points: int = _optimisation_option(
        _DEFAULTS["points"], help="Number of collocation points between two knots."
    )
    subdivisions: int = _optimisation_option(
        _DEFAULTS["subdivisions"],
        help="Number of parts of each span at whose control points strokes and speeds are bounded; more "
        "parts cost less power, and more time to solve.",
    )
    starts: int = _optimisation_option(_DEFAULTS["starts"], help="Number of starts; the best result is kept.")
    output: Path | None = option(
        help="Trajectory file to write. Default: results/trajectory/trajectory.json.", group=OUTPUT
    )
    plots: bool = option(True, help="Draw plots beside the trajectory file.", group=OUTPUT)
    report: bool = switch("Write a page with all results beside the trajectory file.", OUTPUT)


def command(parameters: Parameters, options: dict[str, Any]) -> None:
    """Find the motion of a machine with the least actuator power."""
    problem = load_problem(parameters.problem, parameters.set)
    path = parameters.output or _prepare_default_path()
    overwrite = options.get("overwrite", False)
    files = MotionFiles(path, problem, parameters.problem, overwrite, parameters.plots, parameters.report)
    options |= vars(parameters) | {"output": path, "problem": problem}
    del options["set"]
    with BarProgress() as progress:
        result = trajectory(progress=progress, **options)
    show_report(build_report(result))
    print_line(f"Wrote {', '.join((str(path), *(file.name for file in files.paths[1:])))}")


def _prepare_default_path() -> Path:
    """Return the default path of the trajectory file, and create its folder."""
    folder = results_folder("trajectory")
    with report_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder / "trajectory.json"
