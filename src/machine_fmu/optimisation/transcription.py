"""The optimisation of a motion as a nonlinear programme: direct collocation with B-splines.

The unknowns are the coefficients c, the duration t_M, and q, q' and q'' at every collocation point. The
latter are "lifted": c and t_M determine them. As unknowns they allow one function to be mapped over all
points, and its exact second derivatives stay small and sparse.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi
import numpy as np

from .grid import SplineBasis, guess_unknowns, least_cost, lobatto, point_function, stage
from .obstacles import Separation
from .problem import Load, MotionProblem
from .surroundings import moving_points


class Constraints:
    """Expressions with their bounds."""

    def __init__(self) -> None:
        self._expressions: list[casadi.MX] = []
        self._low: list[np.ndarray] = []
        self._high: list[np.ndarray] = []

    def require_zero(self, expression: casadi.MX) -> None:
        """Require that all elements are zero."""
        self.require_between(expression, 0.0, 0.0)

    def require_between(self, expression: casadi.MX, low: Any, high: Any) -> None:
        """Require that all elements are between bounds: numbers, or one for each element."""
        column = casadi.vec(expression)
        self._expressions.append(column)
        for bounds, values in ((self._low, low), (self._high, high)):
            bounds.append(np.broadcast_to(np.asarray(values, dtype=float), column.shape[0]))

    def require_between_with_slack(self, expression: casadi.MX, low: float, high: float, slack: Any) -> None:
        """Require as `require_between`, but allow `slack` beyond the bounds; None for none."""
        if slack is None:
            self.require_between(expression, low, high)
        else:
            column = casadi.vec(expression)
            self.require_between(column - slack, -np.inf, high)
            self.require_between(column + slack, low, np.inf)

    @property
    def expression(self) -> casadi.MX:
        """Return all expressions as a column."""
        return casadi.vertcat(*self._expressions)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds of that column."""
        return np.concatenate(self._low), np.concatenate(self._high)


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


_MIN_DISTANCE = 1e-9
"""Smallest distance of two places, as a fraction of the duration."""


LONGEST = "the longest time t_M"
"""Name of the bound of the duration."""


def slack_names(problem: MotionProblem) -> tuple[str, ...]:
    """Return the bounds that an elastic programme relaxes.

    Those of strokes are not among them, as triangles may not close beyond them.
    """
    joints = problem.names
    return (
        *(f"the force bounds of the {joint}" for joint in joints),
        *(f"the speed bounds of the {joint}" for joint in joints),
        LONGEST,
        "the start speeds v_S",
        "the end speeds v_E",
        *(f"the acceleration bounds of the {joint}" for joint in joints),
        *(f"the jerk bounds of the {joint}" for joint in joints),
        "the clearance from the ground",
        *(f"the clearance from {obstacle.label}" for obstacle in problem.obstacles),
    )


@dataclass(frozen=True)
class Programme:
    """A nonlinear programme.

    Its unknowns are in this order: coefficients by joint, t_M, q, q', q'', coordinates that Newton's method
    would find, directions that separate lines of the machine from obstacles, slacks.
    """

    problem: MotionProblem
    how: Discretisation
    elastic: bool = False
    """Whether the groups of `slack_names` are relaxed; their slacks are minimised then."""
    grounded: bool = False
    """Whether the collocation points keep the clearance from the ground."""
    separations: tuple[Separation, ...] = ()
    """Lines of the machine that keep clear of obstacles at the collocation points."""

    @cached_property
    def basis(self) -> SplineBasis:
        """The spline's basis."""
        return self.how.basis

    @cached_property
    def parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Collocation points on [0, 1] and weights for each payload; a change of it is a point of both."""
        knots = self.basis.distinct_knots
        return [lobatto(_select_between(knots, load), self.how.points) for load in self.problem.loads]

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Collocation points on [0, 1], and their weights."""
        points, weights = zip(*self.parts, strict=True)
        return np.concatenate(points), np.concatenate(weights)

    @cached_property
    def slack_names(self) -> tuple[str, ...]:
        """Names of the slacks."""
        return slack_names(self.problem) if self.elastic else ()

    @property
    def joints(self) -> int:
        """Number of actuators."""
        return len(self.problem.names)

    @cached_property
    def moments(self) -> np.ndarray:
        """Where the tip is at its aims, on [0, 1]."""
        return np.array([moment for _, moment, _ in self.problem.aims])

    @cached_property
    def symbols(self) -> tuple[casadi.MX, ...]:
        """Coefficients, t_M, q, q', q'', coordinates, directions and slacks."""
        count, n = len(self.points[0]), self.joints
        lifted = [casadi.MX.sym(name, n, count) for name in ("q", "v", "a")]
        c, t_M = casadi.MX.sym("c", self.basis.size, n), casadi.MX.sym("t_M")
        x = casadi.MX.sym("x", len(self.problem.machine.unknowns), count + len(self.moments))
        directions = casadi.MX.sym("d", len(self.separations) * self.problem.machine.dimensions, count)
        return c, t_M, *lifted, x, directions, casadi.MX.sym("slack", len(self.slack_names))

    def built(self) -> tuple[dict[str, casadi.MX], tuple[np.ndarray, np.ndarray]]:
        """Return the programme for CasADi, and the bounds of its constraints."""
        _, t_M, q, v, a, x, _, slack = self.symbols
        forces, cost, errors = self._map_forces(q, v, a, x)
        constraints = Constraints()
        self._require_spline(constraints)
        self._require_strokes(constraints)
        self._require_speeds(constraints)
        self._require_accelerations_and_jerks(constraints)
        self._require_positions(constraints)
        if self.grounded:
            self._require_heights(constraints)
        self._require_separations(constraints)
        if x.shape[0]:
            constraints.require_zero(errors)
        bounds = zip(self.problem.names, self.problem.f_LB, self.problem.f_UB, strict=True)
        for i, (joint, low, high) in enumerate(bounds):
            scale, force_slack = max(high - low, 1.0), self._get_slack(f"the force bounds of the {joint}")
            constraints.require_between_with_slack(
                forces[i, :] / scale, low / scale, high / scale, force_slack
            )
        total = 0.5 * t_M * casadi.mtimes(cost, casadi.DM(self.points[1])) / self.cost_scale
        if self.elastic:
            # the cost decides between motions with equal slacks
            total = casadi.sum1(slack) + 1e-4 * total
            duration_slack = slack[self.slack_names.index(LONGEST)]
            constraints.require_between(t_M / self.problem.t_M - duration_slack, -np.inf, 1.0)
        unknowns = casadi.vertcat(*(casadi.vec(x) for x in self.symbols))
        return {"x": unknowns, "f": total, "g": constraints.expression}, constraints.bounds

    def _map_forces(
        self, q: casadi.MX, v: casadi.MX, a: casadi.MX, x: casadi.MX
    ) -> tuple[casadi.MX, casadi.MX, casadi.MX]:
        """Return forces in N, the cost's integrand in W2 and closing errors in m, each with its payload."""
        return self._map_points(lambda payload: stage(self.problem, self.how.tie_break, payload), q, v, a, x)

    def _map_points(self, function: Callable[[float], casadi.Function], *columns: casadi.MX) -> Any:
        """Return the values of a function at all collocation points, with the payload of each."""
        values_by_load, first = [], 0
        for load, (points, _) in zip(self.problem.loads, self.parts, strict=True):
            rows = slice(first, first + len(points))
            values_by_load.append(function(load.payload).map(len(points))(*(x[:, rows] for x in columns)))
            first = rows.stop
        return tuple(casadi.horzcat(*values) for values in zip(*values_by_load, strict=True))

    def _map_locations(self, names: Sequence[str]) -> casadi.MX:
        """Return points of the machine in m at all collocation points, one after the other."""
        _, _, q, _, _, x, *_ = self.symbols
        return self._map_points(lambda payload: point_function(self.problem.machine, names, payload), q, x)[0]

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of the unknowns. Coefficients are within strokes unless subdivided ones are."""
        problem = self.problem
        q_LB, q_UB = problem.machine.q_LB, problem.machine.q_UB
        lasts = (q_LB, q_UB) if problem.tip_E is not None else (problem.q_E, problem.q_E)
        # the subdivided control points are bounded instead, which are closer to the curve
        is_free = self.how.subdivisions > 1
        low = self._spread_over_coefficients(
            problem.q_S, [-np.inf] * self.joints if is_free else q_LB, lasts[0]
        )
        high = self._spread_over_coefficients(
            problem.q_S, [np.inf] * self.joints if is_free else q_UB, lasts[1]
        )
        unbounded = np.full(sum(x.numel() for x in self.symbols[2:7]), np.inf)
        longest = np.inf if self.elastic else problem.t_M
        slacks = len(self.slack_names)
        return (
            np.concatenate([low, [1e-3 * problem.t_M], -unbounded, np.zeros(slacks)]),
            np.concatenate([high, [longest], unbounded, np.full(slacks, np.inf)]),
        )

    def _spread_over_coefficients(
        self, first: Sequence[float], inner: Sequence[float], last: Sequence[float]
    ) -> list[float]:
        """Return values for all coefficients from those of each joint."""
        count = self.basis.size - 2
        return [
            x
            for first_value, inner_value, last_value in zip(first, inner, last, strict=True)
            for x in (first_value, *[inner_value] * count, last_value)
        ]

    def start(self, coefficients: np.ndarray) -> np.ndarray:
        """Return initial unknowns: a curve with these coefficients, one column per joint, of duration t_M."""
        duration, positions = self.problem.t_M, self.points[0]
        curve = [self.basis.at(positions, d) @ coefficients / duration**d for d in range(3)]
        aims = self.basis.at(self.moments) @ coefficients if len(self.moments) else curve[0][:0]
        payloads = [load.payload for load in self.problem.loads]
        masses = np.repeat(payloads, [len(points) for points, _ in self.parts])
        at_aims = [self.problem.payload_until(moment) for moment in self.moments]
        strokes = np.concatenate([curve[0], aims])
        poses = guess_unknowns(self.problem.machine, strokes, np.array([*masses, *at_aims]))
        directions = self._find_directions(curve[0], masses)
        values = (coefficients.T, [duration], *curve, poses, directions, np.ones(len(self.slack_names)))
        return np.concatenate([np.ravel(x) for x in values])

    def _find_directions(self, strokes: np.ndarray, payloads: np.ndarray) -> np.ndarray:
        """Return directions from obstacles to lines of the machine, one row for each row of strokes."""
        if not self.separations:
            return np.zeros((len(strokes), 0))
        points = self.problem.machine.points(strokes, payload=payloads)
        directions = []
        for separation in self.separations:
            obstacle, line = self.problem.obstacles[separation.obstacle], separation.line
            directions.append(obstacle.find_separating_directions(points[line.start], points[line.end]))
        return np.concatenate(directions, axis=1)

    def read_solution(self, unknowns: np.ndarray) -> tuple[np.ndarray, float]:
        """Return coefficients, one column per joint, and duration in s of a solution."""
        count = self.joints * self.basis.size
        return unknowns[:count].reshape(self.joints, -1).T, float(unknowns[count])

    @cached_property
    def cost_scale(self) -> float:
        """A typical cost in W2 s."""
        powers = zip(self.problem.f_UB, self.problem.v_UB, strict=True)
        # the least cost of a motion without a change of energy is 0, and cannot be the scale
        typical_power = 0.01 * max(max(abs(f * v) for f, v in powers), 1.0)
        return max(
            least_cost(self.problem, self.problem.t_M), 0.5 * self.problem.t_M * typical_power * typical_power
        )

    def _require_spline(self, constraints: Constraints) -> None:
        """Require that lifted unknowns equal the spline's values, in the scale of positions."""
        c, t_M, *lifted = self.symbols[:5]
        relative = t_M / self.problem.t_M
        for order, x in enumerate(lifted):
            rows = casadi.DM(casadi.sparsify(casadi.DM(self.basis.at(self.points[0], order)), 1e-14))
            scale = self.problem.t_M**order
            constraints.require_zero(x.T * relative**order - casadi.mtimes(rows, c) / scale)

    def _require_positions(self, constraints: Constraints) -> None:
        """Require positions of the tip at way-points and at the end, and rest where the payload changes.

        A machine with fewer actuators than coordinates gets the strokes that reach the position.
        """
        problem, count = self.problem, len(self.points[0])
        x = self.symbols[5]
        for i, (_, moment, position) in enumerate(problem.aims):
            row = casadi.DM(casadi.sparsify(casadi.DM(self.basis.at(np.array([moment]))), 1e-14))
            q = casadi.mtimes(row, self.symbols[0]).T
            locate = point_function(problem.machine, [problem.tip], problem.payload_until(moment))
            tip, errors = locate(q, x[:, count + i])
            # a tip on a curve cannot be at a rounded position exactly
            if self.joints < len(position):
                constraints.require_zero(q - casadi.DM(problem.guesses[i]))
            else:
                constraints.require_zero(tip - casadi.DM(position))
            if x.shape[0]:
                constraints.require_zero(errors)
        for load in problem.loads[1:]:
            row = casadi.DM(casadi.sparsify(casadi.DM(self.basis.at(np.array([load.first]), 1)), 1e-14))
            constraints.require_zero(casadi.mtimes(row, self.symbols[0]) / problem.t_M)

    def _require_strokes(self, constraints: Constraints) -> None:
        """Require bounds of the strokes' subdivided control points."""
        if self.how.subdivisions > 1:
            fine = casadi.mtimes(casadi.DM(self.basis.subdivided(self.how.subdivisions)), self.symbols[0])
            for i in range(self.joints):
                low, high = self.problem.machine.q_LB[i], self.problem.machine.q_UB[i]
                constraints.require_between((fine[1:-1, i] - low) / (high - low), 0.0, 1.0)

    def _require_speeds(self, constraints: Constraints) -> None:
        """Require the speeds at both ends, and bounds of the speed's control points between.

        A speed at an end may be beyond its bound only there, and up to the next control point.
        """
        c, t_M, *_ = self.symbols
        steps = (c[1:, :] - c[:-1, :]) / casadi.repmat(casadi.DM(self.basis.speed_spans), 1, self.joints)
        speeds = steps / self.problem.t_M  # speeds of a motion with the longest duration
        relative = t_M / self.problem.t_M
        for i, joint in enumerate(self.problem.names):
            low, high = self.problem.v_LB[i], self.problem.v_UB[i]
            scale = max(high - low, 1e-3)
            for row, ends, name in (
                (0, self.problem.v_S, "the start speeds v_S"),
                (-1, self.problem.v_E, "the end speeds v_E"),
            ):
                error = (speeds[row, i] - ends[i] * relative) / scale
                constraints.require_between_with_slack(error, 0.0, 0.0, self._get_slack(name))
            slack = self._get_slack(f"the speed bounds of the {joint}")
            inner = speeds[1:-1, i]
            if self.how.subdivisions > 1 and i not in self.problem.beyond_bounds():
                fine = self.basis.derivative.subdivided(self.how.subdivisions)
                inner = casadi.mtimes(casadi.DM(fine), speeds[:, i])[1:-1]
            extra = 0.0 if slack is None else slack
            constraints.require_between((inner - high * relative) / scale - extra, -np.inf, 0.0)
            constraints.require_between((inner - low * relative) / scale + extra, 0.0, np.inf)

    def _require_accelerations_and_jerks(self, constraints: Constraints) -> None:
        """Require bounds of the control points of accelerations and jerks, also at both ends."""
        c, t_M, *_ = self.symbols
        relative = t_M / self.problem.t_M
        basis, values = self.basis, c
        for order, (low, high), quantity in (
            (1, (None, None), ""),
            (2, (self.problem.a_LB, self.problem.a_UB), "acceleration"),
            (3, (self.problem.j_LB, self.problem.j_UB), "jerk"),
        ):
            spans = casadi.repmat(casadi.DM(basis.speed_spans * self.problem.t_M), 1, self.joints)
            values, basis = (values[1:, :] - values[:-1, :]) / spans, basis.derivative
            if low is None and high is None:
                continue
            fine = casadi.DM(casadi.sparsify(casadi.DM(basis.subdivided(self.how.subdivisions))))
            points = casadi.mtimes(fine, values)
            for i, joint in enumerate(self.problem.names):
                slack = self._get_slack(f"the {quantity} bounds of the {joint}")
                lower, upper = (None if bound is None else bound[i] for bound in (low, high))
                _require_bounds(constraints, points[:, i], relative**order, lower, upper, slack)

    def _require_heights(self, constraints: Constraints) -> None:
        """Require the clearance from the ground at the collocation points."""
        problem, slack = self.problem, self._get_slack("the clearance from the ground")
        n = problem.machine.dimensions
        points = self._map_locations(list(moving_points(problem.machine)))
        heights = points[n - 1 :: n, :] - problem.ground_height
        extra = 0.0 if slack is None else slack
        constraints.require_between(casadi.vec(heights) + extra, problem.ground_clearance, np.inf)

    def _require_separations(self, constraints: Constraints) -> None:
        """Require the clearances from obstacles at the collocation points."""
        count, n = len(self.points[0]), self.problem.machine.dimensions
        for i, separation in enumerate(self.separations):
            obstacle, line = self.problem.obstacles[separation.obstacle], separation.line
            points = self._map_locations([line.start, line.end])
            directions = self.symbols[6][n * i : n * (i + 1), :]
            distances, size = separation.function(obstacle).map(count)(
                points[:n, :], points[n:, :], directions
            )
            slack = self._get_slack(f"the clearance from {obstacle.label}")
            extra = 0.0 if slack is None else slack
            constraints.require_between(casadi.vec(distances) + extra, obstacle.clearance, np.inf)
            constraints.require_between(size, 1.0, 1.0)

    def _get_slack(self, name: str) -> casadi.MX | None:
        return self.symbols[-1][self.slack_names.index(name)] if self.elastic else None


def _require_bounds(
    constraints: Constraints,
    points: casadi.MX,
    relative: casadi.MX,
    low: float | None,
    high: float | None,
    slack: casadi.MX | None,
) -> None:
    """Require the bounds that exist of control points of a joint, which are in the scale of t_M."""
    scale = bound_width(low, high)
    extra = 0.0 if slack is None else slack
    if high is not None:
        constraints.require_between((points - high * relative) / scale - extra, -np.inf, 0.0)
    if low is not None:
        constraints.require_between((points - low * relative) / scale + extra, 0.0, np.inf)


def bound_width(low: float | None, high: float | None) -> float:
    """Return the width between two bounds, or the size of the only one."""
    width = high - low if low is not None and high is not None else abs(high or low or 0.0)
    return max(width, 1e-3)


def _select_between(knots: np.ndarray, load: Load) -> np.ndarray:
    """Return the places within a load, with its ends."""
    inner = knots[(knots > load.first + _MIN_DISTANCE) & (knots < load.last - _MIN_DISTANCE)]
    return np.concatenate([[load.first], inner, [load.last]])
