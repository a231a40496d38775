"""Measure what finds the manipulator's motion: python -m benchmarks.trajectory.

IPOPT with what our optimisation gives it, and SciPy's SLSQP with the same spline, the same points, the same
bounds and exact first derivatives. Times are of this machine at this moment.
"""

import time
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from scipy.optimize import minimize

from emla_cosim.analyses.trajectory.problem import paper_problem
from machine_fmu.optimisation.assessment import assessed
from machine_fmu.optimisation.problem import EndSpeed, MotionProblem
from machine_fmu.optimisation.solving import Solution, solved, straight
from machine_fmu.optimisation.transcription import Discretisation, Programme, stage

MOST_ITERATIONS = 300


@dataclass(frozen=True)
class _Reduced:
    """The programme without what can be computed: coefficients between the ends, and t_M by its longest."""

    programme: Programme
    cost: casadi.Function
    equal: casadi.Function
    above: casadi.Function
    """At least 0 where all bounds hold."""

    @classmethod
    def of(cls, programme: Programme) -> "_Reduced":
        """Cost and constraints, each with its first derivatives."""
        problem, basis = programme.problem, programme.basis
        x = casadi.MX.sym("x", 3 * (basis.size - 2) + 1)
        inner = casadi.reshape(x[:-1], basis.size - 2, 3)
        c = casadi.vertcat(casadi.DM(problem.q_S).T, inner, casadi.DM(problem.q_E).T)
        t_M = problem.t_M * x[-1]
        points, weights = programme.points
        q, v, a = (casadi.mtimes(casadi.DM(basis.at(points, d)), c).T / t_M**d for d in range(3))
        at_once = stage(problem, programme.how.tie_break, problem.payload).map(len(points))
        forces, power, _ = at_once(q, v, a, casadi.DM(0, len(points)))
        cost = 0.5 * t_M * casadi.mtimes(power, casadi.DM(weights)) / programme.cost_scale
        spans = casadi.repmat(casadi.DM(basis.speed_spans), 1, 3)
        speeds = ((c[1:, :] - c[:-1, :]) / spans / t_M).T
        ends = casadi.vertcat(speeds[:, 0] - problem.v_S, speeds[:, -1] - problem.v_E)
        bounded = [(forces, problem.f_LB, problem.f_UB), (speeds[:, 1:-1], problem.v_LB, problem.v_UB)]
        above = casadi.vertcat(*(_distances(values, low, high) for values, low, high in bounded))
        return cls(programme, *(_with_slopes(x, e) for e in (cost, ends, above)))

    def solve(self) -> tuple[Solution, str]:
        """What SLSQP finds from the straight line, and what it says."""
        problem, how = self.programme.problem, self.programme.how
        start = np.concatenate([straight(problem, how)[1:-1].T.ravel(), [1.0]])
        low, high = (np.repeat(x, len(start) // 3) for x in (problem.machine.q_LB, problem.machine.q_UB))
        began = time.perf_counter(), time.process_time()
        solution = minimize(
            lambda x: float(self.cost(x)[0]),
            start,
            jac=lambda x: self.cost(x)[1].full().ravel(),
            method="SLSQP",
            bounds=[*zip(low, high, strict=True), (1e-3, 1.0)],
            constraints=[_constraint("eq", self.equal), _constraint("ineq", self.above)],
            options={"maxiter": MOST_ITERATIONS, "ftol": 1e-8},
        )
        inner = solution.x[:-1].reshape(3, -1).T
        c = np.vstack([problem.q_S, inner, problem.q_E])
        times = time.perf_counter() - began[0], time.process_time() - began[1]
        cost = float(solution.fun) * self.programme.cost_scale
        return Solution(problem.names, c, problem.t_M * solution.x[-1], cost, int(solution.nit), *times), str(
            solution.message
        )


def main() -> None:
    """Measure and print."""
    problem, how = paper_problem().read_as(EndSpeed.CLIP), Discretisation()
    print(_line("IPOPT", solved(problem, how), problem, how))
    reduced, message = _Reduced.of(Programme(problem, how)).solve()
    print(_line("SLSQP", reduced, problem, how), f"({message})")


def _line(name: str, result: Solution, problem: MotionProblem, how: Discretisation) -> str:
    figures = assessed(result.spline(how), problem, how.tie_break)
    worst = max(peak.excess for peak in figures.peaks)
    return (
        f"{name}: cost {result.cost:.0f} W2 s, t_M {result.duration:.2f} s, {result.iterations} iterations, "
        f"{result.wall_s:.1f} s ({result.cpu_s:.1f} s CPU), beyond bounds by {worst:.1e} of their width"
    )


def _distances(values: casadi.MX, low: Any, high: Any) -> casadi.MX:
    width = casadi.DM(high) - casadi.DM(low)
    part = (values - casadi.repmat(casadi.DM(low), 1, values.shape[1])) / casadi.repmat(
        width, 1, values.shape[1]
    )
    return casadi.vertcat(casadi.vec(part), casadi.vec(1.0 - part))


def _with_slopes(x: casadi.MX, expression: casadi.MX) -> casadi.Function:
    return casadi.Function("f", [x], [expression, casadi.jacobian(expression, x)])


def _constraint(kind: str, function: casadi.Function) -> dict[str, Any]:
    return {
        "type": kind,
        "fun": lambda x: function(x)[0].full().ravel(),
        "jac": lambda x: function(x)[1].full(),
    }


if __name__ == "__main__":
    main()
