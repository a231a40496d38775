"""Linear systems without pivots."""

import pytest

from machine_fmu.exact import ZERO
from machine_fmu.linear import Factors


def test_zero_pivots_are_supported() -> None:
    """Elimination without pivots would divide by zero."""
    assert Factors([[0.0, 1.0], [1.0, 0.0]]).solve([2.0, 3.0]) == pytest.approx([3.0, 2.0])
    assert Factors([[ZERO, 1.0], [2.0, ZERO]]).solve([2.0, 3.0]) == pytest.approx([1.5, 2.0])
