"""Linear systems without pivots against NumPy."""

import numpy as np
import pytest

from machine_fmu.exact import ZERO
from machine_fmu.linear import Factors, solve_symmetric

RANDOM = np.random.default_rng(7)


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_factors_solve_both_ways(n: int) -> None:
    A, b = RANDOM.normal(size=(n, n)), RANDOM.normal(size=n)
    factors = Factors(A.tolist())
    assert factors.solve(b.tolist()) == pytest.approx(np.linalg.solve(A, b), rel=1e-9)
    assert factors.solve_transposed(b.tolist()) == pytest.approx(np.linalg.solve(A.T, b), rel=1e-9)


def test_zero_pivots_are_supported() -> None:
    """Elimination without pivots would divide by zero."""
    assert Factors([[0.0, 1.0], [1.0, 0.0]]).solve([2.0, 3.0]) == pytest.approx([3.0, 2.0])
    assert Factors([[ZERO, 1.0], [2.0, ZERO]]).solve([2.0, 3.0]) == pytest.approx([1.5, 2.0])


@pytest.mark.parametrize("n", [1, 3, 6])
def test_symmetric_systems(n: int) -> None:
    A, b = RANDOM.normal(size=(n, n)), RANDOM.normal(size=n)
    M = A @ A.T + n * np.eye(n)
    assert solve_symmetric(M.tolist(), b.tolist()) == pytest.approx(np.linalg.solve(M, b), rel=1e-9)
