"""Draw panels as a grid with a column for each subject."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Indices, Vector
from ..pages.curve_data import mask_undrawable, thin_points
from ..pages.text import shorten_text
from ..panels import Line, Plot
from .style import GREY, RED, new_figure, tidy_axes, with_margins

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_EARLY = 0.45
"""A motion that ends before this fraction of the time is drawn wider than the rest."""

_WIDE = 0.62
"""Fraction of the width for the motion."""

_LETTERS = 13
"""Letters per inch in the line below the title."""

_NEAR = 0.3
"""Distance at which a limit is shown, relative to the range of the curves."""


def draw_panels(panels: Sequence[Plot], title: str, run: str, rest: float | None = None) -> "Figure":
    """Draw panels row by row, with one panel per column.

    Rows without changes have no axes: their values are under the column names. `rest` is the time in s from
    which nothing moves.
    """
    columns = list(dict.fromkeys(panel.column for panel in panels))
    rows = [panels[i : i + len(columns)] for i in range(0, len(panels), len(columns))]
    shown, still = [row for row in rows if has_changes(row)], [row for row in rows if not has_changes(row)]
    if not shown:
        shown, still = still, []
    said = {c: [_constant(row[j]) for row in still] for j, c in enumerate(columns)}
    figure, grid = new_figure(len(shown), len(columns), 3.9, measured=False)
    split = _split(shown, rest)
    for i, row in enumerate(shown):
        for j, panel in enumerate(row):
            _draw_panel(grid[i, j], panel, split)
        grid[i, 0].set_ylabel(row[0].label, parse_math=False)
    for j, column in enumerate(columns):
        grid[0, j].set_title("   ".join([column, *said[column]]), fontsize=11, parse_math=False)
        if split is not None:
            _widen(grid[-1, j], split)
        grid[-1, j].set_xlabel("time / s" if split is None else f"time / s, wider until {split[1]:.2g} s")
    width, height = figure.get_size_inches()
    figure.suptitle(title, y=1.0 - 0.08 / height, fontsize=12, fontweight="bold", parse_math=False)
    said_of_run = shorten_text(run, int(_LETTERS * width))
    figure.text(0.5, 1.0 - 0.4 / height, said_of_run, ha="center", color=GREY, fontsize=9, parse_math=False)
    with_margins(figure, grid)
    return figure


def has_changes(panels: Sequence[Plot]) -> bool:
    """Return whether any panel shows a change."""
    return not all(_is_constant(panel) for panel in panels)


def _is_constant(panel: Plot) -> bool:
    """Return whether a panel has lines and none of them changes."""
    return bool(panel.lines) and all(len(x.values) and (x.values == x.values[0]).all() for x in panel.lines)


def _constant(panel: Plot) -> str:
    """Return the text for a panel without changes."""
    quantity, _, unit = panel.label.partition(" / ")
    value = panel.lines[0].values[0] if panel.lines else np.nan
    return f"{quantity} {value:.4g} {unit.strip('()')}".rstrip()


def _split(rows: Sequence[Sequence[Plot]], rest: float | None) -> tuple[float, float, float] | None:
    """Return the first time, the end of the motion and the last time, or None if the time scale is even."""
    times = [line.time for row in rows for panel in row for line in panel.lines if len(line.time)]
    if rest is None or not times:
        return None
    first, last = min(t[0] for t in times), max(t[-1] for t in times)
    end = first + 1.15 * (rest - first)
    return (first, end, last) if first < end < first + _EARLY * (last - first) else None


def _place(time: Vector, split: tuple[float, float, float] | None) -> Vector:
    """Return the positions of times on the axis, where the motion is wider than the rest."""
    if split is None:
        return time
    first, end, last = split
    early, late = (time - first) / (end - first), (time - end) / (last - end)
    return np.where(time < end, _WIDE * early, _WIDE + (1.0 - _WIDE) * late)


def _widen(axes: "Axes", split: tuple[float, float, float]) -> None:
    """Label the axis with times at their positions; a scale of the axis would be slower."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

    first, end, last = split
    early = [t for t in MaxNLocator(5).tick_values(first, end) if first <= t <= end - 0.08 * (end - first)]
    late = [t for t in MaxNLocator(4).tick_values(end, last) if end + 0.1 * (last - end) < t <= last]
    said = dict(zip(_place(np.array([*early, *late]), split).tolist(), [*early, *late], strict=True))
    axes.xaxis.set_major_locator(FixedLocator(list(said)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda place, _: f"{said.get(place, np.nan):g}"))


def _draw_panel(axes: "Axes", panel: Plot, split: tuple[float, float, float] | None) -> None:
    for line in panel.lines:
        draw_line(axes, line, split)
    axes.locator_params(axis="y", nbins=5)  # every tick takes time to draw
    labels = [line.label for line in panel.lines]
    tidy_axes(axes, labels if len(labels) > 1 else ())
    _shade(axes, panel)
    if split is not None:
        axes.axvline(_WIDE, color=GREY, linewidth=0.7, linestyle=":")


def draw_line(axes: "Axes", line: Line, split: tuple[float, float, float] | None = None) -> None:
    """Draw the visible points of a line."""
    values = mask_undrawable(line.values)
    kept = _select_rows(line.time, values, split)
    axes.plot(
        _place(line.time[kept], split),
        values[kept],
        color=line.color,
        linestyle=(0, (4, 2)) if line.dashed else "-",
        linewidth=1.1,
        label=line.label,
    )


def _select_rows(time: Vector, values: Vector, split: tuple[float, float, float] | None) -> Indices:
    """Return the rows to draw, as many of the motion as of the rest."""
    if not len(values):
        return np.arange(0)
    border = 0 if split is None else int(np.searchsorted(time, split[1]))
    if not 0 < border < len(time):
        return thin_points(values)
    return np.concatenate([thin_points(values[:border]), border + thin_points(values[border:])])


def _shade(axes: "Axes", panel: Plot) -> None:
    """Shade the area beyond a limit that curves come near to."""
    lowest, highest = _reach(panel.lines)
    near = _NEAR * (highest - lowest)
    for limit in panel.limits:
        low, high = limit.low, limit.high
        bottom, top = axes.get_ylim()
        if high is not None and highest > high - near:
            top = max(top, high + 0.06 * (top - bottom))
            axes.axhspan(high, top, color=RED, alpha=0.12, linewidth=0.0)
        if low is not None and lowest < low + near:
            bottom = min(bottom, low - 0.06 * (top - bottom))
            axes.axhspan(bottom, low, color=RED, alpha=0.12, linewidth=0.0)
        axes.set_ylim(bottom, top)


def _reach(lines: Sequence[Line]) -> tuple[float, float]:
    known = [x.values[np.isfinite(mask_undrawable(x.values))] for x in lines]
    known = [values for values in known if len(values)]
    if not known:
        return np.nan, np.nan
    return min(float(v.min()) for v in known), max(float(v.max()) for v in known)
