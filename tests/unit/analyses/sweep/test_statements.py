"""Random draws give intervals for the share of failures and for quantiles; other samplings give none."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from emla_cosim.analyses.sweep.report import OUTPUTS, build_report
from emla_cosim.analyses.sweep.sensitivity import make_statements
from tests.support.sweep_results import swept

N = 200
VALUES = np.random.default_rng(0).normal(size=N)


def draws(sampling: str, failing: int = 0, **fields: Any) -> Any:
    is_held = [i >= failing for i in range(N)]
    return swept({"a": range(N), "b": range(N)}, {"x.held": is_held, "f": VALUES}, sampling, **fields)


def test_report_states_the_bound_of_the_share_of_failures() -> None:
    (sentence,) = build_report(draws("random")).sections[0].lines[1:]
    assert sentence == "0 of 200 variants not held: below 1.5 % with 95 % confidence."
    (sentence,) = build_report(draws("random", N)).sections[0].lines[1:]
    assert sentence == "All 200 variants not held: above 98.5 % with 95 % confidence."


def test_share_that_is_not_held_has_the_exact_interval() -> None:
    record = OUTPUTS.record(draws("random", 3))
    expected = binomtest(3, N).proportion_ci(0.95)
    share = record["statements"]["not held"]
    assert (share["count"], share["total"]) == (3, N)
    assert (share["low"], share["high"]) == pytest.approx((expected.low, expected.high), rel=1e-9)


def test_variants_that_are_not_done_count_as_failures() -> None:
    status = ["diverged"] * 2 + ["done"] * (N - 2)
    statements = make_statements(draws("random", 3, status=status))
    assert statements is not None and statements.count == 3
    without_verdict = swept({"a": range(N)}, {"f": VALUES}, "random", status)
    assert OUTPUTS.record(without_verdict)["statements"]["not done"]["count"] == 2


def test_quantiles_have_intervals() -> None:
    quantiles = OUTPUTS.record(draws("random"))["quantiles"]
    assert list(quantiles) == ["f"]
    median = quantiles["f"]["median"]
    assert median["value"] == np.median(VALUES)
    assert median["low"] < np.median(VALUES) < median["high"]
    assert {median["low"], median["high"]} <= set(VALUES.tolist())


def test_few_draws_leave_an_end_of_an_interval_open() -> None:
    report = build_report(swept({"a": range(8)}, {"f": range(8)}, "random"))
    (table,) = (t for section in report.sections for t in section.tables if "confidence" in t.title)
    assert table.rows == [["f", "3.5", "0 to 7", "6.65", "from 5", ""]]


@pytest.mark.parametrize("sampling", ["latin-hypercube", "sobol"])
def test_evenly_spread_draws_state_their_assumption(sampling: str) -> None:
    statements = make_statements(draws(sampling, 3))
    assert statements is not None
    assert f"sampling {sampling} are spread more evenly" in statements.sentences[1]
    assert statements.quantiles


def test_base_samples_of_saltelli_count_once() -> None:
    statements = make_statements(draws("saltelli", 6))
    assert statements is not None
    assert (statements.count, statements.total, statements.quantiles) == (2, 50, {})
    assert statements.sentences[0].startswith("2 of 50 base samples not held: 4 %, ")


@pytest.mark.parametrize("result", [draws("grid"), draws("one-at-a-time"), draws("random", complete=False)])
def test_no_statement_without_random_draws(result: Any) -> None:
    assert make_statements(result) is None
    assert not {"statements", "quantiles"} & set(OUTPUTS.record(result))
