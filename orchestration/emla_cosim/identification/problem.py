"""The least-squares problem: weighted residuals of all samples, and their derivatives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Vector
from .measurement import MeasuredSignal
from .prediction import Prediction, Predictor, predict_samples

_FIRST_STEP = 1e-3
"""First step of differences, as a part of the range of a parameter."""

_STEPS = 1e-5, 2e-3
"""Smallest and largest step."""

_CHANGE = 30.0
"""Change of the predictions in standard deviations at which steps aim: smaller ones drown in the rounding of
sensors and in the instants at which limits begin and end, larger ones leave the tangent.
"""


@dataclass
class Problem:
    """Residuals in standard deviations.

    Attributes:
        predictor: predicts the experiments.
        fitted: positions of the experiments that are not held out.
        sigma: standard deviation of each measured signal, in its unit.
        steps: next steps of differences by parameter, as parts of their ranges.
        blocked: parameters for which all runs with other values failed at the last differentiation.
    """

    predictor: Predictor
    fitted: Sequence[int]
    sigma: dict[str, float]
    steps: dict[int, float] = field(default_factory=dict)
    blocked: set[int] = field(default_factory=set)

    @property
    def samples(self) -> list[MeasuredSignal]:
        """The measured signals that are fitted, in the order of the residuals."""
        return [one for i in self.fitted for one in self.predictor.experiments[i]]

    def residuals(self, points: Sequence[Vector]) -> list[Vector | None]:
        """Return prediction minus measurement at each point in standard deviations; None if a run failed."""
        return [
            self._weigh(p, found) for p, found in zip(points, self.predictor.predict(points), strict=True)
        ]

    def differences(self, point: Vector, predictions: Sequence[Prediction], i: int) -> Mapping[str, Vector]:
        """Return prediction minus measurement by signal, in its unit; empty if the run failed."""
        data = predictions[i]
        if isinstance(data, str):
            return {}
        of = self.predictor.parameters
        return {
            one.signal: predict_samples(of, point, data, one) - one.values
            for one in self.predictor.experiments[i]
        }

    def jacobian(self, point: Vector, central: bool = False, factor: float = 1.0) -> NDArray[np.float64]:
        """Return the derivatives of the residuals by the places, of shape (n, p).

        Args:
            point: Places of the parameters, shape (p,), at which all runs succeed.
            central: Whether to use central differences.
            factor: Factor of the steps.

        Derivatives by a parameter for which all other runs fail are 0.
        """
        count = len(point)
        shifted = list[Vector]()
        for i in range(count):
            step = factor * self.steps.get(i, _FIRST_STEP)
            sign = 1.0 if point[i] + step <= 1.0 else -1.0
            for direction in (sign, -sign) if central else (sign,):
                moved = point.copy()
                moved[i] = np.clip(point[i] + direction * step, 0.0, 1.0)
                shifted.append(moved)
        here, *found = self.residuals([point, *shifted])
        assert here is not None
        width = 2 if central else 1
        columns = [
            self._differentiate(
                i, (point, here), list(zip(shifted, found, strict=True))[width * i : width * (i + 1)]
            )
            for i in range(count)
        ]
        return np.column_stack(columns)

    def _differentiate(
        self, i: int, here: tuple[Vector, Vector], moved: Sequence[tuple[Vector, Vector | None]]
    ) -> Vector:
        """Return the derivative of the residuals by parameter i, and choose its next step.

        Args:
            i: Position of the parameter.
            here: A point and its residuals.
            moved: Other points, which differ in this parameter, with their residuals; None for a failed run.
        """
        known = [
            (point[i], values) for point, values in moved if values is not None and point[i] != here[0][i]
        ]
        if not known:
            self.blocked.add(i)
            return np.zeros_like(here[1])
        self.blocked.discard(i)
        (at, values), (bt, other) = known[0], known[1] if len(known) > 1 else (here[0][i], here[1])
        change = float(np.sqrt(np.mean((values - other) ** 2))) / abs(at - bt)
        if change > 0.0:
            self.steps[i] = float(np.clip(_CHANGE / change, *_STEPS))
        return (values - other) / (at - bt)

    def _weigh(self, point: Vector, predictions: Sequence[Prediction]) -> Vector | None:
        parts = list[Vector]()
        for i in self.fitted:
            differences = self.differences(point, predictions, i)
            if len(differences) < len(self.predictor.experiments[i]):
                return None
            parts += [values / self.sigma[signal] for signal, values in differences.items()]
        return np.concatenate(parts)
