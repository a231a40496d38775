"""Which experiment tells most about the parameters: Fisher information of planned experiments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from ...base.arrays import Vector
from .certainty import LEVEL
from .parameters import Parameters

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


def rank_experiments(
    parameters: Parameters, point: Vector, names: Sequence[str], jacobians: Sequence[NDArray[np.float64]]
) -> list[Candidate]:
    """Return the candidates, the most informative first.

    Args:
        parameters: the parameters.
        point: places at which the derivatives hold, shape (p,).
        names: names of the experiments.
        jacobians: derivatives of the predicted samples in standard deviations by the places, each (n, p).
    """
    found = [_judge(parameters, point, name, j) for name, j in zip(names, jacobians, strict=True)]
    return sorted(found, key=lambda one: (-one.information, one.experiment))


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
