"""Metrics of variants can be names, expressions over signals and functions."""

import sys
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emla_cosim.analyses.variants.measures import MeasureError, Measures, MetricRequest, resolve_measures
from emla_cosim.base.errors import CommandError
from emla_cosim.recorders.metrics import Figure

FIGURES = {
    f"{j}.{n}": Figure(j, n, x)
    for j, n, x in [("lift", "error_m", 0.0), ("lift", "held", True), ("tilt", "error_m", 0.0)]
}
SIGNALS = ["lift.plant.x", "lift.plant.x_d", "lift.plant.x[1]", "a'b.x", 'say "x".y', "lift.plant.x.x"]
TIMES = np.array([0.0, 0.1, 0.2, 0.3])
VALUES = {name: np.array([1.0, -3.0, 2.0, 0.5]) * (k + 1) for k, name in enumerate(SIGNALS)}


def resolve(metrics: Any, signals: tuple[str, ...] = ()) -> Measures:
    return resolve_measures(MetricRequest.of(metrics, "the plan"), FIGURES, SIGNALS, [], signals, "the plan")


def result(lift: dict[str, Any] | None = None) -> Any:
    """As much of a result as measures look at, with figures of lift."""
    table = {"time": TIMES, **VALUES}
    metrics = {"joints": {"lift": lift or {}}}
    return SimpleNamespace(metrics=metrics, read=lambda names: {n: table[n] for n in names})


def test_without_metrics_all_figures_are_kept() -> None:
    measures = resolve([])
    assert measures.names == list(FIGURES)
    assert measures.truths == ["lift.held"]
    assert measures.read == []
    figures = measures.of(result({"error_m": 1.0, "held": True}))
    assert figures == {"lift.error_m": 1.0, "lift.held": True, "tilt.error_m": None}


def test_patterns_keep_the_order_of_the_plan_and_each_figure_once() -> None:
    assert resolve(["tilt.*", "*.error_m"]).names == ["tilt.error_m", "lift.error_m"]


@pytest.mark.parametrize(
    "expression, value",
    [
        ("max(abs(lift.plant.x_d))", 6.0),
        ("max(lift.plant.x[1])", 6.0),
        ("max(a'b.x)", 8.0),
        ('max(say "x".y)', 10.0),
        ("max(lift.plant.x.x) - min(lift.plant.x)", 15.0),
        ('max("lift.plant.x")', 2.0),
        ("max(abs(lift.plant.x)) filter (where time > 0.15)", 2.0),
        ("sqrt(avg(lift.plant.x * lift.plant.x))", float(np.sqrt(np.mean(VALUES["lift.plant.x"] ** 2)))),
        ("max(lift.plant.x) > 1.5", True),
        ("last(lift.plant.x)", 0.5),
        ("max(time)", 0.3),
        ("max(case when time > 9 then time end)", None),
    ],
)
def test_expressions_use_signals_by_name(expression: str, value: float | bool | None) -> None:
    measures = resolve([f"mine = {expression}"])
    assert measures.names == ["mine"]
    assert measures.of(result()) == {"mine": value if value is None else pytest.approx(value)}
    assert measures.truths == (["mine"] if isinstance(value, bool) else [])


def test_only_the_signals_of_expressions_are_recorded() -> None:
    assert resolve(["mine = max(lift.plant.x_d)"]).read == ["lift.plant.x_d"]
    signals = ["lift.plant.x", "lift.plant.x_d"]
    assert resolve(["mine = max(lift.plant.x_d)"], ("lift.plant.x",)).read == signals
    assert resolve({"mine": lambda r: 1.0}).read == sorted(SIGNALS)


@given(st.sampled_from(SIGNALS), st.sampled_from(SIGNALS))
def test_any_two_signals_can_be_combined(first: str, second: str) -> None:
    value = resolve({"mine": f"sum({first}) + 2 * max({second})"}).of(result())["mine"]
    assert value == pytest.approx(sum(VALUES[first]) + 2 * max(VALUES[second]))


@pytest.mark.parametrize(
    "metrics, words",
    [
        (["lift.eror_m"], r"no metric matches 'lift\.eror_m'; did you mean lift\.error_m"),
        (["mine = max("], "'mine = max.' cannot be computed: unable to parse"),
        (["mine = foo(lift.plant.x)"], "unsupported function 'foo'"),
        (["mine = lift.plant.x"], "gives a value for each row; apply max"),
        (["mine = max(lift.plant.y)"], r"Did you mean lift\.plant\.x"),
        (["mine = 'text'"], "neither a number nor a Boolean"),
        (["lift.error_m = max(lift.plant.x)", "*.error_m"], "two columns 'lift.error_m'"),
        (["status = max(lift.plant.x)"], "two columns 'status'"),
        (["a = max(time)", "a = min(time)"], "two columns 'a'"),
        (["(select 1)"], "no metric matches"),
        (["mine = (select 1)"], "cannot be computed"),
        ([3], "a metric of the plan is 3; it must be"),
        ([""], "a metric of the plan is ''; it must be"),
        ("lift.error_m", "must be a list or a table"),
        (3, "must be a list or a table"),
    ],
)
def test_invalid_metrics_give_one_message(metrics: Any, words: str) -> None:
    with pytest.raises(CommandError, match=words):
        resolve(metrics)


def test_functions_return_numbers_booleans_or_none() -> None:
    functions = {"a": lambda r: np.float32(2.5), "b": lambda r: np.bool_(True), "c": lambda r: 10**400}
    assert resolve(functions).of(result()) == {"a": 2.5, "b": True, "c": np.inf}
    assert resolve({"none": lambda r: None}).of(result()) == {"none": None}

    def fails(_: Any) -> float:
        raise ValueError("mine")

    with pytest.raises(MeasureError, match=r"the metric 'fails' raised ValueError\('mine'\)"):
        resolve([fails]).of(result())
    with pytest.raises(MeasureError, match="neither a number nor a Boolean"):
        resolve({"text": lambda r: "x"}).of(result())


LIMIT = 1.0


def test_identity_of_functions_has_the_values_they_use(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a resumed sweep would mix figures of two functions with the same source."""

    def scaled(factor: float) -> Any:
        return lambda _: factor

    def is_below(_: Any, offset: float = 0.0) -> bool:
        return offset < LIMIT

    def identity(function: Any) -> list[Any]:
        return MetricRequest.of({"m": function}, "a plan").identity([])

    assert identity(scaled(1.0)) == identity(scaled(1.0)) != identity(scaled(2.0))
    assert identity(partial(is_below, offset=1.0)) != identity(partial(is_below, offset=2.0))
    before = identity(is_below)
    monkeypatch.setattr(sys.modules[__name__], "LIMIT", 2.0)
    assert identity(is_below) != before
    before = identity(is_below)
    monkeypatch.setattr(is_below, "__defaults__", (1.0,))
    assert identity(is_below) != before
