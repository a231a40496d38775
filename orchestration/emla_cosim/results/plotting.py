"""Pictures of results that are registered for what a run has."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Vector
from ..files import written_whole
from .style import BLUE, new_figure, save, tidied

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


def _drawn(
    picture: Picture, columns: Sequence[str], data: Mapping[str, Vector], roles: Mapping[str, str]
) -> "Figure | None":
    panels = picture.panels
    shown = [
        c
        for c in columns
        if any(picture.find(c, curve.signal, data, roles) for p in panels for curve in p.curves)
    ]
    if not shown:
        return None
    figure, grid = new_figure(len(panels), len(shown), 3.9)
    for j, column in enumerate(shown):
        grid[0, j].set_title(column, fontsize=11, parse_math=False)
        grid[-1, j].set_xlabel("time / s")
        for i, panel in enumerate(panels):
            _draw_panel(grid[i, j], panel, partial(_values, picture, column, data, roles), data["time"])
            if j == 0:
                grid[i, 0].set_ylabel(panel.label)
    figure.align_ylabels()
    figure.suptitle(picture.title, fontsize=12, fontweight="bold")
    return figure


def _values(
    picture: Picture, column: str, data: Mapping[str, Vector], roles: Mapping[str, str], signal: str
) -> Vector | None:
    name = picture.find(column, signal, data, roles)
    return None if name is None else data[name]


def _draw_panel(axes: "Axes", panel: Panel, values_of: Callable[[str], Vector | None], time: Vector) -> None:
    late = panel.late and time[-1] > time[0] + 2 * _TRANSIENT
    part = time >= time[0] + (_TRANSIENT if late else 0.0)
    shown = []
    for curve in panel.curves:
        values = values_of(curve.signal)
        minus = values_of(curve.less) if curve.less else np.zeros_like(time)
        if values is None or minus is None:
            continue
        axes.plot(
            time[part],
            curve.scale * (values - minus)[part],
            color=curve.color,
            linestyle=(0, (4, 2)) if curve.dashed else "-",
            linewidth=1.1,
        )
        shown.append(curve.label)
    tidied(axes, shown if len(panel.curves) > 1 else ())
