"""Distributions equal those of SciPy, keep their bounds, and have the same short and long forms."""

import math
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy import stats

from emla_cosim.analyses.variants.distributions import parse_distribution
from emla_cosim.analyses.variants.kinds import Distribution
from emla_cosim.base.errors import CommandError


class TruncatedLogNormal:
    """SciPy has none; it is exp of a truncated normal distribution."""

    def __init__(self, median: float, deviation: float, low: float, high: float) -> None:
        bounds = np.log(np.array([low, high]) / median) / deviation
        self._logarithm = stats.truncnorm(*bounds, loc=math.log(median), scale=deviation)

    def ppf(self, quantiles: np.ndarray) -> np.ndarray:
        return np.exp(self._logarithm.ppf(quantiles))


KINDS: list[tuple[str, Any]] = [
    ("uniform(-2, 5)", stats.uniform(-2, 7)),
    ("log-uniform(1e-3, 1e3)", stats.loguniform(1e-3, 1e3)),
    ("normal(0.14, 0.01)", stats.norm(0.14, 0.01)),
    ("normal(0.14, 0.01, 0.13, 0.145)", stats.truncnorm(-1, 0.5, 0.14, 0.01)),
    ("normal(1, 2, low=0)", stats.truncnorm(-0.5, np.inf, 1, 2)),
    ("normal(0, 1, low=7)", stats.truncnorm(7, np.inf)),
    ("normal(0, 1, -8, -6)", stats.truncnorm(-8, -6)),
    ("log-normal(3, 0.5)", stats.lognorm(0.5, scale=3)),
    ("log-normal(3, 0.5, 2, 8)", TruncatedLogNormal(3, 0.5, 2, 8)),
    ("triangular(-1, 0, 4)", stats.triang(0.2, -1, 5)),
    ("triangular(1, 1, 2)", stats.triang(0, 1, 1)),
    ("triangular(1, 2, 2)", stats.triang(1, 1, 1)),
]


def table(name: str, **fields: Any) -> dict[str, Any]:
    return {"distribution": name, **fields}


@pytest.mark.parametrize(("text", "expected"), KINDS)
def test_quantiles_equal_those_of_scipy(text: str, expected: Any) -> None:
    quantiles = np.array([1e-12, 1e-6, 0.01, 0.3, 0.5, 0.7, 0.99, 1 - 1e-6])
    np.testing.assert_allclose(
        parse_distribution(text, "x").at(quantiles), expected.ppf(quantiles), rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize(
    ("form", "values"),
    [
        ([3, 2, "x", True], [3, 2, "x", True]),
        ("integers(-3, 4)", list(range(-3, 5))),
        ([0.5], [0.5]),
        (["a", "a", "b"], ["a", "a", "b"]),
    ],
)
def test_values_have_equal_shares(form: Any, values: list[Any]) -> None:
    drawn = parse_distribution(form, "x")
    count = len(values)
    assert drawn.at(np.arange(count) / count + 1e-9) == values
    assert drawn.at((np.arange(count) + 1) / count - 1e-9) == values


finite = st.floats(-1e6, 1e6)
width = st.floats(1e-3, 1e6)
positive = st.floats(1e-6, 1e6)


@st.composite
def bounded(draw: st.DrawFn) -> Distribution:
    """A distribution of numbers of any kind with two bounds."""
    low, by, where = draw(finite), draw(width), draw(st.floats(0, 1))
    kind = draw(st.sampled_from(["uniform", "log-uniform", "normal", "log-normal", "triangular", "integers"]))
    if kind == "integers":
        return parse_distribution(table(kind, low=int(low), high=int(low) + int(by)), "x")
    if kind.startswith("log"):
        low = draw(positive)
    inner = min(low + where * by, low + by)
    more = {
        "normal": {"mean": inner, "deviation": draw(st.floats(0.1 * by, 100 * by))},
        "log-normal": {"median": inner, "deviation": draw(st.floats(0.5, 5))},
        "triangular": {"mode": inner},
    }
    return parse_distribution(table(kind, low=low, high=low + by, **more.get(kind, {})), "x")


@given(bounded(), st.lists(st.floats(0, 1), min_size=1, max_size=20))
@settings(deadline=None)
def test_values_rise_from_low_to_high(kind: Distribution, inner: list[float]) -> None:
    low, high = kind.low, kind.high  # type: ignore[attr-defined]
    values = np.array(kind.at(np.sort([0, *inner, 1])))
    assert values[0] == low and values[-1] == high and kind.ends == (low, high)
    assert (values >= low).all() and (values <= high).all()
    rounding = 8 * np.finfo(float).eps * np.maximum(abs(low), abs(high))
    assert (np.diff(values) >= -rounding).all()


@given(finite, positive)
@settings(deadline=None)
def test_unbounded_normal_has_finite_values(mean: float, by: float) -> None:
    kind = parse_distribution(table("normal", mean=mean, deviation=by), "x")
    assert np.isfinite(kind.at(np.array([0.0, 1.0]))).all()
    np.testing.assert_allclose(kind.ends, stats.norm(mean, by).ppf([0.05, 0.95]), rtol=1e-9, atol=1e-9 * by)
    assert parse_distribution(table("normal", mean=mean, deviation=by, low=mean), "x").ends[0] == mean


def test_log_normal_is_positive_at_quantile_0() -> None:
    assert parse_distribution("log-normal(1, 3)", "x").at(np.zeros(1))[0] > 0


@given(st.floats(-1e3, 1e3), width, st.integers(2, 50))
@settings(deadline=None)
def test_levels_are_evenly_spaced(low: float, by: float, points: int) -> None:
    kind = parse_distribution(f"{low!r}:{low + by!r}:{points}", "x")
    levels = kind.levels
    assert levels is not None and len(levels) == points == kind.level_count
    assert (levels[0], levels[-1]) == (low, low + by)
    np.testing.assert_allclose(
        levels, np.linspace(low, low + by, points), rtol=1e-12, atol=1e-12 * (1e3 + by)
    )


def test_levels_of_other_kinds() -> None:
    logarithmic = parse_distribution("log-uniform(0.01, 100, 5)", "x").levels
    np.testing.assert_allclose(logarithmic or [], [0.01, 0.1, 1, 10, 100], rtol=1e-14)
    assert parse_distribution("0:1:11", "x").levels == [i / 10 for i in range(11)]
    assert list(parse_distribution("integers(2, 5)", "x").levels or []) == [2, 3, 4, 5]
    assert parse_distribution("b,a", "x").levels == ["b", "a"]
    for text in ("0:1", "normal(0, 1)", "log-normal(1, 1)", "triangular(0, 1, 2)", "integers(1, 1001)"):
        kind = parse_distribution(text, "x")
        assert kind.levels is kind.level_count is None
    assert parse_distribution("integers(1, 1000)", "x").level_count == 1000
    assert parse_distribution("0:1:1000000000000000", "x").level_count == 10**15  # not made to be counted


def test_ends_of_listed_values() -> None:
    assert parse_distribution("3,1,2", "x").ends == (1, 3)
    assert parse_distribution("c,a,b", "x").ends == ("c", "b")
    assert parse_distribution("true,false", "x").ends == (True, False)


def test_wide_ranges_and_large_integers_are_exact() -> None:
    assert parse_distribution("triangular(-8e307, 0, 8e307)", "x").at(np.array([0.5])) == [0.0]
    middle = parse_distribution("log-uniform(1e-300, 1e300)", "x").at(np.array([0.5]))
    assert middle == pytest.approx([1.0], rel=1e-12)
    largest = 2**53
    ends = parse_distribution(f"integers(-{largest}, {largest})", "x").at(np.array([0.0, 0.5, 1.0]))
    assert ends == [-largest, 0, largest]


FORMS: list[tuple[str, Any]] = [
    ("0.05:0.3", table("uniform", low=0.05, high=0.3)),
    (" -1 : 1e-2 ", table("uniform", low=-1, high=0.01)),
    ("0.05:0.3:20", table("uniform", low=0.05, high=0.3, points=20)),
    ("1,2.5,3", [1, 2.5, 3]),
    ("rsba, 1, true", ["rsba", 1, True]),
    ("0.2", 0.2),
    ("models/plant.fmu", ["models/plant.fmu"]),
    ("±10%", table("uniform", low=0.9, high=1.1, relative=True)),
    ("+- 2.5 %", table("uniform", low=0.975, high=1.025, relative=True)),
    ("80%:120%:5", table("uniform", low=0.8, high=1.2, points=5, relative=True)),
    ("90%,100%", table("values", values=[0.9, 1.0], relative=True)),
    ("0%", table("values", values=[0.0], relative=True)),
    ("normal(0.14, 0.01)", table("normal", mean=0.14, deviation=0.01)),
    ("normal(0.14, 0.01, high=0.15)", table("normal", mean=0.14, deviation=0.01, high=0.15)),
    ("normal (1, 0.1, relative=true)", table("normal", mean=1, deviation=0.1, relative=True)),
    ("log-normal(median=2, deviation=1)", table("log-normal", median=2, deviation=1)),
    ("log-uniform(1, 10, 3)", table("log-uniform", low=1, high=10, points=3)),
    ("triangular(0, 1, 2)", table("triangular", low=0, mode=1, high=2)),
    ("integers(1, 6)", table("integers", low=1, high=6)),
    ("values(a, 2)", table("values", values=["a", 2])),
]


@pytest.mark.parametrize(("text", "plain"), FORMS)
def test_short_forms_are_read_as_tables(text: str, plain: Any) -> None:
    read = parse_distribution(text, "x")
    assert read == parse_distribution(plain, "x") == parse_distribution(read, "x")
    assert read.relative == (isinstance(plain, Mapping) and plain.get("relative", False))
    assert pickle.loads(pickle.dumps(read)) == read and hash(read) == hash(parse_distribution(plain, "x"))


def test_values_keep_their_types() -> None:
    def types(form: Any) -> list[type]:
        return [type(v) for v in parse_distribution(form, "x").levels or ()]

    assert types("1,2") == [int, int] and types("1,2.0") == types([1, 0.5]) == [float, float]
    assert types("1,true,x") == [int, bool, str] and types([1, 2.0, "x"]) == [int, float, str]
    assert types("1_000,0x10,١") == [str, str, str]  # no numbers as engineers write them
    assert types(np.array([1, 2])) == [int, int] and types([np.float64(1), np.int32(2)]) == [float, float]
    assert types([Path("a"), "b"]) == [str, str] and types(np.float32(0.5)) == [float] and types(range(2))


BAD: list[tuple[Any, str]] = [
    (table("nromal"), "there is no distribution 'nromal'; did you mean normal or log-normal?"),
    (table("cauchy"), "there is no distribution 'cauchy'; there are uniform, log-uniform, normal,"),
    ({"low": 0, "high": 1}, "the table has no distribution; write distribution = one of uniform"),
    (table("uniform", low=0), "a uniform distribution needs low and high."),
    (table("normal", mean=0, deviatoin=1), "has the unknown entry 'deviatoin'; did you mean"),
    (table("uniform", low=0, high=1, xyz=2), "unknown entry 'xyz'; use low, high, points and relative."),
    (table("uniform", low=1, high=1), "needs low < high; 1.0 to 1.0 is an empty range."),
    (table("integers", low=2, high=1), "needs low <= high; 2 to 1 is an empty range."),
    (table("normal", mean=0, deviation=1, low=2, high=1), "2.0 to 1.0 is an empty range."),
    (table("uniform", low=0, high=math.inf), "high of a uniform distribution is inf; it must be a finite"),
    (table("normal", mean=0, deviation=0), "a normal distribution needs deviation > 0; it is 0.0."),
    (table("log-uniform", low=0, high=1), "a log-uniform distribution needs low > 0; it is 0.0."),
    (table("log-normal", median=-1, deviation=1), "a log-normal distribution needs median > 0; it is -1.0."),
    (table("triangular", low=0, mode=2, high=1), "needs low <= mode <= high; mode is 2.0, outside 0.0 to"),
    (table("uniform", low=0, high=1, points=1), "needs 2 points or more, including both ends; points is 1."),
    (table("uniform", low=0, high=1, points=2.5), "points of a uniform distribution is 2.5; it must be a"),
    (table("uniform", low="0", high=1), "low of a uniform distribution is '0'; it must be a number."),
    (table("uniform", low=10**400, high=1), "it must be a number."),
    (table("uniform", low=0, high=1, relative="yes"), "is 'yes'; it must be true or false."),
    (table("uniform", low=-1e308, high=1e308), "cannot be as wide as -1e+308 to 1e+308: high - low must be"),
    (table("normal", mean=0, deviation=1e308), "a normal distribution as wide as this exceeds 1.8e308"),
    (table("log-normal", median=1, deviation=100), "a log-normal distribution as wide as this exceeds"),
    (table("normal", mean=0, deviation=1, low=50), "has no values between its low and high;"),
    (table("log-normal", median=1, deviation=0.1, low=100, high=200), "has no values between its low and"),
    (table("integers", low=0, high=2**53 + 1), "supports integers up to 2^53, 9007199254740992;"),
    (table("integers", low=0.5, high=2), "low of a range of integers is 0.5; it must be a whole number."),
    (table("values", values=[]), "a list of values needs one value or more; it is empty."),
    (table("values", values="abc"), "values of a list of values is 'abc'; it must be a list."),
    (table("values", values=[True], relative=True), "that is relative needs factors; True is not a number."),
    ([1, [2, 3]], "'1' in values of a list of values is [2, 3]; it must be a number, true, false or a text."),
    (np.ones((2, 2)), "it must be a number, true, false or a text."),
    ([1, math.nan], "a list of values holds nan; its numbers must be finite."),
    ([2**60], "a list of values supports integers up to 2^53"),
    (None, "what varies is None; it must be a list of values, a text such as '0.1:0.3', or a table such as"),
    (b"1,2", "what varies is b'1,2'; it must be a list"),
    ("1e400:2", "low of a uniform distribution is inf; it must be a finite number."),
    ("0:1:2.0", "points of a uniform distribution is 2.0; it must be a whole number."),
    ("±0%", "the tolerance '±0%' must be more than 0 %."),
    ("normal()", "a normal distribution needs mean and deviation."),
    ("normal(10%, 1%)", "mean of a normal distribution is '10%'; it must be a number."),
    ("normal(0, 1, 2, 3, 4)", "takes 4 arguments at most: mean, deviation, low and high; here are 5."),
    ("normal(mean=0, 1)", "positional arguments must precede keyword arguments."),
    ("normal(0, deviation=1, deviation=2)", "a normal distribution has deviation twice; remove one."),
    ("values()", "a list of values needs values."),
]

NO_FORM = ["", " ", "1:", ":", "a:b", "1:2:3:4", "1:true", "80%:120", "80:120%", "80%:120%:5%", "1,,2", ","]
NO_FORM += ["1,", "±10", "±", "+-x%", "±true%", "90%,1", "normal(0, 1", "0, 1)", "normal(0,,1)", "(1, 2)"]


@pytest.mark.parametrize(("form", "hint"), BAD)
def test_invalid_distributions_give_one_message(form: Any, hint: str) -> None:
    with pytest.raises(CommandError) as caught:
        parse_distribution(form, "R_s in plan.toml")
    text = str(caught.value)
    assert text.startswith("R_s in plan.toml: ") and hint in text
    assert text.endswith((".", "?")) and "\n" not in text


@pytest.mark.parametrize("text", NO_FORM)
def test_unknown_form_lists_the_forms(text: str) -> None:
    with pytest.raises(CommandError, match=r"^R_s: '.*' is not a distribution; write one of LOW:HIGH, .*A,B"):
        parse_distribution(text, "R_s")


@given(st.text(alphabet="0123456789.,:%±+-()=eE abnorml", max_size=30))
def test_any_text_is_a_distribution_or_a_message(text: str) -> None:
    try:
        kind = parse_distribution(text, "x")
    except CommandError as error:
        assert str(error).startswith("x: ")
    else:
        assert len(kind.at(np.array([0.0, 0.5, 1.0]))) == 3
