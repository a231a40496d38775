"""How all pictures look: colours, figures that need no state of matplotlib, names as they are."""

import warnings
from collections.abc import Sequence
from io import BytesIO
from typing import IO, TYPE_CHECKING, Literal

import numpy as np

from ..colors import BLUE, COLORS, GREEN, GREY, ORANGE, PURPLE, RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["BLUE", "COLORS", "GREEN", "GREY", "ORANGE", "PURPLE", "RED", "new_figure", "save", "tidied"]


def new_figure(
    rows: int, columns: int, width: float, height: float = 2.1, sharex: Literal["col", "none"] = "col"
) -> "tuple[Figure, np.ndarray]":
    """A figure and its grid of axes, each of this width and height in inches."""
    from matplotlib.figure import Figure

    class Shown(Figure):
        """A figure that a notebook shows as a picture, whatever it was told of matplotlib."""

        def _repr_png_(self) -> bytes:
            content = BytesIO()
            save(self, content)
            return content.getvalue()

    figure = Shown(figsize=(1.2 + width * columns, 0.8 + height * rows), dpi=120, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, sharex=sharex)


def tidied(axes: "Axes", labels: Sequence[str] = ()) -> None:
    """With a legend of the lines, if there are labels; they appear as they are, no formula, none left out."""
    if labels:
        legend = axes.legend(axes.lines, ["label"] * len(labels), fontsize=8, frameon=False)
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
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # a box says so too
        FigureCanvasAgg(figure).print_png(stream)
