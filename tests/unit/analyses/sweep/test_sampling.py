"""Samplings have their size, order and distribution, and depend only on the seed."""

import itertools
import warnings
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from emla_cosim.analyses.variants.distributions import parse_distribution
from emla_cosim.analyses.variants.kinds import Distribution
from emla_cosim.analyses.variants.sampling import count_variants, sample
from emla_cosim.base.errors import CommandError

DRAWING = ["random", "latin-hypercube", "sobol", "saltelli"]


def parse(*forms: Any) -> list[Distribution]:
    return [parse_distribution(g, "x") for g in forms]


MIXED = parse("normal(0.14, 0.01)", "log-uniform(1, 100)", "integers(0, 9)", ["a", "b", "c"])
UNITS = parse("0:1", "0:1", "0:1")


def points(method: str, runs: int, seed: int = 0, d: int = 3) -> np.ndarray:
    """What a sampling draws of quantiles."""
    return np.array(sample(method, parse(*["0:1"] * d), runs, seed)).T


@pytest.mark.parametrize("method", DRAWING)
@pytest.mark.parametrize("runs", [1, 100, 128])
def test_number_of_variants(method: str, runs: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        columns = sample(method, MIXED, runs, 1)
    expected = runs * 6 if method == "saltelli" else runs
    assert [len(column) for column in columns] == [expected] * 4
    assert count_variants(method, MIXED, runs) == expected


@pytest.mark.parametrize("method", DRAWING)
def test_values_follow_their_distributions(method: str) -> None:
    normal, logarithmic, digits, letters = sample(method, MIXED, 2000, 3)
    if method == "saltelli":  # of which the first of a base point's rows are independent
        normal, logarithmic, digits, letters = (c[::6] for c in (normal, logarithmic, digits, letters))
    assert stats.kstest(normal, stats.norm(0.14, 0.01).cdf).pvalue > 0.01
    assert stats.kstest(logarithmic, stats.loguniform(1, 100).cdf).pvalue > 0.01
    assert stats.chisquare(np.bincount(np.array(digits, dtype=int), minlength=10)).pvalue > 0.01
    assert stats.chisquare([letters.count(c) for c in "abc"]).pvalue > 0.01
    assert abs(stats.spearmanr(normal, logarithmic).statistic) < 0.07
    assert {type(v) for v in digits} == {int} and {type(v) for v in normal} == {float}


@pytest.mark.parametrize("method", DRAWING)
def test_seed_determines_the_sample(method: str) -> None:
    assert sample(method, MIXED, 100, 7) == sample(method, MIXED, 100, 7)
    assert points(method, 100, 7).tolist() != points(method, 100, 8).tolist()
    assert sample(method, MIXED, 4, 2**70)


@pytest.mark.parametrize("method", ["random", "sobol", "saltelli"])
def test_larger_samples_extend_smaller_ones(method: str) -> None:
    few = points(method, 100)
    np.testing.assert_array_equal(points(method, 300)[: len(few)], few)


def test_latin_hypercube_has_one_point_in_each_stratum() -> None:
    strata = np.sort(np.floor(points("latin-hypercube", 250) * 250).astype(int), axis=0)
    np.testing.assert_array_equal(strata, np.tile(np.arange(250)[:, None], 3))


def test_sobol_is_a_scrambled_net() -> None:
    """One point in each of 2^m intervals of every dimension, and far more even than chance."""
    net = points("sobol", 256)
    strata = np.sort(np.floor(net * 256).astype(int), axis=0)
    np.testing.assert_array_equal(strata, np.tile(np.arange(256)[:, None], 3))
    assert qmc.discrepancy(net) < qmc.discrepancy(points("random", 256)) / 5


def test_last_factor_of_a_grid_varies_fastest() -> None:
    factors = parse("0:1:3", ["a", "b"], "integers(4, 6)", "7")
    assert count_variants("grid", factors, None) == 18
    rows = list(zip(*sample("grid", factors, None, 0), strict=True))
    assert rows == list(itertools.product([0.0, 0.5, 1.0], "ab", [4, 5, 6], [7]))


def test_huge_grids_are_counted() -> None:
    assert count_variants("grid", parse(*["0:1:1000000"] * 10), None) == 10**60
    assert count_variants("saltelli", UNITS, 2**30) == 5 * 2**30


def test_one_at_a_time_varies_one_factor() -> None:
    factors = parse("1:2", "3,1,2", "normal(0, 1)")
    columns = sample("one-at-a-time", factors, None, 0)
    deviation = stats.norm.ppf(0.95)
    assert columns[0] == [None, 1.0, 2.0, None, None, None, None]
    assert columns[1] == [None, None, None, 1, 3, None, None]
    assert columns[2][:5] == [None] * 5 and columns[2][5:] == pytest.approx([-deviation, deviation])
    assert count_variants("one-at-a-time", factors, None) == 7


@pytest.mark.parametrize("runs", [64, 41])
def test_saltelli_sample_has_rows_of_two_matrices_and_mixed_ones(runs: int) -> None:
    base = qmc.Sobol(6, rng=np.random.default_rng(9)).random(64)[:runs]
    expected = [
        row
        for *a, x, y, z in base.tolist()
        for row in (a, [x, a[1], a[2]], [a[0], y, a[2]], [a[0], a[1], z], [x, y, z])
    ]
    np.testing.assert_array_equal(points("saltelli", runs, 9), expected)


INVALID = [
    ("sobl", UNITS, 4, "there is no sampling 'sobl'; choose from grid, random, latin-hypercube, sobol,"),
    ("random", [], 4, "nothing varies; a sampling needs at least one distribution."),
    ("random", UNITS, None, "the sampling 'random' needs a number of runs, 1 or more."),
    ("saltelli", UNITS, 0, "the number of runs is 0; it must be 1 or more."),
    ("random", UNITS, 2.5, "the number of runs is 2.5; it must be a whole number."),
    ("grid", UNITS, None, "but a uniform distribution, number 1 of the factors, has none"),
    ("grid", parse("1,2", "integers(1, 9999)"), None, "a range of integers, number 2 of the factors, has"),
    ("grid", parse("1,2"), 4, "'grid' does not accept a number of runs: a grid is as large as its levels"),
    ("one-at-a-time", UNITS, 4, "'one-at-a-time' does not accept a number of runs: it runs the nominal"),
]


@pytest.mark.parametrize(("method", "factors", "runs", "hint"), INVALID)
def test_invalid_samplings_give_one_message(method: str, factors: Any, runs: Any, hint: str) -> None:
    with pytest.raises(CommandError) as caught:
        sample(method, factors, runs, 0)
    text = str(caught.value)
    assert hint in text
    assert text.endswith(".") and "\n" not in text


@pytest.mark.parametrize("seed", [-1, 0.5])
def test_seeds_are_whole_numbers_from_0(seed: Any) -> None:
    with pytest.raises(CommandError, match="must be a whole number"):
        sample("random", UNITS, 4, seed)


def test_runs_and_seed_can_be_numpy_integers() -> None:
    assert sample("random", UNITS, np.int64(3), np.uint8(4)) == sample("random", UNITS, 3, 4)  # type: ignore[arg-type]
