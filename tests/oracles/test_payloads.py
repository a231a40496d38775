"""A payload that changes on the way, against the dynamics with a constant payload on each side."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import simpson

from emla_cosim.analyses.trajectory.problem import paper_problem
from machine_fmu.optimisation.assessment import assessed, course
from machine_fmu.optimisation.contradictions import find_contradictions
from machine_fmu.optimisation.problem import Via
from machine_fmu.optimisation.solving import NoMotionError, Solution, solved
from machine_fmu.optimisation.transcription import Discretisation
from machine_fmu.spline import TrajectoryError
from tests.support.reference_manipulator import LAGRANGIAN

COARSE = Discretisation(knots=12, points=6)
REST = (0.0, 0.0, 0.0)
PROBLEM = paper_problem(
    q_E=(0.36, 0.46, 0.1),
    v_S=REST,
    v_E=REST,
    payload=470.0,
    via=(
        Via((3.0, -0.6), at=0.37, payload=50.0),
        Via((3.0, 0.2), at=0.6),
        Via((3.2, 0.4), at=0.8, payload=300.0),
    ),
    t_M=15.0,
)
SIDES = ((0.0, 0.37, 470.0), (0.37, 0.8, 50.0), (0.8, 1.0, 300.0))


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solved(PROBLEM, COARSE)


def constant(solution: Solution, first: float, last: float, payload: float) -> tuple[np.ndarray, ...]:
    """Times, speeds and forces from one moment to another with one payload, a point at a time."""
    spline = solution.spline(COARSE)
    times = np.linspace(first * spline.end, last * spline.end, 3001)
    q, v, a = (spline.evaluated(times, order) for order in range(3))
    rows = zip(q.tolist(), v.tolist(), a.tolist(), strict=True)
    return times, q, v, np.array([LAGRANGIAN.forces(*row, payload) for row in rows])


def test_forces_match_the_payload_on_each_side(solution: Solution) -> None:
    for side in SIDES:
        times, _, _, force = constant(solution, *side)
        trajectory = course(solution.spline(COARSE), PROBLEM, times)
        assert trajectory.force[1:-1] == pytest.approx(force[1:-1], rel=1e-9, abs=1e-6)
        assert np.all(np.abs(force) <= np.array(PROBLEM.f_UB) * (1.0 + 1e-6))


def test_costs_and_work_are_the_sums_of_all_sides(solution: Solution) -> None:
    figures = assessed(solution.spline(COARSE), PROBLEM, COARSE.tie_break)
    cost = work = gross_work = tie_break = 0.0
    for first, last, payload in SIDES:
        times, q, v, force = constant(solution, first, last, payload)
        power = v * force
        cost += 0.5 * simpson(power.sum(axis=1) ** 2, x=times)
        gross_work += simpson(np.abs(power).sum(axis=1), x=times)
        tie_break += 0.5e-3 * simpson((power**2).sum(axis=1), x=times)
        ends = [LAGRANGIAN.at(q[i], v[i], payload)[2] for i in (0, -1)]
        work += ends[1] - ends[0]
    assert figures.cost == pytest.approx(cost, rel=1e-6)
    assert figures.gross_work == pytest.approx(gross_work, rel=1e-5)
    assert figures.net_work == pytest.approx(work, rel=1e-6)
    assert figures.tie_break == pytest.approx(tie_break, rel=1e-6)
    assert figures.least_cost == pytest.approx(work**2 / (2.0 * figures.duration), rel=1e-6)
    assert figures.least_cost <= figures.cost
    assert solution.cost == pytest.approx(figures.cost + figures.tie_break, rel=1e-3)
    assert figures.within_bounds


def test_machine_rests_only_where_the_payload_changes(solution: Solution) -> None:
    spline = solution.spline(COARSE)
    speeds = spline.evaluated([part * spline.end for part in (0.37, 0.6, 0.8)], 1)
    assert np.abs(speeds[[0, 2]]).max() < 1e-8
    assert np.abs(speeds[1]).max() > 1e-3


@pytest.mark.slow
def test_bounds_of_forces_hold_with_the_payload_after_the_change() -> None:
    """The lift cannot carry what is picked up, however slowly."""
    empty = replace(PROBLEM, payload=0.0, via=(Via((3.0, -0.6)),), f_UB=(45e3, 68.6e3, 6.1e3))
    assert find_contradictions(empty) == []
    assert assessed(solved(empty, COARSE).spline(COARSE), empty, 0.0).within_bounds
    full = replace(empty, via=(Via((3.0, -0.6), payload=470.0),))
    assert any("holding q_E takes" in message for message in find_contradictions(full))
    with pytest.raises(NoMotionError, match="the force bounds of the lift by"):
        solved(full, COARSE)


@pytest.mark.slow
def test_change_to_the_same_payload_changes_no_force() -> None:
    same = replace(PROBLEM, via=tuple(replace(via, payload=470.0) for via in PROBLEM.via))
    never = replace(PROBLEM, via=tuple(replace(via, payload=None) for via in PROBLEM.via))
    assert [load.payload for load in same.loads] == [470.0] * 4 and len(never.loads) == 1
    assert all(a.last == b.first for a, b in pairwise(same.loads))
    spline = solved(same, COARSE).spline(COARSE)
    changing, constant_ = (assessed(spline, problem, 1e-3) for problem in (same, never))
    assert changing.cost == pytest.approx(constant_.cost, rel=1e-9)
    assert changing.net_work == pytest.approx(constant_.net_work, rel=1e-9)


def test_payloads_are_not_negative() -> None:
    with pytest.raises(TrajectoryError, match="payload of a way-point is -1; it must be 0 kg or more"):
        Via((3.0, 0.0), payload=-1)
