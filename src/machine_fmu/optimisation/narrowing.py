"""Make forces and distances from obstacles keep their bounds between the collocation points, too."""

from collections.abc import Callable
from dataclasses import replace

from .assessment import GROUND, Assessment, assessed
from .problem import MotionProblem
from .solving import NoMotionError, Solution, solved
from .transcription import Discretisation

_MAX_REPETITIONS = 6
"""Largest number of times that bounds are narrowed; once is usually enough."""

_NARROWING_FACTOR = 1.5
"""Factor by which bounds are narrowed more than forces exceeded them."""

_MIN_RISE = 1e-4
"""Smallest height in m by which a clearance is raised."""


def narrowed(
    solution: Solution, problem: MotionProblem, how: Discretisation, on_iteration: Callable[[], None]
) -> tuple[Solution, Assessment]:
    """Find a motion near a given one that keeps its bounds on the dense grid, and return it with its figures.

    Strokes and their derivatives keep their bounds everywhere, forces and distances only at the collocation
    points. If these exceed them between, the optimisation is repeated with bounds that are narrower by the
    excess.
    """
    figures, narrow_problem = assessed(solution.spline(how), problem, how.tie_break), problem
    for _ in range(_MAX_REPETITIONS):
        if figures.within_bounds:
            break
        narrow_problem = _narrow(narrow_problem, figures)
        try:
            repeated = solved(narrow_problem, how, solution.coefficients, on_iteration)
        # the motion before stays, and its figures report what it exceeds
        except NoMotionError:
            break
        solution = solution.then(repeated)
        figures = assessed(solution.spline(how), problem, how.tie_break)
    return solution, figures


def _narrow(problem: MotionProblem, figures: Assessment) -> MotionProblem:
    bounds = zip(problem.f_LB, problem.f_UB, figures.peaks, strict=True)
    reductions = [_NARROWING_FACTOR * peak.excess * (high - low) for low, high, peak in bounds]
    low, high = (
        tuple(x + sign * d for x, d in zip(values, reductions, strict=True))
        for sign, values in ((1.0, problem.f_LB), (-1.0, problem.f_UB))
    )
    rises = {
        clearance.obstacle: _NARROWING_FACTOR * clearance.shortfall + _MIN_RISE
        for clearance in figures.clearances
        if not clearance.is_kept
    }
    height = problem.ground_clearance
    if height is not None:
        height += rises.get(GROUND, 0.0)
    obstacles = tuple(
        replace(obstacle, clearance=obstacle.clearance + rises.get(obstacle.label, 0.0))
        for obstacle in problem.obstacles
    )
    return replace(problem, f_LB=low, f_UB=high, ground_clearance=height, obstacles=obstacles)
