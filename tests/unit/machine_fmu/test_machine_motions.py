"""Motions of least cost of machines with links, loops and passive joints, in the plane and in space."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from emla_cosim.analyses.trajectory.problem import load_problem
from machine_fmu.model import MachineModel
from machine_fmu.optimisation.assessment import assessed, course
from machine_fmu.optimisation.contradictions import find_contradictions
from machine_fmu.optimisation.problem import MotionProblem
from machine_fmu.optimisation.solving import NoMotionError, Solution, solved
from machine_fmu.optimisation.transcription import Discretisation
from tests.support.tiers import mostly_slow

COARSE = Discretisation(knots=9, points=5)
TASKS: dict[str, dict[str, Any]] = {
    "crane": {"q_E": [0.4, 0.4, 0.6], "t_M": 12.0},
    "lift_table": {"q_E": 0.2, "t_M": 8.0},
    "excavator": {"q_E": [0.2, 0.35, 0.1], "t_M": 8.0},
}
MACHINES = list(TASKS)


def task(name: str, **changes: Any) -> MotionProblem:
    problem = load_problem({"machine": name, **TASKS[name], **changes})
    assert find_contradictions(problem) == []
    return problem


@cache
def best(name: str) -> tuple[MotionProblem, Solution]:
    problem = task(name)
    return problem, solved(problem, COARSE)


def fresh(problem: MotionProblem) -> MachineModel:
    """The machine, without what the optimisation stored in its model."""
    return MachineModel(problem.machine.machine)


def quintic(problem: MotionProblem, count: int = 2001) -> float:
    """The cost of the move of all strokes together from rest to rest."""
    start, way = np.array(problem.q_S), np.array(problem.q_E) - problem.q_S
    x = np.linspace(0.0, 1.0, count)
    shares = (
        10 * x**3 - 15 * x**4 + 6 * x**5,
        (30 * x**2 - 60 * x**3 + 30 * x**4) / problem.t_M,
        (60 * x - 180 * x**2 + 120 * x**3) / problem.t_M**2,
    )
    q, v, a = (share[:, None] * way for share in shares)
    power = v * fresh(problem).forces(start + q, v, a)
    rates = power.sum(axis=1) ** 2 + COARSE.tie_break * (power**2).sum(axis=1)
    return 0.5 * float(np.trapezoid(rates, x * problem.t_M))


@pytest.mark.parametrize("name", MACHINES)
def test_bounds_hold_and_forces_match_the_machine(name: str) -> None:
    problem, solution = best(name)
    spline = solution.spline(COARSE)
    assert spline.joints == problem.machine.names
    times = np.linspace(spline.start, spline.end, 301)
    q, v, a = (spline.evaluated(times, order) for order in range(3))
    force = fresh(problem).forces(q, v, a)
    assert course(spline, problem, times).force == pytest.approx(force, rel=1e-9, abs=1e-6)
    for values, low, high in (
        (q, problem.machine.q_LB, problem.machine.q_UB),
        (v, problem.v_LB, problem.v_UB),
        (force, problem.f_LB, problem.f_UB),
    ):
        assert np.all(values >= np.array(low) - 1e-6 * np.abs(low))
        assert np.all(values <= np.array(high) + 1e-6 * np.abs(high))
    assert q[[0, -1]] == pytest.approx(np.array([problem.q_S, problem.q_E]), abs=1e-9)
    assert assessed(spline, problem, COARSE.tie_break).within_bounds


@pytest.mark.parametrize("name", MACHINES)
def test_no_straight_quintic_costs_less(name: str) -> None:
    problem, solution = best(name)
    figures = assessed(solution.spline(COARSE), problem, COARSE.tie_break)
    assert figures.least_cost <= figures.cost
    assert figures.cost + figures.tie_break == pytest.approx(solution.cost, rel=1e-3)
    assert figures.net_work == pytest.approx(gained(problem), rel=1e-6)
    assert solution.cost < 0.8 * quintic(problem)


def gained(problem: MotionProblem) -> float:
    q, rest = np.array([problem.q_S, problem.q_E]), np.zeros((2, len(problem.names)))
    start, end = fresh(problem).energy(q, rest)
    return float(end - start)


@pytest.mark.parametrize(
    ("name", "via", "at"),
    mostly_slow(
        [("crane", (4.3, 2.9), 0.4), ("excavator", (1.9, -0.5), 0.5), ("lift_table", None, 0.5)],
        [("excavator", (1.9, -0.5), 0.5), ("lift_table", None, 0.5)],
    ),
)
def test_tip_passes_its_way_point(name: str, via: tuple[float, float] | None, at: float) -> None:
    """The table has one actuator, so its way-point must be on the path of the tip."""
    position = via or fresh(task(name)).tip(np.array([[0.123]]))[0].tolist()
    problem = task(name, via=[{"tip": position, "at": at}])
    spline = solved(problem, COARSE).spline(COARSE)
    (tip,) = fresh(problem).tip(spline.evaluated([at * spline.end]))
    assert tip == pytest.approx(np.array(position), abs=1e-6)


OBSTACLES = [
    ("crane", "hook.load", {"radius": 0.1, "centre": (0.0, -0.1)}),
    ("excavator", "bucket.load", {"low": (-0.1, -0.4), "high": (0.1, -0.2)}),
]


@pytest.mark.parametrize(("name", "point", "form"), mostly_slow(OBSTACLES, OBSTACLES[1:]))
def test_obstacle_is_avoided(name: str, point: str, form: dict[str, Any]) -> None:
    free, solution = best(name)
    spline = solution.spline(COARSE)
    middle = free.machine.points(spline.evaluated([0.5 * spline.end]))[point][0]
    shape = {key: x if key == "radius" else (middle + x).tolist() for key, x in form.items()}
    problem = task(name, obstacles=[{"name": "post", "clearance": 0.1, **shape}])
    (before,) = assessed(spline, problem, 0.0).clearances
    assert before.obstacle == "the obstacle 'post'" and before.smallest.distance < 0.05
    around = solved(problem, COARSE)
    spline = around.spline(COARSE)
    at = fresh(problem).points(spline.evaluated(np.linspace(spline.start, spline.end, 500)))
    if "radius" in shape:
        distance = np.linalg.norm(at[point] - shape["centre"], axis=1) - shape["radius"]
    else:
        distance = np.linalg.norm(at[point] - np.clip(at[point], shape["low"], shape["high"]), axis=1)
    assert distance.min() >= 0.095  # collocation points keep 0.1
    assert around.cost >= solution.cost


def test_obstacle_on_the_only_way_is_named() -> None:
    low, high = fresh(task("lift_table")).tip(np.array([[0.02], [0.2]]))
    middle = (0.5 * (low + high)).tolist()
    problem = task(
        "lift_table", obstacles=[{"name": "lamp", "centre": middle, "radius": 0.03, "clearance": 0.05}]
    )
    with pytest.raises(NoMotionError, match="the clearance from the obstacle 'lamp' by"):
        solved(problem, COARSE)


@pytest.mark.slow
def test_bounds_in_the_way_have_the_names_of_the_actuators() -> None:
    problem = task("crane", t_M=1.6, a_LB=[-0.5] * 3, a_UB=[0.5] * 3)
    with pytest.raises(NoMotionError, match="the speed bounds of the telescope by"):
        solved(problem, COARSE)


@pytest.mark.slow
def test_platform_moves_in_space_around_a_box() -> None:
    q_E = [0.45, 0.4, 0.42, 0.5, 0.43, 0.47]
    free = load_problem({"machine": "stewart", "q_E": q_E, "t_M": 6.0})
    how = Discretisation(knots=6, points=4)
    spline = solved(free, how).spline(how)
    middle = free.machine.tip(spline.evaluated([0.5 * spline.end]))[0]
    low, high = (np.add(middle, shift).tolist() for shift in ((-0.02, -0.5, -0.02), (0.02, 0.5, 0.02)))
    box = {"name": "beam", "low": low, "high": high, "clearance": 0.01}
    problem = load_problem({"machine": "stewart", "q_E": q_E, "t_M": 6.0, "obstacles": [box]})
    assert find_contradictions(problem) == []
    (before,) = assessed(spline, problem, 0.0).clearances
    assert before.smallest.distance == 0.0 and before.smallest.part == "'platform'"
    spline = solved(problem, how).spline(how)
    (after,) = assessed(spline, problem, 0.0).clearances
    assert after.smallest.distance > 0.005 and after.smallest.z is not None
