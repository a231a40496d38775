"""Rank experiments by their information on the parameters: Fisher information of planned experiments."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from .certainty import LEVEL
from .parameters import Parameters
from .prediction import InterruptedRunsError, Predictor
from .preparation import IdentificationTask

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
        candidates.append(_assess(parameters, point, experiment.name, np.column_stack(columns)))
    return sorted(candidates, key=lambda candidate: (-candidate.information, candidate.experiment))


def _assess(parameters: Parameters, point: Vector, name: str, jacobian: NDArray[np.float64]) -> Candidate:
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
