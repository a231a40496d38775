"""The panels of a run's pictures as plots that can be zoomed into."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base import colors
from ...base.arrays import Vector
from ...run.result import Result
from ..pages.page import Plots
from ..pages.plot import Limit, Line, Plot
from ..plots.drawing import changing
from ..plots.panels import ShownLine, ShownPanel
from ..plots.plotting import FIGURES, Picture

_POINTS = 110_000
"""Points of all lines together, of about 11 bytes each."""

_PANELS = 120
"""Panels that a page has room for."""

_COLUMNS = 3
"""Panels side by side at most."""

_ANY = "Signals that change"
"""The title of what is shown of a system that nobody has pictures for."""

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
    """The pictures that there are signals for, as far as there is room, and how many panels are left out.

    Where there are none, signals are shown by component and unit.
    """
    if len(data["time"]) < 2:
        return [], 0
    pictures = [(p.title, p.resolved(result, data)) for p in _pictures()]
    resolved = [(title, p) for title, panels in pictures if changing(panels) for p in panels if p.lines]
    resolved = resolved or [(_ANY, panel) for panel in by_unit(result, data)]
    found = resolved[:_PANELS]
    most = int(np.clip(_POINTS / max(sum(len(panel.lines) for _, panel in found), 1), 100, 4000))
    by_title: dict[str, list[ShownPanel]] = {}
    for title, panel in found:
        by_title.setdefault(title, []).append(panel)
    made = [_shown(title, panels, most, plots) for title, panels in by_title.items()]
    return made, len(resolved) - len(found)


def by_unit(result: Result, data: Mapping[str, Vector]) -> list[ShownPanel]:
    """Signals that change, those of one component and unit in a panel, or in several where they are many."""
    components = sorted(result.record.get("components", {}), key=len, reverse=True)
    groups: dict[tuple[str, str], list[tuple[str, Vector]]] = {}
    for name, values in data.items():
        if name != "time" and len(np.unique(values)) > 1:
            component = next((c for c in components if name.startswith(f"{c}.")), "")
            unit = str(result.units.get(name) or "")
            groups.setdefault((component, unit), []).append((name.removeprefix(f"{component}."), values))
    return [
        ShownPanel(
            component,
            unit,
            data["time"],
            tuple(
                ShownLine(label, values, color, False)
                for (label, values), color in zip(part, colors.COLORS, strict=False)
            ),
        )
        for (component, unit), lines in groups.items()
        for part in (lines[k : k + len(colors.COLORS)] for k in range(0, len(lines), len(colors.COLORS)))
    ]


def _pictures() -> list[Picture]:
    return [picture for picture in FIGURES.values() if isinstance(picture, Picture)]


def _shown(title: str, panels: Sequence[ShownPanel], most: int, plots: Plots) -> Shown:
    columns = len(dict.fromkeys(panel.column for panel in panels))
    columns = 2 if columns == 1 < len(panels) else min(columns, _COLUMNS)
    made = (Panel(p.column, p.label, plots.add(_plot(p, most))) for p in panels)
    return Shown(title, columns, tuple(made))


def _plot(panel: ShownPanel, most: int) -> Plot:
    return Plot(
        panel.label,
        tuple(
            Line(
                line.label or panel.label or "value",
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
