"""Read columns of a sweep's table as arrays, and format their names, numbers and levels in pictures."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import polars

from ...base.arrays import Indices, Vector
from ...base.errors import CommandError, suggest_names
from ...recorders.metrics import MetricDisplay
from ...views.plots.style import new_figure
from ..variants.measures import VARIANT
from .result import SweepResult

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

LARGEST = 1e150
"""Numbers beyond this count as missing: their squares overflow."""


@dataclass(frozen=True, eq=False)
class FactorColumn:
    """A factor: `values` for each variant are numbers, or positions in `levels` if there are levels."""

    name: str
    values: Vector
    levels: tuple[str, ...] | None


def read_factor(result: SweepResult, name: str) -> FactorColumn:
    """Return a factor by name. One that is not numeric has levels, in the order of first occurrence."""
    column = result.variants[name]
    # Booleans, too, have levels: an axis with "false" and "true" is easier to read than 0 and 1
    if column.dtype.is_numeric():
        return FactorColumn(name, _to_numbers(column), None)
    texts = ["none" if value is None else _format_level(value) for value in column.to_list()]
    levels = tuple(dict.fromkeys(texts))
    position = {level: float(i) for i, level in enumerate(levels)}
    return FactorColumn(name, np.array([position[text] for text in texts]), levels)


def find_varying_factors(result: SweepResult) -> list[FactorColumn]:
    """Return the factors with at least two values."""
    return [
        factor for factor in (read_factor(result, n) for n in result.factors) if _has_variation(factor.values)
    ]


def figure_values(result: SweepResult, figure: str) -> Vector:
    """Return a figure for each row of the table, Booleans as 0 and 1.

    It is NaN if missing, not finite, beyond `LARGEST`, or of a variant that is not done.

    Raises:
        CommandError: The sweep does not have the figure.
    """
    if figure not in result.figures:
        hint = suggest_names(str(figure), result.figures)
        raise CommandError(f"the sweep '{result.name}' has no figure '{figure}'; {hint}", name=figure)
    values = _to_numbers(result.variants[figure])
    values[~result.is_done] = np.nan
    return values


def read_figure_by_variant(result: SweepResult, figure: str, count: int) -> Vector:
    """Return a figure for the variants 0 to `count` - 1; NaN for one without a row. See `figure_values`."""
    values = np.full(count, np.nan)
    values[variant_numbers(result)] = figure_values(result, figure)
    return values


def variant_numbers(result: SweepResult) -> Indices:
    """Return the variant number of each row."""
    return result.variants[VARIANT].to_numpy().astype(np.intp)


def is_truth(result: SweepResult, figure: str) -> bool:
    """Return whether a figure is Boolean."""
    return result.variants[figure].dtype == polars.Boolean


def find_varying_figures(result: SweepResult) -> list[str]:
    """Return the figures that differ between variants that are done: numbers first, labelled ones before."""
    varying = [figure for figure in result.figures if _has_variation(figure_values(result, figure))]
    return sorted(varying, key=lambda figure: (is_truth(result, figure), figure not in result.displays))


def nothing_varies_error(result: SweepResult, noun: str) -> CommandError:
    """Return the error for a sweep without such a figure or factor to draw."""
    return CommandError(
        f"no {noun} varies between the variants of the sweep '{result.name}' that are done; there is nothing "
        "to draw."
    )


def main_figure(result: SweepResult) -> str | None:
    """Return the default figure: the first that varies, or else the first."""
    return next(iter([*find_varying_figures(result), *result.figures]), None)


def display_of(result: SweepResult, figure: str) -> MetricDisplay:
    """Return label, factor and unit for displaying a figure. The label begins with the subsystem."""
    display = result.displays.get(figure)
    if display is None:
        return MetricDisplay(figure, figure)
    subsystem = figure.removesuffix(display.name).rstrip(".") if figure.endswith(display.name) else ""
    label = display.label if display.label.startswith(subsystem) else f"{subsystem} {display.label}"
    return MetricDisplay(figure, label, display.factor, display.unit, display.large)


def influence(factor: FactorColumn, values: Vector) -> float:
    """Return the absolute rank correlation of a factor with values, from 0 to 1, without NaN.

    For levels it is the root of the share of the ranks' variance that they explain, corrected for chance.
    """
    is_known = ~(np.isnan(factor.values) | np.isnan(values))
    x, y = factor.values[is_known], values[is_known]
    if not (_has_variation(x) and _has_variation(y)):
        return 0.0
    ranks = _rank(y)
    if factor.levels is None:
        return float(abs(np.corrcoef(_rank(x), ranks)[0, 1]))
    _, group = np.unique(x, return_inverse=True)
    count = np.bincount(group)
    # a level for each variant explains everything and says nothing
    if len(count) >= len(y):
        return 0.0
    means = np.bincount(group, ranks) / count
    # many levels explain much by chance: adjusted as the R² of a regression
    unexplained = np.var(ranks - means[group]) / np.var(ranks) * (len(y) - 1) / (len(y) - len(count))
    return float(np.sqrt(max(1.0 - unexplained, 0.0)))


def _rank(values: Vector) -> Vector:
    return polars.Series(values).rank("average").to_numpy()


def _has_variation(values: Vector) -> bool:
    finite = values[~np.isnan(values)]
    return len(finite) > 1 and float(np.ptp(finite)) > 1e-12 * float(np.max(np.abs(finite)))


def _to_numbers(column: polars.Series) -> Vector:
    """Return a column as floats; NaN for missing values and for those beyond `LARGEST`."""
    values = column.cast(polars.Float64, strict=False).to_numpy().astype(float)  # a copy
    values[~(np.abs(values) <= LARGEST)] = np.nan
    return values


def _format_level(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


_DECADES = 2.0
"""Positive numbers get a logarithmic axis if 90 % of them span more decades than this."""

_MAX_LEVELS = 12
"""Most level names on an axis; of more levels only every n-th is named."""


def shorten_text(text: str, most: int) -> str:
    """Shorten a text to `most` characters: an ellipsis replaces its middle."""
    text = re.sub(r"\s", " ", text)
    if len(text) <= most:
        return text
    front = (most - 1) // 2
    return f"{text[:front].rstrip(' .')}…{text[len(text) - (most - 1 - front) :].lstrip(' .')}"


def wrap_text(text: str, width: int, lines: int = 2) -> str:
    """Wrap a text to lines of at most `width` characters, if possible after dots and spaces.

    A unit stays on the line of its quantity.
    """
    text = shorten_text(text, width * lines)
    rows = [""]
    for piece in re.split(r"(?<=[ .])(?<!/ )(?!/)(?![^(]*\))", text):
        if len(rows[-1] + piece.rstrip()) <= width:
            rows[-1] += piece
        else:
            rows.append(piece)
    if len(rows) > lines or max(map(len, rows)) > width + 1:
        rows = [text[i : i + width] for i in range(0, len(text), width)]
    return "\n".join(line.strip() for line in rows if line.strip())


def label_with_unit(name: str, unit: str) -> str:
    """Return the axis label of a quantity: name / unit."""
    if not unit:
        return name
    return f"{name} / ({unit})" if re.search(r"[ /.*]", unit) else f"{name} / {unit}"


def factor_label(result: SweepResult, name: str) -> str:
    """Return the label of a factor with its unit."""
    return label_with_unit(name, result.units.get(name) or "")


def figure_label(result: SweepResult, name: str) -> str:
    """Return the label of a figure with its display unit."""
    display = display_of(result, name)
    return label_with_unit(display.label, display.unit)


def is_wide(values: Vector) -> bool:
    """Return whether values need a logarithmic axis: all positive, and most spanning many decades."""
    finite = values[~np.isnan(values)]
    if not len(finite) or finite.min() <= 0.0:
        return False
    # without the extremes, so that one outlier does not decide
    low, high = np.quantile(finite, [0.05, 0.95])
    return bool(np.log10(high / low) > _DECADES)


def scale(axes: "Axes", axis: "Axis", values: Vector) -> None:
    """Choose the scale of the x or y axis for numbers, with few ticks."""
    from matplotlib.ticker import MaxNLocator, NullFormatter

    if is_wide(values):
        (axes.set_xscale if axis is axes.xaxis else axes.set_yscale)("log")
        axis.set_minor_formatter(NullFormatter())
        return
    axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    axes.ticklabel_format(axis="x" if axis is axes.xaxis else "y", scilimits=(-3, 4))
    axis.get_offset_text().set_fontsize(8)


def put_levels(
    axis: "Axis", levels: Sequence[str], most: int = 24, room: int | None = None, first: float = 0.0
) -> None:
    """Put names at the positions `first`, `first` + 1 and so on; of many only every n-th.

    Names are shortened to `most` characters. They are rotated if together they exceed `room` characters.
    """
    positions = range(0, len(levels), -(-len(levels) // _MAX_LEVELS))
    names = [shorten_text(levels[i], most) for i in positions]
    is_rotated = room is not None and sum(len(name) + 2 for name in names) > room
    rotation = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"} if is_rotated else {}
    axis.set_ticks([first + i for i in positions], names, parse_math=False, **rotation)
    axis.set_tick_params(labelsize=8)


def put_title(figure: "Figure", title: str) -> None:
    """Put the title over a picture."""
    lines = wrap_text(title, int(9.0 * figure.get_figwidth()))
    figure.suptitle(lines, fontsize=12, fontweight="bold", parse_math=False)


def put_legend(figure: "Figure", handles: "Mapping[str, Artist]", note: str = "") -> None:
    """Put a legend below the picture, with a note in small letters above it."""
    width = figure.get_figwidth()
    columns = len(handles) if width > 1.5 * len(handles) else -(-len(handles) // 2)
    legend = figure.legend(
        handles=list(handles.values()),
        labels=["label"] * len(handles),  # matplotlib drops labels that begin with _ and parses those with $
        loc="outside lower center",
        ncols=columns,
        fontsize=8,
        frameon=False,
    )
    for text, label in zip(legend.get_texts(), handles, strict=True):
        text.set(text=label, parse_math=False)
    if note:
        legend.set_title(" ")
        legend.get_title().set(
            text=wrap_text(note, int(13.0 * width), 4),
            parse_math=False,
            color="#555555",
            fontsize=8,
            ha="center",
        )


def make_panels(titles: Sequence[str], width: float, **size: Any) -> tuple["Figure", np.ndarray]:
    """Return a picture with a panel for each title, and its axes: a row for each row of panels.

    Panels in several columns have this `width` in inches; `size` are further arguments of `new_figure`.
    """
    columns = 1 if len(titles) <= 1 else 2 if len(titles) <= 4 else 3
    rows = -(-len(titles) // columns)
    figure, grid = new_figure(rows, columns, 7.5 if columns == 1 else width, sharex="none", **size)
    for axes, title in zip(grid.flat, titles, strict=False):
        axes.set_title(title, fontsize=9, parse_math=False)
    for axes in grid.flat[len(titles) :]:
        axes.set_visible(False)
    return figure, grid
