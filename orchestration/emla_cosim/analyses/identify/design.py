"""Which experiment tells most about the parameters: Fisher information of planned experiments."""

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

_HALF = float(norm.ppf(0.5 + LEVEL / 2.0))


@dataclass(frozen=True)
class Candidate:
    """What a planned experiment would tell.

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
    """Return what the experiments would tell at the values of the scenario, the most informative first.

    Raises:
        CommandError: The standard deviation of a signal is not known.
        RunError: A run fails, or the user interrupts.
    """
    plan, parameters = task.plan, task.parameters
    missing = [signal for signal in predictor.signals if signal not in task.sigma]
    if missing or not predictor.signals:
        raise CommandError(
            f"{plan.where} needs the standard deviation of {missing[0] if missing else 'each signal'} to "
            "rank experiments; add it to 'sigma'."
        )
    point = np.clip(parameters.start, 0.01, 0.99)
    steps = _STEP * np.eye(len(point))
    try:
        predictions = predictor.predict([point, *(point + s for s in steps), *(point - s for s in steps)])
    except InterruptedRunsError as error:
        raise RunError("interrupted before any experiment was ranked.") from error
    candidates = list[Candidate]()
    for i, one in enumerate(plan.experiments):
        samples = list[Vector]()
        for prediction in predictions:
            if isinstance(run := prediction[i], str):
                raise RunError(f"the experiment '{one.name}' fails: {run}.")
            samples.append(np.concatenate([run[s] / task.sigma[s] for s in predictor.signals]))
        above, below = samples[1 : 1 + len(point)], samples[1 + len(point) :]
        columns = [(a - b) / (2.0 * _STEP) for a, b in zip(above, below, strict=True)]
        candidates.append(_judge(parameters, point, one.name, np.column_stack(columns)))
    return sorted(candidates, key=lambda one: (-one.information, one.experiment))


def _judge(parameters: Parameters, point: Vector, name: str, jacobian: NDArray[np.float64]) -> Candidate:
    information = jacobian.T @ jacobian
    sign, logarithm = np.linalg.slogdet(information)
    intervals: dict[str, float | None] = {}
    known = sign > 0 and np.linalg.cond(information) < 1e14
    covariance = np.linalg.inv(information) if known else None
    for i, one in enumerate(parameters.items):
        slope = (one.extrapolate(point[i] + 1e-6) - one.extrapolate(point[i] - 1e-6)) / 2e-6
        width = (
            None if covariance is None else _HALF * abs(slope) * float(np.sqrt(max(covariance[i, i], 0.0)))
        )
        intervals[one.name] = width
    bits = float(logarithm / np.log(2.0)) if known else -np.inf
    return Candidate(name, intervals, bits, len(jacobian))
