"""The panels of a run's pictures as plots that can be zoomed into."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ... import colors
from ...arrays import Vector
from ...report.page import Plots
from ...report.plot import Limit, Line, Plot
from ..panels import ShownPanel
from ..plotting import FIGURES, Picture
from ..result import Result

_POINTS = 140_000
"""Points of all lines together, of about 11 bytes each."""

_PANELS = 120
"""Panels that a page has room for."""

_NAMES = dict(zip(colors.COLORS, ("blue", "orange", "green", "red", "purple", "grey"), strict=True))
"""What a page calls the colours."""


@dataclass(frozen=True)
class Panel:
    """What it is of, what it shows, and the id of its plot."""

    column: str
    label: str
    plot: str


@dataclass(frozen=True)
class Shown:
    """A picture: its title, how many columns it has, and its panels row by row."""

    title: str
    columns: int
    panels: tuple[Panel, ...]


def wanted(result: Result) -> Iterable[str]:
    """The signals that pictures show."""
    return (name for picture in _pictures() for name in picture.signals(result))


def shown(result: Result, data: Mapping[str, Vector], plots: Plots) -> tuple[list[Shown], int]:
    """The pictures that there are signals for, as far as there is room, and how many panels are left out."""
    if len(data["time"]) < 2:
        return [], 0
    resolved = [(p.title, panel) for p in _pictures() for panel in p.resolved(result, data) if panel.lines]
    found = resolved[:_PANELS]
    most = int(np.clip(_POINTS / max(sum(len(panel.lines) for _, panel in found), 1), 200, 4000))
    by_title: dict[str, list[ShownPanel]] = {}
    for title, panel in found:
        by_title.setdefault(title, []).append(panel)
    made = [_shown(title, panels, most, plots) for title, panels in by_title.items()]
    return made, len(resolved) - len(found)


def _pictures() -> list[Picture]:
    return [picture for picture in FIGURES.values() if isinstance(picture, Picture)]


def _shown(title: str, panels: Sequence[ShownPanel], most: int, plots: Plots) -> Shown:
    columns = len(dict.fromkeys(panel.column for panel in panels))
    made = (Panel(p.column, p.label, plots.add(_plot(p, most))) for p in panels)
    return Shown(title, columns, tuple(made))


def _plot(panel: ShownPanel, most: int) -> Plot:
    return Plot(
        panel.label,
        tuple(
            Line(
                line.label or panel.label,
                panel.time,
                line.values,
                _NAMES.get(line.color, "grey"),
                line.dashed,
            )
            for line in panel.lines
        ),
        limits=tuple(Limit(*limit) for limit in panel.limits),
        group=panel.column,
        points=most,
    )
