"""Draw the scales of axes: grid, ticks and their labels.

Matplotlib has five objects for each tick. They take more than half of the time of a plot, so here one object
draws a whole scale.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist, allow_rasterization
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from matplotlib.transforms import IdentityTransform

_MOST = 5
"""Most intervals of a scale."""

_STEPS = [1, 2, 2.5, 5, 10]
_TICK, _PAD, _SIZE = 3.5, 3.5, 8.0
"""Length of a tick, distance of its label, and size of letters, in points."""

_GRID, _LINE, _WIDTH = (0.69, 0.69, 0.69, 0.25), (0.0, 0.0, 0.0, 1.0), 0.8
_BELOW_LINES = 1.5
"""Place among the objects of axes: above areas, below lines."""


_WITHOUT_TICKS: dict[str, Any] = {"majorTicks": [], "minorTicks": []}
_XAxis: type[XAxis] = type("XAxis", (XAxis,), _WITHOUT_TICKS)
_YAxis: type[YAxis] = type("YAxis", (YAxis,), _WITHOUT_TICKS)
"""The axes of Matplotlib, which make a tick where they are made; these do not."""


class PlainAxes(Axes):
    """Axes without ticks, for `Scales`. Its axes have a label, and make no ticks."""

    def _init_axis(self) -> None:
        self.xaxis, self.yaxis = _XAxis(self, clear=False), _YAxis(self, clear=False)
        for side, axis in (
            ("bottom", self.xaxis),
            ("top", self.xaxis),
            ("left", self.yaxis),
            ("right", self.yaxis),
        ):
            self.spines[side].register_axis(axis)


class Scales(Artist):
    """The scales of axes below and left of them, with a grid, and their labels.

    It replaces the scales of Matplotlib, which become invisible. It fits plots without interaction and with
    linear axes.
    """

    def __init__(self, axes: Axes) -> None:
        super().__init__()
        self.shows_time = True
        """Whether the axis below has numbers and a label."""
        self._axes = axes
        self._font = FontProperties(size=_SIZE)
        self.set_zorder(_BELOW_LINES)
        for side in ("left", "bottom"):  # ticks would do it
            axes.spines[side].set_position(("outward", 0.0))
        axes.xaxis.set_visible(False)
        axes.yaxis.set_visible(False)
        axes.add_artist(self)
        self.set_clip_on(False)

    def find_ticks(self, axis: Axis) -> tuple[np.ndarray, list[str], str]:
        """Return the values with ticks, their labels, and a text for what all of them have in common."""
        low, high = sorted(axis.get_view_interval())
        values = np.asarray(MaxNLocator(_MOST, steps=_STEPS).tick_values(low, high))
        margin = 1e-10 * (high - low)
        values = values[(low - margin <= values) & (values <= high + margin)]
        formatter = ScalarFormatter()
        formatter.set_axis(axis)
        labels = formatter.format_ticks(values.tolist())
        return values, labels, formatter.get_offset()

    @allow_rasterization
    def draw(self, renderer: Any) -> None:
        """Draw both scales; of axes without curves only the labels."""
        if self._axes.lines:
            self._draw_scales(renderer)
        if self.shows_time:
            self._axes.xaxis.label.draw(renderer)
        self._axes.yaxis.label.draw(renderer)
        self.stale = False

    def _draw_scales(self, renderer: Any) -> None:
        below, left = self.find_ticks(self._axes.xaxis), self.find_ticks(self._axes.yaxis)
        box, points = self._axes.bbox, renderer.points_to_pixels
        to_pixels = self._axes.transData.transform
        some_x, some_y = self._axes.get_xlim()[0], self._axes.get_ylim()[0]
        x = to_pixels(np.column_stack((below[0], np.full(len(below[0]), some_y))))[:, 0]
        y = to_pixels(np.column_stack((np.full(len(left[0]), some_x), left[0])))[:, 1]
        grid = [((at, box.y0), (at, box.y1)) for at in x] + [((box.x0, at), (box.x1, at)) for at in y]
        length = points(_TICK)
        ticks = [((at, box.y0), (at, box.y0 - length)) for at in x]
        ticks += [((box.x0, at), (box.x0 - length, at)) for at in y]
        self._draw_lines(renderer, grid, _GRID)
        self._draw_lines(renderer, ticks, _LINE)
        away = points(_TICK + _PAD)
        _, whole, descent = renderer.get_text_width_height_descent("lp", self._font, False)
        gc = renderer.new_gc()
        gc.set_foreground(_LINE)
        for at, text in zip(y, left[1], strict=True):
            width = self._width(renderer, text)
            self._write(renderer, gc, box.x0 - away - width, at - (whole - descent) / 2.0, text)
        if left[2]:
            self._write(renderer, gc, box.x0, box.y1 + points(3.0), left[2])
        if self.shows_time:
            base = box.y0 - away - (whole - descent)
            for at, text in zip(x, below[1], strict=True):
                self._write(renderer, gc, at - self._width(renderer, text) / 2.0, base, text)
            if below[2]:
                width = self._width(renderer, below[2])
                self._write(renderer, gc, box.x1 - width, base - 1.3 * whole, below[2])
        gc.restore()

    def _draw_lines(self, renderer: Any, lines: Sequence[Any], color: Any) -> None:
        gc = renderer.new_gc()
        gc.set_foreground(color, isRGBA=True)
        gc.set_alpha(color[3])
        gc.set_linewidth(_WIDTH)
        gc.set_capstyle("butt")
        gc.set_snap(True)
        for line in lines:
            renderer.draw_path(gc, Outline(np.asarray(line)), IdentityTransform())
        gc.restore()

    def _width(self, renderer: Any, text: str) -> float:
        return renderer.get_text_width_height_descent(text, self._font, False)[0]

    def _write(self, renderer: Any, gc: Any, x: float, y: float, text: str) -> None:
        if renderer.flipy():
            y = renderer.get_canvas_width_height()[1] - y
        renderer.draw_text(gc, x, y, text, self._font, 0.0, ismath=False)
