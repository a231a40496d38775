"""The function set gives the same bits on floats and as generated from symbols."""

import math
import struct
from itertools import product

import casadi
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

import fmublock
from fmublock.noise import MODULUS, lehmer, normal, uniform

UNARY = (
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "tanh"),
    *("exp", "log", "sqrt", "floor", "sign", "logical_not"),
)
BINARY = ("arctan2", "minimum", "maximum", "mod", "logical_and", "logical_or")
SPECIAL = (0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 2.5, -2.5, 5e-324, 1e308, math.inf, -math.inf, math.nan)
finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
any_float = st.floats(width=64)


def _function(name: str, arity: int) -> casadi.Function:
    symbols = [casadi.SX.sym(f"x{i}") for i in range(arity)]
    return casadi.Function("f", symbols, [getattr(fmublock, name)(*symbols)])


SYMBOLIC = {name: _function(name, 1) for name in UNARY} | {name: _function(name, 2) for name in BINARY}


def _same(name: str, a: float, b: float) -> bool:
    """The same bits, or both NaN; of two zeros min and max may choose either."""
    if name in ("minimum", "maximum") and a == b == 0.0:
        return True
    return (math.isnan(a) and math.isnan(b)) or struct.pack("d", a) == struct.pack("d", b)


@pytest.mark.parametrize("name", UNARY)
@given(x=any_float)
def test_unary_functions_on_floats_agree_with_symbols(name: str, x: float) -> None:
    for value in (x, math.remainder(x, 4.0) if math.isfinite(x) else x):
        assert _same(name, getattr(fmublock, name)(value), float(SYMBOLIC[name](value)))


@pytest.mark.parametrize("name", BINARY)
@given(x=any_float, y=any_float)
def test_binary_functions_on_floats_agree_with_symbols(name: str, x: float, y: float) -> None:
    assert _same(name, getattr(fmublock, name)(x, y), float(SYMBOLIC[name](x, y)))


@pytest.mark.parametrize("name", [*UNARY, *BINARY])
def test_functions_agree_at_zeros_infinities_and_nan(name: str) -> None:
    arity = 1 if name in UNARY else 2
    for arguments in product(SPECIAL, repeat=arity):
        actual, expected = getattr(fmublock, name)(*arguments), float(SYMBOLIC[name](*arguments))
        assert _same(name, actual, expected), arguments


@pytest.mark.parametrize(
    "name", ["minimum", "maximum", "mod", "floor", "sign", "sin", "arctan2", "sqrt", "where"]
)
def test_functions_give_floats_of_whole_numbers_too(name: str) -> None:
    """An int zero would lose its sign."""
    arguments = {"where": (True, 3, 2)}.get(name, (3, 2))
    if name in UNARY:
        arguments = (4,)
    assert type(getattr(fmublock, name)(*arguments)) is float


@given(st.lists(st.tuples(finite, finite), min_size=1, max_size=5))
def test_dot_adds_from_the_first_element_on(pairs: list[tuple[float, float]]) -> None:
    expected = pairs[0][0] * pairs[0][1]
    for x, y in pairs[1:]:
        expected += x * y
    actual = fmublock.dot([x for x, _ in pairs], [y for _, y in pairs])
    assert _same("dot", actual, expected)


def test_matvec_refuses_a_short_vector() -> None:
    with pytest.raises(ValueError, match="shorter"):
        fmublock.matvec([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], [7.0, 8.0])


@given(x=finite, y=finite)
def test_where_ignores_the_other_branch(x: float, y: float) -> None:
    assert fmublock.where(x < y, x, math.nan if x < y else y) == min(x, y)


@given(x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6), limit=st.floats(1e-3, 1e6))
def test_limit_magnitude_keeps_direction_and_length(x: float, y: float, limit: float) -> None:
    a, b, limited = fmublock.limit_magnitude(x, y, limit)
    length = math.hypot(x, y)
    assert math.hypot(a, b) <= limit * (1 + 1e-12)
    assert limited == float(math.sqrt(x * x + y * y) > 1.000000001 * limit)
    if not limited:
        assert (a, b) == pytest.approx((x, y), rel=2e-9)
        assert math.sqrt(x * x + y * y) > limit or (a, b) == (x, y)  # rounded as there
    else:
        assert a == pytest.approx(x * limit / length)
        assert b == pytest.approx(y * limit / length)


@given(x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6), limit=st.floats(1e-3, 1e6))
def test_limited_value_is_not_limited_again(x: float, y: float, limit: float) -> None:
    a, b, _ = fmublock.limit_magnitude(x, y, limit)
    assert fmublock.limit_magnitude(a, b, limit)[2] == 0.0


def test_lehmer_is_the_park_miller_generator() -> None:
    """Park and Miller (1988): seeded with 1, the 10,000th number is 1043618065."""
    x = 1.0
    for _ in range(10_000):
        x = lehmer(x)
    assert x == 1043618065.0


@given(st.integers(1, int(MODULUS) - 1))
def test_lehmer_is_exact_in_doubles(seed: int) -> None:
    assert lehmer(float(seed)) == 16807 * seed % 2147483647


def test_noise_has_mean_zero_and_deviation_one() -> None:
    x, draws, flat = 20240901.0, [], []
    for _ in range(20_000):
        first = lehmer(x)
        x = lehmer(first)
        draws.append(normal(first, x))
        flat.append(uniform(x))
    # four standard errors of mean and deviation for 20,000 draws
    assert abs(np.mean(draws)) < 4 / math.sqrt(20_000)
    assert abs(np.std(draws) - 1.0) < 4 / math.sqrt(40_000)
    assert abs(np.mean(flat) - 0.5) < 4 / math.sqrt(12 * 20_000)
