"""Constraints of an optimisation, gathered one after the other."""

from typing import Any

import casadi
import numpy as np


class Constraints:
    """What has to be between bounds."""

    def __init__(self) -> None:
        self._expressions: list[casadi.MX] = []
        self._low: list[np.ndarray] = []
        self._high: list[np.ndarray] = []

    def equal(self, expression: casadi.MX) -> None:
        """All elements have to be zero."""
        self.between(expression, 0.0, 0.0)

    def between(self, expression: casadi.MX, low: Any, high: Any) -> None:
        """All elements have to be between bounds, of which each is a number or one for each element."""
        column = casadi.vec(expression)
        self._expressions.append(column)
        for bounds, given in ((self._low, low), (self._high, high)):
            bounds.append(np.broadcast_to(np.asarray(given, dtype=float), column.shape[0]))

    def giving_way(self, expression: casadi.MX, low: float, high: float, slack: Any) -> None:
        """As `between`, by so much beyond the bounds as the slack says; None is none."""
        if slack is None:
            self.between(expression, low, high)
        else:
            column = casadi.vec(expression)
            self.between(column - slack, -np.inf, high)
            self.between(column + slack, low, np.inf)

    @property
    def expression(self) -> casadi.MX:
        """All of them as a column."""
        return casadi.vertcat(*self._expressions)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of that column."""
        return np.concatenate(self._low), np.concatenate(self._high)
