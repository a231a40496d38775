"""Plots of results, registered for the kinds of metrics that a run has."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...base.arrays import Vector
from ...pages.panels import Limit, Line, Plot
from ...recorders.metrics import HELD
from ..formatting import format_headline
from .panel_drawing import draw_panels, has_changes, read_rows
from .style import BLUE, GREY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...run.result import Result

EVALUATED_FROM = "evaluated_from_s"
"""Metric of a column, if it has it: the time in s from which its errors count."""

MOST_COLUMNS = 8
"""Most subjects of a plot, such as joints; with more, it shows the worst ones."""

_TRANSIENT = 0.3
"""Time in s after which errors are small enough for a scale of their own, where that metric is missing."""

Part = Literal["", "settling", "settled"]


class Drawing(ABC):
    """Base of plots of a run."""

    @abstractmethod
    def signals(self, result: "Result") -> Iterable[str]:
        """Return the full names of the recorded signals that the plot shows."""

    @abstractmethod
    def drawn(self, result: "Result", data: Mapping[str, Vector]) -> "Figure | None":
        """Return the figure, or None if `data` lacks signals. `data` includes `time`."""


def _find_signal(column: str, signal: str, names: Collection[str], roles: Mapping[str, str]) -> str | None:
    """Return the full name of a column's signal, or what its role names; None if it does not exist."""
    name = f"{column}.{signal}"
    name = roles.get(name, name)
    return name if name in names else None


@dataclass(frozen=True)
class Curve:
    """One line of a panel.

    Its value is `scale` * (`signal` * `times` - `less`), integrated over time if `integrated`. The plot
    defines how the names of the signals are resolved.
    """

    label: str
    signal: str
    color: str = BLUE
    less: str | None = None
    scale: float = 1.0
    dashed: bool = False
    times: str | None = None
    integrated: bool = False

    @property
    def names(self) -> list[str]:
        """Names of the signals that it needs."""
        return [name for name in (self.signal, self.times, self.less) if name is not None]


Find = Callable[[str, Collection[str]], str | None]
"""Function that returns the full name of a column's signal or parameter, from the existing names."""


class Bound(ABC):
    """Base of ranges that curves should stay in."""

    @abstractmethod
    def resolve(self, result: "Result", column: str, find: Find) -> Limit | None:
        """Return the range for a column in the unit of its panel; None if it is unknown."""


@dataclass(frozen=True)
class RangeLimit(Bound):
    """A range between products of parameters, times `scale`.

    Without `low` the range is symmetric.
    """

    label: str
    high: tuple[str, ...]
    low: tuple[str, ...] = ()
    scale: float = 1.0

    def resolve(self, result: "Result", column: str, find: Find) -> Limit | None:
        """Return the range, from the parameters of the result."""
        ends = [_multiply_parameters(names, find, result.parameters) for names in (self.low, self.high)]
        low, high = (None if end is None else self.scale * end for end in ends)
        if high is None:
            return None
        return Limit(self.label, low if self.low else -high, high)


@dataclass(frozen=True)
class PanelSpec:
    """One row of axes, with the same curves for each column.

    `part` is the part of the time that it shows: all of it, or what is before or after `EVALUATED_FROM`.
    `since` is the kind and the name of a metric to use instead of that.
    """

    label: str
    curves: tuple[Curve, ...]
    part: Part = ""
    bound: Bound | None = None
    since: tuple[str, str] | None = None


@dataclass(frozen=True)
class Picture(Drawing):
    """A grid of panels, with a column for each subject that has metrics of the kind `of`.

    `find` returns the full name of a column's signal, or None. Its arguments are the column, the signal's
    name in the curve, all names, and the result's roles. By default the full name is the
    column's name, a dot and the signal's name. `index` makes a collection of the names for fast look-ups.

    Of many columns, those with the largest metric `worst` are shown, and first those that are not held.
    """

    title: str
    panels: tuple[PanelSpec, ...]
    of: str
    find: Callable[[str, str, Collection[str], Mapping[str, str]], str | None] = _find_signal
    worst: str = ""
    index: Callable[[Iterable[str]], Collection[str]] = set

    def signals(self, result: "Result") -> Iterable[str]:
        """Return the signals of the curves of all columns."""
        names = self.index(result.names)
        needed = dict.fromkeys(name for p in self.panels for curve in p.curves for name in curve.names)
        names_of_columns = (
            self.find(column, signal, names, result.roles)
            for column in self._choose_columns(result)
            for signal in needed
        )
        return [name for name in names_of_columns if name is not None]

    def drawn(self, result: "Result", data: Mapping[str, Vector]) -> "Figure | None":
        """Draw the panels whose curves have signals; None if there are none, or if no value changes."""
        panels = self.resolve_panels(result, data)
        if not has_changes(panels):
            return None
        return draw_panels(panels, self.make_title(result), format_headline(result), result.name)

    def make_title(self, result: "Result") -> str:
        """Return the title, with the number of columns if not all are shown."""
        drawn_count, total = len(self._choose_columns(result)), len(result.metrics.get(self.of, ()))
        return (
            self.title
            if drawn_count == total
            else f"{self.title}: the {drawn_count} worst of {total} {self.of}"
        )

    def _choose_columns(self, result: "Result") -> list[str]:
        """Return the columns to show, the worst ones first if there are many."""
        metrics = result.metrics.get(self.of, {})
        if len(metrics) <= MOST_COLUMNS:
            return list(metrics)

        def severity(name: str) -> tuple[bool, float]:
            value = metrics[name].get(self.worst, 0.0)
            # a joint without an error is at least as bad as one with a large one
            return metrics[name].get(HELD) is False, math.inf if math.isnan(value) else float(value)

        return sorted(metrics, key=severity, reverse=True)[:MOST_COLUMNS]

    def resolve_panels(self, result: "Result", data: Mapping[str, Vector]) -> list[Plot]:
        """Return the panels row by row: one for each column that has signals."""
        columns, names = self._choose_columns(result), self.index(result.names)
        grid = [
            [self._resolve_panel(panel, c, result, names, data) for c in columns] for panel in self.panels
        ]
        has_lines = [any(row[i].lines for row in grid) for i in range(len(columns))]
        rows = [row for row in grid if any(panel.lines for panel in row)]
        return [panel for row in rows for panel, has_line in zip(row, has_lines, strict=True) if has_line]

    def _resolve_panel(
        self,
        panel: PanelSpec,
        column: str,
        result: "Result",
        names: Collection[str],
        data: Mapping[str, Vector],
    ) -> Plot:
        """Return a panel for a column. Signals are found among `names`, the recorded ones."""

        def find(name: str, there: Collection[str]) -> str | None:
            return self.find(column, name, there, result.roles)

        time = data["time"]
        kind, metric = panel.since or (self.of, EVALUATED_FROM)
        # of the load where it has its own, of the joint elsewhere
        since = result.metrics.get(kind, {}).get(column, {}).get(metric)
        rows = _mask_rows(time, panel.part, _find_settled_start(since, time))
        lines = []
        for curve in panel.curves:
            signals = [find(name, names) for name in curve.names]
            values = [data[name] for name in signals if name is not None and name in data]
            if len(values) == len(signals):
                drawn = _compute_values(curve, values, time)[rows]
                lines.append(Line(curve.label, time[rows], drawn, curve.color, curve.dashed))
        limit = None if panel.bound is None else panel.bound.resolve(result, column, find)
        limits = () if limit is None else (limit,)
        return Plot(panel.label, tuple(lines), limits=limits, column=column, part=panel.part)


FIGURES: dict[str, Drawing] = {}
"""Plots of every run that has signals for them, by file name."""


def draw_figures(result: "Result") -> "Iterator[tuple[str, Figure | None]]":
    """Draw each plot by name. The figure is None if the result has no signals for it, or no value changes."""
    needed = {name for picture in FIGURES.values() for name in picture.signals(result)}
    data, left_out = read_rows(result, [name for name in result.names if name in needed])
    if len(data["time"]) >= 2:
        for name, picture in FIGURES.items():
            figure = picture.drawn(result, data)
            if figure is not None and left_out:
                figure.text(0.998, 0.004, left_out, ha="right", va="bottom", color=GREY, fontsize=8)
            yield name, figure


def _mask_rows(time: Vector, part: Part, settled: float) -> np.ndarray:
    """Return the mask of the rows of a part of the time. A result that is too short is shown whole."""
    if not part or settled <= time[0]:
        return np.ones(len(time), dtype=bool)
    return time <= settled if part == "settling" else time >= settled


def _find_settled_start(evaluated_from: float | None, time: Vector) -> float:
    """Return the time in s at which settled panels begin, from that of the metrics."""
    if evaluated_from is None or math.isnan(evaluated_from):  # it has not settled, or has no such metric
        return float(time[0]) + (_TRANSIENT if time[-1] > time[0] + 2 * _TRANSIENT else 0.0)
    return evaluated_from if (time >= evaluated_from).sum() > 1 else float(time[0])


def _compute_values(curve: Curve, values: Sequence[Vector], time: Vector) -> Vector:
    """Return the values of a curve from the signals that it names."""
    result, *operands = values
    with np.errstate(all="ignore"):
        if curve.times is not None:
            result = result * operands.pop(0)
        if curve.less is not None:
            result = result - operands.pop(0)
        if curve.integrated:
            steps = np.diff(time) * (result[1:] + result[:-1]) / 2.0
            result = np.concatenate([[0.0], np.cumsum(steps)])
        return curve.scale * result


def _multiply_parameters(names: Sequence[str], find: Find, parameters: Mapping[str, float]) -> float | None:
    """Return the product of parameters, 1 without names; None if one does not exist."""
    factors = [None if (n := find(name, parameters)) is None else parameters[n] for name in names]
    existing = [value for value in factors if value is not None]
    return math.prod(existing) if len(existing) == len(factors) else None
