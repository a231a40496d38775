"""Collect the constraints of an optimisation."""

from typing import Any

import casadi
import numpy as np


class Constraints:
    """Expressions with their bounds."""

    def __init__(self) -> None:
        self._expressions: list[casadi.MX] = []
        self._low: list[np.ndarray] = []
        self._high: list[np.ndarray] = []

    def require_zero(self, expression: casadi.MX) -> None:
        """Require that all elements are zero."""
        self.require_between(expression, 0.0, 0.0)

    def require_between(self, expression: casadi.MX, low: Any, high: Any) -> None:
        """Require that all elements are between bounds: numbers, or one for each element."""
        column = casadi.vec(expression)
        self._expressions.append(column)
        for bounds, values in ((self._low, low), (self._high, high)):
            bounds.append(np.broadcast_to(np.asarray(values, dtype=float), column.shape[0]))

    def require_between_with_slack(self, expression: casadi.MX, low: float, high: float, slack: Any) -> None:
        """Require as `require_between`, but allow `slack` beyond the bounds; None for none."""
        if slack is None:
            self.require_between(expression, low, high)
        else:
            column = casadi.vec(expression)
            self.require_between(column - slack, -np.inf, high)
            self.require_between(column + slack, low, np.inf)

    @property
    def expression(self) -> casadi.MX:
        """Return all expressions as a column."""
        return casadi.vertcat(*self._expressions)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds of that column."""
        return np.concatenate(self._low), np.concatenate(self._high)
