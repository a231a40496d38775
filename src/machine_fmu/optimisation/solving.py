"""Solve the optimisation with IPOPT, and find the bounds that prevent a solution."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi
import numpy as np

from ..spline import Spline, TrajectoryError
from .assessment import GROUND, Assessment, assessed, measure_clearances, nearest_lines
from .obstacles import Separation
from .problem import MotionProblem
from .transcription import LONGEST, Discretisation, Programme, slack_names

MAX_ITERATIONS = 300
"""Most iterations of IPOPT; problems with a solution need 20 to 60."""

_MAX_SEARCHES = 8
"""Most times that a motion is sought with further obstacles."""

_NEGLIGIBLE = 1e-6
"""Fraction of a bound that is negligible."""

_OPTIONS = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": MAX_ITERATIONS,
    # the default of 1e-8 would let motions exceed their bounds
    "ipopt.bound_relax_factor": 0.0,
}


class NoMotionError(TrajectoryError):
    """No motion satisfies all bounds; the message names the bounds that prevent it."""


@dataclass(frozen=True)
class Solution:
    """A motion that IPOPT found.

    `coefficients` has a column for each of the `joints`, in m; `duration` is in s, `cost` in W2 s with the
    tie-break.
    """

    joints: tuple[str, ...]

    coefficients: np.ndarray
    duration: float
    cost: float
    iterations: int
    wall_s: float
    cpu_s: float

    def then(self, later: "Solution") -> "Solution":
        """Return a later motion with the effort of both."""
        return replace(
            later,
            iterations=self.iterations + later.iterations,
            wall_s=self.wall_s + later.wall_s,
            cpu_s=self.cpu_s + later.cpu_s,
        )

    def spline(self, how: Discretisation) -> Spline:
        """Return the motion over time."""
        knots = (how.basis.knots * self.duration).tolist()
        columns = zip(self.joints, self.coefficients.T.tolist(), strict=True)
        return Spline(how.degree, knots, dict(columns))


def solved(
    problem: MotionProblem,
    how: Discretisation,
    start: np.ndarray | None = None,
    on_iteration: Callable[[], None] = lambda: None,
) -> Solution:
    """Return the motion of least cost near a start.

    The start is a straight line, or has the form of `Solution.coefficients`. `on_iteration` is called after
    every iteration; an exception there ends the search. Ground and obstacles become constraints only if the
    motion without them comes too close; otherwise that motion is the best one with them, too.

    Raises:
        NoMotionError: No motion is found.
    """
    start_coefficients = straight(problem, how) if start is None else start
    programme = Programme(problem, how)
    solution = _solve_programme(programme, start_coefficients, on_iteration)
    for _ in range(_MAX_SEARCHES):
        closer = _add_obstacles(programme, solution)
        if closer == programme:
            break
        programme = closer
        solution = solution.then(_solve_programme(programme, start_coefficients, on_iteration))
    return solution


def _add_obstacles(programme: Programme, solution: Solution) -> Programme:
    """Return the programme with constraints for what a motion comes too close to."""
    problem, spline = programme.problem, solution.spline(programme.how)
    if problem.ground_clearance is None and not problem.obstacles:
        return programme
    clearances = measure_clearances(spline, problem)
    is_low = any(not clearance.is_kept for clearance in clearances if clearance.obstacle == GROUND)
    separations = [Separation(line, i) for i, line in nearest_lines(spline, problem)]
    # earlier constraints stay, so that the search ends
    all_separations = dict.fromkeys((*programme.separations, *separations))
    return replace(programme, grounded=programme.grounded or is_low, separations=tuple(all_separations))


def _solve_programme(programme: Programme, start: np.ndarray, on_iteration: Callable[[], None]) -> Solution:
    times_before = time.perf_counter(), time.process_time()
    result = _run_ipopt(programme, start, on_iteration)
    if not result.is_solved:
        raise NoMotionError(_explain_failure(programme, start, on_iteration, result.status))
    coefficients, duration = programme.read_solution(result.unknowns)
    if duration > (1.0 - _NEGLIGIBLE) * programme.problem.t_M:
        duration = programme.problem.t_M  # an interior-point method only approaches it
    wall, cpu = time.perf_counter() - times_before[0], time.process_time() - times_before[1]
    cost = result.cost * programme.cost_scale
    return Solution(programme.problem.names, coefficients, duration, cost, result.iterations, wall, cpu)


def straight(problem: MotionProblem, how: Discretisation) -> np.ndarray:
    """Return the coefficients of the straight line from start to end, by way of the guesses of way-points."""
    start, end = np.array(problem.q_S), np.array(problem.guesses[-1])
    if not problem.via:
        return start + (end - start) * how.basis.means[:, None]
    moments, strokes = [0.0, *problem.moments, 1.0], np.array([problem.q_S, *problem.guesses])
    return np.column_stack([np.interp(how.basis.means, moments, column) for column in strokes.T])


def detour(problem: MotionProblem, how: Discretisation, seed: int) -> np.ndarray:
    """Return the coefficients of a random detour within the strokes for a seed."""
    low, high = np.array(problem.machine.q_LB), np.array(problem.machine.q_UB)
    line, draw = straight(problem, how), np.random.default_rng(seed)
    deviation = draw.normal(scale=0.1, size=line.shape) * (high - low)
    deviation *= np.sin(np.pi * how.basis.means)[:, None]
    return np.clip(line + deviation, low, high)


class _IterationCallback(casadi.Callback):
    """Calls a function after every iteration of IPOPT; an exception there ends it, and is stored."""

    def __init__(self, sizes: tuple[int, int], on_iteration: Callable[[], None]) -> None:
        casadi.Callback.__init__(self)
        self.sizes, self.on_iteration = sizes, on_iteration
        self.error: BaseException | None = None
        self.construct("on_iteration", {})

    def get_n_in(self) -> int:
        """Return the number of a solver's results."""
        return casadi.nlpsol_n_out()

    def get_n_out(self) -> int:
        """Return the number of outputs: whether to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Return the name of a result."""
        return casadi.nlpsol_out(i)

    def get_sparsity_in(self, i: int) -> casadi.Sparsity:
        """Return the size of a result."""
        unknowns, constraints = self.sizes
        sizes = {"f": 1, "x": unknowns, "lam_x": unknowns, "g": constraints, "lam_g": constraints}
        return casadi.Sparsity.dense(sizes.get(casadi.nlpsol_out(i), 0), 1)

    def eval(self, arguments: Sequence[casadi.DM]) -> list[int]:
        """Return 1 to end the search."""
        try:
            self.on_iteration()
        except BaseException as error:
            self.error = error
        return [int(self.error is not None)]


@dataclass(frozen=True)
class _IpoptResult:
    """How IPOPT ended."""

    unknowns: np.ndarray
    cost: float
    iterations: int
    status: str

    @property
    def is_solved(self) -> bool:
        """Whether it found a solution."""
        return self.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")


def _run_ipopt(programme: Programme, start: np.ndarray, on_iteration: Callable[[], None]) -> _IpoptResult:
    functions, (low_g, high_g) = programme.built()
    listener = _IterationCallback((functions["x"].shape[0], functions["g"].shape[0]), on_iteration)
    solver = casadi.nlpsol("motion", "ipopt", functions, {**_OPTIONS, "iteration_callback": listener})
    low, high = programme.bounds()
    result = solver(x0=programme.start(start), lbx=low, ubx=high, lbg=low_g, ubg=high_g)
    if listener.error is not None:
        raise listener.error
    stats = solver.stats()
    unknowns, cost = result["x"].full().ravel(), float(result["f"])
    return _IpoptResult(unknowns, cost, int(stats["iter_count"]), str(stats["return_status"]))


def _explain_failure(
    programme: Programme, start: np.ndarray, on_iteration: Callable[[], None], status: str
) -> str:
    """Return a message with the bounds that prevent a solution."""
    # with slacks, whose smallest sum shows the bounds that prevent a motion
    result = _run_ipopt(replace(programme, elastic=True), start, on_iteration)
    if not result.is_solved:
        return f"no motion was found: IPOPT ended with {status}, and with {result.status} for relaxed bounds."
    names = slack_names(programme.problem)
    slacks = dict(zip(names, result.unknowns[-len(names) :], strict=True))
    relaxed = sorted((x, name) for name, x in slacks.items() if x > _NEGLIGIBLE)
    if not relaxed:
        return f"no motion was found: IPOPT ended with {status}, although no bound prevents a motion."
    relaxations = " and ".join(f"{name} by {_format_relaxation(x, name)}" for x, name in reversed(relaxed))
    return f"no motion keeps all bounds; the smallest relaxation that would allow one: {relaxations}."


def _format_relaxation(x: float, name: str) -> str:
    if "clearance" in name:
        return f"{x:.2g} m"
    width = "their width" if "bounds" in name else "it" if name == LONGEST else "the speed bounds' width"
    return f"{100.0 * x:.2g} % of {width}"


_MAX_REPETITIONS = 6
"""Largest number of times that bounds are narrowed; once is usually enough."""

_NARROWING_FACTOR = 1.5
"""Factor by which bounds are narrowed more than forces exceeded them."""

_MIN_RISE = 1e-4
"""Smallest height in m by which a clearance is raised."""


def narrowed(
    solution: Solution, problem: MotionProblem, how: Discretisation, on_iteration: Callable[[], None]
) -> tuple[Solution, Assessment]:
    """Find a motion near a given one that keeps its bounds on the dense grid, and return it with its figures.

    Strokes and their derivatives keep their bounds everywhere, forces and distances only at the collocation
    points. If these exceed them between, the optimisation is repeated with bounds that are narrower by the
    excess.
    """
    figures, narrow_problem = assessed(solution.spline(how), problem, how.tie_break), problem
    for _ in range(_MAX_REPETITIONS):
        if figures.within_bounds:
            break
        narrow_problem = _narrow(narrow_problem, figures)
        try:
            repeated = solved(narrow_problem, how, solution.coefficients, on_iteration)
        # the motion before stays, and its figures report what it exceeds
        except NoMotionError:
            break
        solution = solution.then(repeated)
        figures = assessed(solution.spline(how), problem, how.tie_break)
    return solution, figures


def _narrow(problem: MotionProblem, figures: Assessment) -> MotionProblem:
    bounds = zip(problem.f_LB, problem.f_UB, figures.peaks, strict=True)
    reductions = [_NARROWING_FACTOR * peak.excess * (high - low) for low, high, peak in bounds]
    low, high = (
        tuple(x + sign * d for x, d in zip(values, reductions, strict=True))
        for sign, values in ((1.0, problem.f_LB), (-1.0, problem.f_UB))
    )
    rises = {
        clearance.obstacle: _NARROWING_FACTOR * clearance.shortfall + _MIN_RISE
        for clearance in figures.clearances
        if not clearance.is_kept
    }
    height = problem.ground_clearance
    if height is not None:
        height += rises.get(GROUND, 0.0)
    obstacles = tuple(
        replace(obstacle, clearance=obstacle.clearance + rises.get(obstacle.label, 0.0))
        for obstacle in problem.obstacles
    )
    return replace(problem, f_LB=low, f_UB=high, ground_clearance=height, obstacles=obstacles)
