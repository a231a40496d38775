"""Functions give the same for all rows at once as for one float after the other."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fmublock
from fmublock.row_array import evaluate_rows

ONE_ARGUMENT = (
    "sin",
    "cos",
    "tan",
    "arcsin",
    "arccos",
    "arctan",
    "tanh",
    "exp",
    "log",
    "sqrt",
    "floor",
    "sign",
)
TWO_ARGUMENTS = ("arctan2", "mod", "minimum", "maximum")
NUMBERS = st.one_of(
    st.floats(-5.0, 5.0), st.sampled_from([0.0, -0.0, 1.0, -1.0, 800.0, math.inf, -math.inf, math.nan])
)


def equation(numbers: Any) -> list[Any]:
    """All functions, also with one constant, and constants alone."""
    x, y = numbers
    condition = fmublock.logical_and(x < y, fmublock.logical_not(fmublock.logical_or(x < 0.0, y > 1.0)))
    return [
        *(getattr(fmublock, name)(x) for name in ONE_ARGUMENT),
        *(getattr(fmublock, name)(x, y) for name in TWO_ARGUMENTS),
        fmublock.clamp(x, 0.5, y),
        fmublock.where(condition, x, y),
        fmublock.where(x >= y, 1.0, 2.0),
        x + 2.0 * y,
        7.0,
    ]


@given(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=20))
def test_rows_match_floats(rows: list[tuple[float, float]]) -> None:
    expected = [equation(row) for row in rows]
    assert evaluate_rows(equation, np.array(rows)) == pytest.approx(
        np.array(expected), rel=1e-14, nan_ok=True
    )
