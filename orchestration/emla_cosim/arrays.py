"""Arrays as all rooms call them."""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""Numbers: a vector, or rows of them."""

Indices = NDArray[np.intp]
"""Positions in a vector."""

Mask = NDArray[np.bool_]
"""Truths in one or two dimensions."""
