"""Draw panels as a grid with a column for each subject."""

from collections.abc import Sequence
from itertools import pairwise
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...pages.panels import Limit, Line, Plot, mask_undrawable
from ...pages.text import shorten_text
from .style import GREY, RED, add_legend, make_figure, tidy_axes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...inputs.stored_runs import StoredRun
    from ...run.result import Result

_LETTERS_PER_INCH = 13
"""Letters per inch in the line below the title."""

_PANEL_WIDTH, _PANEL_HEIGHT = 3.9, 2.1
"""Width and height of a panel with its labels in inches."""

_LEFT_MARGIN, _RIGHT_MARGIN, _BOTTOM_MARGIN, _TOP_MARGIN = 0.95, 0.15, 0.55, 0.78
"""Margins around the axes in inches. Measuring all labels takes longer than the drawing."""

_COLUMN_GAP, _ROW_GAP, _TIME_GAP = 0.75, 0.25, 0.65
"""Distances of axes in inches, the last one below axes with a time label."""

_TIME_LABEL, _VALUE_LABEL = -0.28, -0.56
"""Positions of labels relative to the lower left corner of axes in inches."""

_LINE_LETTERS = 24
"""Most letters in a line of an axis label or of a legend."""

_SHADE = {"color": RED, "alpha": 0.12, "linewidth": 0.0}
"""Style of the area beyond a limit."""

MOST_ROWS = 200_000
"""Of longer tables plots show only every n-th row."""

_NEAR_FRACTION = 0.3
"""Distance at which a limit is shown, relative to the range of the curves."""


def draw_panels(panels: Sequence[Plot], title: str, run: str, name: str = "") -> "Figure":
    """Draw panels row by row, with one panel per column.

    Rows without changes have no axes: their values are under the column names. Rows of the same part of the
    time share an axis. A single column has no name above it if that is `name`, which `run` has.
    """
    columns = list(dict.fromkeys(panel.column for panel in panels))
    rows = [panels[i : i + len(columns)] for i in range(0, len(panels), len(columns))]
    changing_rows, constant_rows = (
        [row for row in rows if has_changes(row)],
        [row for row in rows if not has_changes(row)],
    )
    # a system at rest still has a plot
    if not changing_rows:
        changing_rows, constant_rows = constant_rows, []
    shares_time = [*(upper[0].part == lower[0].part for upper, lower in pairwise(changing_rows)), False]
    figure, grid = _make_grid(
        len(columns), [_ROW_GAP if is_shared else _TIME_GAP for is_shared in shares_time]
    )
    for i, row in enumerate(changing_rows):
        entries = {}
        for axes, panel in zip(grid[i], row, strict=True):
            entries |= _draw_panel(axes, panel)
        grid[i, 0].set_ylabel(fill(row[0].label, _LINE_LETTERS), parse_math=False)
        add_legend(grid[i, -1], list(entries.items()))
        for j, axes in enumerate(grid[i]):
            if shares_time[i]:
                axes.sharex(grid[i + 1, j])
                axes.tick_params(labelbottom=False)
            else:
                axes.set_xlabel("time / s")
    for j, column in enumerate(columns):
        column_name = [] if columns == [name] else [column]
        title_of_column = "   ".join([*column_name, *(_format_constant(row[j]) for row in constant_rows)])
        grid[0, j].set_title(title_of_column, y=1.0, fontsize=11, parse_math=False)
    width, height = figure.get_size_inches()
    figure.suptitle(title, y=1.0 - 0.08 / height, fontsize=12, fontweight="bold", parse_math=False)
    headline = shorten_text(run, int(_LETTERS_PER_INCH * width))
    figure.text(0.5, 1.0 - 0.4 / height, headline, ha="center", color=GREY, fontsize=9, parse_math=False)
    _set_margins(figure, grid)
    return figure


def _make_grid(columns: int, gaps: Sequence[float]) -> "tuple[Figure, np.ndarray]":
    """Return a figure and its axes, with these distances in inches below all rows but the last one."""
    width, height = 1.2 + _PANEL_WIDTH * columns, 0.8 + _PANEL_HEIGHT * len(gaps)
    axes_height = (height - _BOTTOM_MARGIN - _TOP_MARGIN - sum(gaps[:-1])) / len(gaps)
    heights = [part for gap in gaps for part in (axes_height, gap)][:-1]
    figure = make_figure(width, height)
    cells = figure.add_gridspec(len(heights), columns, height_ratios=heights)
    rows = range(0, len(heights), 2)
    return figure, np.array([[figure.add_subplot(cells[i, j]) for j in range(columns)] for i in rows])


def _set_margins(figure: "Figure", grid: np.ndarray) -> None:
    """Set fixed margins, and widen the figure by the legends right of its panels."""
    legends = [legend for axes in grid[:, -1] if (legend := axes.get_legend()) is not None]
    legend_width = max((legend.get_window_extent().width for legend in legends), default=0.0) / figure.dpi
    columns, (narrow, height) = grid.shape[1], figure.get_size_inches()
    width = narrow + legend_width
    axes_width = (narrow - _LEFT_MARGIN - _RIGHT_MARGIN - _COLUMN_GAP * (columns - 1)) / columns
    figure.set_size_inches(width, height)
    figure.subplots_adjust(
        left=_LEFT_MARGIN / width,
        right=1.0 - (_RIGHT_MARGIN + legend_width) / width,
        bottom=_BOTTOM_MARGIN / height,
        top=1.0 - _TOP_MARGIN / height,
        wspace=_COLUMN_GAP / axes_width,
        hspace=0.0,  # distances are rows of the grid
    )
    for axes in grid.flat:
        axes.xaxis.set_label_coords(0.5, _TIME_LABEL / (axes.get_position().height * height))
        axes.yaxis.set_label_coords(_VALUE_LABEL / axes_width, 0.5)


def has_changes(panels: Sequence[Plot]) -> bool:
    """Return whether any panel shows a change, or has no lines."""
    return any(
        not panel.lines or not all(len(x.values) and (x.values == x.values[0]).all() for x in panel.lines)
        for panel in panels
    )


def _format_constant(panel: Plot) -> str:
    """Return the quantity of a panel without changes, and its value."""
    quantity, _, unit = panel.label.partition(" / ")
    value = panel.lines[0].values[0] if panel.lines else np.nan
    return f"{quantity} {value:.4g} {unit.strip('()')}".rstrip()


def _draw_panel(axes: "Axes", panel: Plot) -> "dict[str, Artist]":
    """Draw a panel, and return the entries of its legend: lines if it has several, and shaded areas."""
    entries = {line.label: draw_line(axes, line) for line in panel.lines}
    if len(entries) == 1:
        entries = {}
    tidy_axes(axes)
    axes.tick_params(bottom=False, left=False)  # the grid shows the ticks; drawing them takes a tenth longer
    axes.locator_params(nbins=5)
    for limit in _find_near_limits(panel):
        entries[fill(f"beyond the {limit.label}", _LINE_LETTERS)] = _draw_shaded_limit(axes, limit)
    if not panel.lines:
        axes.text(0.5, 0.5, "no such signal", transform=axes.transAxes, ha="center", color=GREY, fontsize=9)
    return entries


def draw_line(axes: "Axes", line: Line) -> "Artist":
    """Draw a line and return it. Matplotlib leaves out points that are not visible."""
    (artist,) = axes.plot(
        line.time,
        mask_undrawable(line.values),
        drawstyle="steps-post" if line.is_stepped else "default",
        color=line.color,
        linestyle=(0, (4, 2)) if line.dashed else "-",
        linewidth=1.1,
        label=line.label,
    )
    return artist


def _draw_shaded_limit(axes: "Axes", limit: Limit) -> "Artist":
    """Shade the area beyond a limit, and return it for a legend."""
    from matplotlib.patches import Patch

    bottom, top = axes.get_ylim()
    if limit.high is not None:
        # so that a limit above the curves is visible as an area
        top = max(top, limit.high + 0.06 * (top - bottom))
        axes.axhspan(limit.high, top, **_SHADE)
    if limit.low is not None:
        bottom = min(bottom, limit.low - 0.06 * (top - bottom))
        axes.axhspan(bottom, limit.low, **_SHADE)
    axes.set_ylim(bottom, top)
    return Patch(**_SHADE)


def _find_near_limits(panel: Plot) -> list[Limit]:
    """Return the limits that curves come near to, with those ends only."""
    lowest, highest = _find_range(panel.lines)
    near = _NEAR_FRACTION * (highest - lowest)
    near_limits = []
    for limit in panel.limits:
        low = limit.low if limit.low is not None and lowest < limit.low + near else None
        high = limit.high if limit.high is not None and highest > limit.high - near else None
        if low is not None or high is not None:
            near_limits.append(Limit(limit.label, low, high))
    return near_limits


def _find_range(lines: Sequence[Line]) -> tuple[float, float]:
    """Return the lowest and the highest drawable value of all lines; NaN without any."""
    curves = [x.values[np.isfinite(mask_undrawable(x.values))] for x in lines]
    curves = [values for values in curves if len(values)]
    if not curves:
        return np.nan, np.nan
    return min(float(v.min()) for v in curves), max(float(v.max()) for v in curves)


def read_rows(table: "Result | StoredRun", names: Sequence[str]) -> tuple[dict[str, Vector], str]:
    """Return columns and `time` by name, and a note on rows that are left out, empty if none is."""
    data = dict(table.read(["time", *names], MOST_ROWS))
    drawn_count = len(data["time"])
    if 2 * drawn_count <= MOST_ROWS:  # a longer table would fill more than half
        return data, ""
    rows = len(table.read(["time"])["time"])
    return data, f"{drawn_count} of {rows} rows drawn" if drawn_count < rows else ""
