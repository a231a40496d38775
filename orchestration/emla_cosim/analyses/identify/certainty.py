"""How certain estimates are, and how much planned experiments would say about them.

Source: covariance of least squares with serially correlated residuals, W. K. Newey and K. D. West, "A Simple,
Positive Semi-definite, Heteroskedasticity and Autocorrelation Consistent Covariance Matrix", Econometrica 55
(1987); profile likelihood, A. Raue et al., "Structural and practical identifiability analysis of partially
observed dynamical models by exploiting the profile likelihood", Bioinformatics 25 (2009).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares
from scipy.stats import f as fisher
from scipy.stats import norm
from scipy.stats import t as student

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from .parameters import Parameter, Parameters
from .prediction import InterruptedRunsError, Predictor
from .preparation import IdentificationTask
from .problem import Problem
from .residuals import LINEAR, autocorrelation, count_correlated_lags, find_robust_deviation, scale_for_loss

LEVEL = 0.95
"""Probability of the intervals."""

_END_FRACTION = 1e-6
"""Distance from the end of a range, as a part of it, within which an estimate is at its end."""

_MAX_HALF_WIDTH = 0.5
"""Half width of an interval, as a part of the range, from which a parameter is not identified."""

_MAX_DOUBT = 0.5
"""Part of the influence of a direction that another step of the differences may change."""

_MIN_COMPONENT = 0.01
"""Component of a direction without influence from which a parameter is part of it."""

_MAX_CONDITION = 1e6
"""Condition number from which directions cannot be separated, however certain the derivatives are."""

_SHARED_INFLUENCE = 1.5
"""Factor by which other parameters widen an interval before they are named."""

_EVALUATIONS = 20
"""Most iterations of the other parameters for each value."""

_FAILED_RUN_COST = 1e6
"""Cost, relative to the smallest, of values whose run fails."""

_FIRST_DISTANCE = 0.01
"""First distance from the estimate, as a part of the range, if the standard error is not known."""

_PRECISION = 0.02
"""Relative precision of the interval's ends."""


@dataclass(frozen=True)
class Estimate:
    """An estimated parameter.

    Attributes:
        name: its name.
        value: the estimate.
        unit: its unit.
        start: the value it started from.
        low: lower end of its range.
        high: upper end.
        error: standard error; None if it is not identified.
        interval: interval of 95 %; None if it is not identified.
        problem: why it is not identified; None if it is.
        profile: interval of the profile likelihood, if asked for; an end is None if the range ends before.
        step_change: change of the estimate by half the step, in standard errors; None if it was not judged.
    """

    name: str
    value: float
    unit: str
    start: float
    low: float
    high: float
    error: float | None = None
    interval: tuple[float, float] | None = None
    problem: str | None = None
    profile: tuple[float | None, float | None] | None = None
    step_change: float | None = None


@dataclass(frozen=True)
class Certainty:
    """The certainty of all estimates.

    Attributes:
        estimates: the estimates.
        correlations: their correlations, shape (p, p); NaN for those that are not identified.
        condition: condition number of the derivatives, each scaled to length 1.
        deviation: standard deviation of the residuals, in the standard deviations of the signals.
    """

    estimates: Sequence[Estimate]
    correlations: NDArray[np.float64]
    condition: float
    deviation: float


def assess_certainty(
    parameters: Parameters,
    point: Vector,
    residuals: Vector,
    jacobian: NDArray[np.float64],
    lengths: Sequence[int],
    change: NDArray[np.float64] | None = None,
    loss: str = LINEAR,
    blocked: Collection[int] = (),
    cost_tolerance: float = 0.0,
    moves: Vector | None = None,
) -> Certainty:
    """Return the certainty of estimates.

    Args:
        parameters: the parameters.
        point: the estimates as fractions of their ranges, shape (p,).
        residuals: residuals in standard deviations, shape (n,).
        jacobian: their derivatives by the fractions, shape (n, p).
        lengths: number of samples of each signal of each experiment, whose residuals may be correlated.
        change: what another step of the differences changes in the derivatives, shape (n, p). A direction
            whose influence it changes by half or more has none.
        loss: the loss function, a name of `LOSSES`.
        blocked: positions of parameters whose derivatives are not known, because other runs fail.
        cost_tolerance: by how much the cost at nearby points exceeds that of the tangent, in variances of the
            residuals. The search may have ended wherever the cost is larger by less than this.
        moves: by how much the estimates, as fractions, would move without a shift in time, shape (p,); see
            `find_time_shifts`.
    """
    count, total = len(point), len(residuals)
    score_weights, factors = scale_for_loss(loss, residuals)
    scores, jacobian = jacobian * score_weights[:, None], jacobian * factors[:, None]
    change = None if change is None else change * factors[:, None]
    rms = float(np.sqrt(residuals @ residuals / max(total - count, 1)))
    deviation = rms if loss == LINEAR else find_robust_deviation(residuals)
    problems: dict[int, str] = {}
    sizes = np.linalg.norm(jacobian, axis=0)
    noise = max(deviation, np.finfo(float).tiny)
    for i in range(count):
        # without any run beside it, the derivative is 0 by definition, not by measurement
        if i in blocked:
            problems[i] = "runs with other values of it fail"
        elif sizes[i] <= np.finfo(float).eps * max(sizes.max(), 1e-300) or noise / sizes[i] > 1.0:
            problems[i] = "it has no influence on the measured signals"
        elif point[i] < _END_FRACTION or point[i] > 1.0 - _END_FRACTION:
            end = "lower" if point[i] < _END_FRACTION else "upper"
            problems[i] = f"it is at the {end} end of its range"
    free = [i for i in range(count) if i not in problems]
    covariance, condition, freedom = np.full((count, count), np.nan), 1.0, 1.0
    if free:
        # columns of length 1, so that the condition number does not depend on the ranges of the user
        scaled = jacobian[:, free] / sizes[free]
        _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
        condition = float(singular[0] / max(singular[-1], 1e-300))
        limit = np.full(len(free), singular[0] / _MAX_CONDITION)
        if change is not None:
            changed = np.linalg.norm(change[:, free] / sizes[free] @ directions.T, axis=0)
            limit = np.maximum(limit, changed / _MAX_DOUBT)
        for direction, size in zip(directions[singular < limit], singular[singular < limit], strict=True):
            is_singular = size < singular[0] / _MAX_CONDITION
            why = "" if is_singular else "; runs with almost equal values differ too much"
            involved = [free[k] for k in np.flatnonzero(np.abs(direction) > _MIN_COMPONENT)]
            for i in involved:
                rest = ", ".join(parameters.items[k].name for k in involved if k != i)
                problems[i] = f"the data do not tell it from a combination of {rest}{why}"
        free = [i for i in free if i not in problems]
    if free:
        certain = find_covariance(jacobian[:, free], scores[:, free], score_weights, lengths)
        if change is not None:
            wider = _find_widening_matrix(jacobian[:, free] / sizes[free], change[:, free] / sizes[free])
            wider = wider * sizes[free] / sizes[free][:, None]
            # derivatives with errors may claim more influence than there is
            certain = wider @ certain @ wider.T
        covariance[np.ix_(free, free)] = certain
        # correlated residuals have less information than their number says
        independent = max(_count_independent_residuals(score_weights, lengths), len(free) + 1.0)
        # the search may have ended in any dent of this depth; the rest corrects for estimated parameters
        covariance *= (1.0 + 2.0 * cost_tolerance) * independent / (independent - len(free))
        freedom = independent - len(free)
        if moves is not None:
            # a shift in time is the same in each cycle: no number of samples averages it out
            covariance[np.ix_(free, free)] += np.outer(moves[free], moves[free])
    errors = np.sqrt(np.diag(covariance))
    # Student, not normal: the deviation of the residuals is estimated from the same residuals
    width = float(student.ppf(0.5 + LEVEL / 2.0, freedom))
    estimates = list[Estimate]()
    for i, parameter in enumerate(parameters.items):
        fraction = float(point[i])
        if i not in problems and width * errors[i] > _MAX_HALF_WIDTH:
            problems[i] = "its interval is wider than its range"
            if errors[i] > _SHARED_INFLUENCE * noise / sizes[i] and len(free) > 1:
                nearest = max(
                    (k for k in free if k != i), key=lambda k: abs(jacobian[:, i] @ jacobian[:, k]) / sizes[k]
                )
                problems[i] += f": its influence resembles that of {parameters.items[nearest].name}"
        if i in problems:
            estimates.append(make_estimate(parameter, fraction, problem=problems[i]))
            continue
        half = width * float(errors[i])
        ends = parameter.extrapolate(fraction - half), parameter.extrapolate(fraction + half)
        error = float(abs(parameter.slope(fraction)) * errors[i])
        estimates.append(make_estimate(parameter, fraction, error=error, interval=ends))
    with np.errstate(invalid="ignore"):
        correlations = covariance / np.outer(errors, errors)
    return Certainty(estimates, correlations, condition, deviation)


def make_estimate(parameter: Parameter, fraction: float, **fields: Any) -> Estimate:
    """Return the estimate of a parameter at a fraction of its range, with further fields."""
    p = parameter
    return Estimate(p.name, p.value(fraction), p.unit, p.start, p.low, p.high, **fields)


def find_covariance(
    jacobian: NDArray[np.float64], scores: NDArray[np.float64], score_weights: Vector, lengths: Sequence[int]
) -> NDArray[np.float64]:
    """Return the covariance of the fractions, shape (p, p), with residuals correlated within each signal.

    Args:
        jacobian: derivatives of the residuals, shape (n, p).
        scores: derivatives of the loss of each residual, shape (n, p).
        score_weights: the same by the residual, shape (n,).
        lengths: number of samples of each signal of each experiment.
    """
    count = jacobian.shape[1]
    # by QR: the product of the Jacobian with itself would square its condition number
    _, triangle = np.linalg.qr(jacobian)
    inverse = np.linalg.inv(triangle)
    bread = inverse @ inverse.T
    meat, ends = np.zeros((count, count)), np.cumsum(lengths)[:-1]
    for part, weights in zip(np.split(scores, ends), np.split(score_weights, ends), strict=True):
        meat += part.T @ part
        lags = count_correlated_lags(weights)
        for lag in range(1, lags + 1):
            cross = part[lag:].T @ part[:-lag]
            # the weights of Bartlett keep the sum positive semi-definite
            meat += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return bread @ meat @ bread


def _find_widening_matrix(scaled: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix that widens errors where derivatives, each of length 1, are uncertain.

    The influence of each principal direction may be smaller by what another step changes in it.
    """
    _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
    doubt = np.linalg.norm(change @ directions.T, axis=0) / singular
    return directions.T @ np.diag(1.0 / (1.0 - np.minimum(doubt, _MAX_DOUBT))) @ directions


def _count_independent_residuals(residuals: Vector, lengths: Sequence[int]) -> float:
    """Return the number of independent residuals with the information of these, which may be correlated."""
    count = 0.0
    for part in np.split(residuals, np.cumsum(lengths)[:-1]):
        lags = count_correlated_lags(part)
        weights = 1.0 - np.arange(1, lags + 1) / (lags + 1.0)
        excess = 2.0 * float(np.sum(weights * autocorrelation(part)[1 : lags + 1]))
        count += len(part) / max(1.0 + excess, 1.0)
    return count


def find_profile(
    problem: Problem,
    point: Vector,
    i: int,
    error: float | None,
    report: Callable[[int], None],
    cost_tolerance: float = 0.0,
) -> tuple[float | None, float | None]:
    """Return the ends of the interval of 95 % of parameter i, as fractions of its range.

    An end is None if the range ends before.

    Args:
        problem: the problem.
        point: the estimates as fractions of their ranges, shape (p,).
        i: position of the parameter.
        error: its standard error, as a fraction of its range, if it is known.
        report: called with the number of evaluations.
        cost_tolerance: as for `assess_certainty`.
    """
    (best,) = problem.residuals([point])
    assert best is not None
    total, count = len(best), len(point)
    smallest = float(best @ best)
    freedom = max(total - count, 1)
    # the F distribution of one parameter, with the residuals as the only measure of their variance
    limit = smallest * (1.0 + (1.0 + 2.0 * cost_tolerance) * fisher.ppf(LEVEL, 1, freedom) / freedom)
    free = np.array([k for k in range(count) if k != i], dtype=int)

    def find_end(sign: float) -> float | None:
        """Return the end below (-1) or above (1) the estimate; None if the range ends before."""
        near = point[free].copy()
        # searches that begin elsewhere end in other dents: run each once
        excesses = {0.0: float(smallest - limit)}

        def excess(distance: float) -> float:
            """Return by how much the cost at a distance, minimal over the others, exceeds the limit."""
            nonlocal near
            if distance not in excesses:
                fixed = point.copy()
                fixed[i] = point[i] + sign * distance
                cost, near = _minimize_others(problem, fixed, free, near, report)
                excesses[distance] = float((_FAILED_RUN_COST * smallest if cost is None else cost) - limit)
            return excesses[distance]

        distance_to_end = 1.0 - point[i] if sign > 0 else point[i]
        # an end of the interval is about two standard errors away
        inner, outer = 0.0, min(2.0 * error if error else _FIRST_DISTANCE, distance_to_end)
        while excess(outer) < 0.0:
            if outer >= distance_to_end:
                return None
            inner, outer = outer, min(2.0 * outer, distance_to_end)
        return float(point[i] + sign * cast(float, brentq(excess, inner, outer, xtol=_PRECISION * outer)))

    return find_end(-1.0), find_end(1.0)


def _minimize_others(
    problem: Problem, fixed: Vector, free: np.ndarray, near: Vector, report: Callable[[int], None]
) -> tuple[float | None, Vector]:
    """Return the smallest sum of squares with one parameter fixed, and the values of the others there.

    If the run at `near` fails, the sum is None and the values are `near`.
    """

    def insert(part: Vector) -> Vector:
        point = fixed.copy()
        point[free] = part
        return point

    (first,) = problem.residuals([insert(near)])
    if first is None:
        return None, near
    if not len(free):
        return float(first @ first), near

    def residuals(part: Vector) -> Vector:
        report(1)
        (values,) = problem.residuals([insert(part)])
        # a finite wall, as in `Estimator`: the solver stops at NaN or infinity
        return 1e3 * (np.abs(first) + 1.0) if values is None else values

    minimum = least_squares(
        residuals,
        np.clip(near, 1e-9, 1.0 - 1e-9),
        lambda part: problem.jacobian(insert(part))[:, free],  # type: ignore[arg-type]
        bounds=(0.0, 1.0),
        x_scale="jac",
        max_nfev=_EVALUATIONS,
        ftol=1e-6,
    )
    return 2.0 * float(minimum.cost), minimum.x


_STEP = 1e-3
"""Step of the differences, as a part of the range of a parameter."""

_WIDTH = float(norm.ppf(0.5 + LEVEL / 2.0))


@dataclass(frozen=True)
class Candidate:
    """The expected information of a planned experiment.

    Attributes:
        experiment: its name.
        intervals: half widths of the intervals of 95 % by parameter, in its unit; None without information.
        information: logarithm of the determinant of the Fisher information, in bits, or minus infinity. A
            difference of 2 halves one interval.
        samples: number of samples.
    """

    experiment: str
    intervals: Mapping[str, float | None]
    information: float
    samples: int


def rank_experiments(task: IdentificationTask, predictor: Predictor) -> list[Candidate]:
    """Return the experiments with their information at the scenario's values, the most informative first.

    Raises:
        CommandError: The standard deviation of a signal is not known.
        RunError: A run fails, or the user interrupts.
    """
    plan, parameters = task.plan, task.parameters
    # without measurements there are no residuals from which the deviations could follow
    missing = [signal for signal in predictor.signals if signal not in task.sigma]
    if missing or not predictor.signals:
        raise CommandError(
            f"{plan.where} needs the standard deviation of {missing[0] if missing else 'each signal'} to "
            "rank experiments; add it to 'sigma'."
        )
    # central differences need room on both sides
    point = np.clip(parameters.start, 0.01, 0.99)
    steps = _STEP * np.eye(len(point))
    try:
        predictions = predictor.predict([point, *(point + s for s in steps), *(point - s for s in steps)])
    except InterruptedRunsError as error:
        raise RunError("interrupted before any experiment was ranked.") from error
    candidates = list[Candidate]()
    for i, experiment in enumerate(plan.experiments):
        samples = list[Vector]()
        for prediction in predictions:
            if isinstance(run := prediction[i], str):
                raise RunError(f"the experiment '{experiment.name}' fails: {run}.")
            samples.append(np.concatenate([run[s] / task.sigma[s] for s in predictor.signals]))
        above, below = samples[1 : 1 + len(point)], samples[1 + len(point) :]
        columns = [(a - b) / (2.0 * _STEP) for a, b in zip(above, below, strict=True)]
        candidates.append(_assess_candidate(parameters, point, experiment.name, np.column_stack(columns)))
    return sorted(candidates, key=lambda candidate: (-candidate.information, candidate.experiment))


def _assess_candidate(
    parameters: Parameters, point: Vector, name: str, jacobian: NDArray[np.float64]
) -> Candidate:
    """Return the information of an experiment; minus infinity if it does not tell the parameters apart."""
    information = jacobian.T @ jacobian
    sign, logarithm = np.linalg.slogdet(information)
    # the inverse of such a matrix is rounding
    if sign <= 0 or np.linalg.cond(information) >= 1e14:
        return Candidate(name, dict.fromkeys(parameters.names), -np.inf, len(jacobian))
    variances = np.diag(np.linalg.inv(information))
    intervals = {
        p.name: _WIDTH * abs(p.slope(x)) * float(np.sqrt(max(variance, 0.0)))
        for p, x, variance in zip(parameters.items, point, variances, strict=True)
    }
    return Candidate(name, intervals, float(logarithm / np.log(2.0)), len(jacobian))
