"""Common style of all plots: colours, figures without matplotlib's global state, labels without markup."""

import warnings
from collections.abc import Sequence
from io import BytesIO
from typing import IO, TYPE_CHECKING, Literal

import numpy as np

from ...base.colors import BLUE, COLORS, GREEN, GREY, ORANGE, PURPLE, RED
from ...base.ownership import has_mark

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "COLORS",
    "GREEN",
    "GREY",
    "ORANGE",
    "PURPLE",
    "RED",
    "is_picture",
    "new_figure",
    "save",
    "tidy_axes",
    "with_margins",
]


_SOFTWARE = "emla-cosim, Matplotlib"

is_picture = has_mark(b"Software\x00emla-cosim")
"""Marks plots that `save` wrote."""


def new_figure(
    rows: int,
    columns: int,
    width: float,
    height: float = 2.1,
    sharex: Literal["col", "none"] = "col",
    measured: bool = True,
) -> "tuple[Figure, np.ndarray]":
    """Return a figure and its grid of axes, each of this width and height in inches.

    `measured` figures measure their labels to make room for them. For others call `with_margins`.
    """
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """A figure that a notebook shows as an image, regardless of matplotlib's settings."""

        def _repr_png_(self) -> bytes:
            content = BytesIO()
            save(self, content)
            return content.getvalue()

    size = (1.2 + width * columns, 0.8 + height * rows)
    figure = NotebookFigure(figsize=size, dpi=120, layout="constrained" if measured else None)
    return figure, figure.subplots(rows, columns, squeeze=False, sharex=sharex)


def with_margins(figure: "Figure", grid: np.ndarray) -> None:
    """Set fixed margins that leave room for titles and labels of common size.

    Measuring every label takes longer than all of the drawing.
    """
    rows, columns = grid.shape
    width, height = figure.get_size_inches()
    left, right, bottom, top = 0.95, 0.15, 0.55, 0.78
    between, below = 0.75, 0.25
    wide = (width - left - right - between * (columns - 1)) / columns
    high = (height - bottom - top - below * (rows - 1)) / rows
    figure.subplots_adjust(
        left / width, bottom / height, 1 - right / width, 1 - top / height, between / wide, below / high
    )
    for axes in grid.flat:
        axes.set_title(axes.get_title(), y=1.0, fontsize=11, parse_math=False)
        axes.xaxis.set_label_coords(0.5, -0.28 / high)
        axes.yaxis.set_label_coords(-0.56 / wide, 0.5)


def tidy_axes(axes: "Axes", labels: Sequence[str] = ()) -> None:
    """Add a legend if there are labels. All labels appear literally, also those with $ or _."""
    if labels:
        legend = axes.legend(axes.lines, ["label"] * len(labels), fontsize=8, edgecolor="none")
        for text, label in zip(legend.get_texts(), labels, strict=True):
            text.set(text=label, parse_math=False)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    axes.margins(x=0.01)


def save(figure: "Figure", stream: IO[bytes]) -> None:
    """Write a figure as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", "Glyph .* missing from", UserWarning
        )  # the missing glyph is visible as a box
        FigureCanvasAgg(figure).print_png(stream, metadata={"Software": _SOFTWARE})
