"""Knots of a spline, and points at which the motion along it is evaluated."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi
import numpy as np
from numpy.polynomial.legendre import Legendre
from scipy.interpolate import BSpline

from ..model import MachineModel
from .problem import MotionProblem, Numbers


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


def guess_unknowns(machine: MachineModel, strokes: np.ndarray, payloads: np.ndarray) -> np.ndarray:
    """Return the machine's unknowns; where it has none, those of the row before."""
    unknowns = machine.find_unknowns(strokes, payloads)
    last = np.array([machine.closure.assembly[i] for i in machine.unknowns])
    for row in unknowns:
        if not np.isfinite(row).all():
            row[:] = last
        last = row
    return unknowns


def stage(problem: MotionProblem, tie_break: float, payload: float) -> casadi.Function:
    """Return a function of a point to the forces in N, the cost's integrand in W2, and errors of the pose.

    Its arguments are q, q', q'', and the machine's unknowns.
    """
    machine = problem.machine
    q, v, a = (casadi.SX.sym(name, len(problem.names)) for name in "qva")
    x = casadi.SX.sym("x", len(machine.unknowns))
    strokes, unknowns, speeds, growths = map(casadi.vertsplit, (q, x, v, a))
    force = casadi.vertcat(*machine.inverse(strokes, unknowns, speeds, growths, payload))
    errors = casadi.vertcat(*machine.errors(machine.at(strokes, unknowns, payload)))
    power = casadi.dot(v, force) ** 2 + tie_break * casadi.sumsqr(v * force)
    return casadi.Function("stage", [q, v, a, x], [force, power, errors])


def point_function(machine: MachineModel, names: Sequence[str], payload: float) -> casadi.Function:
    """Return a function of strokes and unknowns to points in m, in turn, and errors of the pose."""
    q, x = casadi.SX.sym("q", len(machine.names)), casadi.SX.sym("x", len(machine.unknowns))
    dynamics = machine.at(casadi.vertsplit(q), casadi.vertsplit(x), payload)
    points = machine.locate(dynamics, [machine.ends[name] for name in names])
    return casadi.Function(
        "points", [q, x], [casadi.vertcat(*points), casadi.vertcat(*machine.errors(dynamics))]
    )


def least_cost(problem: MotionProblem, duration: float, strokes: Sequence[Numbers] = ()) -> float:
    """Return the lower bound of the cost of motions of this duration in s, in W2 s: dE^2 / (2 t_M).

    All power goes into energy, and constant power has the least square. `strokes` are those at the way-points
    and at the end; by default, the guesses. A payload that changes brings or takes its own energy.
    """
    strokes, loads, zero_speeds = strokes or problem.guesses, problem.loads, (0.0,) * len(problem.names)

    def energy(q: Numbers, v: Numbers, payload: float) -> float:
        return float(problem.machine.energy(np.array([q]), np.array([v]), payload)[0])

    gained = energy(strokes[-1], problem.v_E, loads[-1].payload) - energy(
        problem.q_S, problem.v_S, problem.payload
    )
    strokes_at = dict(zip(problem.moments, strokes, strict=False))
    for previous, load in pairwise(loads):
        q = strokes_at[load.first]
        gained -= energy(q, zero_speeds, load.payload) - energy(q, zero_speeds, previous.payload)
    return gained**2 / (2.0 * duration)
