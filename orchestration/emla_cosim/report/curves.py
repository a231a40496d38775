"""Curves made small: fewer points, fewer digits, nothing that cannot be drawn."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ..arrays import Vector

_BUCKETS = 400
"""Parts of a curve of which only the extremes are kept: about half as many as a plot has pixels."""

_HUGE = 1e150
"""What is larger is not drawn: no axis can show it beside other things."""


def drawable(values: Vector) -> Vector:
    """The values, NaN where one is infinite or too large."""
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < _HUGE, values, np.nan)


def thinned(*curves: Vector) -> np.ndarray:
    """Indices of the points to be drawn of curves of one length: all, or all extremes and ends of gaps."""
    count = len(curves[0])
    if count <= 2 * _BUCKETS:
        return np.arange(count)
    starts = np.linspace(0, count, _BUCKETS + 1).astype(int)
    kept = {0, count - 1}
    for curve in curves:
        known = np.isfinite(curve)
        for low, high in pairwise(starts):
            part, here = curve[low:high], known[low:high]
            kept.add(low + int(np.argmin(np.where(here, part, np.inf))))
            kept.add(low + int(np.argmax(np.where(here, part, -np.inf))))
            kept.add(low + int(np.argmin(here)))
    return np.array(sorted(kept))


def span(curves: Sequence[Vector]) -> tuple[float, float]:
    """The lowest and the highest value that can be drawn; 0 and 1 where there are none."""
    known = np.concatenate([drawable(curve) for curve in curves])
    known = known[np.isfinite(known)]
    return (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)


def padded(low: float, high: float, part: float = 0.05) -> tuple[float, float]:
    """A range with room at both ends: so much of it, or what makes one of a single value."""
    size = max(abs(low), abs(high))
    flat = high - low <= max(1e-12 * size, 1e-290)
    room = (0.05 * size if size > 1e-290 else 1.0) if flat else part * (high - low)
    return low - room, high + room


def times(values: Vector) -> list[float | None] | dict[str, Any]:
    """Times as a list, or as first, last and count where they are equally far apart."""
    count = len(values)
    if count < 3 or not np.isfinite(values).all():
        return rounded(values)
    length = values[-1] - values[0]
    if np.abs(values - np.linspace(values[0], values[-1], count)).max() <= 1e-6 * length / count:
        return {"first": float(values[0]), "last": float(values[-1]), "count": count}
    steps = np.diff(values)
    return rounded(values, max(steps[steps > 0].min(initial=length) / 100, 1e-10 * length))


def rounded(values: Iterable[float], grain: float = 0.0) -> list[float | None]:
    """Numbers with as many digits as `grain` needs, 12 where it is 0; None for what is none."""
    found = [float(value) for value in values]
    largest = max((abs(v) for v in found if np.isfinite(v)), default=0.0)
    digits = 12
    if grain > 0 and largest > 0:
        digits = int(np.clip(np.ceil(np.log10(largest / grain)), 3, 16))
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in found]
