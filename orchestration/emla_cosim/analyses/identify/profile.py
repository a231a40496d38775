"""Profile likelihood: the interval of a parameter with all others estimated again.

Source: A. Raue et al., "Structural and practical identifiability analysis of partially observed dynamical
models by exploiting the profile likelihood", Bioinformatics 25 (2009).
"""

from collections.abc import Callable
from typing import cast

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import f as fisher

from ...base.arrays import Vector
from .certainty import LEVEL
from .problem import Problem

_EVALUATIONS = 20
"""Most iterations of the other parameters for each value."""

_LOST = 1e6
"""Cost, relative to the smallest, of values whose run fails."""

_FIRST = 0.01
"""First distance from the estimate, as a part of the range, if the standard error is not known."""

_PRECISION = 0.02
"""Relative precision of the interval's ends."""


def profile(
    problem: Problem, point: Vector, i: int, error: float | None, report: Callable[[int], None]
) -> tuple[float | None, float | None]:
    """Return the places of the ends of the interval of 95 % of parameter i.

    An end is None where the range ends before.

    Args:
        problem: the problem.
        point: places of the estimates, shape (p,).
        i: position of the parameter.
        error: standard error of its place, if it is known.
        report: called with the number of evaluations.
    """
    (best,) = problem.residuals([point])
    assert best is not None
    total, count = len(best), len(point)
    smallest = float(best @ best)
    limit = smallest * (1.0 + fisher.ppf(LEVEL, 1, max(total - count, 1)) / max(total - count, 1))
    others = np.array([k for k in range(count) if k != i], dtype=int)

    def side(sign: float) -> float | None:
        near = point[others].copy()

        def excess(distance: float) -> float:
            nonlocal near
            fixed = point.copy()
            fixed[i] = point[i] + sign * distance
            if not len(others):
                (found,) = problem.residuals([fixed])
                return float((_LOST * smallest if found is None else found @ found) - limit)
            cost, near = _minimise(problem, fixed, others, near, report)
            return float((_LOST * smallest if cost is None else cost) - limit)

        room = 1.0 - point[i] if sign > 0 else point[i]
        inner, outer = 0.0, min(2.0 * error if error else _FIRST, room)
        while excess(outer) < 0.0:
            if outer >= room:
                return None
            inner, outer = outer, min(2.0 * outer, room)
        found = cast(float, brentq(excess, inner, outer, xtol=_PRECISION * outer))
        return float(point[i] + sign * found)

    return side(-1.0), side(1.0)


def _minimise(
    problem: Problem, fixed: Vector, others: np.ndarray, near: Vector, report: Callable[[int], None]
) -> tuple[float | None, Vector]:
    """Return the smallest sum of squares with one parameter fixed, and the places of the others."""

    def place(part: Vector) -> Vector:
        whole = fixed.copy()
        whole[others] = part
        return whole

    (first,) = problem.residuals([place(near)])
    if first is None:
        return None, near

    def residuals(part: Vector) -> Vector:
        report(1)
        (found,) = problem.residuals([place(part)])
        return 1e3 * (np.abs(first) + 1.0) if found is None else found

    found = least_squares(
        residuals,
        np.clip(near, 1e-9, 1.0 - 1e-9),
        lambda part: problem.jacobian(place(part))[:, others],  # type: ignore[arg-type]
        bounds=(0.0, 1.0),
        x_scale="jac",
        max_nfev=_EVALUATIONS,
        ftol=1e-6,
    )
    return 2.0 * float(found.cost), found.x
