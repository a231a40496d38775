"""Certainty of estimates equals closed forms of linear regression; unidentifiable parameters are named."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import t as student

from emla_cosim.analyses.identify.certainty import assess_certainty, find_profile
from emla_cosim.analyses.identify.parameters import Parameter, Parameters
from emla_cosim.analyses.identify.residuals import (
    LOSSES,
    autocorrelation,
    count_correlated_lags,
    find_cost,
    scale_for_loss,
)
from emla_cosim.analyses.identify.systematic_errors import find_time_shifts
from tests.support.known_predictions import contain, measured, parameter, problem
from tests.support.tiers import mostly_slow

TIME = np.linspace(0.0, 1.0, 400)
LINE = np.column_stack([np.ones_like(TIME), TIME])
NOISE = np.random.default_rng(3).standard_normal(len(TIME))
PARAMETERS = Parameters([parameter("a", 0.0, 10.0), parameter("b", 0.0, 10.0)])


def fitted(values: np.ndarray, columns: np.ndarray = LINE) -> tuple[np.ndarray, np.ndarray]:
    """The least-squares estimates of the columns' factors, and the residuals."""
    factors = np.linalg.lstsq(columns, values, rcond=None)[0]
    return factors, columns @ factors - values


def test_white_residuals_give_the_covariance_of_regression() -> None:
    factors, residuals = fitted(LINE @ [4.0, 6.0] + NOISE)
    got = assess_certainty(PARAMETERS, factors / 10.0, residuals, 10.0 * LINE, [len(TIME)])
    variance = residuals @ residuals / (len(TIME) - 2)
    expected = np.sqrt(np.diag(variance * np.linalg.inv(LINE.T @ LINE)))
    assert [estimate.value for estimate in got.estimates] == pytest.approx(factors)
    assert [estimate.error for estimate in got.estimates] == pytest.approx(expected, rel=0.12)
    assert got.deviation == pytest.approx(np.sqrt(variance))
    assert got.correlations[0, 1] == pytest.approx(-np.sqrt(3.0) / 2.0, abs=0.05)


MEMORIES = [(0.0, 0.92), (0.5, 0.9), (0.9, 0.84)]


@pytest.mark.parametrize(("correlation", "least"), mostly_slow(MEMORIES, MEMORIES[-1:]))
def test_intervals_contain_true_values_with_correlated_residuals(correlation: float, least: float) -> None:
    """With the covariance of independent residuals, that would be 0.33 of 400 for a memory of 0.9."""
    random, inside, runs = np.random.default_rng(1), np.zeros(2), 400
    for _ in range(runs):
        noise = lfilter([1.0], [1.0, -correlation], random.standard_normal(len(TIME) + 200))[200:]
        factors, residuals = fitted(LINE @ [4.0, 6.0] + 0.2 * noise)
        got = assess_certainty(PARAMETERS, factors / 10.0, residuals, 10.0 * LINE, [len(TIME)]).estimates
        inside += contain(got, (4.0, 6.0))
    assert (inside / runs > least).all() and (inside / runs < 0.985).all(), inside / runs


@pytest.mark.parametrize("loss", mostly_slow(["soft_l1", "huber", "cauchy"], ["cauchy"]))
def test_intervals_contain_true_values_despite_outliers(loss: str) -> None:
    random, inside, runs, widths = np.random.default_rng(1), np.zeros(2), 300, list[float]()
    for _ in range(runs):
        noise = random.standard_normal(len(TIME)) * np.where(random.random(len(TIME)) < 0.05, 30.0, 1.0)
        values = LINE @ [4.0, 6.0] + noise
        factors = least_squares(lambda p, y=values: LINE @ p - y, fitted(values)[0], loss=loss).x
        residuals = LINE @ factors - values
        got = assess_certainty(
            PARAMETERS, factors / 10.0, residuals, 10.0 * LINE, [len(TIME)], loss=loss
        ).estimates
        widths.append(float(got[1].error or np.inf))
        inside += contain(got, (4.0, 6.0))
    assert (inside / runs > 0.91).all() and (inside / runs < 0.99).all(), inside / runs
    error_without_outliers = np.sqrt(np.linalg.inv(LINE.T @ LINE)[1, 1])  # the error without outliers
    assert np.median(widths) < 1.4 * error_without_outliers


@pytest.mark.parametrize("loss", LOSSES)
def test_losses_equal_those_of_scipy(loss: str) -> None:
    values = np.array([-40.0, -1.0, -0.3, 0.0, 0.9, 1.1, 7.0])
    solution = least_squares(lambda p: values + 0.0 * p[0], [0.0], loss=loss)
    assert find_cost(loss, values) == pytest.approx(solution.cost)
    weights, _ = scale_for_loss(loss, values)
    step = 1e-6
    slope = [(find_cost(loss, np.array([v + step])) - find_cost(loss, np.array([v - step]))) / (2 * step)
             for v in values]  # fmt: skip
    assert weights == pytest.approx(slope, abs=1e-6)


def test_unidentifiable_parameters_are_named() -> None:
    columns = np.column_stack([TIME, 0.0 * TIME, np.ones_like(TIME), np.ones_like(TIME), TIME**2])
    names = ["a", "idle", "c", "d", "end"]
    parameters = Parameters([parameter(name, 0.0, 1.0) for name in names])
    point = np.array([0.5, 0.5, 0.5, 0.5, 1.0])
    residuals = 0.01 * np.random.default_rng(0).standard_normal(len(TIME))
    got = assess_certainty(parameters, point, residuals, columns, [len(TIME)])
    problems = {estimate.name: estimate.problem for estimate in got.estimates}
    assert problems["a"] is None
    assert problems["idle"] == "it has no influence on the measured signals"
    assert problems["c"] == "the data do not tell it from a combination of d"
    assert problems["d"] == "the data do not tell it from a combination of c"
    assert problems["end"] == "it is at the upper end of its range"
    assert all(
        estimate.interval is None and estimate.error is None
        for estimate in got.estimates
        if estimate.name != "a"
    )
    assert np.isnan(got.correlations[1:, :]).all()


def test_uncertain_derivatives_and_uneven_responses_widen_intervals() -> None:
    """Where another step changes a slope by a fifth, the error is a quarter larger.

    Where nearby costs exceed the tangent by 1.5 variances, 2 standard errors away costs as much.
    """
    factors, residuals = fitted(LINE @ [4.0, 6.0] + NOISE)
    slopes = 10.0 * LINE
    sure, unsure, uneven, unidentified = (
        assess_certainty(
            PARAMETERS, factors / 10.0, residuals, slopes, [len(TIME)], part * slopes, cost_tolerance=x
        ).estimates
        for part, x in ((0.0, 0.0), (0.2, 0.0), (0.0, 1.5), (0.6, 0.0))
    )
    for narrow, wider, widest in zip(sure, unsure, uneven, strict=True):
        assert narrow.error is not None and wider.error == pytest.approx(narrow.error / 0.8)
        assert widest.error == pytest.approx(2.0 * narrow.error)
    assert all("do not tell" in str(narrow.problem) for narrow in unidentified)


def test_interval_wider_than_the_range_names_similar_parameters() -> None:
    columns = np.column_stack([TIME, TIME + 1e-4 * np.sin(20.0 * TIME), np.ones_like(TIME)])
    parameters = Parameters([parameter(name, 0.0, 1.0) for name in ("a", "twin", "c")])
    residuals = 0.01 * np.random.default_rng(0).standard_normal(len(TIME))
    got = assess_certainty(parameters, np.full(3, 0.5), residuals, columns, [len(TIME)]).estimates
    assert "resembles that of twin" in str(got[0].problem)
    assert "resembles that of a" in str(got[1].problem)
    assert got[2].problem is None


def test_autocorrelation_equals_its_definition() -> None:
    values = np.random.default_rng(5).standard_normal(73).cumsum()
    centred = values - values.mean()
    expected = np.correlate(centred, centred, "full")[len(values) - 1 :] / (centred @ centred)
    assert autocorrelation(values) == pytest.approx(expected)
    assert count_correlated_lags(np.random.default_rng(2).standard_normal(1000)) == 0
    assert count_correlated_lags(values) > 2


@given(st.floats(1e-6, 1e3), st.floats(1.001, 1e6), st.floats(0.0, 1.0))
def test_places_are_the_inverse_of_values(low: float, ratio: float, fraction: float) -> None:
    range_ = Parameter("p", low, low * ratio, low, "")
    assert range_.is_logarithmic == (low * ratio >= 10.0 * low)
    assert low <= range_.value(fraction) <= range_.high
    assert range_.to_fraction(range_.value(fraction)) == pytest.approx(fraction, abs=1e-9)


def test_profile_of_a_linear_model_equals_its_interval() -> None:
    noise = np.random.default_rng(7).standard_normal(len(TIME))
    values = LINE @ [4.0, 6.0] + noise
    factors, residuals = fitted(values)

    def model(p: dict[str, float]) -> list[dict[str, np.ndarray]]:
        return [{"time": TIME, "y": p["a"] + p["b"] * TIME}]

    def ends(low: float) -> tuple[float | None, float | None]:
        """Ends of the interval of b, whose range begins at `low`."""
        space = [parameter("a", 0.0, 10.0), parameter("b", low, 10.0)]
        solved = problem(space, [[measured(TIME, values)]], model)  # type: ignore[arg-type]
        point = np.array([parameter_.to_fraction(x) for parameter_, x in zip(space, factors, strict=True)])
        return find_profile(solved, point, 1, None, lambda n: None)

    variance = residuals @ residuals / (len(TIME) - 2)
    width = student.ppf(0.975, len(TIME) - 2) * np.sqrt(variance * np.linalg.inv(LINE.T @ LINE)[1, 1])
    low, high = ends(0.0)
    assert low is not None and high is not None
    assert (10.0 * low, 10.0 * high) == pytest.approx((factors[1] - width, factors[1] + width), rel=5e-3)
    assert ends(factors[1] - 0.5 * width)[0] is None


@pytest.mark.parametrize("late", [0.0, 0.004, -0.004])
def test_time_shift_and_its_effect_are_estimated(late: float) -> None:
    """Least squares with the true shift is the reference."""
    time, noise = np.linspace(0.0, 4.0, 801), 0.02 * np.random.default_rng(5).standard_normal(801)

    def columns(shift: float) -> np.ndarray:
        at = time - shift
        return np.column_stack([np.sin(6.0 * at) + np.sin(17.0 * at), np.cos(6.0 * at) + np.cos(11.0 * at)])

    measured_values = columns(late) @ [4.0, 2.0] + noise
    factors, residuals = fitted(measured_values, columns(0.0))
    samples = [measured(time, measured_values)]
    shifts, moves = find_time_shifts(samples, residuals, 10.0 * columns(0.0), [1.0], "linear", ())
    assert bool(shifts) == bool(late)
    without, _ = fitted(measured_values, columns(late))
    if late:
        assert abs(shifts[0].seconds - late) < 4.0 * shifts[0].error + 1e-4
        assert 10.0 * moves == pytest.approx(without - factors, rel=0.25, abs=0.01)
    random_errors, total_errors = (
        assess_certainty(
            PARAMETERS, factors / 10.0, residuals, 10.0 * columns(0.0), [len(time)], moves=x
        ).estimates
        for x in (None, moves)
    )
    for a, b, move in zip(random_errors, total_errors, 10.0 * moves, strict=True):
        assert a.error is not None and b.error == pytest.approx(np.hypot(a.error, move))
    assert not find_time_shifts(samples, residuals, 10.0 * columns(0.0), [1.0], "linear", ("y",))[0]


def test_samples_at_one_time_have_no_slope() -> None:
    """A measurement that jumps has two; without them, the shift is the same."""
    time = np.linspace(0.0, 4.0, 801)
    values = 4.0 * np.sin(6.0 * (time - 0.004)) + 0.02 * np.random.default_rng(5).standard_normal(801)
    shifts = []
    for index in (None, 400):
        at, of = (x if index is None else np.insert(x, index, x[index]) for x in (time, values))
        columns = np.column_stack([np.sin(6.0 * at), np.ones_like(at)])
        _, residuals = fitted(of, columns)
        estimated, _ = find_time_shifts([measured(at, of)], residuals, 10.0 * columns, [1.0], "linear", ())
        shifts.append(estimated[0].seconds)
    assert shifts[1] == pytest.approx(shifts[0], rel=0.02) and shifts[0] == pytest.approx(0.004, rel=0.1)
