"""Passes over recorded rows in C: twice as fast as NumPy, which matters in long runs."""

import numpy as np

from ..base.arrays import Vector
from .library import require_stepper


def reduce_rows(rows: Vector) -> tuple[Vector, Vector, Vector]:
    """Return minimum, maximum and sum of squares of every column.

    Args:
        rows: Contiguous rows of doubles, shape (rows, columns). A column with NaN has NaN for all three.

    Raises:
        RunError: The C code cannot be built or loaded on this machine.
    """
    count, width = rows.shape
    low, high, squares = np.full(width, np.inf), np.full(width, -np.inf), np.zeros(width)
    results = (low.ctypes.data, high.ctypes.data, squares.ctypes.data)
    require_stepper().reduce_rows(rows.ctypes.data, count, width, *results)
    missing = np.isnan(squares)
    low[missing] = high[missing] = np.nan
    return low, high, squares
