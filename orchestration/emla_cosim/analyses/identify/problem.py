"""The least-squares problem: weighted residuals of all samples, and their derivatives."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from .prediction import Prediction, Predictor, predict_samples
from .residuals import EXACT, MeasuredSignal

_INITIAL_STEP = 1e-3
"""First step of differences, as a part of the range of a parameter."""

_STEP_LIMITS = 1e-5, 2e-3
"""Smallest and largest step."""

_TARGET_CHANGE = 30.0
"""Change of the predictions in standard deviations at which steps aim: smaller ones drown in the rounding of
sensors and in the instants at which limits begin and end, larger ones leave the tangent. Residuals that are
smaller than the standard deviations, such as those before these are known, reduce it.
"""

UNSURE = 0.1
"""Relative difference between derivatives of two steps from which longer steps are tried."""

_LONGER_STEPS = 4.0, 16.0, 64.0, 256.0
"""Longer steps, as multiples of the first one."""

_MAX_STEP = 0.1
"""Longest step, as a part of the range of a parameter."""

_NEAR = 2.0
"""Distance in standard errors of the points that show whether the cost is uneven."""

_MIN_STEP = 1e-9
"""Distance, as a part of the range, up to which rounding of the values matters: a perfect fit is even."""

_CORNER = 0.5
"""Relative difference between the derivatives of both sides from which a point is at a corner."""


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of the residuals, and their errors.

    Attributes:
        matrix: derivatives by the fractions, shape (n, p).
        change: their errors: what another step of the differences changes, shape (n, p).
        doubts: lengths of the errors, as parts of those of the derivatives, shape (p,).
        cost_tolerance: by how much the cost at nearby points exceeds that of the tangent, in variances of the
            residuals; 0 for an even response.
        steps: steps of the parameters if the response is uneven; empty if it is even.
    """

    matrix: NDArray[np.float64]
    change: NDArray[np.float64]
    doubts: Vector
    cost_tolerance: float
    steps: dict[int, float]


@dataclass
class Problem:
    """Residuals in standard deviations.

    Attributes:
        predictor: predicts the experiments.
        fitted: positions of the experiments that are not held out.
        sigma: standard deviation of each measured signal, in its unit.
        steps: next steps of differences by parameter, as parts of their ranges.
        blocked: parameters for which all runs with other values failed at the last differentiation.
        fixed_steps: steps of differences that replace `steps`: those of an uneven response.
    """

    predictor: Predictor
    fitted: Sequence[int]
    sigma: dict[str, float]
    steps: dict[int, float] = field(default_factory=dict)
    blocked: set[int] = field(default_factory=set)
    fixed_steps: dict[int, float] = field(default_factory=dict)

    @property
    def fitted_signals(self) -> list[MeasuredSignal]:
        """The measured signals that are fitted, in the order of the residuals."""
        return [signal for i in self.fitted for signal in self.predictor.experiments[i]]

    def split(self, residuals: Vector) -> list[tuple[MeasuredSignal, Vector]]:
        """Return the measured signals with their part of the residuals, which have the shape (n,)."""
        ends = np.cumsum([len(signal.time) for signal in self.fitted_signals])
        return list(zip(self.fitted_signals, np.split(residuals, ends[:-1]), strict=True))

    def residuals(self, points: Sequence[Vector]) -> list[Vector | None]:
        """Return prediction minus measurement at each point in standard deviations; None if a run failed."""
        return [
            self._weigh_differences(point, predictions)
            for batch in self.predictor.batches(points, self.fitted)
            for point, predictions in zip(batch, self.predictor.predict(batch, self.fitted), strict=True)
        ]

    def find_halved_step_residuals(self, point: Vector) -> Vector | str:
        """Return the residuals at a point with half the step, or why they cannot be judged."""
        (predictions,) = self.predictor.predict([point], self.fitted, is_halved=True)
        residuals = self._weigh_differences(point, predictions)
        if residuals is None:
            return next(reason for reason in predictions.values() if isinstance(reason, str))
        return residuals

    def is_exact(self, residuals: Vector) -> bool:
        """Return whether the predictions differ from all measured signals by rounding only."""
        return all(
            _compute_length(part * self.sigma[measured.signal])
            <= EXACT * _compute_length(measured.values - measured.values.mean())
            for measured, part in self.split(residuals)
        )

    def differences(
        self, point: Vector, predictions: Mapping[int, Prediction], i: int
    ) -> Mapping[str, Vector]:
        """Return prediction minus measurement by signal, in its unit; empty if the run failed."""
        data = predictions[i]
        if isinstance(data, str):
            return {}
        parameters = self.predictor.parameters
        return {
            measured.signal: predict_samples(parameters, point, data, measured) - measured.values
            for measured in self.predictor.experiments[i]
        }

    def jacobian(self, point: Vector, central: bool = False) -> NDArray[np.float64]:
        """Return the derivatives of the residuals by the fractions, of shape (n, p).

        Args:
            point: Fractions of the parameters, shape (p,), at which all runs succeed.
            central: Whether to use central differences.

        Derivatives by a parameter for which all other runs fail are 0.
        """
        shifted = list[Vector]()
        for i in range(len(point)):
            step = self.fixed_steps.get(i, self.steps.get(i, _INITIAL_STEP))
            # values beyond a range may not be possible, such as a negative mass
            step = step if point[i] + step <= 1.0 else -step
            shifted += [_shift(point, i, x) for x in ((step, -step) if central else (step,))]
        residuals, *side_residuals = self.residuals([point, *shifted])
        assert residuals is not None
        sides = iter(zip(shifted, side_residuals, strict=True))
        width = 2 if central else 1
        columns = [self._differentiate(i, point, residuals, islice(sides, width)) for i in range(len(point))]
        return np.column_stack(columns)

    def differentiate(self, point: Vector) -> Derivatives:
        """Return central differences at a point, of the steps whose derivatives are most certain.

        Where two steps disagree, the response is uneven: sampled controllers, limits and rounding change the
        runs of almost equal values. Longer steps average it out, until the response is no longer straight.
        The step is chosen whose derivative agrees best with that of the next shorter one and whose sides
        agree best.

        Args:
            point: Fractions of the parameters, shape (p,), at which all runs succeed.
        """
        count = len(point)
        (residuals,) = self.residuals([point])
        assert residuals is not None
        self.blocked.clear()
        first = [self.steps.get(i, _INITIAL_STEP) for i in range(count)]
        steps = [(i, f * first[i]) for i in range(count) for f in (0.5, 1.0)]
        responses = self._try_steps(point, residuals, steps)
        rungs = [responses[2 * i : 2 * i + 2] for i in range(count)]
        self.blocked.update(i for i, responses in enumerate(rungs) if not any(r.sides for r in responses))
        uneven = [
            i
            for i, (half, full) in enumerate(rungs)
            if _compute_length(full.slope - half.slope) >= UNSURE * _compute_length(full.slope) and full.sides
        ]  # without any change the step may be shorter than the rounding
        longer = [(i, step) for i in uneven for f in _LONGER_STEPS if (step := f * first[i]) <= _MAX_STEP]
        for (i, _), rung in zip(longer, self._try_steps(point, residuals, longer), strict=True):
            rungs[i].append(rung)
        derivatives = [_choose_step(responses) for responses in rungs]
        matrix = np.column_stack([slope for slope, _, _ in derivatives])
        change = np.column_stack([error for _, error, _ in derivatives])
        sizes, errors = np.linalg.norm(matrix, axis=0), np.linalg.norm(change, axis=0)
        doubts = np.divide(errors, sizes, out=np.zeros(count), where=sizes > 0.0)
        chosen_steps = {i: derivatives[i][2] for i in uneven if sizes[i] > 0.0}
        cost_tolerance = self._find_cost_tolerance(point, residuals, matrix)
        return Derivatives(matrix, change, doubts, cost_tolerance, chosen_steps)

    def _find_cost_tolerance(self, point: Vector, residuals: Vector, matrix: NDArray[np.float64]) -> float:
        """Return by how much the cost near a point exceeds that of the tangent, in variances."""
        deviation = _compute_length(residuals) / np.sqrt(max(len(residuals) - len(point), 1))
        sizes = np.linalg.norm(matrix, axis=0)
        steps = {i: min(_NEAR * deviation / size, _MAX_STEP) for i, size in enumerate(sizes) if size > 0.0}
        shifts = [(i, step) for i, step in steps.items() if step > _MIN_STEP]
        excess = [
            0.5 * (_sum_squares(values) - _sum_squares(residuals + at * matrix[:, i]))
            for (i, _), rung in zip(shifts, self._try_steps(point, residuals, shifts), strict=True)
            for at, values in rung.sides
        ]
        return max(float(np.mean(excess)) / deviation**2, 0.0) if excess else 0.0

    def _try_steps(
        self, point: Vector, residuals: Vector, steps: Sequence[tuple[int, float]]
    ) -> list["_StepResponse"]:
        """Return the residuals at both sides of a point for each parameter and step."""
        shifted = [_shift(point, i, sign * step) for i, step in steps for sign in (1.0, -1.0)]
        runs = iter(zip(shifted, self.residuals(shifted), strict=True))
        rungs = list[_StepResponse]()
        for i, step in steps:
            sides = [
                (at[i] - point[i], values)
                for at, values in islice(runs, 2)
                if values is not None and at[i] != point[i]
            ]
            rungs.append(_StepResponse(step, residuals, sides))
        return rungs

    def _differentiate(
        self, i: int, point: Vector, residuals: Vector, runs: Iterable[tuple[Vector, Vector | None]]
    ) -> Vector:
        """Return the derivative of the residuals by parameter i, and choose its next step."""
        sides = [(at[i], values) for at, values in runs if values is not None and at[i] != point[i]]
        if not sides:
            self.blocked.add(i)
            return np.zeros_like(residuals)
        self.blocked.discard(i)
        (at, values), (bt, other_residuals), *_ = *sides, (point[i], residuals)
        change = float(np.sqrt(np.mean((values - other_residuals) ** 2))) / abs(at - bt)
        if change > 0.0:
            aim = _TARGET_CHANGE * min(float(np.sqrt(np.mean(residuals**2))), 1.0)
            self.steps[i] = float(np.clip(aim / change, *_STEP_LIMITS))
        return (values - other_residuals) / (at - bt)

    def _weigh_differences(self, point: Vector, predictions: Mapping[int, Prediction]) -> Vector | None:
        """Return the residuals of all fitted experiments in standard deviations; None if a run failed."""
        parts = list[Vector]()
        for i in self.fitted:
            differences = self.differences(point, predictions, i)
            if not differences:
                return None
            parts += [values / self.sigma[signal] for signal, values in differences.items()]
        return np.concatenate(parts)


@dataclass(frozen=True)
class _StepResponse:
    """The residuals at a point and at both sides of it, with the distances of the sides."""

    step: float
    residuals: Vector
    sides: Sequence[tuple[float, Vector]]

    @property
    def slope(self) -> Vector:
        """The derivative between both sides, or that of the only side."""
        if not self.sides:
            return np.zeros_like(self.residuals)
        (at, values), (bt, other_residuals), *_ = *self.sides, (0.0, self.residuals)
        return (values - other_residuals) / (at - bt)

    @property
    def bend(self) -> Vector:
        """Half the difference between the derivatives of both sides; zero if there is only one."""
        if len(self.sides) < 2:
            return np.zeros_like(self.residuals)
        right_slope, left_slope = ((values - self.residuals) / at for at, values in self.sides)
        return 0.5 * (right_slope - left_slope)


def _choose_step(rungs: Sequence[_StepResponse]) -> tuple[Vector, Vector, float]:
    """Return the most certain derivative, its error and its step; `rungs` have longer and longer steps."""
    changes = [_compute_length(b.slope - a.slope) for a, b in pairwise(rungs)]
    scores = [
        float(np.hypot(c, _compute_length(rung.bend))) / size
        if (size := _compute_length(rung.slope)) > 0.0
        else np.inf
        for c, rung in zip(changes, rungs[1:], strict=True)
    ]
    best = int(np.argmin(scores)) + 1
    best_response, shorter = rungs[best], rungs[best - 1]
    # noise dominates short steps, curvature long ones: where two steps agree, both are small
    slope, error = best_response.slope, best_response.slope - shorter.slope
    if best > 1 and changes[best - 1] < 0.5 * changes[best - 2]:
        # it is noise still, whose part in the longer step is smaller
        error = error * shorter.step / float(np.hypot(shorter.step, best_response.step))
    # at a corner both sides are right, so half their difference is the error
    if all(_compute_length(rung.bend) > _CORNER * _compute_length(rung.slope) for rung in rungs):
        error = best_response.bend
    return slope, error, best_response.step


def _shift(point: Vector, i: int, step: float) -> Vector:
    """Return a point with another fraction of parameter i, within its range."""
    shifted = point.copy()
    shifted[i] = np.clip(point[i] + step, 0.0, 1.0)
    return shifted


def _compute_length(values: Vector) -> float:
    return float(np.linalg.norm(values))


def _sum_squares(values: Vector) -> float:
    return float(values @ values)
