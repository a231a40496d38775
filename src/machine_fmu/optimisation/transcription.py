"""The optimisation of a motion as a nonlinear programme: direct collocation with B-splines.

The unknowns are the coefficients c, the duration t_M, and q, q' and q'' at every collocation point. The
latter are "lifted": c and t_M determine them. As unknowns they allow one function to be mapped over all
points, and its exact second derivatives stay small and sparse.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi
import numpy as np

from hdrm_fmu.dynamics import energy, inverse_dynamics
from hdrm_fmu.kinematics import tip
from hdrm_fmu.parameters import Three

from ..trajectory import JOINTS
from .constraints import Constraints
from .grid import SplineBasis, lobatto
from .problem import Load, MotionProblem
from .surroundings import heights


@dataclass(frozen=True)
class Discretisation:
    """Resolution of a motion, and weight of the term beside the paper's cost.

    `degree` and `knots` are those of the spline, `points` the collocation points in each span between
    knots. `tie_break` is the weight of the joints' own powers, without which many motions cost the same.
    Control points after dividing each span into `subdivisions` parts keep the bounds of strokes and speeds,
    and so does the spline between them. The more parts, the closer they are to the spline.
    """

    degree: int = 5
    knots: int = 20
    points: int = 10
    tie_break: float = 1e-3
    subdivisions: int = 1

    @property
    def basis(self) -> SplineBasis:
        """Return the spline's basis on [0, 1]."""
        return SplineBasis.cosine(self.degree, self.knots)


_APART = 1e-9
"""Smallest distance of two places, as a fraction of the duration."""

SLACKS = (
    *(f"the force bounds of the {joint}" for joint in JOINTS),
    *(f"the speed bounds of the {joint}" for joint in JOINTS),
    "the longest time t_M",
    "the start speeds v_S",
    "the end speeds v_E",
    *(f"the acceleration bounds of the {joint}" for joint in JOINTS),
    *(f"the jerk bounds of the {joint}" for joint in JOINTS),
    "the clearance from the ground",
)
"""Bounds that an elastic programme relaxes: not those of strokes, as triangles may not close beyond them."""

_FORCE, _SPEED, _TIME, _START, _END, _ACCELERATION, _JERK, _GROUND = 0, 3, 6, 7, 8, 9, 12, 15


@dataclass(frozen=True)
class Programme:
    """A nonlinear programme, its unknowns in this order: coefficients by joint, t_M, q, q', q'', slacks."""

    problem: MotionProblem
    how: Discretisation
    elastic: bool = False
    """Whether the groups of SLACKS are relaxed; their slacks are minimised then."""
    grounded: bool = False
    """Whether the collocation points keep the clearance from the ground."""

    @cached_property
    def basis(self) -> SplineBasis:
        """The spline's basis."""
        return self.how.basis

    @cached_property
    def parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Collocation points on [0, 1] and weights for each payload; a change of it is a point of both."""
        places = self.basis.places
        return [lobatto(_between(places, load), self.how.points) for load in self.problem.loads]

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Collocation points on [0, 1], and their weights."""
        points, weights = zip(*self.parts, strict=True)
        return np.concatenate(points), np.concatenate(weights)

    @property
    def slacks(self) -> int:
        """Number of slacks."""
        return len(SLACKS) if self.elastic else 0

    @cached_property
    def symbols(self) -> tuple[casadi.MX, ...]:
        """Coefficients, t_M, q, q', q'' and slacks."""
        count = len(self.points[0])
        lifted = [casadi.MX.sym(name, 3, count) for name in ("q", "v", "a")]
        c, t_M = casadi.MX.sym("c", self.basis.size, 3), casadi.MX.sym("t_M")
        return c, t_M, *lifted, casadi.MX.sym("slack", self.slacks)

    def built(self) -> tuple[dict[str, casadi.MX], tuple[np.ndarray, np.ndarray]]:
        """Return the programme for CasADi, and the bounds of its constraints."""
        _, t_M, q, v, a, slack = self.symbols
        forces, cost = self._forces(q, v, a)
        constraints = Constraints()
        self._on_spline(constraints)
        self._strokes(constraints)
        self._speeds(constraints)
        self._accelerations_and_jerks(constraints)
        self._positions(constraints)
        if self.grounded:
            self._heights(constraints)
        for i, (low, high) in enumerate(zip(self.problem.f_LB, self.problem.f_UB, strict=True)):
            scale = max(high - low, 1.0)
            constraints.giving_way(forces[i, :] / scale, low / scale, high / scale, self._slack(_FORCE + i))
        total = 0.5 * t_M * casadi.mtimes(cost, casadi.DM(self.points[1])) / self.cost_scale
        if self.elastic:
            total = casadi.sum1(slack) + 1e-4 * total
            constraints.between(t_M / self.problem.t_M - slack[_TIME], -np.inf, 1.0)
        unknowns = casadi.vertcat(*(casadi.vec(x) for x in self.symbols))
        return {"x": unknowns, "f": total, "g": constraints.expression}, constraints.bounds

    def _forces(self, q: casadi.MX, v: casadi.MX, a: casadi.MX) -> tuple[casadi.MX, casadi.MX]:
        """Return forces in N and the cost's integrand in W2 at all points, each with its payload."""
        found, first = [], 0
        for load, (points, _) in zip(self.problem.loads, self.parts, strict=True):
            rows = slice(first, first + len(points))
            at_once = stage(self.problem, self.how.tie_break, load.payload).map(len(points))
            found.append(at_once(q[:, rows], v[:, rows], a[:, rows]))
            first = rows.stop
        forces, costs = zip(*found, strict=True)
        return casadi.horzcat(*forces), casadi.horzcat(*costs)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of the unknowns. Coefficients are within strokes unless subdivided ones are."""
        problem = self.problem
        q_LB, q_UB = problem.machine.q_LB, problem.machine.q_UB
        lasts = (q_LB, q_UB) if problem.tip_E is not None else (problem.q_E, problem.q_E)
        free = self.how.subdivisions > 1
        low = self._in_columns(problem.q_S, [-np.inf] * 3 if free else q_LB, lasts[0])
        high = self._in_columns(problem.q_S, [np.inf] * 3 if free else q_UB, lasts[1])
        anywhere = np.full(9 * len(self.points[0]), np.inf)
        longest = np.inf if self.elastic else problem.t_M
        return (
            np.concatenate([low, [1e-3 * problem.t_M], -anywhere, np.zeros(self.slacks)]),
            np.concatenate([high, [longest], anywhere, np.full(self.slacks, np.inf)]),
        )

    def _in_columns(
        self, first: Sequence[float], inner: Sequence[float], last: Sequence[float]
    ) -> list[float]:
        """Return values for all coefficients from those of each joint."""
        count = self.basis.size - 2
        return [x for s, mid, e in zip(first, inner, last, strict=True) for x in (s, *[mid] * count, e)]

    def start(self, coefficients: np.ndarray) -> np.ndarray:
        """Return initial unknowns: a curve with these coefficients, one column per joint, of duration t_M."""
        duration, places = self.problem.t_M, self.points[0]
        curve = [self.basis.at(places, d) @ coefficients / duration**d for d in range(3)]
        slacks = np.ones(self.slacks)
        return np.concatenate([coefficients.T.ravel(), [duration], *(x.ravel() for x in curve), slacks])

    def found(self, unknowns: np.ndarray) -> tuple[np.ndarray, float]:
        """Return coefficients, one column per joint, and duration in s of a solution."""
        count = 3 * self.basis.size
        return unknowns[:count].reshape(3, -1).T, float(unknowns[count])

    @cached_property
    def cost_scale(self) -> float:
        """A typical cost in W2 s."""
        powers = zip(self.problem.f_UB, self.problem.v_UB, strict=True)
        usual = 0.01 * max(max(abs(f * v) for f, v in powers), 1.0)
        return max(least_cost(self.problem, self.problem.t_M), 0.5 * self.problem.t_M * usual * usual)

    def _on_spline(self, constraints: Constraints) -> None:
        """Require that lifted unknowns equal the spline's values, in the scale of positions."""
        c, t_M, *lifted, _ = self.symbols
        relative = t_M / self.problem.t_M
        for order, x in enumerate(lifted):
            rows = casadi.DM(casadi.sparsify(casadi.DM(self.basis.at(self.points[0], order)), 1e-14))
            scale = self.problem.t_M**order
            constraints.equal(x.T * relative**order - casadi.mtimes(rows, c) / scale)

    def _positions(self, constraints: Constraints) -> None:
        """Require positions of the tip at way-points and at the end, and rest where the payload changes."""
        problem, q = self.problem, casadi.SX.sym("q", 3)
        place = casadi.Function("tip", [q], [casadi.vertcat(*tip(problem.machine, casadi.vertsplit(q)))])
        aims = [(moment, via.tip) for moment, via in zip(problem.moments, problem.via, strict=True)]
        for moment, position in aims if problem.tip_E is None else [*aims, (1.0, problem.tip_E)]:
            row = casadi.DM(casadi.sparsify(casadi.DM(self.basis.at(np.array([moment]))), 1e-14))
            constraints.equal(place(casadi.mtimes(row, self.symbols[0]).T) - casadi.DM(position))
        for load in problem.loads[1:]:
            row = casadi.DM(casadi.sparsify(casadi.DM(self.basis.at(np.array([load.first]), 1)), 1e-14))
            constraints.equal(casadi.mtimes(row, self.symbols[0]) / problem.t_M)

    def _strokes(self, constraints: Constraints) -> None:
        """Require bounds of the strokes' subdivided control points."""
        if self.how.subdivisions > 1:
            fine = casadi.mtimes(casadi.DM(self.basis.subdivided(self.how.subdivisions)), self.symbols[0])
            for i in range(3):
                low, high = self.problem.machine.q_LB[i], self.problem.machine.q_UB[i]
                constraints.between((fine[1:-1, i] - low) / (high - low), 0.0, 1.0)

    def _speeds(self, constraints: Constraints) -> None:
        """Require the speeds at both ends, and bounds of the speed's control points between.

        A speed at an end may be beyond its bound only there, and up to the next control point.
        """
        c, t_M, *_ = self.symbols
        steps = (c[1:, :] - c[:-1, :]) / casadi.repmat(casadi.DM(self.basis.speed_spans), 1, 3)
        speeds = steps / self.problem.t_M  # speeds of a motion with the longest duration
        relative = t_M / self.problem.t_M
        for i in range(3):
            low, high = self.problem.v_LB[i], self.problem.v_UB[i]
            scale = max(high - low, 1e-3)
            for row, ends, group in ((0, self.problem.v_S, _START), (-1, self.problem.v_E, _END)):
                off = (speeds[row, i] - ends[i] * relative) / scale
                constraints.giving_way(off, 0.0, 0.0, self._slack(group))
            slack = self._slack(_SPEED + i)
            inner = speeds[1:-1, i]
            if self.how.subdivisions > 1 and i not in self.problem.beyond_bounds():
                fine = self.basis.derivative.subdivided(self.how.subdivisions)
                inner = casadi.mtimes(casadi.DM(fine), speeds[:, i])[1:-1]
            extra = 0.0 if slack is None else slack
            constraints.between((inner - high * relative) / scale - extra, -np.inf, 0.0)
            constraints.between((inner - low * relative) / scale + extra, 0.0, np.inf)

    def _accelerations_and_jerks(self, constraints: Constraints) -> None:
        """Require bounds of the control points of accelerations and jerks, also at both ends."""
        c, t_M, *_ = self.symbols
        relative = t_M / self.problem.t_M
        basis, values = self.basis, c
        for order, (low, high), group in (
            (1, (None, None), 0),
            (2, (self.problem.a_LB, self.problem.a_UB), _ACCELERATION),
            (3, (self.problem.j_LB, self.problem.j_UB), _JERK),
        ):
            spans = casadi.repmat(casadi.DM(basis.speed_spans * self.problem.t_M), 1, 3)
            values, basis = (values[1:, :] - values[:-1, :]) / spans, basis.derivative
            if low is None and high is None:
                continue
            fine = casadi.DM(casadi.sparsify(casadi.DM(basis.subdivided(self.how.subdivisions))))
            points = casadi.mtimes(fine, values)
            for i in range(3):
                self._bounded(constraints, points[:, i], relative**order, (low, high), i, group)

    def _bounded(
        self,
        constraints: Constraints,
        points: casadi.MX,
        relative: casadi.MX,
        bounds: tuple[Three | None, Three | None],
        i: int,
        group: int,
    ) -> None:
        """Require the bounds that exist of control points of joint i, which are in the scale of t_M."""
        low, high = (None if bound is None else bound[i] for bound in bounds)
        scale = bound_width(low, high)
        slack = self._slack(group + i)
        extra = 0.0 if slack is None else slack
        if high is not None:
            constraints.between((points - high * relative) / scale - extra, -np.inf, 0.0)
        if low is not None:
            constraints.between((points - low * relative) / scale + extra, 0.0, np.inf)

    def _heights(self, constraints: Constraints) -> None:
        """Require the clearance from the ground at the collocation points."""
        problem, slack = self.problem, self._slack(_GROUND)
        above = heights(problem.machine).map(len(self.points[0]))(self.symbols[2]) - problem.ground_height
        extra = 0.0 if slack is None else slack
        constraints.between(casadi.vec(above) + extra, problem.ground_clearance, np.inf)

    def _slack(self, group: int) -> casadi.MX | None:
        return self.symbols[-1][group] if self.elastic else None


def bound_width(low: float | None, high: float | None) -> float:
    """Return the width between two bounds, or the size of the only one."""
    both = high - low if low is not None and high is not None else abs(high or low or 0.0)
    return max(both, 1e-3)


def _between(places: np.ndarray, load: Load) -> np.ndarray:
    """Return the places within a load, with its ends."""
    inside = places[(places > load.first + _APART) & (places < load.last - _APART)]
    return np.concatenate([[load.first], inside, [load.last]])


def stage(problem: MotionProblem, tie_break: float, payload: float) -> casadi.Function:
    """Return a function from q, q', q'' at one point to the forces in N and the cost's integrand in W2."""
    q, v, a = (casadi.SX.sym(name, 3) for name in "qva")
    parts = casadi.vertsplit(q), casadi.vertsplit(v), casadi.vertsplit(a)
    force = casadi.vertcat(*inverse_dynamics(problem.machine, *parts, payload))
    power = casadi.dot(v, force) ** 2 + tie_break * casadi.sumsqr(v * force)
    return casadi.Function("stage", [q, v, a], [force, power])


def least_cost(problem: MotionProblem, duration: float, strokes: Sequence[Sequence[float]] = ()) -> float:
    """Return the lower bound of the cost of motions of this duration in s, in W2 s: dE^2 / (2 t_M).

    All power goes into energy, and constant power has the least square. `strokes` are those at the way-points
    and at the end; by default, the guesses. A payload that changes brings or takes its own energy.
    """
    strokes, machine, loads, rest = (
        strokes or problem.guesses,
        problem.machine,
        problem.loads,
        (0.0, 0.0, 0.0),
    )
    start = energy(machine, problem.q_S, problem.v_S, problem.payload)
    gained = energy(machine, strokes[-1], problem.v_E, loads[-1].payload) - start
    here = dict(zip(problem.moments, strokes, strict=False))
    for before, load in pairwise(loads):
        q = here[load.first]
        gained -= energy(machine, q, rest, load.payload) - energy(machine, q, rest, before.payload)
    return gained**2 / (2.0 * duration)
