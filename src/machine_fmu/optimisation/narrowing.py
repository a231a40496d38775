"""Make forces and distances from obstacles keep their bounds between the collocation points, too."""

from collections.abc import Callable
from dataclasses import replace

from .assessment import GROUND, Assessment, assessed
from .problem import MotionProblem
from .solving import NoMotionError, Solution, solved
from .transcription import Discretisation

_ROUNDS = 6
"""Largest number of times that bounds are narrowed; once is usually enough."""

_MORE = 1.5
"""Factor by which bounds are narrowed more than forces exceeded them."""

_LEAST_RISE = 1e-4
"""Smallest height in m by which a clearance is raised."""


def narrowed(
    found: Solution, problem: MotionProblem, how: Discretisation, heard: Callable[[], None]
) -> tuple[Solution, Assessment]:
    """Find a motion near a given one that keeps its bounds on the dense grid, and return it with its figures.

    Strokes and their derivatives keep their bounds everywhere, forces and distances only at the collocation
    points. If these exceed them between, the optimisation is repeated with bounds that are narrower by the
    excess.
    """
    figures, within = assessed(found.spline(how), problem, how.tie_break), problem
    for _ in range(_ROUNDS):
        if figures.within_bounds:
            break
        within = _narrower(within, figures)
        try:
            again = solved(within, how, found.coefficients, heard)
        except NoMotionError:
            break
        found = found.then(again)
        figures = assessed(found.spline(how), problem, how.tie_break)
    return found, figures


def _narrower(problem: MotionProblem, figures: Assessment) -> MotionProblem:
    bounds = zip(problem.f_LB, problem.f_UB, figures.peaks, strict=True)
    by = [_MORE * peak.excess * (high - low) for low, high, peak in bounds]
    low, high = (
        tuple(x + sign * d for x, d in zip(values, by, strict=True))
        for sign, values in ((1.0, problem.f_LB), (-1.0, problem.f_UB))
    )
    rises = {
        clearance.obstacle: _MORE * clearance.shortfall + _LEAST_RISE
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
