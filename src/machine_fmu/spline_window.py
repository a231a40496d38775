"""B-splines of degree 5 or less by arithmetic only, for blocks, which cannot index arrays by a value."""

from typing import Any, NamedTuple

from fmublock import logical_and, where

DEGREE = 5
"""The highest degree."""

COEFFICIENTS = 48
"""Largest number of coefficients of a spline."""

KNOTS = COEFFICIENTS + DEGREE + 1
"""Number of knots of such a spline."""

_SHIFTS = (16, 16, 8, 4, 2, 1)
"""Places by which `window` moves if the time is beyond them; together they reach every span."""


class Basis(NamedTuple):
    """Weights of a window's coefficients for position, speed and acceleration."""

    x: list[Any]
    v: list[Any]
    a: list[Any]

    def chosen(self, condition: Any, other: "Basis") -> "Basis":
        """Return this basis if the condition holds, else the other."""
        pairs = (zip(own, others, strict=True) for own, others in zip(self, other, strict=True))
        return Basis(*([where(condition, a, b) for a, b in pair] for pair in pairs))


def window(t: Any, knots: list[Any], rows: list[list[Any]]) -> tuple[list[Any], list[list[Any]]]:
    """Return the 10 knots around the span that contains t, and the 6 coefficients of each row for it.

    All arrays move together until they reach t. This takes six choices between two, instead of one of 48.
    """
    lead, end = [knots[0]] * DEGREE, knots[-1]
    arrays = [[*lead, *knots][1:], *([*[row[0]] * DEGREE, *row] for row in rows)]
    widths = [2 * DEGREE] + [DEGREE + 1] * len(rows)
    left = sum(_SHIFTS)
    for shift in _SHIFTS:
        left -= shift
        first = arrays[0][DEGREE - 1 + shift]  # the knot at which the span begins then
        beyond = logical_and(first <= t, first < end)
        arrays = [_moved(a, shift, width + left, beyond) for a, width in zip(arrays, widths, strict=True)]
    return arrays[0], arrays[1:]


def _moved(array: list[Any], shift: int, length: int, condition: Any) -> list[Any]:
    return [where(condition, array[i + shift], array[i]) for i in range(length)]


def basis(t: Any, knots: list[Any], degree: Any) -> Basis:
    """Return the basis functions of a degree and their derivatives at t, in the window of these knots.

    The recursion of Cox and de Boor goes from one degree to the next.
    """
    zeros = [0.0] * DEGREE
    last = chosen = Basis([*zeros, 1.0], [*zeros, 0.0], [*zeros, 0.0])
    for p in range(1, DEGREE + 1):
        last = _raised(t, knots, p, last)
        chosen = last.chosen(degree >= p, chosen)
    return chosen


def _raised(t: Any, knots: list[Any], p: int, below: Basis) -> Basis:
    """Return the basis of degree p from that of p - 1; only its last p + 1 functions are not zero."""
    x, v, a = ([0.0] * (DEGREE + 1) for _ in range(3))
    for i in range(DEGREE + 1 - p, DEGREE + 1):  # functions of degree p - 1, each from its own first knot
        first, end = knots[i - 1], knots[i - 1 + p]
        span = where(end > first, end - first, 1.0)  # 1 if knots are out of order
        part, part_v = below.x[i] / span, below.v[i] / span
        x[i - 1], x[i] = x[i - 1] + (end - t) * part, (t - first) * part
        v[i - 1], v[i] = v[i - 1] - p * part, p * part
        a[i - 1], a[i] = a[i - 1] - p * part_v, p * part_v
    return Basis(x, v, a)
