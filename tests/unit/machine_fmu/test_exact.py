"""Exact numbers: they disappear from calculations with floats and with symbols alike."""

import casadi
import pytest

from fmublock.symbol import Symbol
from machine_fmu.exact import ONE, ZERO, is_zero


@pytest.mark.parametrize("x", [2.5, Symbol(casadi.SX.sym("x"))], ids=["float", "symbol"])
def test_exact_zero_and_one_change_no_number(x: object) -> None:
    assert ZERO + x is x  # type: ignore[operator]
    assert x + ZERO is x  # type: ignore[operator]
    assert x - ZERO is x  # type: ignore[operator]
    assert ONE * x is x  # type: ignore[operator]
    assert x / ONE is x  # type: ignore[operator]
    assert is_zero(ZERO * x)  # type: ignore[operator]
    assert is_zero(ZERO / x)  # type: ignore[operator]


def test_division_by_an_exact_zero_is_an_error() -> None:
    with pytest.raises(ZeroDivisionError, match="singular in every pose"):
        1.0 / ZERO
