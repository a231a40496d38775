"""Plots as data that a page draws when they become visible."""

import json
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Vector
from ...base.colors import NAMES
from ..panels import Band, Limit, Line, Plot
from .curve_data import (
    build_small_curve,
    condense_curve,
    mask_undrawable,
    pad_range,
    round_values,
    span,
    thin_points,
    times,
)
from .text import make_visible, shorten_text


class Shape(NamedTuple):
    """The variant of a template: number of lines, with or without a band, number of limits."""

    lines: int
    band: bool = False
    limits: int = 0

    def __str__(self) -> str:
        return f"{self.lines}-{int(self.band)}-{self.limits}"


def describe_items(items: Mapping[int, str]) -> str:
    """Return the names of values for the label of an axis, such as `0 false, 1 true`."""
    return ", ".join(f"{value} {name}" for value, name in items.items())


def shape(plot: Plot) -> Shape:
    """Return the shape of a plot; plots of one shape share a template."""
    return Shape(len(plot.lines), plot.band is not None, len(plot.limits))


def as_json(plot: Plot, points: int | None = None) -> str:
    """Return the data of a plot as JSON: thinned, rounded, with finite numbers only.

    Lines have a few hundred points each. With `points` they have about that many, for zooming in.
    """
    low, high = _range(plot)
    grain = _grain(plot, high - low)
    lines, band = plot.lines, plot.band
    content: dict[str, Any] = {
        "shape": str(shape(plot)),
        "unit": shorten_text(make_visible(plot.label or describe_items(plot.items)), 40),
        "x": round_values(pad_range(*span([line.time for line in lines]), 0.01)),
        "y": round_values([low, high]),
        "lines": [_line(plot, line, grain, points) for line in lines],
        "band": None if band is None else _band(plot, band, grain),
        "mark": _mark(plot),
        "since": None,
        "base": None if plot.against is None else make_visible(lines[plot.against].label),
        "limits": [{"label": make_visible(x.label), "low": x.low, "high": x.high} for x in _limits(plot)],
        "group": " ".join(filter(None, (plot.column, plot.part))) or None,
    }
    if plot.since is not None and np.isfinite(plot.since[0]):
        content["since"] = {"at": float(plot.since[0]), "label": make_visible(plot.since[1])}
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


def _range(plot: Plot) -> tuple[float, float]:
    """Return the initial range: the band, and the lines as far as they are near it."""
    if plot.band is None:
        low, high = span([line.values for line in plot.lines])
        near = 0.5 * (high - low)
        edges = [e for x in _limits(plot) for e in (x.low, x.high) if e is not None]
        edges = [e for e in edges if low - near <= e <= high + near]
        return pad_range(min([low, *edges]), max([high, *edges]))
    low, high = span([plot.band.lower, plot.band.upper])
    first, last = span([line.values for line in plot.lines])
    room = (high - low) or abs(high) or 1.0  # a diverging line leaves the plot
    return pad_range(max(min(low, first), low - room), min(max(high, last), high + room))


def _limits(plot: Plot) -> list[Limit]:
    """Return the limits that can be drawn, with their finite ends."""

    def end(value: float | None) -> float | None:
        return (
            None if value is None or not np.isfinite(mask_undrawable(np.array([value]))[0]) else float(value)
        )

    return [Limit(x.label, end(x.low), end(x.high)) for x in plot.limits]


def _grain(plot: Plot, size: float) -> float:
    """Return a size that is invisible even when you zoom in on the edge of a band."""
    grain = size / 1e5
    if plot.band is not None:
        width = mask_undrawable(plot.band.upper) - mask_undrawable(plot.band.lower)
        width = width[width > 0]
        grain = min(grain, float(np.median(width)) / 200) if width.size else grain
    return grain


def _values_against(plot: Plot, time: Vector) -> list[Vector]:
    """Return the values to subtract for differences, or nothing."""
    if plot.against is None:
        return []
    line = plot.lines[plot.against]
    if not len(line.time):
        return [np.full(len(time), np.nan)]
    return [np.interp(time, line.time, mask_undrawable(line.values))]


def _line(plot: Plot, line: Line, grain: float, points: int | None) -> dict[str, Any]:
    label = make_visible(line.label or plot.label or "value")
    look = {"label": label, "color": NAMES.get(line.color, "grey"), "dashed": line.dashed}
    values = mask_undrawable(line.values)
    if points is not None:
        return {**look, **build_small_curve(line.time, values, condense_curve(line.time, values, points))}
    base = _values_against(plot, line.time)
    kept = thin_points(values, *(values - b for b in base))
    return {
        **look,
        "missing": int(np.isnan(values).sum()),
        "x": times(line.time[kept]),
        "y": round_values(values[kept], grain),
        **_base(base, lambda b: round_values(b[kept], grain)),
    }


def _band(plot: Plot, band: Band, grain: float) -> dict[str, Any]:
    lower, upper, base = (
        mask_undrawable(band.lower),
        mask_undrawable(band.upper),
        _values_against(plot, band.time),
    )
    kept = thin_points(lower, upper, *(edge - b for b in base for edge in (lower, upper)))
    return {
        "label": make_visible(band.label),
        "x": times(band.time[kept]),
        "lower": round_values(lower[kept], grain),
        "upper": round_values(upper[kept], grain),
        **_base(base, lambda b: round_values(b[kept], grain)),
    }


def _mark(plot: Plot) -> dict[str, Any] | None:
    """Return the drawn point of the first line that is nearest to the mark."""
    if plot.mark is None:
        return None
    time, label = plot.mark
    values = mask_undrawable(plot.lines[0].values)
    away = np.where(np.isfinite(values), np.abs(plot.lines[0].time - time), np.inf)
    if not np.isfinite(away.min(initial=np.inf)):
        return None
    k = int(np.argmin(away))
    at = plot.lines[0].time[k : k + 1]
    base = _base(_values_against(plot, at), lambda b: round_values(b)[0])
    return {"label": make_visible(label), "x": float(at[0]), "y": float(values[k]), **base}


def _base(found: list[Vector], shown: Callable[[Vector], Any]) -> dict[str, Any]:
    """Return the entry for the values to subtract, if there are any."""
    return {"base": shown(found[0])} if found else {}
