"""Draw figures against factors: a grid of panels with a point for each variant."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Vector
from ...base.errors import join_names
from ...views.plots.style import new_figure, tidy_axes
from .columns import (
    FactorColumn,
    display_of,
    figure_values,
    find_varying_figures,
    good_outcome,
    influence,
    is_truth,
    nothing_varies_error,
    read_factor,
    read_outcomes,
)
from .labels import (
    color_of,
    count_outcomes,
    factor_label,
    figure_label,
    make_legend_handles,
    put_factor,
    put_legend,
    put_levels,
    put_title,
    scale,
    spread,
    wrap_text,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .result import SweepResult

_MOST_FIGURES, _MOST_FACTORS = 4, 6
_NAMED = 6
"""Most omitted factors that the note names; of more it gives the number."""

_ROOM = 30
"""Characters that fit below a panel."""


def draw_figures(result: "SweepResult", figures: Sequence[str] = ()) -> "Figure":
    """Draw figures in rows and factors in columns.

    The default is the first 4 figures that vary, against the 6 strongest factors. Marks at the bottom of a
    panel are variants without the figure.
    """
    chosen = list(figures or find_varying_figures(result))[:_MOST_FIGURES]
    values = {figure: figure_values(result, figure) for figure in chosen}
    varying = [one for name in result.factors if (one := read_factor(result, name)).varies]
    factors = sorted(varying, key=lambda one: -max((influence(one, v) for v in values.values()), default=0.0))
    if not (chosen and factors):
        raise nothing_varies_error(result, "factor" if chosen else "figure")
    outcomes = read_outcomes(result)
    shown = factors[:_MOST_FACTORS]
    figure, grid = new_figure(len(chosen), len(shown), 2.5 if len(shown) > 1 else 5.0, 1.9, sharex="none")
    for i, name in enumerate(chosen):
        row = grid[i]
        for axes, one in zip(row, shown, strict=True):
            _draw_panel(axes, result, one, name, values[name], outcomes)
            axes.tick_params(labelleft=axes is row[0], labelbottom=i == len(chosen) - 1)
        row[0].set_ylabel(wrap_text(figure_label(result, name), 25, 3), fontsize=8, parse_math=False)
    for axes, one in zip(grid[-1], shown, strict=True):
        axes.set_xlabel(wrap_text(factor_label(result, one.name), _ROOM), fontsize=8, parse_math=False)
    figure.align_ylabels()
    figure.set_layout_engine("constrained", w_pad=0.08)  # room for the numbers at the ends of axes
    put_title(figure, f"{result.name}: figures against factors")
    more = 0 if figures else len(find_varying_figures(result)) - len(chosen)
    notes = list(_notes(result, factors, more))
    if any(np.isnan(column).any() for column in values.values()):
        notes.append("Marks at the bottom are variants without the figure.")
    put_legend(figure, make_legend_handles(outcomes, good_outcome(result)), " ".join(notes))
    return figure


def _draw_panel(
    axes: "Axes", result: "SweepResult", one: FactorColumn, name: str, values: Vector, outcomes: np.ndarray
) -> None:
    shown = display_of(result, name).factor * values
    truth = is_truth(result, name)
    x = spread(one.values, 0) if one.levels else one.values
    y = spread(shown, 1) if truth else shown
    count = max(len(x), 1)
    size, alpha = (
        float(np.clip(90.0 / np.sqrt(count), 1.2, 5.0)),
        float(np.clip(20.0 / np.sqrt(count), 0.25, 0.9)),
    )
    missing = np.isnan(shown)
    for outcome in count_outcomes(outcomes):
        mine, color = outcomes == outcome, color_of(outcome)
        known, lost = mine & ~missing, mine & missing
        axes.plot(x[known], y[known], "o", color=color, markersize=size, alpha=alpha, markeredgewidth=0)
        axes.plot(
            x[lost],
            np.full(lost.sum(), 0.03),
            "|",
            color=color,
            markersize=7,
            alpha=0.8,
            transform=axes.get_xaxis_transform(),
        )
    tidy_axes(axes)
    axes.margins(x=0.04, y=0.1)
    put_factor(axes, axes.xaxis, one, _ROOM, 16)
    if truth:
        put_levels(axes.yaxis, ["no", "yes"])
        axes.set_ylim(-0.6, 1.5)
    else:
        scale(axes, axes.yaxis, shown)


def _notes(result: "SweepResult", factors: Sequence[FactorColumn], figures_left: int) -> Iterator[str]:
    if len(factors) > _MOST_FACTORS:
        rest = [one.name for one in factors[_MOST_FACTORS:]]
        named = join_names(rest) if len(rest) <= _NAMED else f"{len(rest)} factors"
        yield f"Omitted for smaller rank correlations: {named}."
    if (same := len(result.factors) - len(factors)) > 0:
        yield f"Factors with one value only: {same}."
    if figures_left > 0:
        yield f"{figures_left} more figures vary."
