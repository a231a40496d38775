"""Passes over recorded rows in C; NumPy does the same where the C code cannot be built."""

import numpy as np

from ..base.arrays import Vector
from .library import find_stepper


def reduce_rows(rows: Vector) -> tuple[Vector, Vector, Vector] | None:
    """Return minimum, maximum and sum of squares of every column; None without the C code.

    Args:
        rows: Contiguous rows of doubles, shape (rows, columns). A column with NaN has NaN for all three.
    """
    library = find_stepper()
    if library is None or not rows.flags.c_contiguous:
        return None
    count, width = rows.shape
    low, high, squares = np.full(width, np.inf), np.full(width, -np.inf), np.zeros(width)
    results = (low.ctypes.data, high.ctypes.data, squares.ctypes.data)
    library.reduce_rows(rows.ctypes.data, count, width, *results)
    missing = np.isnan(squares)
    low[missing] = high[missing] = np.nan
    return low, high, squares
