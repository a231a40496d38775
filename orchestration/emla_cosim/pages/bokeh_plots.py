"""Plots as Bokeh figures: zoom, legends that hide lines, values at the pointer."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Literal

import numpy as np

from ..base.arrays import Vector
from ..base.colors import GREY, ORANGE, RED
from .panels import Limit, Line, Plot, compact, condense_curves, find_range, mask_undrawable, pad_range
from .text import make_visible, shorten_text

_FORMAT = "%.6g"
_LEGEND_LETTERS, _LABEL_LETTERS = 52, 46
"""Most letters in a line of a legend, and of a label."""

_LEGEND_LINE = 20
"""Height of a line of a legend in pixels."""

_PAINT, _LINE = "#737a82", "#c5c9ce"
_AXIS: dict[str, Any] = {
    "axis_label_text_color": _PAINT,
    "axis_label_text_font_size": "12px",
    "axis_label_text_font_style": "normal",
    "axis_line_color": _LINE,
    "major_label_text_color": _PAINT,
    "major_tick_in": 0,
    "major_tick_line_color": _LINE,
    "minor_tick_line_color": None,
}
_LEGEND: dict[str, Any] = {
    "background_fill_color": None,
    "border_line_color": None,
    "click_policy": "hide",
    "label_text_color": _PAINT,
    "label_text_font_size": "12px",
    "glyph_height": 14,
    "label_height": 14,
    "margin": 0,
    "padding": 2,
    "spacing": 4,
}
"""Looks of all figures; `style.css` inverts them in the dark theme. A Bokeh theme takes longer."""


def new_figure(label: str, times: Sequence[Vector], values: Any) -> Any:
    """Return a figure without curves over all these times and a range of values."""
    from bokeh.models import CrosshairTool, Grid, LinearAxis, Plot, Range1d, Toolbar, WheelZoomTool

    start, end = pad_range(*find_range(times), 0.01)
    wheel = WheelZoomTool(modifiers={"ctrl": True})  # without Ctrl the wheel scrolls the page
    crosshair = CrosshairTool(dimensions="height", line_color=GREY, visible=False)
    drag, *buttons = _make_tools()
    plot = Plot(
        height=250,
        sizing_mode="stretch_width",
        toolbar=Toolbar(
            tools=[drag, *buttons, wheel, crosshair], active_drag=drag, active_scroll=wheel, logo=None
        ),
        title=None,
        x_range=Range1d(start=start, end=end),
        y_range=values,
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=None,
        min_border=8,
    )
    vertical = LinearAxis(axis_label=label, **_AXIS)
    plot.add_layout(LinearAxis(axis_label="time / s", **_AXIS), "below")
    plot.add_layout(vertical, "left")
    plot.add_layout(Grid(axis=vertical, dimension=1, grid_line_color="#e2e4e7"))
    return plot


@cache
def _make_tools() -> Sequence[Any]:
    """Return the tools that figures share, because they have no state; the first one is for dragging."""
    from bokeh.models import BoxZoomTool, PanTool, ResetTool, SaveTool, ZoomInTool, ZoomOutTool

    return BoxZoomTool(), PanTool(), ZoomInTool(), ZoomOutTool(), ResetTool(), SaveTool()


def serialize_figure(figure: Any) -> dict[str, Any]:
    """Return a figure for `Bokeh.embed.embed_item`, as `bokeh.embed.json_item` does in twice the time."""
    from bokeh import __version__
    from bokeh.core.serialization import Serializer

    root = Serializer(deferred=False).encode(figure)
    document = {"version": __version__, "title": "", "roots": [root]}
    return {"target_id": None, "root_id": figure.id, "doc": document, "version": __version__}


def build_figure(plot: Plot, most: int) -> Any:
    """Return the Bokeh figure of a plot with at most about `most` points for each line."""
    from bokeh.models import ColumnDataSource, Range1d, Scatter, VArea, VSpan

    low, high = _find_value_range(plot)
    unit = describe_unit(plot.label, plot.items)
    figure = new_figure(unit, [line.time for line in plot.lines], Range1d(start=low, end=high))
    data = ColumnDataSource({name: compact(values) for name, values in _sample_lines(plot, most).items()})
    entries, rows = list[tuple[str, Any]](), [("time / s", "@time")]
    if plot.band is not None:
        area = VArea(x="time", y1="lower", y2="upper", fill_color=ORANGE, fill_alpha=0.25)
        entries.append((plot.band.label, figure.add_glyph(data, area)))
    for number, line in enumerate(plot.lines):
        curve = add_line(figure, data, "time", f"y{number}", line)
        entries.append((describe_line(line, plot.label), curve))
        name = ", ".join(filter(None, (shorten_text(make_visible(line.label), _LABEL_LETTERS), unit)))
        rows.append((name, f"@y{number}"))
    if plot.band is not None:
        rows.append((make_visible(plot.band.label), "@lower … @upper"))
    if plot.lines:
        add_values(figure, [entries[-1][1]], rows, "vline")
    entries += [
        (_describe_limit(limit), _add_limit(figure, limit, 10.0 * (high - low))) for limit in plot.limits
    ]
    if (point := _find_mark(plot)) is not None:
        label, x, y = point
        ring = Scatter(size=9, line_color=RED, line_width=1.75, fill_color=None)
        point_data = ColumnDataSource({"x": [x], "y": [y]})
        entries.append((f"{label} at {x:.4g} s", figure.add_glyph(point_data, ring)))
    if plot.since is not None and np.isfinite(plot.since[0]):
        at, label = plot.since
        edge = figure.add_glyph(ColumnDataSource({"x": [at]}), VSpan(line_dash="dashed", line_color=RED))
        entries.append((f"{label} at {at:.4g} s", edge))
    add_legend(figure, entries)
    return figure


def add_line(figure: Any, data: Any, x: str, y: str, line: Line, **attributes: Any) -> Any:
    """Add a line with these columns of `data`, and return its renderer."""
    from bokeh.models.glyphs import Line as LineGlyph
    from bokeh.models.glyphs import Step

    look = {"line_color": line.color, "line_dash": [5, 3] if line.dashed else [], "line_width": 1.5}
    # discrete values hold until they change
    glyph = Step(x=x, y=y, mode="after", **look) if line.is_stepped else LineGlyph(x=x, y=y, **look)
    return figure.add_glyph(data, glyph, view=_make_view(), **attributes)


@cache
def _make_view() -> Any:
    """Return the view of all points, which has no state; each line would make its own."""
    from bokeh.models import CDSView

    return CDSView()


def add_values(
    figure: Any, curves: Sequence[Any], rows: Sequence[tuple[str, str]], mode: Literal["vline", "mouse"]
) -> None:
    """Show labels and values at the pointer.

    Args:
        figure: The figure.
        curves: Renderers whose points are shown.
        rows: Labels, and columns of the data such as `@time`, or texts with columns.
        mode: `vline` for the points above and below the pointer, `mouse` for those at the pointer.
    """
    from bokeh.models import HoverTool

    columns = [word for _, row in rows for word in row.split() if word.startswith("@")]
    tooltips = [(label, re.sub(r"@\w+", rf"\g<0>{{{_FORMAT}}}", row)) for label, row in rows]
    formatters: dict[str, Any] = dict.fromkeys(columns, "printf")
    figure.add_tools(
        HoverTool(renderers=list(curves), tooltips=tooltips, formatters=formatters, mode=mode, visible=False)
    )


def add_legend(figure: Any, entries: Sequence[tuple[str, Any]]) -> list[Any]:
    """Add a legend above a figure, which grows by its lines. Return its items."""
    from bokeh.core.properties import value
    from bokeh.models import Legend, LegendItem

    labels = [shorten_text(make_visible(label), _LABEL_LETTERS) for label, _ in entries]
    items = [
        LegendItem(label=value(label), renderers=[renderer])
        for label, (_, renderer) in zip(labels, entries, strict=True)
    ]
    columns = _count_legend_columns(labels)
    legend = Legend(items=items, ncols=columns, orientation="horizontal", location="left", **_LEGEND)
    figure.add_layout(legend, "above")
    figure.height += _LEGEND_LINE * -(-len(items) // columns)
    return items


def _count_legend_columns(labels: Sequence[str]) -> int:
    """Return how many columns of a legend, filled row by row, fit above a figure."""
    for columns in range(len(labels), 1, -1):
        widths = [max(map(len, labels[first::columns])) + 6 for first in range(columns)]
        if sum(widths) <= _LEGEND_LETTERS:
            return columns
    return 1


def describe_unit(label: str, items: Mapping[int, str]) -> str:
    """Return the label of an axis: quantity and unit, or names of values such as `0 false, 1 true`."""
    names = ", ".join(f"{value} {name}" for value, name in items.items())
    return shorten_text(make_visible(label or names), _LABEL_LETTERS)


def describe_line(line: Line, default: str) -> str:
    """Return the label of a line, with the number of points that no axis can show."""
    missing = int(np.isnan(mask_undrawable(line.values)).sum())
    gaps = f", {missing} point{'s' if missing > 1 else ''} not drawn" if missing else ""
    return (line.label or default or "value") + gaps


def _sample_lines(plot: Plot, most: int) -> dict[str, Vector]:
    """Return times and values of all lines and of the band at common times, condensed."""
    lines = {f"y{number}": (line.time, line.values) for number, line in enumerate(plot.lines)}
    if plot.band is not None:
        lines |= {"lower": (plot.band.time, plot.band.lower), "upper": (plot.band.time, plot.band.upper)}
    times = [time for time, _ in lines.values()]
    curves = {name: mask_undrawable(values) for name, (_, values) in lines.items()}
    # lines with the same times need no interpolation
    if all(np.array_equal(time, times[0]) for time in times):
        time = times[0] if times else np.empty(0)
    else:
        time = np.unique(np.concatenate(times))
        curves = {
            name: np.interp(time, lines[name][0], values, left=np.nan, right=np.nan)
            if len(values)
            else np.full(len(time), np.nan)
            for name, values in curves.items()
        }
    retained = condense_curves(time, list(curves.values()), most)
    return {"time": time[retained], **{name: values[retained] for name, values in curves.items()}}


def _find_value_range(plot: Plot) -> tuple[float, float]:
    """Return the initial range: the band, and lines and limits as far as they are near it."""
    low, high = find_range([line.values for line in plot.lines])
    if plot.band is None:
        near = 0.5 * (high - low)
        edges = [edge for limit in plot.limits for edge in (limit.low, limit.high) if edge is not None]
        edges = [edge for edge in edges if low - near <= edge <= high + near]
        return pad_range(min([low, *edges]), max([high, *edges]))
    first, last = find_range([plot.band.lower, plot.band.upper])
    if plot.shows_all:
        return pad_range(min(first, low), max(last, high))
    room = (last - first) or abs(last) or 1.0  # a diverging line leaves the plot
    return pad_range(max(min(first, low), first - room), min(max(last, high), last + room))


def _describe_limit(limit: Limit) -> str:
    low, high = ("" if end is None else f"{end:.6g}" for end in (limit.low, limit.high))
    return " ".join(filter(None, (limit.label, low, "…", high)))


def _add_limit(figure: Any, limit: Limit, width: float) -> Any:
    """Shade the area of this width beyond a limit, and return its renderer."""
    from bokeh.models import ColumnDataSource, HStrip

    areas = [
        (edge, edge + sign * width)
        for edge, sign in ((limit.low, -1.0), (limit.high, 1.0))
        if edge is not None and np.isfinite(mask_undrawable(np.array([edge]))[0])
    ]
    data = ColumnDataSource({"y0": [edge for edge, _ in areas], "y1": [end for _, end in areas]})
    look = {
        "fill_color": RED,
        "fill_alpha": 0.08,
        "line_color": RED,
        "line_alpha": 0.6,
        "line_dash": "dashed",
    }
    return figure.add_glyph(data, HStrip(y0="y0", y1="y1", **look))


def _find_mark(plot: Plot) -> tuple[str, float, float] | None:
    """Return label, time and value of the point of the first line that is nearest to the mark."""
    if plot.mark is None:
        return None
    at, label = plot.mark
    time, values = plot.lines[0].time, mask_undrawable(plot.lines[0].values)
    finite = np.flatnonzero(np.isfinite(values))
    if not len(finite):
        return None
    k = finite[np.argmin(np.abs(time[finite] - at))]
    return label, float(time[k]), float(values[k])
