"""Arrays as all rooms call them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""Numbers: a vector, or rows of them."""

Indices = NDArray[np.intp]
"""Positions in a vector."""

Mask = NDArray[np.bool_]
"""Truths in one or two dimensions."""


def count_true_per_row(rows: Mask) -> Indices:
    """Return how many truths each row has; NumPy counts along an axis ten times as slowly."""
    return np.array([np.count_nonzero(row) for row in rows], dtype=np.intp)


def read_stored_array(values: Any, *shapes: tuple[int, ...]) -> Vector:
    """Return numbers of a checkpoint as an array; ValueError where they have none of these shapes."""
    array = np.array(values, dtype=float)
    for shape in shapes:
        if array.shape == shape or (array.size == 0 and 0 in shape):  # plain lists forget (0, 3)
            return array.reshape(shape)
    raise ValueError(f"numbers of shape {array.shape} instead of {' or '.join(map(str, shapes))}")
