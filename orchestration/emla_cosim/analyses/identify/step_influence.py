"""How much of each estimate the communication step makes: its change by half the step, in standard errors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...base.errors import join_names
from ...run.half_step import HalfStep
from .certainty import Certainty
from .loss import scale_for_loss
from .parameters import Parameters

_MOST = 1.0
"""Change in standard errors above which the step makes an estimate."""


def judge_step(
    parameters: Parameters,
    point: Vector,
    residuals: Vector,
    halved: Vector,
    jacobian: NDArray[np.float64],
    loss: str,
    half: HalfStep,
    assess: Callable[[Vector], Certainty],
) -> tuple[Certainty, list[str]]:
    """Return the certainty with the change of each identified estimate by half the step, and a note.

    The change is one Gauss-Newton step from the residuals at half the step. It needs no further runs, and
    what a search has left of the way to its minimum is in both residuals.

    Args:
        parameters: the parameters.
        point: places of the estimates, shape (p,).
        residuals: residuals in standard deviations, shape (n,).
        halved: residuals of the runs with half the step, shape (n,).
        jacobian: derivatives of the residuals by the places, shape (n, p).
        loss: the loss function, a name of `LOSSES`.
        half: how the runs with half the step were made.
        assess: returns the certainty for residuals.

    Returns:
        The certainty for `residuals`, and a note on the estimates that the step makes, if there are any.
    """
    found = assess(residuals)
    free = [i for i, one in enumerate(found.estimates) if one.error]
    moves = np.zeros(len(point))
    moves[free] = _find_moves(residuals, halved, jacobian[:, free], loss)
    found = _with_changes(parameters, point, moves, found)
    changes = {one.name: abs(one.step_change) for one in found.estimates if one.step_change is not None}
    made = [name for name, change in changes.items() if change > _MOST]
    if not made:
        return found, []
    # the error of the step is part of the residuals, and so of the standard errors: a good step has less
    rest = residuals + (halved - residuals + jacobian @ moves) / (1.0 - 0.5**half.order)
    in_the_limit = _with_changes(parameters, point, moves, assess(rest)).estimates
    least = [abs(one.step_change) for one in in_the_limit if one.step_change is not None]
    worst = max(changes.values())
    return found, [
        f"the step, not the machine, made the {'estimate' if len(made) == 1 else 'estimates'} of "
        f"{join_names(made)}: half the step changes {'it' if len(made) == 1 else 'them'} by "
        f"{'' if len(made) == 1 else 'up to '}{worst:.3g} standard errors; "
        f"{half.suggest(max(worst, *least) / _MOST)}"
    ]


def _find_moves(
    residuals: Vector, halved: Vector, jacobian: NDArray[np.float64], loss: str
) -> NDArray[np.float64]:
    """Return how far the places of the minimum move with half the step."""
    pulls, factors = scale_for_loss(loss, residuals)
    change = scale_for_loss(loss, halved)[0] - pulls
    sizes = np.linalg.norm(jacobian, axis=0)
    slopes = jacobian / sizes
    curvature = (slopes * factors[:, None] ** 2).T @ slopes
    return np.linalg.lstsq(curvature, -slopes.T @ change, rcond=None)[0] / sizes


def _with_changes(parameters: Parameters, point: Vector, moves: Vector, found: Certainty) -> Certainty:
    """Return the certainty with the moves of the places, in standard errors of the estimates."""
    estimates = list(found.estimates)
    for i, one in enumerate(found.estimates):
        if one.error:
            item, place = parameters.items[i], float(point[i])
            slope = (item.extrapolate(place + 1e-6) - item.extrapolate(place - 1e-6)) / 2e-6
            estimates[i] = replace(one, step_change=float(slope * moves[i] / one.error))
    return replace(found, estimates=estimates)
