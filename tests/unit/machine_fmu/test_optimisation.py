"""The motion of least cost: its bounds, its cost, and the bounds that make a motion impossible."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline

from emla_cosim.analyses.trajectory.problem import paper_problem
from machine_fmu.optimisation.assessment import Assessment, assessed
from machine_fmu.optimisation.contradictions import find_contradictions
from machine_fmu.optimisation.grid import SplineBasis, lobatto
from machine_fmu.optimisation.problem import EndSpeed, MotionProblem
from machine_fmu.optimisation.solving import NoMotionError, Solution, detour, narrowed, solved
from machine_fmu.optimisation.transcription import Discretisation
from machine_fmu.spline import Spline, default_spline
from tests.support.reference_manipulator import LAGRANGIAN
from tests.support.tiers import mostly_slow

PRINTED = paper_problem()
CLIPPED = PRINTED.read_as(EndSpeed.CLIP)
USUAL = Discretisation()
COARSE = Discretisation(knots=12, points=6)


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solved(CLIPPED, USUAL)


@pytest.fixture(scope="module")
def spline(solution: Solution) -> Spline:
    return solution.spline(USUAL)


@pytest.fixture(scope="module")
def figures(spline: Spline) -> Assessment:
    return assessed(spline, CLIPPED, USUAL.tie_break)


def in_floats(spline: Spline, problem: MotionProblem, count: int = 4001) -> tuple[np.ndarray, ...]:
    """Times, speeds and forces of a motion, by the function of one point at a time."""
    times = np.linspace(spline.start, spline.end, count)
    q, v, a = (spline.evaluated(times, order) for order in range(3))
    rows = zip(q.tolist(), v.tolist(), a.tolist(), strict=True)
    force = np.array([LAGRANGIAN.forces(*row, problem.payload) for row in rows])
    return times, q, v, force


def assert_within_bounds(q: np.ndarray, v: np.ndarray, force: np.ndarray) -> None:
    machine = CLIPPED.machine
    for values, low, high in (
        (q, machine.q_LB, machine.q_UB),
        (v, CLIPPED.v_LB, CLIPPED.v_UB),
        (force, CLIPPED.f_LB, CLIPPED.f_UB),
    ):
        width = np.array(high) - np.array(low)
        assert np.all(values >= np.array(low) - 1e-6 * width)
        assert np.all(values <= np.array(high) + 1e-6 * width)


# ---- the default -------------------------------------------------------------------------------


def test_all_bounds_hold_on_a_dense_grid(spline: Spline, figures: Assessment) -> None:
    _, q, v, force = in_floats(spline, CLIPPED)
    assert_within_bounds(q, v, force)
    assert figures.within_bounds
    for i, peak in enumerate(figures.peaks):
        assert abs(peak.force) == pytest.approx(np.abs(force[:, i]).max(), rel=1e-3)
        assert abs(peak.speed) == pytest.approx(np.abs(v[:, i]).max(), rel=1e-3)


def test_default_motion_is_reproduced(spline: Spline, figures: Assessment) -> None:
    """All starts end 1e-7 of the cost apart here; another machine's linear algebra may add to that."""
    stored = default_spline()
    times = np.linspace(0.0, 37.7, 1001)
    assert stored.end == spline.end
    assert spline.evaluated(times) == pytest.approx(stored.evaluated(times), abs=1e-3)
    cost = assessed(stored, CLIPPED, USUAL.tie_break).cost
    assert figures.cost == pytest.approx(cost, rel=1e-3)


@pytest.mark.slow
def test_no_start_leads_to_a_motion_that_is_clearly_better(solution: Solution) -> None:
    costs = [solved(CLIPPED, USUAL, detour(CLIPPED, USUAL, seed)).cost for seed in (1, 2)]
    assert solution.cost <= 1.01 * min(costs)


@pytest.mark.slow
def test_without_tie_break_joints_work_against_each_other() -> None:
    """What the cost as printed does not mind, as long as the sum of the powers is the same."""
    printed, usual = (
        assessed(solved(CLIPPED, how).spline(how), CLIPPED, 0.0)
        for how in (replace(COARSE, tie_break=0.0), COARSE)
    )
    assert printed.cost <= usual.cost
    assert printed.gross_work > 1.05 * usual.gross_work


@pytest.mark.slow
def test_subdivided_control_points_cost_less_and_keep_all_bounds(solution: Solution) -> None:
    """The optimum with bounds at 40 points in each span, from the same solver: 190,515 W2 s."""
    how = replace(USUAL, subdivisions=16)
    best = solved(CLIPPED, how)
    spline, figures = best.spline(how), assessed(best.spline(how), CLIPPED, how.tie_break)
    assert figures.cost + figures.tie_break == pytest.approx(best.cost, rel=1e-6)
    assert 190_515 < best.cost < 190_838 < 0.951 * solution.cost
    _, q, v, force = in_floats(spline, CLIPPED)
    assert_within_bounds(q, v, force)
    assert figures.within_bounds
    speeds = np.abs(v).max(axis=0)
    assert speeds[1] == pytest.approx(0.1, rel=0.01) and speeds[2] == pytest.approx(0.21, rel=1e-6)


@pytest.mark.parametrize("degree", [3, 5])
def test_subdivision_keeps_the_curve_and_comes_closer(degree: int) -> None:
    basis = SplineBasis.cosine(degree, 9)
    coefficients = np.random.default_rng(3).normal(size=basis.size)
    positions = np.linspace(0.0, 1.0, 2001)
    curve = BSpline(basis.knots, coefficients, degree)
    highest = curve(positions).max()
    before = coefficients.max()
    for pieces in (1, 2, 4, 8):
        knots = [a + (b - a) * k / pieces for a, b in pairwise(basis.distinct_knots) for k in range(pieces)]
        knots = np.concatenate([np.zeros(degree), knots, np.ones(degree + 1)])
        fine = basis.subdivided(pieces) @ coefficients
        np.testing.assert_allclose(BSpline(knots, fine, degree)(positions), curve(positions), atol=1e-12)
        assert highest - 1e-12 <= fine.max() <= before + 1e-12
        before = fine.max()
    assert before - highest < 0.2 * (coefficients.max() - highest)
    slopes = np.diff(coefficients) / basis.speed_spans
    derived = BSpline(basis.derivative.knots, slopes, degree - 1)(positions)
    np.testing.assert_allclose(derived, curve(positions, nu=1), atol=1e-9)


ACCELERATION = {"a_LB": (-0.1,) * 3, "a_UB": (0.1, 0.1, 0.15)}
JERK = {"j_LB": (-0.3,) * 3, "j_UB": (0.3, 0.3, 0.4)}
ACCELERATION_AND_JERK = {"a_UB": (0.06,) * 3, "j_LB": (-0.1,) * 3, "j_UB": (0.1,) * 3}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degree", "subdivisions", "limits"), [(5, 1, ACCELERATION), (5, 4, JERK), (3, 2, ACCELERATION_AND_JERK)]
)
def test_accelerations_and_jerks_keep_their_bounds(
    degree: int, subdivisions: int, limits: dict[str, Any]
) -> None:
    how = replace(COARSE, degree=degree, subdivisions=subdivisions)
    problem = replace(CLIPPED, **limits)
    motion, figures = narrowed(solved(problem, how), problem, how, lambda: None)
    free = solved(CLIPPED, how)
    spline = motion.spline(how)
    assert figures.within_bounds and motion.cost > 1.05 * free.cost
    times = np.linspace(spline.start, spline.end, 200_001)
    curves = [BSpline(spline.knots, spline.coefficients[n], degree) for n in ("lift", "tilt", "telescope")]
    reached = False
    for name, order in (("a", 2), ("j", 3)):
        values = np.array([curve(times, nu=order) for curve in curves])
        for side, sign in (("LB", -1.0), ("UB", 1.0)):
            bound = limits.get(f"{name}_{side}")
            if bound is not None:
                share = (sign * values).max(axis=1) / (sign * np.array(bound))
                assert np.all(share <= 1.0 + 1e-6)
                reached = reached or bool(np.any(share > 0.9))
        for i, peak in enumerate(figures.peaks):
            reported = peak.acceleration if name == "a" else peak.jerk
            assert abs(reported) == pytest.approx(np.abs(values[i]).max(), rel=1e-3)
    assert reached
    loose = assessed(free.spline(how), problem, how.tie_break)
    assert not loose.within_bounds


def test_least_time_with_bounded_acceleration_matches_the_closed_form() -> None:
    """From rest to rest over d, half of the time with a and half with -b: t^2 = 2 d (1/a + 1/b)."""
    a, b, way = 0.02, 0.05, 0.2
    least = np.sqrt(2.0 * way * (1.0 / a + 1.0 / b))
    rest = replace(
        PRINTED.read_as(EndSpeed.REST),
        v_S=(0.0, 0.0, 0.0),
        q_S=(0.244, 0.389, 0.3),
        q_E=(0.244, 0.389, 0.3 + way),
        a_LB=(-1.0, -1.0, -b),
        a_UB=(1.0, 1.0, a),
    )
    assert find_contradictions(replace(rest, t_M=1.001 * least)) == []
    (message,) = find_contradictions(replace(rest, t_M=0.999 * least))
    assert message.startswith("the telescope's way of 0.2 m is not possible in t_M = ")
    assert "a_LB[3] = -0.05 and a_UB[3] = 0.02 m/s2" in message


# ---- the problem as printed, and how it is read ------------------------------------------------


READINGS = [
    (EndSpeed.CLIP, (0.0607, -0.0808, -0.210)),
    (EndSpeed.EXEMPT, (0.0607, -0.0808, -0.5477)),
    (EndSpeed.DECIMAL, (0.0607, -0.0808, -0.05477)),
    (EndSpeed.REST, (0.0, 0.0, 0.0)),
]


def test_table_contradicts_itself_in_one_place() -> None:
    (sentence,) = find_contradictions(PRINTED)
    assert sentence.startswith(
        "v_E[3] = -0.5477 m/s of the telescope is beyond its own bounds, -0.21 to 0.21"
    )
    assert "2.6 times" in sentence
    assert find_contradictions(CLIPPED) == []
    for reading, v_E in READINGS:
        assert PRINTED.read_as(reading).v_E == pytest.approx(v_E)


@pytest.mark.parametrize(("reading", "v_E"), mostly_slow(READINGS, READINGS[1:2]))
def test_each_reading_has_its_end_speeds(reading: EndSpeed, v_E: tuple[float, ...]) -> None:
    problem = PRINTED.read_as(reading)
    motion, figures = narrowed(solved(problem, COARSE), problem, COARSE, lambda: None)
    spline = motion.spline(COARSE)
    assert spline.evaluated([spline.end], 1)[0] == pytest.approx(v_E, abs=1e-6)
    assert figures.within_bounds
    before_last = np.linspace(0.0, spline.knots[-7], 2001)
    assert np.all(np.abs(spline.evaluated(before_last, 1)) <= np.array(problem.v_UB) * (1.0 + 1e-6))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"q_E": (0.27, 0.442, 1.2)}, "q_E[3] = 1.2 m of the telescope is beyond its own bounds, 0 to 1 m"),
        ({"v_S": (0.2, 0.0, 0.0)}, "v_S[1] = 0.2 m/s of the lift is beyond its own bounds"),
        ({"t_M": 0.6}, "the telescope's 0.151 m take 0.719 s at its bound of 0.21 m/s, more than t_M"),
        ({"v_UB": (-0.01, 0.1, 0.21)}, "the lift's 0.026 m take inf s"),
        ({"v_LB": (0.2, -0.1, -0.21)}, "v_LB[1] = 0.2 is above v_UB[1] = 0.136"),
        ({"a_LB": (-1.0,) * 3, "a_UB": (1.0, -2.0, 1.0)}, "a_LB[2] = -1 is above a_UB[2] = -2"),
        (
            {"a_LB": (-1.0, -1.0, -1e-3), "a_UB": (1.0, 1.0, 1e-3)},
            "the telescope's change from v_S[3] = -0.0024 to v_E[3] = -0.21 m/s is not possible in "
            "t_M = 37.7 s with a_LB[3] = -0.001 and a_UB[3] = 0.001 m/s2",
        ),
        ({"payload": 900.0}, "holding q_S takes 91.03 kN of the lift, beyond its bounds, -89.8 to 89.8 kN"),
    ],
)
def test_contradictory_problems(changes: dict[str, Any], words: str) -> None:
    assert any(words in sentence for sentence in find_contradictions(replace(CLIPPED, **changes)))


# ---- bounds that cannot be kept ----------------------------------------------------------------


IMPOSSIBLE = [
    ({"f_UB": (58.5e3, 68.6e3, 6.1e3), "t_M": 0.75}, "the force bounds of the lift by"),
    ({"t_M": 0.72}, "the speed bounds of the telescope by"),
    ({"v_E": (0.5, 0.0, 0.0)}, "the end speeds v_E by"),
    ({"v_S": (-0.5, 0.0, 0.0)}, "the start speeds v_S by"),
]


@pytest.mark.parametrize(("changes", "guilty"), mostly_slow(IMPOSSIBLE, IMPOSSIBLE[1:2]))
def test_impossible_problem_names_the_violated_bound(changes: dict[str, Any], guilty: str) -> None:
    problem = replace(CLIPPED, **changes)
    with pytest.raises(NoMotionError, match=f"no motion keeps all bounds; .*{guilty}"):
        solved(problem, COARSE)


def test_forces_keep_their_bounds_between_points_too() -> None:
    hard = replace(PRINTED.read_as(EndSpeed.REST), t_M=1.0)
    loose = solved(hard, COARSE)
    assert not assessed(loose.spline(COARSE), hard, COARSE.tie_break).within_bounds
    stored, figures = narrowed(loose, hard, COARSE, lambda: None)
    assert figures.within_bounds
    assert stored.cost == pytest.approx(loose.cost, rel=0.05)


# ---- the grid ----------------------------------------------------------------------------------


def test_weights_integrate_polynomials_exactly() -> None:
    positions = np.array([0.0, 0.1, 0.4, 1.0])
    points, weights = lobatto(positions, 6)
    assert len(points) == 3 * 5 + 1
    for power in range(10):
        assert weights @ points**power == pytest.approx(1.0 / (power + 1.0), rel=1e-13)
