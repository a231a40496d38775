"""Pictures of results that are registered for what a run has."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ..formatting import format_headline
from ..pages.curve_data import mask_undrawable
from ..panels import Limit, Line, Plot
from .panel_drawing import draw_panels, has_changes
from .style import BLUE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...run.result import Result

_MOST_ROWS = 20_000
"""Of longer results only every n-th row is drawn; a panel is a few hundred pixels wide."""

_TRANSIENT = 0.3
"""Time in s after which errors are small enough to show on a scale of their own."""


class Drawing(ABC):
    """What a picture of a run is drawn by, whatever it shows."""

    @abstractmethod
    def signals(self, result: "Result") -> Iterable[str]:
        """The full names of the signals that it would show, of those that the run kept."""

    @abstractmethod
    def drawn(self, result: "Result", data: Mapping[str, Vector]) -> "Figure | None":
        """The picture; None where the signals at hand, `time` among them, are not enough for one."""


def _inside(column: str, signal: str, names: Collection[str], roles: Mapping[str, str]) -> str | None:
    name = f"{column}.{signal}"
    name = roles.get(name, name)
    return name if name in names else None


@dataclass(frozen=True)
class Curve:
    """One line of a panel: what it shows and how.

    It is `scale` times `signal`, which `times` is multiplied with and `less` subtracted from, all of it
    integrated over time if it is `integrated`. What the signals' names mean depends on the picture.
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
        """What it needs."""
        return [name for name in (self.signal, self.times, self.less) if name is not None]


@dataclass(frozen=True)
class RangeLimit:
    """A range that curves should not leave: the products of parameters, times `scale`.

    Without `low` it is plus and minus the upper one.
    """

    label: str
    high: tuple[str, ...]
    low: tuple[str, ...] = ()
    scale: float = 1.0


@dataclass(frozen=True)
class PanelSpec:
    """One row of axes: the same curves for each column. `late` leaves the initial transient out."""

    label: str
    curves: tuple[Curve, ...]
    late: bool = False
    bound: RangeLimit | None = None


Find = Callable[[str, Collection[str]], str | None]
"""What finds the full name of one of a column's signals, or parameters, among those that there are."""


@dataclass(frozen=True)
class Picture(Drawing):
    """A grid of panels: a column for everything that metrics of the kind `of` were computed for.

    `find` gives the full name of a column's signal, of those that there are, or None: it takes the column,
    what a curve calls the signal, all names, and the result's roles. Usually the signal has the column's
    name before a dot. While the signal `moving` changes, time is drawn wider than after it.
    """

    title: str
    panels: tuple[PanelSpec, ...]
    of: str
    find: Callable[[str, str, Collection[str], Mapping[str, str]], str | None] = _inside
    moving: str | None = None

    def signals(self, result: "Result") -> Iterable[str]:
        """Those of the curves, of every column."""
        names = set(result.names)
        wanted = dict.fromkeys(name for p in self.panels for curve in p.curves for name in curve.names)
        found = (
            self.find(column, signal, names, result.roles)
            for column in result.metrics.get(self.of, ())
            for signal in (*wanted, *([self.moving] if self.moving else []))
        )
        return [name for name in found if name is not None]

    def drawn(self, result: "Result", data: Mapping[str, Vector]) -> "Figure | None":
        """The panels with the curves that there are signals for."""
        shown = self.resolved(result, data)
        if not has_changes(shown):
            return None
        return draw_panels(shown, self.title, format_headline(result), self._rest(result, data))

    def resolved(self, result: "Result", data: Mapping[str, Vector]) -> list[Plot]:
        """What it shows, row by row: a panel for each column that there are signals for."""
        finds = {c: self._find(result, c) for c in result.metrics.get(self.of, ())}
        found = [
            [_resolve_panel(panel, column, find, data, result.parameters) for column, find in finds.items()]
            for panel in self.panels
        ]
        some = [any(row[i].lines for row in found) for i in range(len(finds))]
        rows = [row for row in found if any(panel.lines for panel in row)]
        return [panel for row in rows for panel, known in zip(row, some, strict=True) if known]

    def _find(self, result: "Result", column: str) -> Find:
        return lambda name, names: self.find(column, name, names, result.roles)

    def _rest(self, result: "Result", data: Mapping[str, Vector]) -> float | None:
        """The time from which nothing moves any more; None where that is not known, or never."""
        times = []
        for column in result.metrics.get(self.of, ()) if self.moving else ():
            name = self.find(column, str(self.moving), data, result.roles)
            if name is not None:
                away = np.abs(mask_undrawable(data[name]) - mask_undrawable(data[name])[-1])
                moves = np.flatnonzero(away > 1e-3 * np.nanmax(away, initial=0.0))
                times += [data["time"][moves[-1]]] if len(moves) else []
        return max(times, default=None)


FIGURES: dict[str, Drawing] = {}
"""Pictures that are drawn of every run that has signals for them, by the name of their file."""


def drawn(result: "Result") -> "Iterator[tuple[str, Figure | None]]":
    """Draw each picture by name; None where the result has no signals for it, or nothing changes."""
    data = result.read(_list_signals(result), _MOST_ROWS)
    if len(data["time"]) >= 2:
        for name, picture in FIGURES.items():
            yield name, picture.drawn(result, data)


def _list_signals(result: "Result") -> list[str]:
    """Signals that pictures show, of those that the result has, and time."""
    wanted = {name for picture in FIGURES.values() for name in picture.signals(result)}
    return ["time", *(name for name in result.names if name in wanted)]


def _resolve_panel(
    panel: PanelSpec, column: str, find: Find, data: Mapping[str, Vector], parameters: Mapping[str, float]
) -> Plot:
    time = data["time"]
    late = panel.late and time[-1] > time[0] + 2 * _TRANSIENT
    part = time >= time[0] + (_TRANSIENT if late else 0.0)
    lines = []
    for curve in panel.curves:
        values = [None if (n := find(name, data)) is None else data[n] for name in curve.names]
        if all(v is not None for v in values):
            shown = _values(curve, [v for v in values if v is not None], time)[part]
            lines.append(Line(curve.label, time[part], shown, curve.color, curve.dashed))
    limits = _limits(panel.bound, find, parameters) if panel.bound is not None else ()
    return Plot(panel.label, tuple(lines), limits=limits, column=column)


def _values(curve: Curve, values: Sequence[Vector], time: Vector) -> Vector:
    """What a curve shows, of the signals that it names."""
    found, *others = values
    with np.errstate(all="ignore"):
        if curve.times is not None:
            found = found * others.pop(0)
        if curve.less is not None:
            found = found - others.pop(0)
        if curve.integrated:
            steps = np.diff(time) * (found[1:] + found[:-1]) / 2.0
            found = np.concatenate([[0.0], np.cumsum(steps)])
        return curve.scale * found


def _limits(bound: RangeLimit, find: Find, parameters: Mapping[str, float]) -> tuple[Limit, ...]:
    ends = [_product(names, find, parameters) for names in (bound.low, bound.high)]
    low, high = (None if end is None else bound.scale * end for end in ends)
    if high is None:
        return ()
    return (Limit(bound.label, low if bound.low else -high, high),)


def _product(names: Sequence[str], find: Find, parameters: Mapping[str, float]) -> float | None:
    found = [None if (n := find(name, parameters)) is None else parameters[n] for name in names]
    known = [value for value in found if value is not None]
    return math.prod(known) if len(known) == len(found) else None
