"""A number that has a value in each of many rows, with which equations are evaluated for all rows at once."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .functions import Symbolic

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "fmod": np.fmod,
    "fmin": np.fmin,
    "fmax": np.fmax,
    "sign": np.sign,
    "if_else": np.where,
    "logic_and": np.logical_and,
    "logic_or": np.logical_or,
    "logic_not": np.logical_not,
}
"""NumPy's functions by the names that they have in CasADi."""


class RowArray(np.ndarray, Symbolic):
    """Values of a number, one for each row; functions of `fmublock` call it as they call a symbol."""

    def call(self, name: str, arguments: Sequence[Any]) -> Any:
        """Call the function that has this name in CasADi."""
        return np.asarray(_FUNCTIONS[name](*arguments)).view(RowArray)


def evaluate_rows(equation: Callable[..., Sequence[Any]], *tables: np.ndarray) -> np.ndarray:
    """Return the numbers that an equation gives, shape (rows, numbers); NaN where it has no value.

    Args:
        equation: Takes, for each table, a list of numbers, one for each column.
        tables: Arrays of shape (rows, columns), at least one.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        numbers = equation(*map(_split, tables))
    columns = np.empty((len(tables[0]), len(numbers)))
    for i, number in enumerate(numbers):
        columns[:, i] = number
    return columns


def _split(table: np.ndarray) -> list[RowArray]:
    return [column.view(RowArray) for column in np.ascontiguousarray(table.T)]
