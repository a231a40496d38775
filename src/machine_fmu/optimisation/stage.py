"""Functions of a machine at single points of a motion, for the programme that optimises it."""

from collections.abc import Sequence
from itertools import pairwise

import casadi
import numpy as np

from ..model import MachineModel
from .problem import MotionProblem, Numbers


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
