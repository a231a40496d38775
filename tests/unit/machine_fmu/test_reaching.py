"""Positions of the tip as goals and way-points, by geometry that is written here again."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given
from hypothesis import strategies as st

from emla_cosim.analyses.trajectory.problem import paper_problem
from machine_fmu.optimisation.assessment import assessed
from machine_fmu.optimisation.contradictions import find_contradictions
from machine_fmu.optimisation.problem import Via
from machine_fmu.optimisation.reaching import Reach, nearest_position, nearest_posture
from machine_fmu.optimisation.solving import solved
from machine_fmu.optimisation.transcription import Discretisation
from machine_fmu.spline import TrajectoryError
from tests.support.manipulator_geometry import HDRM, points
from tests.support.tiers import examples

COARSE = Discretisation(knots=12, points=6)
REST = (0.0, 0.0, 0.0)
MACHINE = paper_problem().machine
REACH = Reach(MACHINE, MACHINE.payload)


def tip(q: Any) -> complex:
    return points(HDRM, q)["tip"]


def anywhere() -> Any:
    return st.tuples(*(st.floats(0.0, high) for high in HDRM.q_UB))


def everything(strokes: np.ndarray) -> np.ndarray:
    return np.zeros((len(strokes), 1))


def way(q: Any, start: Any) -> float:
    return float(np.sum(((np.array(q) - start) / HDRM.q_UB) ** 2))


@given(start=anywhere(), q=anywhere())
@examples(4, 20, phases=[Phase.explicit, Phase.generate])
def test_posture_of_a_position_is_the_nearest_to_the_start(start: Any, q: Any) -> None:
    at = tip(q)
    actual = nearest_posture(REACH, (at.real, at.imag), start, everything)
    if actual is None:  # only at the border, where one rounded stroke of the telescope reaches it
        assert min(*q, *np.subtract(HDRM.q_UB, q)) < 2e-3
        return
    assert all(0.0 <= x <= high for x, high in zip(actual, HDRM.q_UB, strict=True))
    assert abs(tip(actual) - at) < 2e-9
    assert way(actual, start) <= way(q, start) + 1e-3


def test_only_allowed_postures_are_chosen() -> None:
    free = nearest_posture(REACH, (3.2, 0.5), (0.244, 0.389, 0.499), everything)
    long = nearest_posture(REACH, (3.2, 0.5), (0.244, 0.389, 0.499), lambda q: q[:, 2:] - 0.6)
    assert free is not None and free[2] < 0.6
    assert long is not None and long[2] == pytest.approx(0.6, abs=1e-3)
    assert abs(tip(long) - (3.2 + 0.5j)) < 1e-9


@pytest.mark.parametrize(
    "position",
    [(5.0, 1.0), *(pytest.param(p, marks=pytest.mark.slow) for p in [(0.3, 0.3), (-2.0, 0.0), (1.0, 4.5)])],
)
def test_nearest_position_in_reach_is_nearer_than_any_random_one(position: tuple[float, float]) -> None:
    draw = np.random.default_rng(4)
    aim = complex(*position)
    nearest = min(abs(tip(q) - aim) for q in draw.uniform(size=(4000, 3)) * HDRM.q_UB)
    x, y = nearest_position(REACH, position)
    assert abs(complex(x, y) - aim) <= nearest
    assert abs(complex(x, y) - aim) == pytest.approx(nearest, abs=0.2)
    assert (
        nearest_posture(REACH, (x, y), REST, everything) is not None
        or min(abs(aim - complex(x, y)), 1.0) > 0.0
    )
    (message,) = find_contradictions(paper_problem(tip_E=position, ground_clearance="off"))[1:]
    assert f"out of the tip's reach by {abs(complex(x, y) - aim):.3g} m" in message


def test_motion_passes_its_way_points() -> None:
    vias = (Via((2.6, -0.4), at=0.3), Via((3.0, 0.2)))
    problem = paper_problem(tip_E=(3.2, 0.5), via=vias, v_S=REST, v_E=REST)
    assert find_contradictions(problem) == []
    assert problem.moments == [0.3, pytest.approx(2.0 / 3.0)]
    actual = solved(problem, COARSE)
    spline, figures = actual.spline(COARSE), assessed(actual.spline(COARSE), problem, COARSE.tie_break)
    assert figures.within_bounds
    for part, position in ((0.3, 2.6 - 0.4j), (2.0 / 3.0, 3.0 + 0.2j), (1.0, 3.2 + 0.5j)):
        (q,) = spline.evaluated([part * spline.end])
        assert abs(tip(q) - position) < 1e-6
    assert figures.least_cost <= figures.cost


def test_optimiser_uses_the_free_stroke() -> None:
    free = paper_problem(tip_E=(3.2, 0.5), v_S=REST, v_E=REST)
    (guess,) = free.guesses
    assert guess is not None
    fixed = replace(free, tip_E=None, q_E=guess)
    costs = [solved(problem, COARSE) for problem in (free, fixed)]
    assert abs(tip(costs[0].coefficients[-1]) - (3.2 + 0.5j)) < 1e-6
    assert costs[0].cost < 0.999 * costs[1].cost


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in [
                (
                    {"tip_E": (2.0, -1.3)},
                    "tip_E = 2,-1.3 m is 0.0806 m above the ground, which is at y = -1.381 m",
                ),
                ({"via": (Via((2.0, -2.0)),)}, "via[1].tip = 2,-2 m is 0.619 m below the ground"),
            ]
        ),
        ({"via": (Via((6.0, 0.0)),)}, "via[1].tip = 6,0 m is out of the tip's reach by 1."),
        (
            {"via": (Via((3.0, 0.0), 0.5), Via((3.1, 0.0), 0.4))},
            "via[2].at = 0.4 is not after via[1].at = 0.5",
        ),
    ],
)
def test_impossible_positions_of_the_tip_are_refused(changes: dict[str, Any], words: str) -> None:
    messages = find_contradictions(paper_problem(v_E=REST, **changes))
    assert len(messages) == 1 and words in messages[0]


def test_positions_have_two_numbers_and_moments_are_between_the_ends() -> None:
    with pytest.raises(TrajectoryError, match=r"tip_E is \(1.0,\); it must be two finite numbers: x, y"):
        replace(paper_problem(), tip_E=(1.0,))
    with pytest.raises(TrajectoryError, match=r"at of a way-point is 1\.0; it must be"):
        Via((1.0, 1.0), 1.0)
