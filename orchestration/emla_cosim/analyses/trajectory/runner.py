"""Optimise a motion of a machine."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from machine_fmu.optimisation.assessment import Assessment, assessed
from machine_fmu.optimisation.contradictions import find_contradictions
from machine_fmu.optimisation.problem import EndSpeed, MotionProblem
from machine_fmu.optimisation.solving import MAX_ITERATIONS, NoMotionError, Solution, detour, narrowed, solved
from machine_fmu.optimisation.transcription import Discretisation
from machine_fmu.spline_window import COEFFICIENTS

from ...base.errors import CommandError, RunError, check_choice
from ...base.extras import LEFT_OUT, has_extra
from ...base.progress import Progress
from ...base.values import convert_value
from .problem import load_problem
from .report import MotionFiles
from .result import TrajectoryResult

_RANGES = {"degree": (3, 5), "points": (3, 50), "starts": (1, 100), "subdivisions": (1, 64)}
"""Smallest and largest values of the sizes; from degree 3 on, the acceleration has no jumps."""

_MIN_COEFFICIENTS = 6
"""Two at either end for position and speed, and two free ones between."""


def trajectory(
    problem: MotionProblem | Mapping[str, Any] | str | Path | None = None,
    *,
    end_speed: str = EndSpeed.CLIP.value,
    tie_break: float = 1e-3,
    degree: int = 5,
    knots: int = 20,
    points: int = 10,
    subdivisions: int = 1,
    starts: int = 1,
    output: str | Path | None = None,
    overwrite: bool = False,
    plots: bool = True,
    report: bool = False,
    progress: Progress | None = None,
) -> TrajectoryResult:
    """Optimize the motion between two postures for least actuator power, (14) within the bounds of (15).

    Args:
        problem: a `MotionProblem`, a TOML file with its fields, or a mapping with some of them, of which
            `machine` is the name or file of a machine, or a mapping with `file` and numbers by name. A file
            or the name of a machine is the problem with that machine. Default: the problem of the paper,
            Table II.
        end_speed: reading of an end speed beyond its own bound: clip, exempt, decimal or rest.
        tie_break: weight of the powers of single joints beside the square of their sum, 0 to 1000; 0 is as
            printed in the paper.
        degree: degree of the spline, 3 to 5.
        knots: number of different knots: at least 7 - `degree` and 2, at most 49 - `degree`.
        points: number of points between two knots in which bounds are checked, 3 to 50.
        subdivisions: number of parts of each span between knots, 1 to 64. Strokes and speeds are bounded at
            the control points of these parts. More parts cost less power, and more time to solve.
        starts: number of initial guesses, 1 to 100. The best motion counts.
        output: file to write the motion to. A payload that changes is written beside it.
        overwrite: replace files that emla did not write.
        plots: draw pictures beside the file.
        report: write a page beside the file.
        progress: receives the progress of the optimization.

    Returns:
        The motion and its metrics.

    Raises:
        CommandError: the problem is wrong. Nothing was solved.
        RunError: no motion keeps all bounds; the message names those that are in the way.
    """
    check_choice("reading of end speeds", end_speed, [reading.value for reading in EndSpeed])
    reporter, reading, stated = progress or Progress(), EndSpeed(end_speed), load_problem(problem)
    _check_sizes(degree=degree, points=points, subdivisions=subdivisions, starts=starts)
    _check_knots(knots, degree)
    weight = convert_value(tie_break, float, "the tie-break weight")
    if not 0.0 <= weight <= 1e3:
        raise CommandError(f"the tie-break weight is {weight:g}; it must be from 0 to 1000.")
    discretisation = Discretisation(degree, knots, points, weight, subdivisions)
    files = None
    if output is not None:
        path = convert_value(output, Path, "the output file")
        files = MotionFiles(path, stated, problem, overwrite, plots, report)
        if plots and not has_extra("plots"):
            reporter.note(f"Note: {LEFT_OUT}.")
    read = _resolve_contradictions(stated, reading)
    best, figures = _find_best(read, discretisation, starts, reporter)
    spline, contradictions = best.spline(discretisation), find_contradictions(stated)
    result = TrajectoryResult(
        spline, figures, stated, read, reading, contradictions, discretisation, best, starts
    )
    if files is not None:
        files.write(result)
    return result


def _check_sizes(**sizes: int) -> None:
    for name, value in sizes.items():
        least, most = _RANGES[name]
        if type(value) is not int or not least <= value <= most:
            raise CommandError(f"{name} is {value!r}; it must be a whole number from {least} to {most}.")


def _check_knots(knots: int, degree: int) -> None:
    # a spline of this degree has knots + degree - 1 coefficients
    least, most = max(_MIN_COEFFICIENTS + 1 - degree, 2), COEFFICIENTS + 1 - degree
    if type(knots) is not int or not least <= knots <= most:
        raise CommandError(
            f"knots is {knots!r}; with degree {degree}, it must be a whole number from {least} to {most}: "
            f"the block Trajectory has room for {COEFFICIENTS} coefficients, which are knots + degree - 1."
        )


def _resolve_contradictions(problem: MotionProblem, reading: EndSpeed) -> MotionProblem:
    """Return the problem with this reading of its end speeds; CommandError if it still contradicts itself."""
    read = problem.read_as(reading)
    remaining = read if reading != EndSpeed.EXEMPT else read.read_as(EndSpeed.CLIP)
    if sentences := find_contradictions(remaining):
        raise CommandError(f"the problem contradicts itself: {'; '.join(sentences)}.")
    return read


def _find_best(
    problem: MotionProblem, how: Discretisation, starts: int, reporter: Progress
) -> tuple[Solution, Assessment]:
    """Return the best of the motions from several starts, with its figures."""
    solutions = list[Solution]()
    for i in range(starts):
        guess = None if i == 0 else detour(problem, how, i)
        reporter.begin("optimising" if starts == 1 else f"start {i + 1}", MAX_ITERATIONS, "iterations")
        try:
            solutions.append(solved(problem, how, guess, lambda: reporter.advance(1)))
        except NoMotionError as error:
            if not solutions and i + 1 == starts:
                raise RunError(str(error)) from error
        reporter.finish()
    best = min(solutions, key=lambda solution: solution.cost)
    # between the points that were constrained, a bound can be exceeded
    figures = assessed(best.spline(how), problem, how.tie_break)
    if not figures.within_bounds:
        reporter.begin("narrower bounds", MAX_ITERATIONS, "iterations")
        best, figures = narrowed(best, problem, how, lambda: reporter.advance(1))
        reporter.finish()
    return best, figures
