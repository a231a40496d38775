"""Exact numbers: they disappear from calculations with floats and with symbols alike."""

import casadi
import pytest

from fmublock.symbol import Symbol
from machine_fmu.exact import MINUS_ONE, ONE, ZERO, Exact, exact, is_zero, plain


@pytest.mark.parametrize("x", [2.5, Symbol(casadi.SX.sym("x"))], ids=["float", "symbol"])
def test_zero_and_one_leave_a_number_as_it_is(x: object) -> None:
    assert ZERO + x is x  # type: ignore[operator]
    assert x + ZERO is x  # type: ignore[operator]
    assert x - ZERO is x  # type: ignore[operator]
    assert ONE * x is x  # type: ignore[operator]
    assert x / ONE is x  # type: ignore[operator]
    assert is_zero(ZERO * x)  # type: ignore[operator]
    assert is_zero(ZERO / x)  # type: ignore[operator]


def test_exact_numbers_calculate_as_numbers() -> None:
    assert ONE + MINUS_ONE is ZERO
    assert MINUS_ONE * MINUS_ONE is ONE
    assert ONE + ONE == 2.0
    assert 3.0 - MINUS_ONE == 4.0
    assert MINUS_ONE - 3.0 == -4.0
    assert 5.0 / MINUS_ONE == -5.0
    assert (ONE / 4.0, plain(MINUS_ONE), plain(7.0)) == (0.25, -1.0, 7.0)


def test_only_constants_become_exact() -> None:
    assert isinstance(exact(0.0), Exact)
    assert isinstance(exact(-1), Exact)
    assert exact(0.5) == 0.5


def test_division_by_an_exact_zero_is_an_error() -> None:
    with pytest.raises(ZeroDivisionError, match="singular in every pose"):
        1.0 / ZERO
