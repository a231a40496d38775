"""Reduce curves: fewer points, fewer digits, only values that can be drawn."""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ...base.arrays import Vector

_BUCKETS = 400
"""Number of sections of a curve that keep only their extremes: half the width of a plot in pixels."""

_HUGE = 1e150
"""Larger values are not drawn: no axis can show them beside others."""


_UNSEEN = 5e-5
"""Smallest visible fraction of a curve's range, except at very high zoom."""


def mask_undrawable(values: Vector) -> Vector:
    """Replace infinite and very large values by NaN."""
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < _HUGE, values, np.nan)


def thin_points(*curves: Vector) -> np.ndarray:
    """Return the indices of the points to draw: all, or all extremes and ends of gaps."""
    count = len(curves[0])
    if count <= 2 * _BUCKETS:
        return np.arange(count)
    size = -(-count // _BUCKETS)
    starts, missing = np.arange(0, count, size), -count % size
    kept = [np.array([0, count - 1])]
    for curve in curves:
        parts = np.pad(curve, (0, missing), constant_values=np.nan).reshape(-1, size)
        known = np.isfinite(parts)
        for found in (np.where(known, parts, np.inf), np.where(known, -parts, np.inf), known):
            kept.append(np.minimum(starts + found.argmin(axis=1), count - 1))
    return np.unique(np.concatenate(kept))


def span(curves: Sequence[Vector]) -> tuple[float, float]:
    """Return the lowest and the highest value that can be drawn, or 0 and 1 without any."""
    known = np.concatenate([mask_undrawable(curve) for curve in curves])
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)


def pad_range(low: float, high: float, part: float = 0.05) -> tuple[float, float]:
    """Widen a range at both ends by a fraction of it, or make one around a single value."""
    size = max(abs(low), abs(high))
    flat = high - low <= max(1e-12 * size, 1e-290)
    room = (0.05 * size if size > 1e-290 else 1.0) if flat else part * (high - low)
    return low - room, high + room


def times(values: Vector) -> list[float | None] | dict[str, Any]:
    """Return times as a list, or as first, last and count if they are equidistant."""
    count = len(values)
    if count < 3 or not np.isfinite(values).all():
        return round_values(values)
    length = values[-1] - values[0]
    if np.abs(values - np.linspace(values[0], values[-1], count)).max() <= 1e-6 * length / count:
        return {"first": float(values[0]), "last": float(values[-1]), "count": count}
    steps = np.diff(values)
    return round_values(values, max(steps[steps > 0].min(initial=length) / 100, 1e-10 * length))


def round_values(values: Iterable[float], grain: float = 0.0) -> list[float | None]:
    """Round numbers to the digits that `grain` needs, or to 12 digits if it is 0. Others become None."""
    found = [float(value) for value in values]
    largest = max((abs(v) for v in found if np.isfinite(v)), default=0.0)
    digits = 12
    if grain > 0 and largest > 0:
        digits = int(np.clip(np.ceil(np.log10(largest / grain)), 3, 16))
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in found]


def condense_curve(time: Vector, values: Vector, most: int) -> np.ndarray:
    """Return the indices of at most about `most` points whose connecting lines approximate a curve.

    Points are added where the lines deviate most, until no deviation is visible. Short transients therefore
    remain visible when you zoom in. Ends and the edges of gaps are kept.
    """
    count, known = len(values), np.isfinite(values)
    if count <= min(most, 100) or not known.any():
        return np.arange(count) if known.any() else np.array([0, count - 1][:count], int)
    edges = np.flatnonzero(np.diff(known))
    edges = edges[:: 1 + len(edges) // max(most // 4, 1)]
    filled = np.where(known, values, np.interp(time, time[known], values[known]))
    kept = np.unique(np.concatenate([np.linspace(0, count - 1, 32).astype(int), edges, edges + 1]))
    while (room := most - len(kept)) > 0:
        off = np.abs(filled - np.interp(time, time[kept], filled[kept]))
        off[kept] = 0.0  # at a step, two points have the same time
        worst = np.maximum.reduceat(off, kept)
        within = np.repeat(np.arange(len(kept)), np.diff(kept, append=count))
        found = _firsts((off == worst[within]) & (off > _UNSEEN * np.ptp(filled)), within)
        if not len(found):
            break
        kept = np.union1d(kept, found[np.argsort(-off[found])[:room]])
    return kept


def _firsts(mask: np.ndarray, within: np.ndarray) -> np.ndarray:
    """Return the first index of each section at which the mask is true."""
    found = np.flatnonzero(mask)
    return found[np.unique(within[found], return_index=True)[1]]


def pack_values(values: Vector) -> dict[str, Any]:
    """Pack numbers as 32 bits each, relative to their range: `middle` + `half` * the floats in `data`."""
    low, high = span([values])
    middle, half = low + (high - low) / 2, (high - low) / 2 or 1.0
    with np.errstate(invalid="ignore", over="ignore"):
        small = ((values - middle) / half).astype("<f4")
    return {"middle": middle, "half": half, "data": b64encode(small.tobytes()).decode()}


def build_small_curve(time: Vector, values: Vector, kept: np.ndarray) -> dict[str, Any]:
    """Return these points of a curve as data of a page: x, y, and the number of values not drawn."""
    missing = int(np.isnan(values).sum())
    return {"missing": missing, "x": pack_values(time[kept]), "y": pack_values(values[kept])}
