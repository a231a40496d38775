"""Exact numbers."""

import pytest

from machine_fmu.exact import ZERO


def test_division_by_an_exact_zero_is_an_error() -> None:
    with pytest.raises(ZeroDivisionError, match="singular in every pose"):
        1.0 / ZERO
