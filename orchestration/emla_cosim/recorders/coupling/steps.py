"""Compute residuals (the value that a consumer used minus the value of the source) during steps.

Within a step of length h, with 0 <= x <= 1 for its time, every value is a + b x + c (x - x^2) with three
coefficients (a, b, c). A source's own value is the parabola through its present, next and previous values.
A consumer uses a constant or a line. The integral of a product over a step is exactly h u' P v, with the
coefficients u and v and the matrix P = `PRODUCTS`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector
from ...master.algorithms.extrapolation import Mode

PRODUCTS = np.array([[1.0, 1 / 2, 1 / 6], [1 / 2, 1 / 3, 1 / 12], [1 / 6, 1 / 12, 1 / 30]])
"""Integrals of the products of 1, x and x - x^2 from 0 to 1."""


@dataclass(frozen=True)
class Use:
    """How consumers use a source: its column, and what they read; see `ContinuousConnection`."""

    column: int
    is_late: bool
    mode: int


class Steps:
    """Steps with the values at the previous point, at their begin and at their end.

    Args:
        before: Rows at the previous points, time in s first, shape (steps, columns).
        begin: Rows at the begin of the steps.
        end: Rows at the end of the steps.

    Attributes:
        lengths: Lengths of the steps in s.
        ratio: Lengths divided by those of the previous steps; 0 for the first step.
    """

    def __init__(self, before: Vector, begin: Vector, end: Vector) -> None:
        self.before, self.begin, self.end = before, begin, end
        self.lengths: Vector = end[:, 0] - begin[:, 0]
        previous = begin[:, 0] - before[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            self.ratio: Vector = np.where(previous > 0.0, self.lengths / previous, 0.0)[:, None]

    def values(self, columns: Sequence[int] | slice = slice(None)) -> Vector:
        """Return the coefficients of the sources' own values, (steps, 3, columns)."""
        begin, change, before = self._differences(columns)
        # weight of the second difference for unequal steps; 0 without a previous step
        share = np.where(self.ratio > 0.0, self.ratio / (1.0 + self.ratio), 0.0)
        return np.stack((begin, change, share * (before - change)), axis=1)

    def residuals(self, uses: Sequence[Use]) -> Vector:
        """Return the coefficients of the used values minus the sources' values, (steps, 3, uses)."""
        columns = [use.column for use in uses]
        values = self.values(columns)
        change, before = values[:, 1], self._differences(columns)[2]
        offset, slope = np.zeros_like(change), np.zeros_like(change)
        for i, use in enumerate(uses):
            offset[:, i], slope[:, i] = _used_value(use, change[:, i], before[:, i])
        return np.stack((offset, slope - change, -values[:, 2]), axis=1)

    def halved(self) -> "Steps":
        """Return the halves of all steps, with the sources' own values between."""
        half, earlier = self._at(0.5), self._at(-0.5)
        return Steps(
            np.concatenate((earlier, self.begin)),
            np.concatenate((self.begin, half)),
            np.concatenate((half, self.end)),
        )

    def _at(self, place: float) -> Vector:
        """Return the sources' own values at a fraction of the step."""
        return np.einsum("a,kai->ki", (1.0, place, place - place**2), self.values())

    def _differences(self, columns: Sequence[int] | slice) -> tuple[Vector, Vector, Vector]:
        """Return values at the begin, their change, and the previous change scaled to this length."""
        begin = self.begin[:, columns]
        return begin, self.end[:, columns] - begin, (begin - self.before[:, columns]) * self.ratio


def integral(lengths: Vector, first: Vector, second: Vector) -> Vector:
    """Return the integrals of all products over all steps, (first, second), of coefficients."""
    weighted = np.einsum("k,kai,ab->kbi", lengths, first, PRODUCTS, optimize=True)
    rows = 3 * len(lengths)
    return weighted.reshape(rows, -1).T @ second.reshape(rows, -1)


def _used_value(use: Use, change: Vector, before: Vector) -> tuple[Vector | float, Vector | float]:
    """Return offset (from the value at the begin of the step) and slope of the value that a consumer uses."""
    match use.mode, use.is_late:
        case Mode.HOLD, True:
            return 0.0, 0.0
        case Mode.HOLD, False:
            return change, 0.0
        case Mode.MIDDLE, True:
            return 0.5 * before, 0.0
        case Mode.MIDDLE, False:
            return 0.5 * change, 0.0
        case _, True:
            return 0.0, before
        case _:
            return 0.0, change
