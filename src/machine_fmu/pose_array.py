"""A number that has a value in each of many poses, for the equations of a machine."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fmublock.functions import Symbolic

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "sqrt": np.sqrt,
    "if_else": np.where,
}
"""Functions of the equations by the name that CasADi gives them."""


class PoseArray(np.ndarray, Symbolic):
    """Values of a number, one for each pose; functions of `fmublock` call it as they call a symbol."""

    def call(self, name: str, arguments: Sequence[Any]) -> Any:
        """Call the function that CasADi gives this name."""
        return np.asarray(_FUNCTIONS[name](*arguments)).view(PoseArray)


def split(values: np.ndarray) -> list[Any]:
    """Return the columns of an array, one row per pose, as numbers."""
    return [column.view(PoseArray) for column in np.ascontiguousarray(values.T)]


def join(numbers: Sequence[Any], count: int) -> np.ndarray:
    """Return an array with numbers as columns, and a row for each of `count` poses."""
    columns = np.empty((count, len(numbers)))
    for i, number in enumerate(numbers):
        columns[:, i] = number
    return columns
