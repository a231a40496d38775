"""Common style of all plots: colours, figures without matplotlib's global state, labels without markup."""

import warnings
from collections.abc import Sequence
from io import BytesIO
from typing import IO, TYPE_CHECKING, Any, Literal

import numpy as np

from ...base.colors import BLUE, COLORS, GREEN, GREY, ORANGE, PURPLE, RED
from ...base.extras import require_extra
from ...base.output_files import has_mark

if TYPE_CHECKING:
    from matplotlib.artist import Artist
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
    "add_legend",
    "count_legend_columns",
    "is_picture",
    "make_figure",
    "new_figure",
    "save",
    "tidy_axes",
    "to_png",
]


_DPI = 150
"""Pixels per inch."""

_LETTER = 0.065
"""Width of a letter of a legend in inches."""

_SOFTWARE = "emla-cosim, Matplotlib"

is_picture = has_mark(b"emla-cosim, Matplotlib", b"Software\x00emla-cosim")
"""Return whether `save` wrote a plot."""


def new_figure(
    rows: int,
    columns: int,
    width: float,
    height: float = 2.1,
    sharex: Literal["col", "none"] = "col",
) -> "tuple[Figure, np.ndarray]":
    """Return a figure and its grid of axes, each of about this width and height in inches."""
    figure = make_figure(1.2 + width * columns, 0.8 + height * rows, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, sharex=sharex)


def make_figure(width: float, height: float, layout: Literal["constrained"] | None = None) -> "Figure":
    """Return an empty figure of this size in inches."""
    require_extra("plots", "a picture")
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """A figure that a notebook shows as an image, regardless of matplotlib's settings."""

        def _repr_png_(self) -> bytes:
            return to_png(self)

    return NotebookFigure(figsize=(width, height), dpi=_DPI, layout=layout)


def count_legend_columns(labels: Sequence[str], width: float) -> int:
    """Return how many columns of a legend with these labels fit `width` inches, at least 1."""
    return max(int(width / (0.5 + _LETTER * max(map(len, labels)))), 1)


def add_legend(
    axes: "Axes", entries: "Sequence[tuple[str, Artist]]", width: float | None = None, title: str = ""
) -> None:
    """Add a legend where it hides no curve.

    Args:
        axes: The axes.
        entries: Labels and their artists; no legend without any.
        width: Width in inches of a legend above the axes; default: it is beside them.
        title: Text above the entries.
    """
    if not entries:
        return
    columns = 0 if width is None else count_legend_columns([label for label, _ in entries], width)
    legend = axes.legend(
        [handle for _, handle in entries],
        # matplotlib leaves out entries that begin with _, and reads $ as mathematics
        ["label"] * len(entries),
        fontsize=8,
        edgecolor="none",
        loc="lower left" if columns else "center left",
        bbox_to_anchor=(0.0, 1.0) if columns else (1.0, 0.5),
        ncols=max(columns, 1),
    )
    if title:
        legend.set_title(title)
        legend.get_title().set(fontsize=8, parse_math=False)
        legend.set_alignment("left")
    for text, (label, _) in zip(legend.get_texts(), entries, strict=True):
        text.set(text=label, parse_math=False)


def tidy_axes(axes: "Axes", labels: Sequence[str] = ()) -> None:
    """Set grid and margins of axes, remove two spines, and add a legend if there are labels.

    All labels appear literally, also those with $ or _.
    """
    if labels:
        legend = axes.legend(axes.lines, ["label"] * len(labels), fontsize=8, edgecolor="none")
        for text, label in zip(legend.get_texts(), labels, strict=True):
            text.set(text=label, parse_math=False)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    axes.margins(x=0.01)


def to_png(figure: "Figure") -> bytes:
    """Return a figure as the content of a PNG file."""
    stream = BytesIO()
    save(figure, stream)
    return stream.getvalue()


def save(figure: "Figure", stream: IO[bytes], form: str = "png") -> None:
    """Write a figure in one of `PLOT_FORMATS`."""
    from matplotlib import rc_context

    creator = {"png": "Software", "pdf": "Creator", "svg": "Creator"}[form]
    dates = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}[form]
    options: dict[str, Any] = {"metadata": {creator: _SOFTWARE, **dates}}
    if form == "png":  # the default takes a tenth of the drawing time more, for a sixth less
        options["pil_kwargs"] = {"compress_level": 3}
    # the same plot has the same bytes, and letters in PDF stay text
    with warnings.catch_warnings(), rc_context({"svg.hashsalt": _SOFTWARE, "pdf.fonttype": 42}):
        warnings.filterwarnings(
            "ignore", "Glyph .* missing from", UserWarning
        )  # the missing glyph is visible as a box
        figure.savefig(stream, format=form, **options)
