"""Intervals of shares and quantiles, compared with SciPy's and with how often they hold the truth."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, quantile_test

from emla_cosim.analyses.frame.confidence import describe_share, quantile_interval, share_interval


@given(st.integers(2, 400), st.data())
def test_shares_are_those_of_clopper_and_pearson(total: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(1, total - 1))
    interval = binomtest(count, total).proportion_ci(0.95, "exact")
    assert share_interval(count, total) == pytest.approx((interval.low, interval.high), rel=1e-8)


@given(st.integers(1, 2000))
def test_what_never_occurred_has_a_one_sided_bound(total: int) -> None:
    bound = 1.0 - 0.05 ** (1.0 / total)
    assert share_interval(0, total) == pytest.approx((0.0, bound))
    assert share_interval(total, total) == pytest.approx((1.0 - bound, 1.0))


@given(st.integers(1, 300), st.sampled_from([0.05, 0.5, 0.95]))
def test_quantiles_are_between_the_same_order_statistics_as_scipys(count: int, quantile: float) -> None:
    values = np.random.default_rng(count).normal(size=count)
    interval = quantile_test(values, p=quantile).confidence_interval(0.95)
    low, high = quantile_interval(values, quantile)
    assert (low == interval.low) or (low == -math.inf and math.isnan(interval.low))
    assert (high == interval.high) or (high == math.inf and math.isnan(interval.high))


def test_an_interval_of_a_quantile_holds_it_as_often_as_it_says() -> None:
    draws = np.random.default_rng(1).uniform(size=(2000, 80))
    is_inside = [low <= 0.9 <= high for low, high in (quantile_interval(row, 0.9) for row in draws)]
    assert 0.95 - 0.015 <= np.mean(is_inside)


@pytest.mark.parametrize(
    ("count", "total", "sentence"),
    [
        (0, 200, "0 of 200 failed: below 1.5 % with 95 % confidence"),
        (200, 200, "all 200 failed: above 98.5 % with 95 % confidence"),
        (10_000, 10_000, "all 10000 failed: above 99.97 % with 95 % confidence"),
        (9_999, 10_000, "9999 of 10000 failed: 99.99 %, 99.944 % to 99.99975 % with 95 % confidence"),
        (12, 200, "12 of 200 failed: 6 %, 3.1 % to 10.2 % with 95 % confidence"),
    ],
)
def test_a_share_is_one_sentence(count: int, total: int, sentence: str) -> None:
    assert describe_share(count, total, "failed") == sentence
