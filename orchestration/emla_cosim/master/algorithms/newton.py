"""Newton's and quasi-Newton methods for fixed points x = F(x), and sizes of signals."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Indices, Vector
from ..network import Network

TOLERANCE = 1e-12
"""Values agree if their difference and their correction are at most this fraction of their size."""

ITERATIONS = 50

DIFFERENCE = 1e-4
"""Difference for the derivatives, as a fraction of a value's size."""

_ROUNDING = 8.0 * np.finfo(float).eps
ROUGH = 1e-6
"""Corrections below this fraction of a value are rounding errors once they stop shrinking."""

_FAST = 0.1
"""The derivatives are kept while each correction is at most this fraction of the previous one."""

HALVINGS = 8
"""Most halvings of a correction that does not help."""


class NoSolutionError(Exception):
    """The guesses and answers do not agree.

    Args:
        gap: F(x) - x at the last guess, shape (n,).
        calls: Number of calls of F.
        singular: Whether a change of the value comes back unchanged, shape (n,), bool. All false if the
            derivatives are not the cause.
    """

    def __init__(self, gap: Vector, calls: int, singular: np.ndarray) -> None:
        super().__init__(gap, calls, singular)
        self.gap, self.calls, self.singular = gap, calls, singular


@dataclass
class _Inverse:
    """(1 - F')^-1 without the directions that rounding errors hide, which are the columns of `hidden`."""

    matrix: Vector
    hidden: Vector


class Newton:
    """Solve x = F(x).

    Args:
        function: F, from shape (n,) to shape (n,).
        sizes: Return the sizes of values, shape (n,), positive, each in its value's unit.
    """

    def __init__(self, function: Callable[[Vector], Vector], sizes: Callable[[Vector], Vector]) -> None:
        self._function, self._sizes, self._calls = function, sizes, 0

    def solve(self, guess: Vector) -> Vector:
        """Return the solution x, shape (n,). The last call of F has this argument.

        Args:
            guess: First guess, shape (n,).

        Raises:
            NoSolutionError: No solution was found.
        """
        x, inverse, last = guess.copy(), None, np.inf
        value = self._evaluate(x)
        for _ in range(ITERATIONS):
            gap = value - x
            if not np.isfinite(gap).all():
                break
            if not gap.any():
                return x
            inverse = inverse or self._invert(x, value)
            correction = inverse.matrix @ gap
            size = self._find_largest_relative(x, correction)
            if self._is_solved(x, gap, size, last):
                x = x + correction  # so that values which the loop amplifies agree, too
                self._evaluate(x)
                return x
            step, value, inverse = self._search_along(x, correction, size, inverse)
            x, last = x + step * correction, size
        raise NoSolutionError(value - x, self._calls, np.zeros(len(x), dtype=bool))

    def _evaluate(self, x: Vector) -> Vector:
        self._calls += 1
        with np.errstate(all="ignore"):
            return np.array(self._function(x), dtype=float)

    def _find_largest_relative(self, x: Vector, difference: Vector) -> float:
        """Return the largest difference relative to the values' sizes; infinity if it is not finite."""
        with np.errstate(all="ignore"):
            largest = float((np.abs(difference) / self._sizes(x)).max())
        return largest if np.isfinite(largest) else np.inf

    def _is_solved(self, x: Vector, gap: Vector, correction_size: float, last_size: float) -> bool:
        """Return whether a correction of this size, after one of the last size, is the last that helps."""
        if correction_size <= TOLERANCE and self._find_largest_relative(x, gap) <= TOLERANCE:
            return True
        # rounding errors: nothing better follows
        return correction_size <= ROUGH and correction_size >= 0.5 * last_size

    def _search_along(
        self, x: Vector, correction: Vector, size: float, inverse: _Inverse
    ) -> tuple[float, Vector, _Inverse | None]:
        """Find how far to go along a correction: the whole correction if no part of it helps.

        Returns:
            The part of the correction; F at that point; the inverse if it can be kept, else None.
        """
        for halvings in range(HALVINGS):
            step = 0.5**halvings
            trial = x + step * correction
            value = self._evaluate(trial)
            following = self._find_largest_relative(x, inverse.matrix @ (value - trial))
            if following <= (1.0 - 0.25 * step) * size or (size <= ROUGH and following < np.inf):
                return step, value, inverse if following <= _FAST * size else None
        return 1.0, self._evaluate(x + correction), None

    def _invert(self, x: Vector, value: Vector) -> _Inverse:
        """Return the inverse at a point, from large differences if rounding errors hide small ones.

        Raises:
            NoSolutionError: No correction can remove the gap, or a derivative is not finite.
        """
        sizes, gap = self._sizes(x), value - x
        inverse = self._invert_differences(x, value, DIFFERENCE * sizes)
        if inverse.hidden.size:
            inverse = self._invert_differences(x, value, np.maximum(sizes, np.abs(gap)))
        if inverse.hidden.size:
            uncorrectable = gap - self._slopes @ (inverse.matrix @ gap)
            if self._find_largest_relative(x, uncorrectable) > TOLERANCE:
                main = np.abs(inverse.hidden).max(axis=1)
                raise NoSolutionError(gap, self._calls, main > 0.1 * main.max())
        return inverse

    def _invert_differences(self, x: Vector, value: Vector, steps: Vector) -> _Inverse:
        """Return the inverse of derivatives from differences with these steps, and keep the derivatives."""
        count, sizes = len(x), self._sizes(x)
        slopes, noise = np.eye(count), np.zeros((count, count))
        for j in range(count):
            shifted = x.copy()
            shifted[j] += steps[j]
            step = shifted[j] - x[j]
            shifted_value = self._evaluate(shifted)
            slopes[:, j] -= (shifted_value - value) / step
            noise[:, j] = _ROUNDING * np.maximum(np.abs(value), np.abs(shifted_value)) / step
        if not np.isfinite(slopes).all():
            raise NoSolutionError(np.full(count, np.nan), self._calls, np.zeros(count, dtype=bool))
        self._slopes = slopes
        rows = (np.abs(slopes) + noise) @ sizes + np.finfo(float).tiny  # size of each equation
        scaled, rounding = slopes * sizes / rows[:, None], noise * sizes / rows[:, None]
        left_vectors, sigma, right_vectors = np.linalg.svd(scaled)
        # along other directions the differences are only rounding errors
        visible = sigma > max(float(np.linalg.norm(rounding)), _ROUNDING * float(sigma[0]))
        matrix = (sizes[:, None] * right_vectors[visible].T / sigma[visible]) @ (
            left_vectors[:, visible].T / rows
        )
        return _Inverse(matrix, right_vectors[~visible].T)


RELAXATION = 0.1
"""Relaxation factor before the first secant."""

NOISE = 1e-10
"""Changes of the residual below this fraction of it count as rounding errors."""

FILTER = 1e-3
"""A difference is used if at least this fraction of it is orthogonal to newer ones."""


def estimate_jacobian(count: int, derivatives: Vector | None = None) -> Vector:
    """Return J before the first step, shape (count, count).

    Args:
        count: Number of values.
        derivatives: F' = dF/dx, so that J = F' (F' - 1)^-1; None if it is not known.
    """
    default = np.eye(count) * (1.0 - RELAXATION)
    if derivatives is None:
        return default
    try:
        with np.errstate(all="ignore"):
            jacobian = np.linalg.solve((derivatives - np.eye(count)).T, derivatives.T).T
    except np.linalg.LinAlgError:
        return default
    return np.array(jacobian, dtype=float) if np.isfinite(jacobian).all() else np.array(default)


NOMINAL_SHARE = 0.01
"""Fraction of a variable's nominal value that is added to the size of its signal."""

TINY = np.finfo(float).tiny
"""Smallest size, so that a division by a size is safe."""


class Scale:
    """The size of every signal: its largest absolute value so far, plus a hundredth of its nominal value.

    So a force that passes through zero keeps the size of a typical force.
    """

    def __init__(self, network: Network) -> None:
        nominals = [instance.nominals for instance in network.instances]
        self.floor: Vector = np.fmax(NOMINAL_SHARE * np.concatenate([np.empty(0), *nominals]), TINY)
        self.largest: Vector = np.zeros(len(network.signals))

    def sizes(self, which: Indices) -> Vector:
        """Return the sizes of these signals."""
        return self.largest[which] + self.floor[which]

    def relative(self, difference: Vector, which: Indices) -> Vector:
        """Return absolute differences of these signals, divided by their sizes."""
        return np.abs(difference) / self.sizes(which)
