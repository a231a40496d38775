"""Estimate parameters by least squares from several starting points (`scipy.optimize.least_squares`).

Source of the criterion at which a search ends: D. M. Bates and D. G. Watts, "A Relative Offset Orthogonality
Convergence Criterion for Nonlinear Least Squares", Technometrics 23 (1981).
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import qmc

from ...base.arrays import Vector
from ...base.errors import RunError
from .problem import Derivatives, Problem
from .residuals import EXACT, LINEAR, find_cost, find_robust_deviation

_TOLERANCE = 1e-10
"""Relative change of cost and parameters at which the search ends."""

_OFFSET = 1e-3
"""Distance from the minimum of the tangent in standard errors at which the search ends. It is 1/1000 of what
the residuals hide; a perfect fit never gets there.
"""

_FAILED_RUN_FACTOR = 1e3
"""Factor of the residuals where a run fails: the search avoids such values."""

_SIGMA_ROUNDS = 4
"""Most estimations while the standard deviations of the signals follow from the residuals."""

_VALLEYS = 5
"""Most searches from points around a solution."""

_DISTANCES = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Distances of these points in standard errors."""

_BETTER_COST = 0.99
"""Part of the cost below which a point is better."""

_FLAT = 1e-8
"""Singular value, as a part of the largest, below which a direction has no influence."""

_SETTLED = 0.02
"""Relative change of the standard deviations below which they are settled."""


@dataclass
class Solution:
    """A point that a search evaluated.

    Attributes:
        point: fractions of the parameters, shape (p,).
        residuals: residuals there in standard deviations, shape (n,).
        cost: half the sum of their squares, or of the loss.
        converged: whether the search ended by its tolerances.
    """

    point: Vector
    residuals: Vector
    cost: float
    converged: bool


@dataclass
class Estimator:
    """Searches for the minimum.

    Attributes:
        problem: the problem.
        loss: the loss function.
        evaluations: most iterations from each starting point.
        report: called with the cost of each iteration.
        history: cost of each evaluation with the number of its starting point.
    """

    problem: Problem
    loss: str
    evaluations: int
    report: Callable[[int], None]
    history: list[dict[str, float]] = field(default_factory=list)
    best: Solution | None = None

    def estimate(self, points: list[Vector], free: Collection[str] = ()) -> Solution:
        """Return the best solution from all starting points.

        Args:
            points: the starting points, each of shape (p,).
            free: signals whose standard deviation follows from the residuals, in turns with the estimation.

        Raises:
            InterruptedRunsError: the user interrupted; `best` has the best point so far.
            RunError: the runs of all starting points fail.
        """
        solutions = [solution for i, p in enumerate(points) if (solution := self._search(p, i)) is not None]
        if not solutions:
            reasons = sorted(self.problem.predictor.failures, key=self.problem.predictor.failures.__getitem__)
            raise RunError(
                f"the runs of all starting points fail, most often because: {reasons[-1].rstrip('.')}."
            )
        best = self._search_around(min(solutions, key=lambda solution: solution.cost))
        for _ in range(_SIGMA_ROUNDS if free else 0):
            before = dict(self.problem.sigma)
            self._adapt_sigma(best, free)
            best = self._search(best.point, len(points)) or best
            if all(abs(self.problem.sigma[k] / v - 1.0) < _SETTLED for k, v in before.items()):
                break
        if free:
            best = self._search_around(best)
        # forward differences move the minimum where residuals are large
        return self._search(best.point, -1, central=True) or best

    def differentiate(self, solution: Solution) -> tuple[Solution, Derivatives]:
        """Return a solution and its derivatives.

        If these need longer steps, the problem keeps them, and a search with them improves the solution.
        """
        slopes = self.problem.differentiate(solution.point)
        if slopes.steps:
            self.problem.fixed_steps = slopes.steps
            solution = self._search(solution.point, -1, central=True) or solution
            slopes = self.problem.differentiate(solution.point)
        return solution, slopes

    def _search_around(self, solution: Solution) -> Solution:
        """Return the minimum that searches from better points around a solution find.

        A sampled controller and its limits make the cost uneven, and a search ends early in a narrow valley.
        Points along the principal directions, in standard errors, show whether the valley continues.
        """
        for _ in range(_VALLEYS):
            jacobian = self.problem.jacobian(solution.point, central=True)
            _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
            deviation = np.sqrt(2.0 * solution.cost / max(len(solution.residuals) - len(solution.point), 1))
            points = [
                np.clip(solution.point + sign * distance * deviation / size * direction, 0.0, 1.0)
                for size, direction in zip(singular, directions, strict=True)
                if size > _FLAT * singular[0]
                for distance in _DISTANCES
                for sign in (1.0, -1.0)
            ]
            costs = [np.inf if r is None else find_cost(self.loss, r) for r in self.problem.residuals(points)]
            if not points or not min(costs) < _BETTER_COST * solution.cost:
                break
            solution = self._search(points[int(np.argmin(costs))], -1) or solution
        return solution

    def _adapt_sigma(self, solution: Solution, free: Collection[str]) -> None:
        """Set the standard deviations of free signals to those of their residuals.

        With a loss for outliers they are those of the median, which outliers do not move.
        """
        parts = self.problem.split(solution.residuals)
        for signal in free:
            differences = np.concatenate([part for measured, part in parts if measured.signal == signal])
            differences = differences * self.problem.sigma[signal]
            rms = float(np.sqrt(np.mean(differences**2)))
            deviation = rms if self.loss == LINEAR else find_robust_deviation(differences)
            spread = max(float(np.std(measured.values)) for measured, _ in parts if measured.signal == signal)
            self.problem.sigma[signal] = max(deviation, EXACT * spread)
        # costs with other standard deviations cannot be compared
        self.best = replace(solution, cost=np.inf)

    def _search(self, start: Vector, number: int, central: bool = False) -> Solution | None:
        """Return the minimum from one point; None if its run fails.

        Derivatives by forward differences move the minimum where residuals are large; central ones do not.
        """
        (first,) = self.problem.residuals([start])
        if first is None:
            return None

        def residuals(point: Vector) -> Vector:
            (values,) = self.problem.residuals([point])
            self.report(1)
            if values is None:
                # a finite wall: the solver stops at NaN or infinity
                return _FAILED_RUN_FACTOR * (np.abs(first) + 1.0)
            cost = find_cost(self.loss, values)
            self.history.append({"start": number, "evaluation": len(self.history), "cost": cost})
            self._update_best(Solution(point.copy(), values, cost, False))
            return values

        def jacobian(point: Vector) -> NDArray[np.float64]:
            slopes = self.problem.jacobian(point, central)
            if self.loss == LINEAR:
                (values,) = self.problem.residuals([point])
                if values is not None and _find_offset(point, values, slopes) < _OFFSET:
                    raise _ArrivedError(point.copy())
            return slopes

        try:
            result = least_squares(
                residuals,
                np.clip(start, 1e-9, 1.0 - 1e-9),
                jacobian,  # type: ignore[arg-type]
                bounds=(0.0, 1.0),
                method="dogbox",
                x_scale="jac",
                loss=self.loss,  # type: ignore[arg-type]
                ftol=_TOLERANCE,
                xtol=_TOLERANCE,
                gtol=None,  # type: ignore[arg-type]  # it is absolute, and residuals of a perfect fit vanish
                max_nfev=self.evaluations,
            )
            end, converged = result.x, result.status > 0
        except _ArrivedError as arrived:
            end, converged = arrived.args[0], True
        (end_residuals,) = self.problem.residuals([end])
        if end_residuals is None:
            return None
        solution = Solution(end, end_residuals, find_cost(self.loss, end_residuals), converged)
        self._update_best(solution)
        return solution

    def _update_best(self, solution: Solution) -> None:
        if self.best is None or solution.cost <= self.best.cost:
            self.best = solution


class _ArrivedError(Exception):
    """The search is at a point so near to the minimum that the residuals hide the rest of the way."""


def _find_offset(point: Vector, residuals: Vector, jacobian: NDArray[np.float64]) -> float:
    """Return the distance from the minimum of the tangent in standard errors (root mean square).

    Parameters at an end of their range towards which the minimum lies do not count.
    """
    gradient = jacobian.T @ residuals
    at_end = ((point < 1e-6) & (gradient > 0.0)) | ((point > 1.0 - 1e-6) & (gradient < 0.0))
    free = jacobian[:, ~at_end & (np.abs(jacobian).max(axis=0, initial=0.0) > 0.0)]
    count, freedom = free.shape[1], len(residuals) - free.shape[1]
    size = float(np.linalg.norm(residuals))
    if not count or freedom < 1 or size == 0.0:
        return np.inf
    basis, _ = np.linalg.qr(free / np.linalg.norm(free, axis=0))
    along = float(np.linalg.norm(basis.T @ residuals))
    across = float(np.sqrt(max(size**2 - along**2, 0.0)))
    return along / np.sqrt(count) / max(across / np.sqrt(freedom), 1e-300)


def draw_starting_points(start: Vector, count: int, seed: int) -> list[Vector]:
    """Return the starting point of the scenario, and further ones of a Latin hypercube."""
    drawn = qmc.LatinHypercube(len(start), rng=np.random.default_rng(seed)).random(count - 1)
    return [start, *drawn]
