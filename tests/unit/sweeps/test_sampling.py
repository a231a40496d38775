"""Samplings: their sizes, their order, their distributions, and that a seed says everything."""

import itertools
import math
import time
import warnings
from typing import Any

import numpy as np
import pytest
from SALib.analyze import sobol as sobol_analysis
from SALib.sample import sobol as sobol_sample
from scipy import stats
from scipy.stats import qmc

from emla_cosim.base.errors import CommandError
from emla_cosim.sweeps.distributions import Distribution, parse_distribution
from emla_cosim.sweeps.sampling import SAMPLINGS, count_variants, sample

DRAWING = ["random", "latin-hypercube", "sobol", "saltelli"]


def made(*given: Any) -> list[Distribution]:
    return [parse_distribution(g, "x") for g in given]


MIXED = made("normal(0.14, 0.01)", "log-uniform(1, 100)", "integers(0, 9)", ["a", "b", "c"])
UNITS = made("0:1", "0:1", "0:1")


def points(method: str, runs: int, seed: int = 0, d: int = 3) -> np.ndarray:
    """What a sampling draws of quantiles."""
    return np.array(sample(method, made(*["0:1"] * d), runs, seed)).T


def sizes(columns: list[list[Any]]) -> set[int]:
    return {len(column) for column in columns}


@pytest.mark.parametrize("method", DRAWING)
@pytest.mark.parametrize("runs", [1, 2, 100, 128])
def test_there_are_as_many_variants_as_counted_and_no_warnings(method: str, runs: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        columns = sample(method, MIXED, runs, 1)
    expected = runs * 6 if method == "saltelli" else runs
    assert sizes(columns) == {expected} == {count_variants(method, MIXED, runs)} and len(columns) == 4


@pytest.mark.parametrize("method", DRAWING)
def test_values_are_distributed_as_they_should_be(method: str) -> None:
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
def test_a_seed_says_all_and_another_says_something_else(method: str) -> None:
    assert sample(method, MIXED, 100, 7) == sample(method, MIXED, 100, 7)
    assert points(method, 100, 7).tolist() != points(method, 100, 8).tolist()
    assert sample(method, MIXED, 4, 2**70)


@pytest.mark.parametrize("method", ["random", "sobol", "saltelli"])
def test_more_runs_begin_with_the_same_ones(method: str) -> None:
    few = points(method, 100)
    np.testing.assert_array_equal(points(method, 300)[: len(few)], few)


def test_a_latin_hypercube_has_one_point_in_each_stratum() -> None:
    strata = np.sort(np.floor(points("latin-hypercube", 250) * 250).astype(int), axis=0)
    np.testing.assert_array_equal(strata, np.tile(np.arange(250)[:, None], 3))


def test_sobol_is_a_scrambled_net() -> None:
    """One point in each of 2^m intervals of every dimension, and far more even than chance."""
    net = points("sobol", 256)
    strata = np.sort(np.floor(net * 256).astype(int), axis=0)
    np.testing.assert_array_equal(strata, np.tile(np.arange(256)[:, None], 3))
    assert qmc.discrepancy(net) < qmc.discrepancy(points("random", 256)) / 5


def test_a_grid_has_all_combinations_with_the_last_one_fastest() -> None:
    factors = made("0:1:3", ["a", "b"], "integers(4, 6)", "7")
    assert count_variants("grid", factors, None) == 18
    rows = list(zip(*sample("grid", factors, None, 0), strict=True))
    assert rows == list(itertools.product([0.0, 0.5, 1.0], "ab", [4, 5, 6], [7]))


def test_a_grid_beyond_all_memory_is_counted() -> None:
    assert count_variants("grid", made(*["0:1:1000000"] * 10), None) == 10**60
    assert count_variants("saltelli", UNITS, 2**30) == 5 * 2**30


def test_one_at_a_time_leaves_the_others_as_they_are() -> None:
    factors = made("1:2", "3,1,2", "normal(0, 1)")
    columns = sample("one-at-a-time", factors, None, 0)
    deviation = stats.norm.ppf(0.95)
    assert columns[0] == [None, 1.0, 2.0, None, None, None, None]
    assert columns[1] == [None, None, None, 1, 3, None, None]
    assert columns[2][:5] == [None] * 5 and columns[2][5:] == pytest.approx([-deviation, deviation])
    assert count_variants("one-at-a-time", factors, None) == 7


def ishigami(x: np.ndarray, a: float = 7.0, b: float = 0.1) -> np.ndarray:
    return np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0])


def test_saltelli_gives_the_sobol_indices_of_ishigamis_function() -> None:
    """Against its variances in closed form."""
    columns = sample("saltelli", made(*[f"{-math.pi}:{math.pi}"] * 3), 1024, 5)
    problem = {"num_vars": 3, "names": ["x", "y", "z"], "bounds": [[-math.pi, math.pi]] * 3}
    found = sobol_analysis.analyze(problem, ishigami(np.array(columns).T), calc_second_order=False, seed=1)
    a, b, pi = 7.0, 0.1, math.pi
    first = np.array([(1 + b * pi**4 / 5) ** 2 / 2, a**2 / 8, 0.0])
    together = b**2 * pi**8 * 8 / 225
    total = first + np.array([together, 0.0, together])
    variance = first.sum() + together
    assert (abs(found["S1"] - first / variance) <= found["S1_conf"] + 1e-12).all()
    assert (abs(found["ST"] - total / variance) <= found["ST_conf"] + 1e-12).all()
    assert (found["S1_conf"] < 0.15).all() and (found["ST_conf"] < 0.15).all()


def test_saltelli_is_salibs() -> None:
    problem = {"num_vars": 3, "names": ["x", "y", "z"], "bounds": [[0, 1]] * 3}
    expected = sobol_sample.sample(problem, 64, calc_second_order=False, seed=np.random.default_rng(9))
    np.testing.assert_array_equal(points("saltelli", 64, 9), expected)


@pytest.mark.parametrize("method", ["random", "latin-hypercube", "sobol"])
def test_a_hundred_thousand_runs_take_little_time(method: str) -> None:
    factors = made(*["normal(0, 1, -2, 2)"] * 10)
    start = time.process_time()
    assert sizes(sample(method, factors, 100_000, 0)) == {100_000}
    assert time.process_time() - start < 5  # 0.1 to 0.3 s on an idle machine


@pytest.mark.parametrize(
    ("method", "factors", "runs", "seed", "hint"),
    [
        (
            "sobl",
            UNITS,
            4,
            0,
            "there is no sampling 'sobl'; choose from grid, random, latin-hypercube, sobol, sal",
        ),
        ("random", [], 4, 0, "nothing varies; a sampling needs at least one distribution."),
        ("random", UNITS, None, 0, "the sampling 'random' needs a number of runs, 1 or more."),
        ("saltelli", UNITS, 0, 0, "the number of runs is 0; it must be 1 or more."),
        ("sobol", UNITS, -3, 0, "the number of runs is -3; it must be 1 or more."),
        ("random", UNITS, 2.5, 0, "the number of runs is 2.5; it must be a whole number."),
        ("random", UNITS, True, 0, "the number of runs is True; it must be a whole number."),
        ("random", UNITS, "9", 0, "the number of runs is '9'; it must be a whole number."),
        ("random", UNITS, 4, -1, "the seed -1 must be a whole number from 0."),
        ("random", UNITS, 4, 0.5, "the seed is 0.5; it must be a whole number."),
        (
            "grid",
            UNITS,
            None,
            0,
            "a grid needs levels, but a uniform distribution, number 1 of the factors, has none",
        ),
        (
            "grid",
            made("1,2", "integers(1, 9999)"),
            None,
            0,
            "a range of integers, number 2 of the factors, has none",
        ),
        (
            "grid",
            made("1,2"),
            4,
            0,
            "'grid' has no number of runs: a grid is as large as its levels make it.",
        ),
        ("one-at-a-time", UNITS, 4, 0, "'one-at-a-time' has no number of runs: it runs the nominal variant"),
        (
            "sobol",
            UNITS * 7068,
            4,
            0,
            "'sobol' can vary at most 21201 factors, as Sobol's sequence has no more dimensions;",
        ),
        ("saltelli", UNITS * 3534, 4, 0, "'saltelli' can vary at most 10600 factors"),
        ("sobol", UNITS, 2**30 + 1, 0, "the sampling 'sobol' has at most 1073741824 runs"),
    ],
)
def test_what_is_wrong_is_one_sentence(method: str, factors: Any, runs: Any, seed: Any, hint: str) -> None:
    with pytest.raises(CommandError) as caught:
        sample(method, factors, runs, seed)
    text = str(caught.value)
    assert hint in text and text.endswith(".") and "\n" not in text


def test_a_number_of_runs_and_a_seed_may_be_numpys() -> None:
    assert sample("random", UNITS, np.int64(3), np.uint8(4)) == sample("random", UNITS, 3, 4)  # type: ignore[arg-type]


def test_every_sampling_says_whether_it_takes_runs() -> None:
    assert [name for name, sampling in SAMPLINGS.items() if sampling.takes_runs] == DRAWING


def test_scipys_number_of_dimensions_is_the_one_in_sentences() -> None:
    assert qmc.Sobol.MAXDIM == 21201
