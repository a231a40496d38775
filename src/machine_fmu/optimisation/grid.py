"""Knots of a spline, and points at which the motion along it is evaluated."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import Legendre
from scipy.interpolate import BSpline


@dataclass(frozen=True)
class SplineBasis:
    """Clamped B-splines of a degree on [0, 1]; multiplied by the duration, this is the time of a motion."""

    degree: int
    knots: np.ndarray

    @classmethod
    def cosine(cls, degree: int, count: int) -> "SplineBasis":
        """Make a basis with `count` different knots, which are denser at both ends, as cosines."""
        positions = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, count))
        positions[[0, -1]] = 0.0, 1.0
        return cls(degree, np.concatenate([np.zeros(degree), positions, np.ones(degree)]))

    @property
    def size(self) -> int:
        """Number of coefficients of a curve."""
        return len(self.knots) - self.degree - 1

    @property
    def distinct_knots(self) -> np.ndarray:
        """The different knots."""
        return self.knots[self.degree : len(self.knots) - self.degree]

    @property
    def means(self) -> np.ndarray:
        """Greville's abscissae: with these as coefficients, the curve is the time itself."""
        return np.array([self.knots[i + 1 : i + self.degree + 1].mean() for i in range(self.size)])

    @property
    def speed_spans(self) -> np.ndarray:
        """Divisors that turn differences of coefficients into the coefficients of the derivative."""
        p, n = self.degree, self.size
        return (self.knots[p + 1 : p + n] - self.knots[1:n]) / p

    @property
    def derivative(self) -> "SplineBasis":
        """The basis of the derivatives of curves."""
        return SplineBasis(self.degree - 1, self.knots[1:-1])

    def subdivided(self, pieces: int) -> np.ndarray:
        """Return the matrix from coefficients to those of the same curve with more knots.

        Every span between knots has `pieces` equal parts. The curve lies closer to the new coefficients.
        """
        if self.degree == 0:
            return np.eye(self.size)  # constant in every span: its coefficients are its values
        curve = BSpline(self.knots, np.eye(self.size), self.degree)
        for a, b in pairwise(np.unique(self.knots)):
            for k in range(1, pieces):
                curve = curve.insert_knot(a + (b - a) * k / pieces)
        return curve.c[: len(curve.t) - self.degree - 1]

    def at(self, positions: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Return a derivative of all basis functions: one row per place, one column per coefficient."""
        return BSpline(self.knots, np.eye(self.size), self.degree)(positions, nu=derivative)


def lobatto(positions: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss-Lobatto points and weights, `count` in each interval, with shared ends.

    The sum of weight times value is the integral. It is exact for polynomials up to degree 2 count - 3.
    """
    legendre = Legendre.basis(count - 1)
    x = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    w = 2.0 / (count * (count - 1) * legendre(x) ** 2)
    points, weights = [positions[:1]], [np.zeros(1)]
    for a, b in pairwise(positions):
        # neighbouring intervals share an end, whose weights add up
        weights[-1][-1] += 0.5 * (b - a) * w[0]
        points.append(0.5 * (a + b) + 0.5 * (b - a) * x[1:])
        weights.append(0.5 * (b - a) * w[1:])
    grid = np.concatenate(points)
    grid[-1] = positions[-1]  # avoids rounding beyond it
    return grid, np.concatenate(weights)
