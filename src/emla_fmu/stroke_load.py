"""A load force over the position, as levers give it: points of a table, and what is between them.

The functions take floats and symbols. Beyond its ends, the table has the force of its first or last point.
"""

from itertools import pairwise
from typing import Any

from fmublock import clamp, logical_and, maximum, sign, where

POINTS = 32
"""Number of points of a table. Shorter ones repeat their last point."""

_SHIFTS = (16, 8, 4, 2, 1)
"""Points by which `_window` moves if the position is beyond them; together they reach every segment."""

HELD, LINEAR, SMOOTH = range(3)
"""Interpolations: the force of the last point, straight lines, monotone cubic polynomials."""

INTERPOLATIONS = {"held": HELD, "linear": LINEAR, "smooth": SMOOTH}
"""Interpolations by name."""


def force_at(x: Any, position: list[Any], force: list[Any], interpolation: Any) -> Any:
    """Return the force of a table in N.

    Smooth curves are those of Fritsch and Butland (1984): they pass through the points without overshoot,
    and their slopes are continuous.

    Args:
        x: Position in m.
        position: Positions of the points in increasing order in m, shape (POINTS,).
        force: Forces of the points in N, shape (POINTS,).
        interpolation: One of `HELD`, `LINEAR` and `SMOOTH`.
    """
    (p_0, p_1, p_2, p_3), (f_0, f_1, f_2, f_3) = _window(x, position, force)
    before, width, after = p_1 - p_0, p_2 - p_1, p_3 - p_2
    rise = f_2 - f_1
    slope = _quotient(rise, width)
    slope_before, slope_after = _quotient(f_1 - f_0, before), _quotient(f_3 - f_2, after)
    first = _slope(before, width, after, slope_before, slope, slope_after)
    last = _slope(after, width, before, slope_after, slope, slope_before)
    r = clamp(_quotient(x - p_1, width), 0.0, 1.0)
    rest = 1.0 - r
    bent = r * rest * (rest * (first * width - rise) - r * (last * width - rise))
    linear = f_1 + r * rise
    return where(interpolation == HELD, f_1, where(interpolation == SMOOTH, linear + bent, linear))


def ordered(position: list[Any]) -> dict[str, Any]:
    """Return the conditions of a table: positions in increasing order."""
    return {
        f"load.table.position[{i + 1}] must not be less than load.table.position[{i}]": b >= a
        for i, (a, b) in enumerate(pairwise(position), 1)
    }


def _window(x: Any, *rows: list[Any]) -> list[list[Any]]:
    """Return four points of each row: the segment that contains x, and a point on each side.

    Blocks cannot index arrays by a value. All rows move together until their segment reaches x.
    """
    arrays = [[row[0], *row, row[-1]] for row in rows]
    left = sum(_SHIFTS)
    for shift in _SHIFTS:
        left -= shift
        beyond = arrays[0][1 + shift] <= x
        arrays = [
            [where(beyond, a[min(i + shift, len(a) - 1)], a[i]) for i in range(4 + left)] for a in arrays
        ]
    return arrays


def _quotient(rise: Any, width: Any) -> Any:
    """Return the slope of a segment; 0 without a width, which repeated points have."""
    return where(width > 0.0, rise / where(width > 0.0, width, 1.0), 0.0)


def _slope(outer: Any, width: Any, opposite: Any, d_outer: Any, d: Any, d_opposite: Any) -> Any:
    """Return the slope of a smooth curve at one end of a segment with the slope d.

    Args:
        outer: Width of the segment beyond this end; 0 at an end of the table.
        width: Width of the segment.
        opposite: Width of the segment beyond its other end; 0 at an end of the table.
        d_outer: Slope of the segment beyond this end.
        d: Slope of the segment.
        d_opposite: Slope of the segment beyond its other end.
    """
    is_monotone = sign(d_outer) * sign(d) > 0.0
    w_1, w_2 = 2.0 * width + outer, width + 2.0 * outer
    divisor = where(is_monotone, w_1 * d + w_2 * d_outer, 1.0)
    inner = where(is_monotone, (w_1 + w_2) * d_outer * d / divisor, 0.0)
    total = maximum(width + opposite, 0.0)
    raw = ((2.0 * width + opposite) * d - width * d_opposite) / where(total > 0.0, total, 1.0)
    turns = sign(d) * sign(d_opposite) <= 0.0
    steep = where(logical_and(turns, abs(raw) > 3.0 * abs(d)), 3.0 * d, raw)
    at_end = where(sign(raw) * sign(d) <= 0.0, 0.0, steep)
    return where(outer > 0.0, inner, where(opposite > 0.0, at_end, d))
