"""The panels of a run's plots, for zooming on its page."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector
from ...pages.page import Plots
from ...pages.panels import Plot
from ...run.result import Result
from ..plots.panel_drawing import has_changes
from ..plots.pictures import FIGURES, Picture
from ..plots.stacked import group_signals

_MOST_POINTS = 110_000
"""Most points of all lines together, of about 11 bytes each."""

_MOST_PANELS = 120
"""Most panels on a page."""

_MOST_COLUMNS = 3
"""Most panels side by side."""


@dataclass(frozen=True)
class PagePanel:
    """A panel: subject, label, and id of its plot."""

    column: str
    label: str
    plot: str


@dataclass(frozen=True)
class PagePicture:
    """A plot: title, number of columns, and panels row by row."""

    title: str
    columns: int
    panels: tuple[PagePanel, ...]


def list_signals(result: Result) -> Iterable[str]:
    """Return the signals that plots show."""
    of_pictures = [name for picture in _list_pictures() for name in picture.signals(result)]
    return of_pictures or (name for group in group_signals(result) for name in group.signals)


def build_pictures(result: Result, data: Mapping[str, Vector], plots: Plots) -> tuple[list[PagePicture], int]:
    """Return the plots that fit on the page, and the number of panels left out.

    Without metrics, signals are shown by part and unit.
    """
    if len(data["time"]) < 2:
        return [], 0
    pictures = [(p.make_title(result), p.resolve_panels(result, data)) for p in _list_pictures()]
    pictures = [(title, panels) for title, panels in pictures if has_changes(panels)]
    pictures = pictures or [(group.title, group.panels(result, data)) for group in group_signals(result)]
    panels_with_titles = [(title, panel) for title, panels in pictures for panel in panels if panel.lines]
    fitting = panels_with_titles[:_MOST_PANELS]
    # so that the size of a page is bounded, and short lines keep their shape
    most = int(np.clip(_MOST_POINTS / max(sum(len(panel.lines) for _, panel in fitting), 1), 100, 4000))
    by_title: dict[str, list[Plot]] = {}
    for title, panel in fitting:
        by_title.setdefault(title, []).append(panel)
    page_pictures = [_build_picture(title, panels, most, plots) for title, panels in by_title.items()]
    return page_pictures, len(panels_with_titles) - len(fitting)


def _list_pictures() -> list[Picture]:
    return [picture for picture in FIGURES.values() if isinstance(picture, Picture)]


def _build_picture(title: str, panels: Sequence[Plot], most: int, plots: Plots) -> PagePicture:
    columns = len(dict.fromkeys(panel.column for panel in panels))
    columns = 2 if columns == 1 < len(panels) else min(columns, _MOST_COLUMNS)
    page_panels = (PagePanel(p.column, p.label, plots.add(p, most)) for p in panels)
    return PagePicture(title, columns, tuple(page_panels))
