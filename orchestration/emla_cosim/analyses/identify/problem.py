"""The least-squares problem: weighted residuals of all samples, and their derivatives."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from .measurement import EXACT, MeasuredSignal
from .prediction import Prediction, Predictor, predict_samples

_FIRST_STEP = 1e-3
"""First step of differences, as a part of the range of a parameter."""

_STEPS = 1e-5, 2e-3
"""Smallest and largest step."""

_CHANGE = 30.0
"""Change of the predictions in standard deviations at which steps aim: smaller ones drown in the rounding of
sensors and in the instants at which limits begin and end, larger ones leave the tangent. Residuals that are
smaller than the standard deviations, such as those before these are known, reduce it.
"""

UNSURE = 0.1
"""Relative difference between derivatives of two steps from which longer steps are tried."""

_LADDER = 4.0, 16.0, 64.0, 256.0
"""Longer steps, as multiples of the first one."""

_LONGEST = 0.1
"""Longest step, as a part of the range of a parameter."""

_NEAR = 2.0
"""Distance in standard errors of the points that show whether the cost is uneven."""

_FINEST = 1e-9
"""Distance, as a part of the range, up to which rounding of the values matters: a perfect fit is even."""

_CORNER = 0.5
"""Relative difference between the derivatives of both sides from which a point is at a corner."""


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of the residuals, and how sure they are.

    Attributes:
        matrix: derivatives by the places, shape (n, p).
        change: their errors: what another step of the differences changes, shape (n, p).
        doubts: lengths of the errors, as parts of those of the derivatives, shape (p,).
        unevenness: by how much the cost at nearby points exceeds that of the tangent, in variances of the
            residuals; 0 for an even response.
        steps: steps of the parameters if the response is uneven; empty if it is even.
    """

    matrix: NDArray[np.float64]
    change: NDArray[np.float64]
    doubts: Vector
    unevenness: float
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
    def samples(self) -> list[MeasuredSignal]:
        """The measured signals that are fitted, in the order of the residuals."""
        return [one for i in self.fitted for one in self.predictor.experiments[i]]

    def split(self, residuals: Vector) -> list[tuple[MeasuredSignal, Vector]]:
        """Return the measured signals with their part of the residuals, which have the shape (n,)."""
        ends = np.cumsum([len(one.time) for one in self.samples])
        return list(zip(self.samples, np.split(residuals, ends[:-1]), strict=True))

    def residuals(self, points: Sequence[Vector]) -> list[Vector | None]:
        """Return prediction minus measurement at each point in standard deviations; None if a run failed."""
        return [
            self._weigh(point, found)
            for batch in self.predictor.batches(points, self.fitted)
            for point, found in zip(batch, self.predictor.predict(batch, self.fitted), strict=True)
        ]

    def halve_step(self, point: Vector) -> Vector | str:
        """Return the residuals at a point with half the step, or why they cannot be judged."""
        (found,) = self.predictor.predict([point], self.fitted, is_halved=True)
        residuals = self._weigh(point, found)
        return next(x for x in found.values() if isinstance(x, str)) if residuals is None else residuals

    def is_exact(self, residuals: Vector) -> bool:
        """Return whether the predictions differ from all measured signals by rounding only."""
        return all(
            _length(part * self.sigma[one.signal]) <= EXACT * _length(one.values - one.values.mean())
            for one, part in self.split(residuals)
        )

    def differences(
        self, point: Vector, predictions: Mapping[int, Prediction], i: int
    ) -> Mapping[str, Vector]:
        """Return prediction minus measurement by signal, in its unit; empty if the run failed."""
        data = predictions[i]
        if isinstance(data, str):
            return {}
        of = self.predictor.parameters
        return {
            one.signal: predict_samples(of, point, data, one) - one.values
            for one in self.predictor.experiments[i]
        }

    def jacobian(self, point: Vector, central: bool = False) -> NDArray[np.float64]:
        """Return the derivatives of the residuals by the places, of shape (n, p).

        Args:
            point: Places of the parameters, shape (p,), at which all runs succeed.
            central: Whether to use central differences.

        Derivatives by a parameter for which all other runs fail are 0.
        """
        shifted = list[Vector]()
        for i in range(len(point)):
            step = self.fixed_steps.get(i, self.steps.get(i, _FIRST_STEP))
            step = step if point[i] + step <= 1.0 else -step
            shifted += [_shift(point, i, x) for x in ((step, -step) if central else (step,))]
        here, *found = self.residuals([point, *shifted])
        assert here is not None
        moved = iter(zip(shifted, found, strict=True))
        width = 2 if central else 1
        columns = [self._differentiate(i, point, here, islice(moved, width)) for i in range(len(point))]
        return np.column_stack(columns)

    def differentiate(self, point: Vector) -> Derivatives:
        """Return central differences at a point, of the steps whose derivatives are most sure.

        Where two steps disagree, the response is uneven: sampled controllers, limits and rounding change the
        runs of almost equal values. Longer steps average it out, until the response is no longer straight.
        The step is chosen whose derivative agrees best with that of the next shorter one and whose sides
        agree best.

        Args:
            point: Places of the parameters, shape (p,), at which all runs succeed.
        """
        count = len(point)
        (here,) = self.residuals([point])
        assert here is not None
        self.blocked.clear()
        first = [self.steps.get(i, _FIRST_STEP) for i in range(count)]
        found = self._try_steps(point, here, [(i, f * first[i]) for i in range(count) for f in (0.5, 1.0)])
        rungs = [found[2 * i : 2 * i + 2] for i in range(count)]
        self.blocked.update(i for i, of in enumerate(rungs) if not any(rung.sides for rung in of))
        uneven = [
            i
            for i, (short, long) in enumerate(rungs)
            if _length(long.slope - short.slope) >= UNSURE * _length(long.slope) and long.sides
        ]  # without any change the step may be shorter than the rounding
        asked = [(i, step) for i in uneven for f in _LADDER if (step := f * first[i]) <= _LONGEST]
        for (i, _), rung in zip(asked, self._try_steps(point, here, asked), strict=True):
            rungs[i].append(rung)
        chosen = [_choose_rung(of) for of in rungs]
        matrix = np.column_stack([slope for slope, _, _ in chosen])
        change = np.column_stack([error for _, error, _ in chosen])
        sizes, moved = np.linalg.norm(matrix, axis=0), np.linalg.norm(change, axis=0)
        doubts = np.divide(moved, sizes, out=np.zeros(count), where=sizes > 0.0)
        steps = {i: chosen[i][2] for i in uneven if sizes[i] > 0.0}
        unevenness = self._find_unevenness(point, here, matrix)
        return Derivatives(matrix, change, doubts, unevenness, steps)

    def _find_unevenness(self, point: Vector, here: Vector, matrix: NDArray[np.float64]) -> float:
        """Return by how much the cost near a point exceeds that of the tangent, in variances."""
        deviation = _length(here) / np.sqrt(max(len(here) - len(point), 1))
        sizes = np.linalg.norm(matrix, axis=0)
        steps = {i: min(_NEAR * deviation / size, _LONGEST) for i, size in enumerate(sizes) if size > 0.0}
        asked = [(i, step) for i, step in steps.items() if step > _FINEST]
        excess = [
            0.5 * (_square(values) - _square(here + at * matrix[:, i]))
            for (i, _), rung in zip(asked, self._try_steps(point, here, asked), strict=True)
            for at, values in rung.sides
        ]
        return max(float(np.mean(excess)) / deviation**2, 0.0) if excess else 0.0

    def _try_steps(self, point: Vector, here: Vector, asked: Sequence[tuple[int, float]]) -> list["_Rung"]:
        """Return the residuals at both sides of a point for each parameter and step."""
        shifted = [_shift(point, i, sign * step) for i, step in asked for sign in (1.0, -1.0)]
        moved = iter(zip(shifted, self.residuals(shifted), strict=True))
        rungs = list[_Rung]()
        for i, step in asked:
            sides = [
                (at[i] - point[i], values)
                for at, values in islice(moved, 2)
                if values is not None and at[i] != point[i]
            ]
            rungs.append(_Rung(step, here, sides))
        return rungs

    def _differentiate(
        self, i: int, point: Vector, here: Vector, moved: Iterable[tuple[Vector, Vector | None]]
    ) -> Vector:
        """Return the derivative of the residuals by parameter i, and choose its next step."""
        sides = [(at[i], values) for at, values in moved if values is not None and at[i] != point[i]]
        if not sides:
            self.blocked.add(i)
            return np.zeros_like(here)
        self.blocked.discard(i)
        (at, values), (bt, other), *_ = *sides, (point[i], here)
        change = float(np.sqrt(np.mean((values - other) ** 2))) / abs(at - bt)
        if change > 0.0:
            aim = _CHANGE * min(float(np.sqrt(np.mean(here**2))), 1.0)
            self.steps[i] = float(np.clip(aim / change, *_STEPS))
        return (values - other) / (at - bt)

    def _weigh(self, point: Vector, predictions: Mapping[int, Prediction]) -> Vector | None:
        parts = list[Vector]()
        for i in self.fitted:
            differences = self.differences(point, predictions, i)
            if not differences:
                return None
            parts += [values / self.sigma[signal] for signal, values in differences.items()]
        return np.concatenate(parts)


@dataclass(frozen=True)
class _Rung:
    """Residuals beside a point: a step of a parameter, and its sides with distance and residuals."""

    step: float
    here: Vector
    sides: Sequence[tuple[float, Vector]]

    @property
    def slope(self) -> Vector:
        """The derivative between both sides, or that of the only side."""
        if not self.sides:
            return np.zeros_like(self.here)
        (at, values), (bt, other), *_ = *self.sides, (0.0, self.here)
        return (values - other) / (at - bt)

    @property
    def bend(self) -> Vector:
        """Half the difference between the derivatives of both sides; zero if there is only one."""
        if len(self.sides) < 2:
            return np.zeros_like(self.here)
        right, left = ((values - self.here) / at for at, values in self.sides)
        return 0.5 * (right - left)


def _choose_rung(rungs: Sequence[_Rung]) -> tuple[Vector, Vector, float]:
    """Return derivative, its error and its step from steps that become longer."""
    changes = [_length(b.slope - a.slope) for a, b in pairwise(rungs)]
    scores = [
        float(np.hypot(c, _length(rung.bend))) / size if (size := _length(rung.slope)) > 0.0 else np.inf
        for c, rung in zip(changes, rungs[1:], strict=True)
    ]
    best = int(np.argmin(scores)) + 1
    here, before = rungs[best], rungs[best - 1]
    slope, error = here.slope, here.slope - before.slope
    if best > 1 and changes[best - 1] < 0.5 * changes[best - 2]:
        # it is noise still, whose part in the longer step is smaller
        error = error * before.step / float(np.hypot(before.step, here.step))
    if all(_length(rung.bend) > _CORNER * _length(rung.slope) for rung in rungs):
        error = here.bend
    return slope, error, here.step


def _shift(point: Vector, i: int, step: float) -> Vector:
    """Return a point with another place of parameter i, within its range."""
    moved = point.copy()
    moved[i] = np.clip(point[i] + step, 0.0, 1.0)
    return moved


def _length(values: Vector) -> float:
    return float(np.linalg.norm(values))


def _square(values: Vector) -> float:
    return float(values @ values)
