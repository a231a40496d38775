"""Bokeh's library and figure templates, which the scripts of a page fill with data."""

import json
import re
from functools import cache
from typing import Any

from .plot_data import Shape


@cache
def library() -> str:
    """Return the text of BokehJS with its licence, escaped for a script element."""
    from bokeh.resources import Resources

    text = Resources(mode="inline", components=["bokeh"], minified=True).js_raw[0]
    return re.sub("<(?=/script|!--)", r"\\x3c", text, flags=re.IGNORECASE)


@cache
def template(shape: Shape) -> str:
    """Return a figure of this shape as JSON. Its models have names, by which scripts set data and colours."""
    from bokeh.embed import json_item
    from bokeh.models import BoxAnnotation, CrosshairTool, Span

    figure = _figure()
    for k in range(shape.limits):
        for end in ("low", "high"):
            name = f"limit-{k}-{end}"
            # a box that begins outside of the view would draw its edge at the border of the plot
            figure.add_layout(BoxAnnotation(name=name, visible=False, line_color=None, level="underlay"))
            edge = Span(name=f"{name}-edge", visible=False, line_dash="dashed", level="underlay")
            figure.add_layout(edge)
    if shape.band:
        source = _source("band", "x", "lower", "upper")
        figure.varea("x", "lower", "upper", source=source, name="band")
        for edge in ("lower", "upper"):
            figure.line("x", edge, source=source, name=f"band-{edge}", line_width=0.75)
    for k in range(shape.lines):  # the last on top, as in plot files: dashes over what they follow
        figure.line("x", "y", source=_source(f"line-{k}", "x", "y"), name=f"line-{k}", line_width=1.5)
    figure.scatter(
        "x", "y", source=_source("mark", "x", "y"), name="mark", size=9, line_width=1.75, fill_color=None
    )
    figure.add_tools(CrosshairTool(dimensions="height", line_width=1, name="crosshair", visible=False))
    figure.add_layout(Span(dimension="height", line_dash="dotted", name="since", visible=False))
    return json.dumps(json_item(figure), separators=(",", ":"))


def _figure() -> Any:
    from bokeh.models import Range1d, WheelZoomTool
    from bokeh.plotting import figure

    made = figure(
        height=250,
        sizing_mode="stretch_width",
        tools="pan,box_zoom,reset,save",
        active_drag="box_zoom",
        x_range=Range1d(start=0, end=1),
        y_range=Range1d(start=0, end=1),
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=None,
        min_border=8,
    )
    wheel = WheelZoomTool(modifiers={"ctrl": True})  # without Ctrl the wheel scrolls the page
    made.add_tools(wheel)
    made.toolbar.active_scroll = wheel
    made.toolbar.logo, made.toolbar.group = None, False
    made.toolbar.stylesheets = [".bk-divider { opacity: 0.25; }"]
    made.xaxis.axis_label = "time / s"
    for axis in made.axis:
        axis.minor_tick_line_color = None
        axis.axis_label_text_font_style = "normal"
        axis.major_tick_in = 0
    made.xgrid.grid_line_color = None
    return made


def _source(name: str, *columns: str) -> Any:
    from bokeh.models import ColumnDataSource

    return ColumnDataSource({column: [] for column in columns}, name=f"{name}-data")
