"""Content of one pair of axes, independent of how it is drawn, with reduced curves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..base.arrays import Vector
from ..base.colors import BLUE


@dataclass(frozen=True)
class Line:
    """Values over `time` in s. The label is empty if the axes' label is enough.

    With `is_stepped`, each value is drawn until the next one.
    """

    label: str
    time: Vector
    values: Vector
    color: str = BLUE
    dashed: bool = False
    is_stepped: bool = False


@dataclass(frozen=True)
class Band:
    """The area between `lower` and `upper`, behind the lines."""

    label: str
    time: Vector
    lower: Vector
    upper: Vector


@dataclass(frozen=True)
class Limit:
    """Range that values should stay in, in the unit of the axes; None for an open end."""

    label: str
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Plot:
    """Lines over time with the quantity and unit of `label`. The area beyond `limits` is shaded.

    `items` are names for values, such as those of an enumeration, which the axis shows.
    `column` is their subject; plots with the same subject zoom together on a page. `part` is the part of the
    time that they show, if it is not the whole; a plot of another part zooms by itself.

    The other attributes are for pages. `mark` is a time on the first line, and `since` the time from which
    conditions differ, both with a text. With `shows_all`, the axes show also values far from the band.
    """

    label: str
    lines: tuple[Line, ...]
    band: Band | None = None
    mark: tuple[float, str] | None = None
    since: tuple[float, str] | None = None
    shows_all: bool = False
    limits: tuple[Limit, ...] = ()
    column: str = ""
    part: str = ""
    items: Mapping[int, str] = field(default_factory=dict)


_HUGE = 1e150
"""Larger values are not drawn: no axis can show them beside others."""

_UNSEEN = 5e-5
"""Smallest visible fraction of the curves' range, except at very high zoom."""


def mask_undrawable(values: Vector) -> Vector:
    """Replace infinite and very large values by NaN."""
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < _HUGE, values, np.nan)


def find_range(curves: Sequence[Vector]) -> tuple[float, float]:
    """Return the lowest and the highest value that can be drawn, or 0 and 1 without any."""
    values = np.concatenate([np.empty(0), *map(mask_undrawable, curves)])
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)


def pad_range(low: float, high: float, fraction: float = 0.05) -> tuple[float, float]:
    """Widen a range at both ends by a fraction of it, or make one around a single value."""
    size = max(abs(low), abs(high))
    is_flat = high - low <= max(1e-12 * size, 1e-290)
    margin = (0.05 * size if size > 1e-290 else 1.0) if is_flat else fraction * (high - low)
    return low - margin, high + margin


def condense_curves(time: Vector, curves: Sequence[Vector], most: int) -> np.ndarray:
    """Return the indices of at most about `most` points whose connecting lines approximate all curves.

    Points are added where the lines deviate most, until no deviation is visible. Short transients therefore
    remain visible when you zoom in. Ends and the edges of gaps are kept.
    """
    count = len(time)
    curves = [curve for curve in curves if np.isfinite(curve).any()]
    if count <= min(most, 100) or not curves:
        return np.arange(count) if curves else np.array([0, count - 1][:count], int)
    low, high = find_range(curves)
    retained, filled = np.linspace(0, count - 1, 32).astype(int), list[Vector]()
    for curve in curves:
        finite = np.isfinite(curve)
        edges = np.flatnonzero(np.diff(finite))
        edges = edges[:: 1 + len(edges) * len(curves) // max(most // 4, 1)]
        retained = np.unique(np.concatenate([retained, edges, edges + 1]))
        # gaps are bridged, so that there is a deviation only where there are values
        filled.append(np.where(finite, curve, np.interp(time, time[finite], curve[finite])))
    while (room := most - len(retained)) > 0:
        errors = [np.abs(curve - np.interp(time, time[retained], curve[retained])) for curve in filled]
        error = np.maximum.reduce(errors)
        error[retained] = 0.0
        sections = np.repeat(np.arange(len(retained)), np.diff(retained, append=count))
        worst = np.maximum.reduceat(error, retained)[sections]
        candidates = np.flatnonzero((error == worst) & (error > _UNSEEN * (high - low)))
        candidates = candidates[np.unique(sections[candidates], return_index=True)[1]]
        if not len(candidates):
            break
        retained = np.union1d(retained, candidates[np.argsort(-error[candidates])[:room]])
    return retained


def compact(values: Vector) -> np.ndarray:
    """Return values with 32 bits each if the difference is invisible."""
    with np.errstate(over="ignore", invalid="ignore"):
        single = values.astype(np.float32)
        error = np.abs(single - values)[np.isfinite(values)].max(initial=0.0)
    low, high = find_range([values])
    return single if error <= 1e-6 * (high - low) else values
