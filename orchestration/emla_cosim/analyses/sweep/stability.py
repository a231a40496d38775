"""Draw a map over two factors of which variants are held."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.wording import format_number
from ...recorders.metrics import HELD
from ...views.plots.style import new_figure, tidy_axes
from ..variants.data import DONE
from .columns import (
    FactorColumn,
    display_of,
    figure_values,
    find_varying_figures,
    good_outcome,
    influence,
    is_truth,
    read_factor,
    read_outcomes,
)
from .labels import (
    color_of,
    count_outcomes,
    factor_label,
    figure_label,
    is_wide,
    make_legend_handles,
    put_factor,
    put_legend,
    put_levels,
    put_title,
    spread,
    wrap_text,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .result import SweepResult

_ROOM = 80
"""Characters that fit below the map."""

_GOOD = ("#cfe0f1", "#12355f")
"""Shades of held variants, for small and large figures."""

_TITLES = {HELD: "where it is held", DONE: "which variants are done"}
"""Titles of maps by the name of the good outcome."""


def draw_map(result: "SweepResult", figures: Sequence[str] = ()) -> "Figure":
    """Draw which variants are held, shaded by a figure.

    If the sweep has no verdict, the map shows which variants are done. A grid of two factors has a cell for
    each variant. Other sweeps show the two factors that have the largest rank correlation with the outcome,
    or with the figure if all outcomes are equal.
    """
    if len(figures) > 1:
        raise CommandError(f"a map shows one figure, not {len(figures)}.")
    outcomes = read_outcomes(result)
    varying = (figure for figure in find_varying_figures(result) if not is_truth(result, figure))
    name = next(iter(figures or varying), None)
    values = (
        figure_values(result, name) * display_of(result, name).factor
        if name
        else np.full(len(outcomes), np.nan)
    )
    values[outcomes != DONE] = np.nan
    if len(set(outcomes)) < 2 and np.isnan(values).all():
        raise CommandError(
            f"the variants of the sweep '{result.name}' do not differ; there is nothing to map."
        )
    one, other = _two_factors(result, outcomes, values)
    figure, grid = new_figure(1, 1, 6.6, 4.6)
    axes = grid[0, 0]
    whole = result.sampling == "grid" and len(result.factors) == 2
    shades = (_draw_cells if whole else _draw_points)(axes, one, other, values, outcomes)
    axes.set_xlabel(wrap_text(factor_label(result, one.name), 80), fontsize=9, parse_math=False)
    axes.set_ylabel(wrap_text(factor_label(result, other.name), 54), fontsize=9, parse_math=False)
    if name and not np.isnan(values).all():
        bar = figure.colorbar(shades, ax=axes)
        bar.ax.tick_params(labelsize=8)
        bar.set_label(wrap_text(figure_label(result, name), 54), fontsize=9, parse_math=False)
    good = good_outcome(result)
    put_title(figure, f"{result.name}: {_TITLES[good]}")
    put_legend(
        figure,
        make_legend_handles(outcomes, good),
        "" if len(result.factors) == 2 else _note(result, outcomes, good),
    )
    return figure


def _two_factors(
    result: "SweepResult", outcomes: np.ndarray, values: Vector
) -> tuple[FactorColumn, FactorColumn]:
    """Return the two factors with the largest influence, in the order of the sweep."""
    factors = [one for name in result.factors if (one := read_factor(result, name)).varies]
    if len(factors) < 2:
        raise CommandError(
            f"a map needs two factors that vary; the sweep '{result.name}' has {len(factors) or 'none'}."
        )
    followed = (outcomes == DONE).astype(float) if _splits(outcomes) else values
    strongest = sorted(factors, key=lambda one: -influence(one, followed))[:2]
    first, second = (one for one in factors if one in strongest)
    return first, second


def _splits(outcomes: np.ndarray) -> bool:
    return 0 < int((outcomes == DONE).sum()) < len(outcomes)


def _note(result: "SweepResult", outcomes: np.ndarray, good: str) -> str:
    what = f"being {good}" if _splits(outcomes) else "the figure"
    return f"The two of {len(result.factors)} factors with the largest rank correlation with {what}."


def _shading(values: Vector) -> dict[str, Any]:
    """Return colour map and scale for the figure of held variants."""
    from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize

    known = values[~np.isnan(values)]
    low, high = (known.min(), known.max()) if len(known) else (0.0, 1.0)
    norm = LogNorm if is_wide(values) else Normalize
    return {"cmap": LinearSegmentedColormap.from_list("held", _GOOD), "norm": norm(low, high)}


def _draw_cells(
    axes: "Axes", one: FactorColumn, other: FactorColumn, values: Vector, outcomes: np.ndarray
) -> Any:
    from matplotlib.colors import ListedColormap

    x_levels, x = np.unique(one.values, return_inverse=True)
    y_levels, y = np.unique(other.values, return_inverse=True)

    def cells(content: Vector, chosen: np.ndarray) -> Any:
        table = np.full((len(y_levels), len(x_levels)), np.nan)
        table[y[chosen], x[chosen]] = content[chosen]
        return np.ma.masked_invalid(table)

    for outcome in count_outcomes(outcomes):
        color = _GOOD[0] if outcome == DONE else color_of(outcome)
        chosen = outcomes == outcome
        axes.pcolormesh(cells(np.ones(len(outcomes)), chosen), cmap=ListedColormap([color]))
    shades = axes.pcolormesh(cells(values, ~np.isnan(values)), **_shading(values))
    for axis, factor_, levels in ((axes.xaxis, one, x_levels), (axes.yaxis, other, y_levels)):
        names = (
            [factor_.levels[int(v)] for v in levels]
            if factor_.levels
            else [format_number(v, 4) for v in levels]
        )
        put_levels(axis, names, room=_ROOM if axis is axes.xaxis else None, first=0.5)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return shades


def _draw_points(
    axes: "Axes", one: FactorColumn, other: FactorColumn, values: Vector, outcomes: np.ndarray
) -> Any:
    x = spread(one.values, 0) if one.levels else one.values
    y = spread(other.values, 1) if other.levels else other.values
    size = float(np.clip(4000.0 / max(len(x), 1), 8.0, 40.0))
    good = outcomes == DONE
    axes.scatter(x[good], y[good], s=size, color=_GOOD[0], linewidths=0)
    shades = axes.scatter(x[good], y[good], s=size, c=values[good], linewidths=0, **_shading(values))
    for outcome in count_outcomes(outcomes):
        if outcome != DONE:
            mine = outcomes == outcome
            axes.scatter(x[mine], y[mine], s=2 * size, marker="X", color=color_of(outcome), linewidths=0)
    tidy_axes(axes)
    axes.margins(0.03)
    put_factor(axes, axes.xaxis, one, _ROOM)
    put_factor(axes, axes.yaxis, other, _ROOM)
    return shades
