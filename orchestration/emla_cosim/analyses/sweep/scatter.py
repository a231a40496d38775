"""Draw a point for each variant: figures against factors, and a map over two factors."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...base.arrays import Mask, Vector
from ...base.errors import CommandError, join_names
from ...base.wording import format_number
from ...views.plots.style import BLUE, GREY, ORANGE, PURPLE, RED, new_figure, tidy_axes
from ..variants.measures import DIED, DIVERGED, DONE, FAILED, REFUSED, TIMED_OUT
from .columns import (
    FactorColumn,
    display_of,
    factor_label,
    figure_label,
    figure_values,
    find_varying_factors,
    find_varying_figures,
    influence,
    is_truth,
    is_wide,
    nothing_varies_error,
    put_legend,
    put_levels,
    put_title,
    scale,
    wrap_text,
)
from .result import NOT_HELD, SweepResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

_MAX_FIGURES, _MAX_FACTORS = 4, 6
_MAX_NAMES = 6
"""Most omitted factors that the note names; of more it gives the number."""

_PANEL_LETTERS, _MAP_LETTERS = 30, 80
"""Characters that fit below a panel, and below a map."""

_SHADES = ("#cfe0f1", "#12355f")
"""Shades of good variants in a map, for small and large figures."""

_COLORS = {
    DONE: BLUE,
    NOT_HELD: ORANGE,
    DIVERGED: RED,
    FAILED: PURPLE,
    REFUSED: GREY,
    TIMED_OUT: "#8a6d3b",
    DIED: "#222222",
}


class _OutcomeGroup(NamedTuple):
    """The variants with one outcome, and their colour."""

    outcome: str
    variants: Mask
    color: str


def _group_outcomes(outcomes: np.ndarray) -> list[_OutcomeGroup]:
    """Return a group for each outcome, in the order of severity."""
    groups = [
        _OutcomeGroup(name, outcomes == name, _COLORS.get(name, GREY))
        for name in dict.fromkeys([*_COLORS, *outcomes])
    ]
    return [group for group in groups if group.variants.any()]


def draw_figures(result: SweepResult, figures: Sequence[str] = ()) -> "Figure":
    """Draw figures in rows and factors in columns.

    The default is the first 4 figures that vary, against the 6 strongest factors. Marks at the bottom of a
    panel are variants without the figure.
    """
    names = list(figures or find_varying_figures(result))[:_MAX_FIGURES]
    values = {figure: figure_values(result, figure) for figure in names}
    factors = sorted(
        find_varying_factors(result),
        key=lambda factor: -max((influence(factor, v) for v in values.values()), default=0.0),
    )
    if not (names and factors):
        raise nothing_varies_error(result, "factor" if names else "figure")
    groups, strongest = _group_outcomes(result.outcomes), factors[:_MAX_FACTORS]
    width = 2.5 if len(strongest) > 1 else 5.0
    figure, grid = new_figure(len(names), len(strongest), width, 1.9, sharex="none")
    for row, name in zip(grid, names, strict=True):
        for axes, factor in zip(row, strongest, strict=True):
            _draw_panel(axes, result, factor, name, values[name], groups)
            axes.tick_params(labelleft=axes is row[0], labelbottom=name == names[-1])
        row[0].set_ylabel(wrap_text(figure_label(result, name), 25, 3), fontsize=8, parse_math=False)
    for axes, factor in zip(grid[-1], strongest, strict=True):
        label = wrap_text(factor_label(result, factor.name), _PANEL_LETTERS)
        axes.set_xlabel(label, fontsize=8, parse_math=False)
    figure.align_ylabels()
    figure.set_layout_engine("constrained", w_pad=0.08)  # room for the numbers at the ends of axes
    put_title(figure, f"{result.name}: figures against factors")
    rest = [factor.name for factor in factors[_MAX_FACTORS:]]
    names_of_rest = join_names(rest) if 0 < len(rest) <= _MAX_NAMES else f"{len(rest)} factors"
    same = len(result.factors) - len(factors)
    more = 0 if figures else len(find_varying_figures(result)) - len(names)
    has_marks = any(np.isnan(column).any() for column in values.values())
    notes = [
        f"Omitted for smaller rank correlations: {names_of_rest}." if rest else "",
        f"Factors with one value only: {same}." if same > 0 else "",
        f"{more} more figures vary." if more > 0 else "",
        "Marks at the bottom are variants without the figure." if has_marks else "",
    ]
    _put_legend(figure, result, groups, " ".join(filter(None, notes)))
    return figure


def _draw_panel(
    axes: "Axes",
    result: SweepResult,
    factor: FactorColumn,
    name: str,
    values: Vector,
    groups: Sequence[_OutcomeGroup],
) -> None:
    """Draw a figure over a factor: points, and marks at the bottom for variants without the figure."""
    scaled, is_boolean = display_of(result, name).factor * values, is_truth(result, name)
    x, y = _spread_levels(factor, 0), _spread(scaled, 1) if is_boolean else scaled
    # the area of all marks together does not depend on their number
    crowding = 1.0 / np.sqrt(max(len(x), 1))
    size, alpha = float(np.clip(90.0 * crowding, 1.2, 5.0)), float(np.clip(20.0 * crowding, 0.25, 0.9))
    missing = np.isnan(scaled)
    at_bottom: Any = {"transform": axes.get_xaxis_transform()}
    for _, variants, color in groups:
        points, marks = variants & ~missing, variants & missing
        axes.plot(x[points], y[points], "o", color=color, markersize=size, alpha=alpha, markeredgewidth=0)
        axes.plot(
            x[marks], np.full(marks.sum(), 0.03), "|", color=color, markersize=7, alpha=0.8, **at_bottom
        )
    tidy_axes(axes)
    axes.margins(x=0.04, y=0.1)
    _put_factor(axes, axes.xaxis, factor, _PANEL_LETTERS, 16)
    if is_boolean:
        put_levels(axes.yaxis, ["no", "yes"])
        axes.set_ylim(-0.6, 1.5)
    else:
        scale(axes, axes.yaxis, scaled)


def _spread_levels(factor: FactorColumn, axis: int) -> Vector:
    return _spread(factor.values, axis) if factor.levels else factor.values


def _spread(values: Vector, axis: int) -> Vector:
    """Spread the positions of levels randomly by up to 0.25. The `axis`, 0 or 1, is the seed."""
    return values + np.random.default_rng(axis).uniform(-0.25, 0.25, len(values))


def _put_factor(axes: "Axes", axis: "Axis", factor: FactorColumn, room: int, most: int = 24) -> None:
    """Prepare an axis for a factor: set its scale, or put the names of its levels (see `put_levels`)."""
    if factor.levels is None:
        scale(axes, axis, factor.values)
        return
    is_x = axis is axes.xaxis
    put_levels(axis, factor.levels, most, room=room if is_x else None)
    (axes.set_xlim if is_x else axes.set_ylim)(-0.5, len(factor.levels) - 0.5)


def _put_legend(figure: "Figure", result: SweepResult, groups: Sequence[_OutcomeGroup], note: str) -> None:
    """Put a legend with the number of variants of each outcome, and a note."""
    from matplotlib.lines import Line2D

    style: Any = {"marker": "o", "linestyle": "", "markersize": 5}
    handles = {
        f"{result.good_outcome if name == DONE else name} ({variants.sum()})": Line2D(
            [], [], color=color, **style
        )
        for name, variants, color in groups
    }
    put_legend(figure, handles, note)


def draw_map(result: SweepResult, figures: Sequence[str] = ()) -> "Figure":
    """Draw which variants are held, shaded by a figure.

    If the sweep has no verdict, the map shows which variants are done. A grid of two factors has a cell for
    each variant. Other sweeps show the two factors that have the largest rank correlation with the outcome,
    or with the figure if all outcomes are equal.
    """
    if len(figures) > 1:
        raise CommandError(f"a map shows one figure, not {len(figures)}.")
    outcomes = result.outcomes
    varying = (figure for figure in find_varying_figures(result) if not is_truth(result, figure))
    name = next(iter(figures or varying), None)
    values = np.full(len(outcomes), np.nan)
    if name is not None:
        values = figure_values(result, name) * display_of(result, name).factor
    values[outcomes != DONE] = np.nan
    differ = len(set(outcomes)) > 1
    if not differ and np.isnan(values).all():
        raise CommandError(
            f"the variants of the sweep '{result.name}' do not differ; there is nothing to map."
        )
    factors, by_outcome = find_varying_factors(result), DONE in outcomes and differ
    if len(factors) < 2:
        raise CommandError(
            f"a map needs two factors that vary; the sweep '{result.name}' has {len(factors)}."
        )
    target = (outcomes == DONE).astype(float) if by_outcome else values
    strongest = sorted(factors, key=lambda factor: -influence(factor, target))[:2]
    across, up = (factor for factor in factors if factor in strongest)
    figure, grid = new_figure(1, 1, 6.6, 4.6)
    axes, groups = grid[0, 0], _group_outcomes(outcomes)
    is_grid = result.sampling == "grid" and len(result.factors) == 2
    shades = (_draw_cells if is_grid else _draw_points)(axes, across, up, values, groups)
    axes.set_xlabel(wrap_text(factor_label(result, across.name), 80), fontsize=9, parse_math=False)
    axes.set_ylabel(wrap_text(factor_label(result, up.name), 54), fontsize=9, parse_math=False)
    if name and not np.isnan(values).all():
        bar = figure.colorbar(shades, ax=axes)
        bar.ax.tick_params(labelsize=8)
        bar.set_label(wrap_text(figure_label(result, name), 54), fontsize=9, parse_math=False)
    title = "where it is held" if result.verdicts else "which variants are done"
    put_title(figure, f"{result.name}: {title}")
    subject = f"being {result.good_outcome}" if by_outcome else "the figure"
    note = f"The two of {len(result.factors)} factors with the largest rank correlation with {subject}."
    _put_legend(figure, result, groups, "" if len(result.factors) == 2 else note)
    return figure


def _make_shading(values: Vector) -> dict[str, Any]:
    from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize

    finite = values[~np.isnan(values)]
    low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 1.0)
    norm = LogNorm if is_wide(values) else Normalize
    return {"cmap": LinearSegmentedColormap.from_list("held", _SHADES), "norm": norm(low, high)}


def _draw_cells(
    axes: "Axes", across: FactorColumn, up: FactorColumn, values: Vector, groups: Sequence[_OutcomeGroup]
) -> Any:
    """Draw a cell for each variant of a grid; return the cells that the figure shades, for a colour bar."""
    from matplotlib.colors import ListedColormap

    x_levels, x = np.unique(across.values, return_inverse=True)
    y_levels, y = np.unique(up.values, return_inverse=True)

    def cells(content: Vector, selection: Mask) -> Any:
        table = np.full((len(y_levels), len(x_levels)), np.nan)
        table[y[selection], x[selection]] = content[selection]
        return np.ma.masked_invalid(table)

    for outcome, variants, color in groups:
        color_map = ListedColormap([_SHADES[0] if outcome == DONE else color])
        axes.pcolormesh(cells(np.ones(len(values)), variants), cmap=color_map)
    shades = axes.pcolormesh(cells(values, ~np.isnan(values)), **_make_shading(values))
    for axis, factor, levels in ((axes.xaxis, across, x_levels), (axes.yaxis, up, y_levels)):
        names = [factor.levels[int(v)] if factor.levels else format_number(v, 4) for v in levels]
        put_levels(axis, names, room=_MAP_LETTERS if axis is axes.xaxis else None, first=0.5)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return shades


def _draw_points(
    axes: "Axes", across: FactorColumn, up: FactorColumn, values: Vector, groups: Sequence[_OutcomeGroup]
) -> Any:
    """Draw a point for each variant; return the points that the figure shades, for a colour bar."""
    x, y = _spread_levels(across, 0), _spread_levels(up, 1)
    size = float(np.clip(4000.0 / max(len(x), 1), 8.0, 40.0))
    good = next((variants for name, variants, _ in groups if name == DONE), np.zeros(len(x), bool))
    axes.scatter(x[good], y[good], s=size, color=_SHADES[0], linewidths=0)
    shades = axes.scatter(x[good], y[good], s=size, c=values[good], linewidths=0, **_make_shading(values))
    for outcome, variants, color in groups:
        if outcome != DONE:
            axes.scatter(x[variants], y[variants], s=2 * size, marker="X", color=color, linewidths=0)
    tidy_axes(axes)
    axes.margins(0.03)
    _put_factor(axes, axes.xaxis, across, _MAP_LETTERS)
    _put_factor(axes, axes.yaxis, up, _MAP_LETTERS)
    return shades
