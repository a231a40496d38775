"""Errors that standard errors do not show: those of a shift in time and of the step size.

Inputs and measurements are compared at the times that their files name. A sensor with a filter, a controller
that samples, or a recorder that writes a sample late shift them against each other. A model without it
fits a part of the shift with its parameters. Standard errors do not show that: it is the same in each cycle.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...base.errors import join_names
from ...run.half_step import HalfStep
from .certainty import Certainty, assess_certainty, find_covariance
from .parameters import DELAY, Parameters
from .problem import Derivatives, Problem
from .residuals import MeasuredSignal, scale_for_loss

_MIN_SHIFT = 3.0
"""Shift in its standard errors from which it is taken as real."""

_MAX_STEP_CHANGE = 1.0
"""Change in standard errors above which the step makes an estimate."""


@dataclass(frozen=True)
class TimeShift:
    """A measured signal that is later than predicted, or earlier if negative.

    Attributes:
        signal: the signal.
        seconds: by how much.
        error: standard error of that in s.
    """

    signal: str
    seconds: float
    error: float

    def __str__(self) -> str:
        way = "later" if self.seconds > 0.0 else "earlier"
        return (
            f"{self.signal} is {1e3 * abs(self.seconds):.3g} ± {1e3 * self.error:.1g} ms {way} than predicted"
        )


def assess_estimates(
    problem: Problem, point: Vector, residuals: Vector, slopes: Derivatives, loss: str
) -> tuple[Certainty, list[str]]:
    """Return the certainty of estimates, and notes on what else than the machine makes them.

    Args:
        problem: the problem.
        point: the estimates as fractions of their ranges, shape (p,).
        residuals: residuals in standard deviations, shape (n,).
        slopes: their derivatives.
        loss: the loss function, a name of `LOSSES`.
    """
    parameters = problem.predictor.parameters
    assess = partial(
        assess_certainty,
        parameters,
        point,
        jacobian=slopes.matrix,
        lengths=[len(measured.time) for measured in problem.fitted_signals],
        change=slopes.change,
        loss=loss,
        blocked=problem.blocked,
        cost_tolerance=slopes.cost_tolerance,
    )
    # residuals of rounding have no statistics
    if problem.is_exact(residuals):
        return assess(residuals), ["the step is not judged: the fit is exact, residuals are rounding"]
    sensors = [item.sensor for item in parameters.items if item.sensor is not None]
    shifts, moves = find_time_shifts(
        problem.fitted_signals,
        residuals,
        slopes.matrix,
        [problem.sigma[measured.signal] for measured in problem.fitted_signals],
        loss,
        delayed={signal for kind, signal in sensors if kind == DELAY},
    )
    notes = _describe_shifts(shifts, parameters, point, moves, assess(residuals))
    shifted = partial(assess, moves=moves)
    halved = problem.find_halved_step_residuals(point)
    if isinstance(halved, str):
        return shifted(residuals), [*notes, f"the step is not judged: {halved.rstrip('.')}"]
    # the coarsest step of all experiments decides
    half = max(problem.predictor.half_steps.values(), key=lambda half: half.step)
    arguments = (parameters, point, residuals, halved, slopes.matrix, loss, half)
    certainty, remarks = _add_step_changes(*arguments, assess)
    if remarks or not shifts:  # a shift that the step makes is not one of the machine
        return certainty, remarks
    certainty, remarks = _add_step_changes(*arguments, shifted)
    return certainty, [*notes, *remarks]


def find_time_shifts(
    samples: Sequence[MeasuredSignal],
    residuals: Vector,
    jacobian: NDArray[np.float64],
    sigma: Sequence[float],
    loss: str,
    delayed: Collection[str],
) -> tuple[list[TimeShift], Vector]:
    """Return the shifts that the residuals show, and by how much the estimates would move without them.

    Shifts and parameters are estimated together, by one Gauss-Newton step.

    Args:
        samples: the measured signals, in the order of the residuals.
        residuals: prediction minus measurement in standard deviations, shape (n,).
        jacobian: derivatives of the residuals by the fractions, shape (n, p).
        sigma: standard deviation of each signal in its unit.
        loss: the loss function, a name of `LOSSES`.
        delayed: signals whose delay is a parameter.

    Returns:
        The shifts, and the moves of the estimates as fractions, shape (p,).
    """
    score_weights, factors = scale_for_loss(loss, residuals)
    lengths = [len(signal.time) for signal in samples]
    ends = np.cumsum([0, *lengths])
    slopes = np.zeros((len(residuals), len(samples)))
    for k, (signal, deviation) in enumerate(zip(samples, sigma, strict=True)):
        part = slice(ends[k], ends[k + 1])
        predicted = signal.values / deviation + residuals[part]
        if signal.signal not in delayed and len(signal.time) > 2:
            with np.errstate(all="ignore"):  # two samples at one time, where the signal jumps, have no slope
                slope = np.gradient(predicted, signal.time)
            slopes[part, k] = np.where(np.isfinite(slope), slope, 0.0)
    shifted = [k for k in range(len(samples)) if slopes[:, k].any()]
    free = np.flatnonzero(np.linalg.norm(jacobian, axis=0) > 0.0)
    while shifted:
        scaled = np.column_stack([jacobian[:, free], slopes[:, shifted]])
        sizes = np.linalg.norm(scaled, axis=0)
        scaled = scaled / sizes
        curvature = (scaled * factors[:, None] ** 2).T @ scaled
        change = np.linalg.lstsq(curvature, -scaled.T @ score_weights, rcond=None)[0]
        try:
            # from what remains after the shift: the shift itself is not noise that would hide it
            rest, weights = scale_for_loss(loss, residuals + scaled @ change)
            covariance = find_covariance(scaled * weights[:, None], scaled * rest[:, None], rest, lengths)
        except np.linalg.LinAlgError:  # a shift that the parameters can make as well
            break
        with np.errstate(invalid="ignore"):  # rounding of dependent parameters: nan is not certain
            errors = np.sqrt(np.diag(covariance))
        certain = np.abs(change) > _MIN_SHIFT * errors
        if certain[len(free) :].all():
            moves = np.zeros(jacobian.shape[1])
            moves[free] = (change / sizes)[: len(free)]
            seconds, of = (change / sizes)[len(free) :], (errors / sizes)[len(free) :]
            shifts = [
                TimeShift(samples[k].signal, float(-s), float(e))
                for k, s, e in zip(shifted, seconds, of, strict=True)
            ]
            return shifts, moves
        # leave out what is not certain and try again: one shift may have explained another
        shifted = [k for k, is_certain in zip(shifted, certain[len(free) :], strict=True) if is_certain]
    return [], np.zeros(jacobian.shape[1])


def _describe_shifts(
    shifts: Sequence[TimeShift], parameters: Parameters, point: Vector, moves: Vector, certainty: Certainty
) -> list[str]:
    """Return a note on shifts in time; `certainty` is the certainty without regard to them."""
    if not shifts:
        return []
    changes = [
        abs(p.extrapolate(float(x + move)) - p.extrapolate(float(x))) / estimate.error
        for p, x, move, estimate in zip(parameters.items, point, moves, certainty.estimates, strict=True)
        if estimate.error
    ]
    most = max(changes, default=0.0)
    return [
        f"{' and '.join(map(str, shifts))}. Without this shift in time, estimates would change by up to "
        f"{most:.2g} standard errors; these contain that. Check the times of the data; a sensor that is late "
        "is 'delay(SIGNAL)' in --vary"
    ]


def _add_step_changes(
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
    """
    certainty = assess(residuals)
    free = [i for i, estimate in enumerate(certainty.estimates) if estimate.error]
    moves = np.zeros(len(point))
    moves[free] = _find_moves(residuals, halved, jacobian[:, free], loss)
    certainty = _add_changes(parameters, point, moves, certainty)
    changes = {e.name: abs(e.step_change) for e in certainty.estimates if e.step_change is not None}
    affected = [name for name, change in changes.items() if change > _MAX_STEP_CHANGE]
    # a change below one standard error is within the interval already
    if not affected:
        return certainty, []
    # the error of the step is part of the residuals, and so of the standard errors: a good step has less
    rest = residuals + (halved - residuals + jacobian @ moves) / (1.0 - 0.5**half.order)
    in_the_limit = _add_changes(parameters, point, moves, assess(rest)).estimates
    least = [abs(estimate.step_change) for estimate in in_the_limit if estimate.step_change is not None]
    worst = max(changes.values())
    return certainty, [
        f"the step, not the machine, made the {'estimate' if len(affected) == 1 else 'estimates'} of "
        f"{join_names(affected)}: half the step changes {'it' if len(affected) == 1 else 'them'} by "
        f"{'' if len(affected) == 1 else 'up to '}{worst:.3g} standard errors; "
        f"{half.suggest(max(worst, *least) / _MAX_STEP_CHANGE)}"
    ]


def _find_moves(
    residuals: Vector, halved: Vector, jacobian: NDArray[np.float64], loss: str
) -> NDArray[np.float64]:
    """Return how far the minimum moves with half the step, as fractions of the ranges, shape (p,)."""
    score_weights, factors = scale_for_loss(loss, residuals)
    # the difference of both gradients: neither search ended exactly at its minimum
    change = scale_for_loss(loss, halved)[0] - score_weights
    # columns of length 1: parameters of different sizes would spoil the condition of the equations
    sizes = np.linalg.norm(jacobian, axis=0)
    slopes = jacobian / sizes
    curvature = (slopes * factors[:, None] ** 2).T @ slopes
    return np.linalg.lstsq(curvature, -slopes.T @ change, rcond=None)[0] / sizes


def _add_changes(parameters: Parameters, point: Vector, moves: Vector, certainty: Certainty) -> Certainty:
    """Return the certainty with the moves of the estimates, in their standard errors."""
    estimates = list(certainty.estimates)
    for i, estimate in enumerate(certainty.estimates):
        if estimate.error:
            slope = parameters.items[i].slope(float(point[i]))
            estimates[i] = replace(estimate, step_change=float(slope * moves[i] / estimate.error))
    return replace(certainty, estimates=estimates)
