"""Pictures of results that are registered for what a run has."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Vector
from ..files import written_whole
from ..patterns import fits
from ..report.curves import drawable, thinned
from .panels import ShownLine, ShownPanel
from .style import BLUE, COLORS, new_figure, save, tidied, with_margins

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .result import Result

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
    """One line of a panel: what it shows and how; `less` is subtracted, `scale` multiplied.

    What `signal` and `less` name depends on the picture.
    """

    label: str
    signal: str
    color: str = BLUE
    less: str | None = None
    scale: float = 1.0
    dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """One row of axes: the same curves for each column. `late` leaves the initial transient out."""

    label: str
    curves: tuple[Curve, ...]
    late: bool = False


@dataclass(frozen=True)
class Picture(Drawing):
    """A grid of panels: a column for everything that metrics of the kind `of` were computed for.

    `find` gives the full name of a column's signal, of those that there are, or None: it takes the column,
    what a curve calls the signal, all names, and the result's roles. Usually the signal has the column's
    name before a dot.
    """

    title: str
    panels: tuple[Panel, ...]
    of: str
    find: Callable[[str, str, Collection[str], Mapping[str, str]], str | None] = _inside

    def signals(self, result: "Result") -> Iterable[str]:
        """Those of the curves, of every column."""
        names = set(result.names)
        found = (
            self.find(column, signal, names, result.roles)
            for column in result.metrics.get(self.of, ())
            for panel in self.panels
            for curve in panel.curves
            for signal in (curve.signal, curve.less)
            if signal is not None
        )
        return [name for name in found if name is not None]

    def drawn(self, result: "Result", data: Mapping[str, Vector]) -> "Figure | None":
        """The panels with the curves that there are signals for."""
        return _drawn(self, list(result.metrics.get(self.of, ())), data, result.roles)


FIGURES: dict[str, Drawing] = {}
"""Pictures that are drawn of every run that has signals for them, by the name of their file."""


def draw(result: "Result", folder: Path, done: Callable[[str], None]) -> list[Path]:
    """Draw all pictures that the result has signals for; returns the files written.

    `done` is called with the name of each. Raises OSError.
    """
    data = result.read(_wanted(result), _MOST_ROWS)
    if len(data["time"]) < 2:
        return []
    written = []
    for name, picture in FIGURES.items():
        figure = picture.drawn(result, data)
        if figure is not None:
            path = folder / f"{name}.png"
            with written_whole(path) as stream:
                save(figure, stream)
            written.append(path)
        done(name)
    return written


def _wanted(result: "Result") -> list[str]:
    """Signals that pictures show, of those that the result has, and time."""
    wanted = {name for picture in FIGURES.values() for name in picture.signals(result)}
    return ["time", *(name for name in result.names if name in wanted)]


def plotted(result: "Result", names: Sequence[str]) -> "Figure":
    """Signals over time, one panel per unit; names may be patterns. CommandError for what is not there."""
    chosen = list(dict.fromkeys(n for name in names for n in _matching(name, result.names)))
    if not chosen:
        raise CommandError("nothing to plot; name one signal or more.")
    groups: dict[str, list[str]] = {}
    for name in chosen:
        groups.setdefault(str(result.units.get(name) or ""), []).append(name)
    data = result.read(["time", *chosen], _MOST_ROWS)
    figure, axes = new_figure(len(groups), 1, 7.5)
    for row, (unit, group) in zip(axes[:, 0], groups.items(), strict=True):
        for i, name in enumerate(group):
            row.plot(data["time"], data[name], color=COLORS[i % len(COLORS)], label=name, linewidth=1.1)
        row.set_ylabel(unit, parse_math=False)
        tidied(row, group)
    axes[-1, 0].set_xlabel("time / s")
    figure.suptitle(result.name, fontsize=12, fontweight="bold", parse_math=False)
    return figure


def _matching(pattern: str, names: Sequence[str]) -> list[str]:
    found = [n for n in names if fits(n, pattern)]
    return found or [pattern]  # whose reading says what is wrong


def _drawn(picture: Picture, shown: Sequence[ShownPanel]) -> "Figure":
    columns = list(dict.fromkeys(panel.column for panel in shown))
    figure, grid = new_figure(len(picture.panels), len(columns), 3.9, measured=False)
    for axes, panel in zip(grid.flat, shown, strict=True):
        _draw_panel(axes, panel)
    for j, column in enumerate(columns):
        grid[0, j].set_title(column, fontsize=11, parse_math=False)
        grid[-1, j].set_xlabel("time / s")
        for i, panel in enumerate(panels):
            _draw_panel(grid[i, j], panel, partial(_values, picture, column, data, roles), data["time"])
            if j == 0:
                grid[i, 0].set_ylabel(panel.label)
    figure.align_ylabels()
    figure.suptitle(picture.title, fontsize=12, fontweight="bold")
    with_margins(figure, len(picture.panels), len(columns))
    return figure


def _draw_panel(axes: "Axes", panel: ShownPanel) -> None:
    for line in panel.lines:
        style = (0, (4, 2)) if line.dashed else "-"
        values = drawable(line.values)
        kept = thinned(values) if len(values) else slice(None)
        axes.plot(panel.time[kept], values[kept], color=line.color, linestyle=style, linewidth=1.1)
    labels = [line.label for line in panel.lines]
    tidied(axes, labels if any(labels) else ())
