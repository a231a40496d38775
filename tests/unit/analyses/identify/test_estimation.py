"""Searches find the minima of SciPy, also with failing runs, narrow valleys, weights and sensors."""

import struct
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from scipy.optimize import least_squares

from emla_cosim.analyses.identify.certainty import assess_certainty, find_profile
from emla_cosim.analyses.identify.estimation import Estimator, draw_starting_points
from emla_cosim.analyses.identify.parameters import Parameter, Parameters
from emla_cosim.analyses.identify.prediction import predict_samples
from emla_cosim.base.errors import RunError
from tests.support.known_predictions import contain, measured, parameter, problem
from tests.support.tiers import mostly_slow

TIME = np.linspace(0.0, 2.0, 201)

DECAY = [parameter("a", 0.0, 5.0), parameter("b", 0.1, 20.0)]
NEAR = [parameter("a", 0.0, 5.0, 1.7), parameter("b", 0.1, 20.0, 3.5)]
EXACT = [parameter("a", 0.0, 5.0, 2.0), parameter("b", 0.1, 20.0, 3.0)]
"""Parameters of a decay: in the middle of their ranges, near to the values of `noisy`, and at these."""


def decay(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
    return [{"time": TIME, "y": p["a"] * np.exp(-p["b"] * TIME)}]


def noisy(seed: int = 0, sigma: float = 0.01) -> np.ndarray:
    return 2.0 * np.exp(-3.0 * TIME) + sigma * np.random.default_rng(seed).standard_normal(len(TIME))


def search(solved: object, loss: str = "linear") -> Estimator:
    return Estimator(solved, loss, 50, lambda n: None)  # type: ignore[arg-type]


@pytest.mark.parametrize("loss", ["linear", "soft_l1", "huber", "cauchy", "arctan"])
def test_minimum_equals_that_of_scipy(loss: str) -> None:
    values = noisy()
    values[::25] += 0.5  # outliers
    solved = problem(NEAR, [[measured(TIME, values)]], decay, sigma=0.02)
    solution = search(solved, loss).estimate([Parameters(NEAR).start])
    expected = least_squares(
        lambda x: (x[0] * np.exp(-x[1] * TIME) - values) / 0.02, [1.7, 3.5], loss=loss, xtol=1e-12, ftol=1e-12
    )
    got = Parameters(NEAR).values(solution.point)
    assert [got["a"], got["b"]] == pytest.approx(expected.x, rel=2e-4)
    assert solution.cost == pytest.approx(expected.cost, rel=1e-6) and solution.converged


def test_outliers_do_not_widen_the_deviation() -> None:
    values = noisy(1)
    values[::20] += 1.0
    solved = problem(DECAY, [[measured(TIME, values)]], decay)
    solution = search(solved, "cauchy").estimate([Parameters(DECAY).start], free=["y"])
    assert solved.sigma["y"] == pytest.approx(0.01, rel=0.15)
    assert Parameters(DECAY).values(solution.point) == pytest.approx({"a": 2.0, "b": 3.0}, rel=0.01)


def test_fixed_deviations_stay() -> None:
    def simulate(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        return [decay(p)[0] | {"v": decay(p)[0]["y"]}]

    signals = [measured(TIME, noisy(1)), measured(TIME, noisy(2, 0.1), "v")]
    solved = problem(DECAY, [signals], simulate, sigma=0.5)
    search(solved).estimate([Parameters(DECAY).start], free=["v"])
    assert solved.sigma == pytest.approx({"y": 0.5, "v": 0.1}, rel=0.15)


def test_values_with_failing_runs_are_avoided() -> None:
    def fails(p: Mapping[str, float]) -> list[dict[str, np.ndarray] | str]:
        return ["the step failed"] if p["b"] > 3.5 else [*decay(p)]

    space = [parameter("a", 0.0, 5.0, 1.0), parameter("b", 0.1, 20.0, 3.4)]
    solved = problem(space, [[measured(TIME, noisy())]], fails)
    solution = search(solved).estimate([np.array([0.2, 0.9]), Parameters(space).start])
    assert Parameters(space).values(solution.point)["b"] == pytest.approx(3.0, rel=0.02)
    with pytest.raises(RunError, match=r"all starting points fail, most often because: the step failed\."):
        search(solved).estimate([np.array([0.2, 0.9])])


def test_uneven_valley_is_followed_to_its_end() -> None:
    """Rounding of the outputs stops a search in a narrow valley; points along it show that it continues."""

    def uneven(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        y = p["a"] * TIME + p["b"] * (TIME + 0.02 * TIME**2)
        return [{"time": TIME, "y": np.round(y / 1e-3) * 1e-3}]

    values = uneven({"a": 2.0, "b": 5.0})[0]["y"] + 1e-3 * np.random.default_rng(0).standard_normal(len(TIME))
    space = [parameter("a", 0.0, 10.0, 6.5), parameter("b", 0.0, 10.0, 0.5)]
    solved = problem(space, [[measured(TIME, values)]], uneven, sigma=1e-3)
    solution = search(solved).estimate([Parameters(space).start])
    assert 2.0 * solution.cost / len(TIME) < 1.2
    assert Parameters(space).values(solution.point) == pytest.approx({"a": 2.0, "b": 5.0}, abs=0.05)


def uneven(kind: str, size: float) -> Callable[[Mapping[str, float]], list[dict[str, np.ndarray]]]:
    """A decay whose samples are rounded, or get other noise for every other value of a parameter."""

    def model(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        (smooth,) = decay(p)
        if kind == "rounded":
            return [smooth | {"y": size * np.round(smooth["y"] / size)}]
        drawn = np.random.default_rng(np.frombuffer(struct.pack("2d", p["a"], p["b"]), np.uint32))
        return [smooth | {"y": smooth["y"] + size * drawn.standard_normal(len(TIME))}]

    return model


UNEVEN = [("noisy", 0.003), ("noisy", 0.01), ("rounded", 0.01)]


@pytest.mark.parametrize(("kind", "size"), mostly_slow(UNEVEN, UNEVEN[-1:]))
def test_intervals_contain_true_values_of_uneven_responses(kind: str, size: float) -> None:
    """A search ends in the deepest of many dents; intervals that know nothing of them hold too rarely."""
    inside, naive, runs, excess = np.zeros(2), np.zeros(2), 30, list[float]()
    for seed in range(runs):
        solved = problem(NEAR, [[measured(TIME, noisy(seed, 0.01 + size))]], uneven(kind, size))
        searching = search(solved)
        solution, slopes = searching.differentiate(searching.estimate([Parameters(NEAR).start], free=["y"]))
        excess.append(slopes.cost_tolerance)
        assert solved.fixed_steps.keys() >= slopes.steps.keys()
        for counted, cost_tolerance in ((inside, slopes.cost_tolerance), (naive, 0.0)):
            got = assess_certainty(
                Parameters(NEAR), solution.point, solution.residuals, slopes.matrix, [len(TIME)],
                slopes.change, cost_tolerance=cost_tolerance,
            )  # fmt: skip
            counted += contain(got.estimates, (2.0, 3.0))
    assert np.median(excess) > 0.2
    assert (inside / runs >= 0.9).all() and (naive / runs < 0.9).any(), (inside / runs, naive / runs)


@pytest.mark.parametrize("seed", range(2))
def test_profile_of_an_uneven_response_has_ends(seed: int) -> None:
    """Searches that begin elsewhere end in other dents; ends are beyond the deepest ones."""
    solved = problem(NEAR, [[measured(TIME, noisy(seed, 0.013))]], uneven("noisy", 0.003))
    searching = search(solved)
    solution, slopes = searching.differentiate(searching.estimate([Parameters(NEAR).start], free=["y"]))
    for i in range(2):
        low, high = find_profile(solved, solution.point, i, None, lambda n: None, slopes.cost_tolerance)
        assert low is not None and high is not None
        assert 0.0 < low < solution.point[i] - 1e-4 < solution.point[i] + 1e-4 < high < 1.0


def test_longer_steps_average_an_uneven_response() -> None:
    """The first step changes less than one digit: half of it gives another derivative."""
    slope = 2.0 * TIME

    def rounded(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        return [{"time": TIME, "y": 0.01 * np.round(p["a"] * slope / 0.01)}]

    solved = problem([parameter("a", 0.0, 1.0)], [[measured(TIME, 0.5 * slope + 0.02)]], rounded, sigma=0.01)
    solved.steps[0] = 1e-3
    derivatives = solved.differentiate(np.array([0.5]))
    true = slope / 0.01
    assert np.linalg.norm(derivatives.matrix[:, 0] - true) < 0.05 * np.linalg.norm(true)
    assert derivatives.steps[0] >= 0.016 and derivatives.doubts[0] < 0.1
    first = solved.jacobian(np.array([0.5]), central=True)[:, 0]
    assert np.linalg.norm(first - true) > 0.5 * np.linalg.norm(true)
    # the estimated error is that of the derivative, neither far too small nor far too large
    assert (
        0.3 < np.linalg.norm(derivatives.change[:, 0]) / np.linalg.norm(derivatives.matrix[:, 0] - true) < 5.0
    )


def test_curvature_limits_the_step() -> None:
    """Long steps see the curve in place of the rounding: a step of 0.1 gives a derivative 30 % too large."""
    slope = 2.0 * TIME

    def curved(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        return [{"time": TIME, "y": 1e-3 * np.round((p["a"] + 30.0 * (p["a"] - 0.5) ** 3) * slope / 1e-3)}]

    values = 0.5 * slope + 1e-3 * np.random.default_rng(0).standard_normal(len(TIME))
    solved = problem([parameter("a", 0.0, 1.0)], [[measured(TIME, values)]], curved, sigma=1e-3)
    solved.steps[0] = 3e-4
    derivatives = solved.differentiate(np.array([0.5]))
    true = slope / 1e-3
    assert np.linalg.norm(derivatives.matrix[:, 0] - true) < 0.03 * np.linalg.norm(true)
    assert 0.0 < derivatives.steps[0] < 0.03


def test_steps_change_outputs_by_more_than_rounding() -> None:
    """The change is 30 standard deviations, or of the residuals if these are smaller."""

    def steep(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        return [{"time": TIME, "y": np.full(len(TIME), 1e5 * p["a"])}]

    space = [parameter("a", 0.0, 1.0)]
    for residual, change in ((3.0, 30.0), (0.1, 3.0)):
        values = np.full(len(TIME), 0.5e5 + residual)
        solved = problem(space, [[measured(TIME, values)]], steep)
        solved.jacobian(np.array([0.5]))
        assert solved.steps[0] * 1e5 == pytest.approx(change, rel=0.01)


def test_smooth_response_keeps_its_steps() -> None:
    solved = problem(EXACT, [[measured(TIME, noisy())]], decay, sigma=0.01)
    point = Parameters(EXACT).start
    derivatives = solved.differentiate(point)
    assert not derivatives.steps and derivatives.cost_tolerance < 1e-3 and (derivatives.doubts < 0.01).all()
    a, b = 2.0, 3.0
    by_b = -a * TIME * np.exp(-b * TIME) / 0.01 * (b * np.log(200.0))
    exact = np.column_stack([5.0 * np.exp(-b * TIME) / 0.01, by_b])
    assert derivatives.matrix == pytest.approx(exact, rel=1e-3, abs=0.01)


def test_perfect_fit_needs_no_cost_tolerance() -> None:
    values = 2.0 * np.exp(-3.0 * TIME) + 1e-15 * np.random.default_rng(0).standard_normal(len(TIME))
    solved = problem(EXACT, [[measured(TIME, values)]], decay)
    assert solved.differentiate(Parameters(EXACT).start).cost_tolerance == 0.0


def test_parameter_at_a_kink_is_not_identified() -> None:
    def corner(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        return [{"time": TIME, "y": abs(p["a"] - 0.5) * TIME + 0.1 * p["a"] * TIME}]

    space = [parameter("a", 0.0, 1.0)]
    values = 0.05 * TIME + 0.01 * np.random.default_rng(0).standard_normal(len(TIME))
    solved = problem(space, [[measured(TIME, values)]], corner, sigma=0.01)
    point = np.array([0.5])
    derivatives = solved.differentiate(point)
    assert derivatives.doubts[0] > 1.0
    (residuals,) = solved.residuals([point])
    assert residuals is not None
    got = assess_certainty(
        Parameters(space), point, residuals, derivatives.matrix, [len(TIME)], derivatives.change
    )
    (estimate,) = got.estimates
    assert (
        estimate.problem is not None and "runs with almost equal values differ too much" in estimate.problem
    )


def test_several_starts_find_the_lowest_minimum() -> None:
    def wave(p: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        return [{"time": TIME, "y": np.sin(p["w"] * TIME)}]

    space = [parameter("w", 10.0, 90.0, 12.0)]
    solved = problem(space, [[measured(TIME, np.sin(60.0 * TIME))]], wave)
    start = Parameters(space).start
    single = search(solved).estimate([start])
    several = search(solved).estimate(draw_starting_points(start, 30, 0))
    assert single.cost > 1.0
    assert Parameters(space).values(several.point)["w"] == pytest.approx(60.0)


def test_sensors_have_offset_gain_and_delay() -> None:
    ends = {"offset": (0.0, 1.0), "gain": (1.0, 3.0), "delay": (0.0, 0.2)}
    sensors = [
        Parameter(f"{kind}(y)", low, high, low, "", sensor=(kind, "y")) for kind, (low, high) in ends.items()
    ]
    of = Parameters(sensors)
    got = predict_samples(
        of, np.array([0.5, 0.25, 0.5]), decay({"a": 2.0, "b": 3.0})[0], measured(TIME, TIME)
    )
    late = TIME >= 0.1
    expected = 0.5 + 1.5 * 2.0 * np.exp(-3.0 * (TIME - 0.1))
    assert got[late] == pytest.approx(expected[late], abs=3e-4)
    assert of.key(np.array([0.1, 0.2, 0.3])) == ()  # sensors need no run


def test_blocked_parameter_has_its_own_problem() -> None:
    def brittle(p: Mapping[str, float]) -> list[dict[str, np.ndarray] | str]:
        return ["the step failed"] if p["b"] != 3.0 else [*decay(p)]

    space = [parameter("a", 0.0, 5.0), parameter("b", 2.0, 4.0)]
    solved = problem(space, [[measured(TIME, noisy())]], brittle)
    point = Parameters(space).start
    jacobian = solved.jacobian(point, central=True)
    (residuals,) = solved.residuals([point])
    assert residuals is not None and solved.blocked == {1}
    got = assess_certainty(Parameters(space), point, residuals, jacobian, [len(TIME)], blocked=solved.blocked)
    assert [estimate.problem for estimate in got.estimates] == [None, "runs with other values of it fail"]


@pytest.mark.parametrize("fraction", [0.0, 1.0, 0.5])
def test_derivatives_equal_those_of_the_model(fraction: float) -> None:
    space = [parameter("a", 1.0, 3.0), parameter("b", 2.0, 4.0)]
    solved = problem(space, [[measured(TIME, noisy())]], decay, sigma=0.1)
    point = np.array([fraction, 0.5])
    a, b = 1.0 + 2.0 * fraction, 3.0
    expected = np.column_stack([2.0 * np.exp(-b * TIME), -2.0 * a * TIME * np.exp(-b * TIME)]) / 0.1
    assert solved.jacobian(point, central=True) == pytest.approx(expected, abs=0.02)
    assert solved.jacobian(point) == pytest.approx(expected, abs=0.05)
