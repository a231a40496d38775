"""Lines over time with a band and a mark, as data that a page draws when somebody looks at them."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..arrays import Vector
from .text import shortened, visible

_BUCKETS = 400
"""Parts of a curve of which only the extremes are kept: about half as many as a plot has pixels."""

_HUGE = 1e150
"""What is larger is not drawn: no axis can show it beside other things."""


@dataclass(frozen=True)
class Line:
    """A line in a colour of the page: `blue`, `orange`, `green`, `red`, `purple` or `grey`."""

    label: str
    time: Vector
    values: Vector
    color: str = "blue"
    dashed: bool = False


@dataclass(frozen=True)
class Band:
    """What lies between `lower` and `upper`; the page draws it behind the lines."""

    label: str
    time: Vector
    lower: Vector
    upper: Vector


@dataclass(frozen=True)
class Plot:
    """Lines over time in s, all in `unit`.

    `mark` is a time to look at, on the first line, and `since` the time from which all is otherwise; both
    with the words for it. With `against`, an index of the lines, everything can also be shown as its
    difference from that line.
    """

    unit: str
    lines: tuple[Line, ...]
    band: Band | None = None
    mark: tuple[float, str] | None = None
    since: tuple[float, str] | None = None
    against: int | None = None

    @property
    def shape(self) -> tuple[int, bool]:
        """How many lines, and whether there is a band: what is alike is drawn from one template."""
        return len(self.lines), self.band is not None

    def as_json(self) -> str:
        """What the page needs to draw it, as JSON: thinned out, rounded, without what is not finite."""
        low, high = self._range()
        grain = self._grain(high - low)
        content = [
            f'"shape":{json.dumps("-".join(str(int(n)) for n in self.shape))}',
            f'"unit":{json.dumps(shortened(visible(self.unit), 40))}',
            f'"x":{_numbers(_padded(*_span(line.time for line in self.lines), 0.01))}',
            f'"y":{_numbers([low, high])}',
            f'"lines":[{",".join(_line_json(line, grain) for line in self.lines)}]',
        ]
        if self.band is not None:
            content.append(f'"band":{_band_json(self.band, grain)}')
        if self.mark is not None and (at := _at(self.lines[0], self.mark[0])) is not None:
            content.append(f'"mark":{{"at":{_numbers(at)},"label":{json.dumps(visible(self.mark[1]))}}}')
        if self.since is not None and np.isfinite(self.since[0]):
            content.append(f'"since":{{"at":{self.since[0]!r},"label":{json.dumps(visible(self.since[1]))}}}')
        if self.against is not None:
            content.append(f'"against":{self.against}')
        return "{" + ",".join(content) + "}"

    def _range(self) -> tuple[float, float]:
        """What to show first: the band, and lines as far as they are near it."""
        if self.band is None:
            return _padded(*_span(line.values for line in self.lines))
        low, high = _span([self.band.lower, self.band.upper])
        first, last = _span(line.values for line in self.lines)
        room = (high - low) or abs(high) or 1.0  # a line that runs away leaves the picture
        return _padded(max(min(low, first), low - room), min(max(high, last), high + room))

    def _grain(self, span: float) -> float:
        """What is too small to be seen, however far one zooms to see where a band is left."""
        grain = span / 1e5
        if self.band is not None:
            width = _drawable(self.band.upper) - _drawable(self.band.lower)
            width = width[width > 0]
            grain = min(grain, float(np.median(width)) / 200) if width.size else grain
        return grain


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


def _line_json(line: Line, grain: float) -> str:
    values = _drawable(line.values)
    kept = thinned(values)
    return (
        f'{{"label":{json.dumps(visible(line.label))},"color":{json.dumps(line.color)},"dashed":{json.dumps(line.dashed)},'
        f'"x":{_numbers(line.time[kept])},"y":{_numbers(values[kept], grain)}}}'
    )


def _band_json(band: Band, grain: float) -> str:
    lower, upper = _drawable(band.lower), _drawable(band.upper)
    kept = thinned(lower, upper)
    return (
        f'{{"label":{json.dumps(visible(band.label))},"x":{_numbers(band.time[kept])},'
        f'"lower":{_numbers(lower[kept], grain)},"upper":{_numbers(upper[kept], grain)}}}'
    )


def _at(line: Line, time: float) -> list[float] | None:
    """The point of a line that is nearest to a time, among those that are drawn."""
    away = np.where(np.isfinite(_drawable(line.values)), np.abs(line.time - time), np.inf)
    if not len(away) or not np.isfinite(away.min()):
        return None
    k = int(np.argmin(away))
    return [float(line.time[k]), float(line.values[k])]


def _drawable(values: Vector) -> Vector:
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < _HUGE, values, np.nan)


def _span(curves: Iterable[Vector]) -> tuple[float, float]:
    """The lowest and the highest value; 0 and 1 where there are none."""
    known = [part for c in curves if (part := (d := _drawable(c))[np.isfinite(d)]).size]
    if not known:
        return 0.0, 1.0
    return float(min(p.min() for p in known)), float(max(p.max() for p in known))


def _padded(low: float, high: float, part: float = 0.05) -> tuple[float, float]:
    size = max(abs(low), abs(high))
    room = part * (high - low) if high - low > 1e-12 * size else 0.05 * size or 1.0
    return low - room, high + room


def _numbers(values: Iterable[float], grain: float = 0.0) -> str:
    """A JSON list of numbers, with no more digits than `grain` needs."""
    found = [float(value) for value in values]
    digits = _digits(max((abs(v) for v in found if np.isfinite(v)), default=0.0), grain)
    return "[" + ",".join(f"{v:.{digits}g}" if np.isfinite(v) else "null" for v in found) + "]"


def _digits(largest: float, grain: float) -> int:
    if grain <= 0 or largest == 0:
        return 12
    return int(np.clip(np.ceil(np.log10(largest / grain)), 3, 16))
