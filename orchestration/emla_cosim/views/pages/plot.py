"""Lines over time with a band and a mark, as data that a page draws when somebody looks at them."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Vector
from .curves import condensed, drawable, padded, rounded, small, span, thinned, times
from .text import shortened, visible


class Shape(NamedTuple):
    """What a template of plots is for: so many lines, a band or none, so many limits."""

    lines: int
    band: bool = False
    limits: int = 0

    def __str__(self) -> str:
        return f"{self.lines}-{int(self.band)}-{self.limits}"


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
class Limit:
    """What values should not leave, in the unit of the plot; None where there is no such end."""

    label: str
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Plot:
    """Lines over time in s, all in `unit`.

    `mark` is a time to look at, on the first line, and `since` the time from which all is otherwise; both
    with the words for it. With `against`, an index of the lines, everything can also be shown as its
    difference from that line. What is beyond `limits` is shaded. Plots of one `group` show the same time.
    Lines have a few hundred points each, for a look; with `points` about so many, to look closely.
    """

    unit: str
    lines: tuple[Line, ...]
    band: Band | None = None
    mark: tuple[float, str] | None = None
    since: tuple[float, str] | None = None
    against: int | None = None
    limits: tuple[Limit, ...] = ()
    group: str = ""
    points: int | None = None

    @property
    def shape(self) -> "Shape":
        """What is alike is drawn from one template."""
        return Shape(len(self.lines), self.band is not None, len(self.limits))

    def as_json(self) -> str:
        """What the page needs to draw it, as JSON: thinned out, rounded, without what is not finite."""
        low, high = self._range()
        grain = self._grain(high - low)
        lines, band = self.lines, self.band
        content: dict[str, Any] = {
            "shape": str(self.shape),
            "unit": shortened(visible(self.unit), 40),
            "x": rounded(padded(*span([line.time for line in lines]), 0.01)),
            "y": rounded([low, high]),
            "lines": [self._line(line, grain) for line in lines],
            "band": None if band is None else self._band(band, grain),
            "mark": self._mark(),
            "since": None,
            "base": None if self.against is None else visible(lines[self.against].label),
            "limits": [{"label": visible(x.label), "low": x.low, "high": x.high} for x in self._limits()],
            "group": self.group or None,
        }
        if self.since is not None and np.isfinite(self.since[0]):
            content["since"] = {"at": float(self.since[0]), "label": visible(self.since[1])}
        return json.dumps(content, separators=(",", ":"), allow_nan=False)

    def _range(self) -> tuple[float, float]:
        """What to show first: the band, and lines as far as they are near it."""
        if self.band is None:
            low, high = span([line.values for line in self.lines])
            near = 0.5 * (high - low)
            edges = [e for x in self._limits() for e in (x.low, x.high) if e is not None]
            edges = [e for e in edges if low - near <= e <= high + near]
            return padded(min([low, *edges]), max([high, *edges]))
        low, high = span([self.band.lower, self.band.upper])
        first, last = span([line.values for line in self.lines])
        room = (high - low) or abs(high) or 1.0  # a line that runs away leaves the picture
        return padded(max(min(low, first), low - room), min(max(high, last), high + room))

    def _limits(self) -> list[Limit]:
        """Those that can be drawn, each with the ends that can."""

        def end(value: float | None) -> float | None:
            return None if value is None or not np.isfinite(drawable(np.array([value]))[0]) else float(value)

        return [Limit(x.label, end(x.low), end(x.high)) for x in self.limits]

    def _grain(self, size: float) -> float:
        """What is too small to be seen, however far one zooms to see where a band is left."""
        grain = size / 1e5
        if self.band is not None:
            width = drawable(self.band.upper) - drawable(self.band.lower)
            width = width[width > 0]
            grain = min(grain, float(np.median(width)) / 200) if width.size else grain
        return grain

    def _base(self, time: Vector) -> list[Vector]:
        """What is subtracted at these times to show differences; nothing where there is nothing."""
        if self.against is None:
            return []
        line = self.lines[self.against]
        if not len(line.time):
            return [np.full(len(time), np.nan)]
        return [np.interp(time, line.time, drawable(line.values))]

    def _line(self, line: Line, grain: float) -> dict[str, Any]:
        look = {"label": visible(line.label), "color": line.color, "dashed": line.dashed}
        if self.points is not None:
            values = drawable(line.values)
            return {**look, **small(line.time, values, condensed(line.time, values, self.points))}
        values, base = drawable(line.values), self._base(line.time)
        kept = thinned(values, *(values - b for b in base))
        return {
            **look,
            "missing": int(np.isnan(values).sum()),
            "x": times(line.time[kept]),
            "y": rounded(values[kept], grain),
            **_base(base, lambda b: rounded(b[kept], grain)),
        }

    def _band(self, band: Band, grain: float) -> dict[str, Any]:
        lower, upper, base = drawable(band.lower), drawable(band.upper), self._base(band.time)
        kept = thinned(lower, upper, *(edge - b for b in base for edge in (lower, upper)))
        return {
            "label": visible(band.label),
            "x": times(band.time[kept]),
            "lower": rounded(lower[kept], grain),
            "upper": rounded(upper[kept], grain),
            **_base(base, lambda b: rounded(b[kept], grain)),
        }

    def _mark(self) -> dict[str, Any] | None:
        """The point of the first line that is nearest to the time of the mark, among those that are drawn."""
        if self.mark is None:
            return None
        time, label = self.mark
        values = drawable(self.lines[0].values)
        away = np.where(np.isfinite(values), np.abs(self.lines[0].time - time), np.inf)
        if not np.isfinite(away.min(initial=np.inf)):
            return None
        k = int(np.argmin(away))
        at = self.lines[0].time[k : k + 1]
        base = _base(self._base(at), lambda b: rounded(b)[0])
        return {"label": visible(label), "x": float(at[0]), "y": float(values[k]), **base}


def _base(found: list[Vector], shown: Callable[[Vector], Any]) -> dict[str, Any]:
    """The entry for what is subtracted, if anything is."""
    return {"base": shown(found[0])} if found else {}
