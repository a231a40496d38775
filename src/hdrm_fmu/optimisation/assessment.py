"""What a motion is like: cost, work, peaks against their limits, on a dense grid."""

from dataclasses import dataclass

import numpy as np

from ..spline import Spline
from ..trajectory import JOINTS
from .grid import lobatto
from .problem import MotionProblem
from .transcription import least_cost, stage

_POINTS = 101
"""In each span between knots."""

_ROUNDING = 1e-6
"""Part of a bound that a motion may be beyond it by rounding."""


@dataclass(frozen=True)
class Course:
    """A motion over time (s): strokes, speeds, accelerations and forces (m, N), one column for each joint."""

    times: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    force: np.ndarray


@dataclass(frozen=True)
class Peak:
    """The largest values of a joint over the motion, force and speed each with the bound on its side.

    `force` in N and `speed` in m/s have the sign that the joint had there; `excess` is how far
    the motion is beyond any of its bounds at most, as a part of the width between both; 0 for none.
    """

    joint: str
    force: float
    force_bound: float
    speed: float
    speed_bound: float
    lowest: float
    highest: float
    excess: float


@dataclass(frozen=True)
class Assessment:
    """A motion's figures: costs in W2 s, work in J, duration in s.

    `cost` is J of (14) as printed, `least_cost` what no motion of this duration can go below, `tie_break`
    what the joints' own powers add to what was minimised. `gross_work` is what the joints give and take,
    each by itself, `net_work` what remains: the change of the manipulator's energy.
    """

    duration: float
    cost: float
    least_cost: float
    tie_break: float
    gross_work: float
    net_work: float
    peaks: tuple[Peak, ...]

    @property
    def within_bounds(self) -> bool:
        """Whether no bound is left, but for rounding."""
        return all(peak.excess <= _ROUNDING for peak in self.peaks)


def course(spline: Spline, problem: MotionProblem, times: np.ndarray) -> Course:
    """The motion along a spline at times in s."""
    q, v, a = (spline.evaluated(times, d) for d in range(3))
    forces, _ = stage(problem, 0.0).map(len(times))(q.T, v.T, a.T)
    return Course(times, q, v, a, forces.full().T)


def assessed(spline: Spline, problem: MotionProblem, tie_break: float) -> Assessment:
    """The figures of the motion along a spline."""
    times, weights = lobatto(np.unique(spline.knots), _POINTS)
    seen = course(spline, problem, times)
    power = seen.v * seen.force
    duration = spline.end - spline.start
    return Assessment(
        duration,
        0.5 * float(weights @ power.sum(axis=1) ** 2),
        least_cost(problem, duration),
        0.5 * tie_break * float(weights @ (power**2).sum(axis=1)),
        float(weights @ np.abs(power).sum(axis=1)),
        float(weights @ power.sum(axis=1)),
        tuple(_peak(seen, problem, i, spline.knots[-spline.degree - 2]) for i in range(3)),
    )


def _peak(seen: Course, problem: MotionProblem, i: int, last: float) -> Peak:
    """What joint i comes to; where its v_E is exempt of the bounds, so is its approach after `last` s."""
    speeds = seen.v[:, i]
    if i in problem.beyond_bounds():
        speeds = speeds[seen.times <= last]
    force, force_bound = _largest(seen.force[:, i], problem.f_LB[i], problem.f_UB[i])
    speed, speed_bound = _largest(seen.v[:, i], problem.v_LB[i], problem.v_UB[i])
    q_LB, q_UB = problem.machine.q_LB[i], problem.machine.q_UB[i]
    excess = max(
        _excess(seen.force[:, i], problem.f_LB[i], problem.f_UB[i]),
        _excess(speeds, problem.v_LB[i], problem.v_UB[i]),
        _excess(seen.q[:, i], q_LB, q_UB),
    )
    lowest, highest = float(seen.q[:, i].min()), float(seen.q[:, i].max())
    return Peak(JOINTS[i], force, force_bound, speed, speed_bound, lowest, highest, excess)


def _largest(values: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """The largest value, and the bound on its side."""
    value = float(values[np.argmax(np.abs(values))])
    return value, high if value > 0.0 else low


def _excess(values: np.ndarray, low: float, high: float) -> float:
    beyond = max(float(values.max()) - high, low - float(values.min()), 0.0)
    return beyond / max(high - low, 1e-9)
