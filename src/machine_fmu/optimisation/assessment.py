"""Assess a motion on a dense grid: cost, work, and peaks against their limits."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..spline import Spline
from .grid import least_cost, lobatto
from .problem import MotionProblem, Numbers
from .surroundings import Approach, Axis, Points, base_approach, ground_approach
from .transcription import bound_width

Bound = TypeVar("Bound", bound=float | None)

_POINTS = 101
"""Number of grid points in each span between knots."""

GROUND, BODY = "ground", "body"
"""Names of ground and base as obstacles."""

_ROUNDING = 1e-6
"""Fraction of a bound that counts as rounding."""


@dataclass(frozen=True)
class Course:
    """A motion over time (s): strokes, their derivatives and forces (m, N), one column for each joint.

    `v`, `a` and `j` are speeds, accelerations and jerks; `payload` is in kg.
    """

    times: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    force: np.ndarray
    j: np.ndarray
    payload: np.ndarray


@dataclass(frozen=True)
class Peak:
    """The peak values of a joint over the motion, each with the bound on its side, if there is one.

    `force` in N, `speed` in m/s, `acceleration` in m/s2 and `jerk` in m/s3 have their sign. `excess` is the
    largest distance of the motion beyond a bound, as a fraction of the width between both bounds; 0 if the
    motion keeps them.
    """

    joint: str
    force: float
    force_bound: float
    speed: float
    speed_bound: float
    acceleration: float
    acceleration_bound: float | None
    jerk: float
    jerk_bound: float | None
    lowest: float
    highest: float
    excess: float


@dataclass(frozen=True)
class Clearance:
    """The smallest distance from an obstacle, and the one that is required in m.

    `obstacle` is GROUND, BODY, or what messages call another one.
    """

    obstacle: str
    required: float
    smallest: Approach

    @property
    def shortfall(self) -> float:
        """Return by how much the distance is too small in m; 0 if it is not."""
        return max(self.required - self.smallest.distance, 0.0)

    @property
    def is_kept(self) -> bool:
        """Whether the distance is large enough, except for rounding of 1 µm."""
        return self.shortfall <= _ROUNDING


@dataclass(frozen=True)
class Swing:
    """How far accelerations alone take a passive coordinate from where it hangs, in `unit`: rad or m.

    The optimisation neglects this, and the swinging that follows.
    """

    name: str
    deflection: float
    unit: str


@dataclass(frozen=True)
class Assessment:
    """A motion's figures: costs in W2 s, work in J, duration in s.

    `cost` is J of (14) as printed, `least_cost` a lower bound for motions of this duration. `tie_break` is
    the term of the joints' own powers in the objective. `gross_work` is the sum of the work that joints give
    and take, `net_work` the change of the manipulator's energy.
    """

    duration: float
    cost: float
    least_cost: float
    tie_break: float
    gross_work: float
    net_work: float
    peaks: tuple[Peak, ...]
    clearances: tuple[Clearance, ...]

    @property
    def within_bounds(self) -> bool:
        """Whether all bounds are kept, except for rounding."""
        is_clear = all(clearance.is_kept for clearance in self.clearances)
        return is_clear and all(peak.excess <= _ROUNDING for peak in self.peaks)


def course(spline: Spline, problem: MotionProblem, times: np.ndarray) -> Course:
    """Return the motion along a spline at times in s; where the payload changes, with the later one."""
    parts = (times - spline.start) / (spline.end - spline.start)
    load_numbers = np.searchsorted([load.first for load in problem.loads[1:]], parts, side="right")
    return _evaluate_course(spline, problem, times, load_numbers)


def _evaluate_course(
    spline: Spline, problem: MotionProblem, times: np.ndarray, load_numbers: np.ndarray
) -> Course:
    """Return the motion along a spline at times in s, each with one of the problem's loads."""
    q, v, a, j = (spline.evaluated(times, d) for d in range(4))
    payload = np.array([load.payload for load in problem.loads])[load_numbers]
    return Course(times, q, v, a, problem.machine.forces(q, v, a, payload), j, payload)


def _build_grid(spline: Spline, problem: MotionProblem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times of a dense grid in s, their weights, and the load of each; a change has both loads."""
    knots, duration = np.unique(spline.knots), spline.end - spline.start
    grids = []
    for i, load in enumerate(problem.loads):
        first, last = (spline.start + x * duration for x in (load.first, load.last))
        inner = knots[(knots > first + _ROUNDING * duration) & (knots < last - _ROUNDING * duration)]
        times, weights = lobatto(np.concatenate([[first], inner, [last]]), _POINTS)
        # forces jump where the payload changes: that time belongs to both loads
        grids.append((times, weights, np.full(len(times), i)))
    times, weights, load_numbers = zip(*grids, strict=True)
    return np.concatenate(times), np.concatenate(weights), np.concatenate(load_numbers)


def measure_clearances(spline: Spline, problem: MotionProblem) -> tuple[Clearance, ...]:
    """Return the smallest distances of a motion from all that limits it: ground, base and obstacles."""
    machine, clearances = problem.machine, list[Clearance]()
    if problem.ground_clearance is None and problem.body_clearance is None and not problem.obstacles:
        return ()
    times, points = _locate_points(spline, problem)
    if problem.ground_clearance is not None:
        approach = ground_approach(machine, problem.ground_height, times, points)
        clearances.append(Clearance(GROUND, problem.ground_clearance, approach))
    if problem.body_clearance is not None:
        base = base_approach(machine, times, points)
        clearances += [] if base is None else [Clearance(BODY, problem.body_clearance, base)]
    for obstacle in problem.obstacles:
        approach = obstacle.approach(machine, times, points)
        clearances.append(Clearance(obstacle.label, obstacle.clearance, approach))
    return tuple(clearances)


def nearest_lines(spline: Spline, problem: MotionProblem) -> list[tuple[int, Axis]]:
    """Return all lines of the machine that come too close to an obstacle, with the obstacle's number."""
    if not problem.obstacles:
        return []
    times, points = _locate_points(spline, problem)
    return [
        (i, line)
        for i, obstacle in enumerate(problem.obstacles)
        for line, approach in obstacle.approaches(problem.machine, times, points)
        if approach.distance < obstacle.clearance - _ROUNDING
    ]


def _locate_points(spline: Spline, problem: MotionProblem) -> tuple[np.ndarray, Points]:
    """Return times of a dense grid in s, and all points of the machine there."""
    times, _, load_numbers = _build_grid(spline, problem)
    payloads = np.array([load.payload for load in problem.loads])[load_numbers]
    return times, problem.machine.points(spline.evaluated(times), payload=payloads)


def find_swings(spline: Spline, problem: MotionProblem) -> list[Swing]:
    """Return the largest deflection by accelerations of each passive coordinate."""
    times, _, load_numbers = _build_grid(spline, problem)
    motion = _evaluate_course(spline, problem, times, load_numbers)
    swings = problem.machine.swing(motion.q, motion.v, motion.a, motion.payload)
    largest = np.abs(swings).max(axis=0, initial=0.0).tolist()
    frames = problem.machine.passive_frames
    return [
        Swing(frame.name, x, "m" if frame.slides else "rad") for frame, x in zip(frames, largest, strict=True)
    ]


def assessed(spline: Spline, problem: MotionProblem, tie_break: float) -> Assessment:
    """Return the figures of the motion along a spline."""
    times, weights, load_numbers = _build_grid(spline, problem)
    motion = _evaluate_course(spline, problem, times, load_numbers)
    power = motion.v * motion.force
    duration = spline.end - spline.start
    return Assessment(
        duration,
        0.5 * float(weights @ power.sum(axis=1) ** 2),
        least_cost(problem, duration, _evaluate_aims(spline, problem)),
        0.5 * tie_break * float(weights @ (power**2).sum(axis=1)),
        float(weights @ np.abs(power).sum(axis=1)),
        float(weights @ power.sum(axis=1)),
        tuple(
            _find_peak(motion, problem, i, spline.knots[-spline.degree - 2])
            for i in range(len(problem.names))
        ),
        measure_clearances(spline, problem),
    )


def _evaluate_aims(spline: Spline, problem: MotionProblem) -> list[Numbers]:
    """Return the strokes in m at way-points and at the end."""
    duration = spline.end - spline.start
    times = [spline.start + x * duration for x in (*problem.moments, 1.0)]
    strokes = [tuple(row) for row in spline.evaluated(times).tolist()]
    return strokes if problem.tip_E is not None else [*strokes[:-1], problem.q_E]


def _find_peak(motion: Course, problem: MotionProblem, i: int, last: float) -> Peak:
    """Return the peaks of joint i; if its v_E may exceed the bounds, so may its speed after `last` s."""
    speeds = motion.v[:, i]
    if i in problem.beyond_bounds():
        speeds = speeds[motion.times <= last]
    force, force_bound = _find_largest(motion.force[:, i], problem.f_LB[i], problem.f_UB[i])
    speed, speed_bound = _find_largest(motion.v[:, i], problem.v_LB[i], problem.v_UB[i])
    a_LB, a_UB = (_select_bound(bounds, i) for bounds in (problem.a_LB, problem.a_UB))
    j_LB, j_UB = (_select_bound(bounds, i) for bounds in (problem.j_LB, problem.j_UB))
    q_LB, q_UB = problem.machine.q_LB[i], problem.machine.q_UB[i]
    excess = max(
        _compute_excess(motion.force[:, i], problem.f_LB[i], problem.f_UB[i]),
        _compute_excess(speeds, problem.v_LB[i], problem.v_UB[i]),
        _compute_excess(motion.a[:, i], a_LB, a_UB),
        _compute_excess(motion.j[:, i], j_LB, j_UB),
        _compute_excess(motion.q[:, i], q_LB, q_UB),
    )
    lowest, highest = float(motion.q[:, i].min()), float(motion.q[:, i].max())
    higher = (*_find_largest(motion.a[:, i], a_LB, a_UB), *_find_largest(motion.j[:, i], j_LB, j_UB))
    joint = problem.names[i]
    return Peak(joint, force, force_bound, speed, speed_bound, *higher, lowest, highest, excess)


def _select_bound(bounds: Numbers | None, i: int) -> float | None:
    return None if bounds is None else bounds[i]


def _find_largest(values: np.ndarray, low: Bound, high: Bound) -> tuple[float, Bound]:
    """Return the largest value, and the bound on its side."""
    value = float(values[np.argmax(np.abs(values))])
    return value, high if value > 0.0 else low


def _compute_excess(values: np.ndarray, low: float | None, high: float | None) -> float:
    over = 0.0 if high is None else float(values.max()) - high
    under = 0.0 if low is None else low - float(values.min())
    return max(over, under, 0.0) / bound_width(low, high)
