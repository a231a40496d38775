"""Draw bars for each factor: tornado of local sensitivities, and Sobol indices."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.errors import CommandError
from ...views.plots.style import BLUE, GREY, ORANGE, tidy_axes
from .columns import display_of, find_varying_figures, is_truth, nothing_varies_error
from .labels import figure_label, make_panels, put_legend, put_levels, put_title, scale, wrap_text
from .result import SweepResult
from .sensitivity import (
    ONE_AT_A_TIME,
    SALTELLI,
    LocalSensitivity,
    SobolIndices,
    check_sampling,
    local_sensitivities,
    sobol_indices,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_PANELS, _MAX_BARS = 12, 12
_MAX_LETTERS = 38
"""Most characters of a factor's name."""

_OFFSETS = {BLUE: -0.18, ORANGE: 0.18}
"""Colours and offsets of the two bars of a factor."""


def draw_tornado(result: SweepResult, figures: Sequence[str] = ()) -> "Figure":
    """Draw a panel for each figure with its change when a factor alone is low or high.

    The largest effect comes first. A cross marks a missing figure. Figures that the nominal variant does not
    have are omitted.
    """
    check_sampling(result, ONE_AT_A_TIME, "local sensitivities")
    panels = _compute_panels(result, figures, local_sensitivities)
    panels = {name: rows for name, rows in panels.items() if rows and rows[0].nominal is not None}
    if not panels:
        raise CommandError(
            f"the nominal variant of the sweep '{result.name}' has none of the figures; there is no tornado."
        )
    bars = ("factor low", "factor high")
    return _draw_panels(result, figures, panels, _draw_tornado, "each factor alone", bars)


def draw_sobol(result: SweepResult, figures: Sequence[str] = ()) -> "Figure":
    """Draw a panel for each figure: first-order and total indices, 95 % confidence, largest total first."""
    check_sampling(result, SALTELLI, "Sobol indices")
    panels = _compute_panels(result, figures, sobol_indices)
    biased = sum(indices.left_out > 0 for indices in panels.values())
    note = f"Biased, as base samples are left out: {biased} of {len(panels)}." if biased else ""
    bars = ("first order", "total")
    return _draw_panels(result, figures, panels, _draw_sobol, "Sobol indices", bars, note)


def _compute_panels(
    result: SweepResult, figures: Sequence[str], compute: Callable[[SweepResult, str], Any]
) -> dict[str, Any]:
    """Compute panels for these figures, by default the first that vary. Raise CommandError without any."""
    if figures:
        return {name: compute(result, name) for name in figures}
    panels, problem = {}, None
    for name in find_varying_figures(result):
        try:
            panels[name] = compute(result, name)
        except CommandError as error:  # more variants may have the next figure
            problem = error
        if len(panels) == _MAX_PANELS:
            break
    if not panels:
        raise problem or nothing_varies_error(result, "figure")
    return panels


def _draw_panels(
    result: SweepResult,
    figures: Sequence[str],
    panels: dict[str, Any],
    draw: Callable[[SweepResult, "Axes", str, Any], None],
    title: str,
    labels: tuple[str, str],
    note: str = "",
) -> "Figure":
    """Draw panels by figure, each factor with two bars of these labels; `note` is the last sentence below."""
    from matplotlib.patches import Patch

    factors = len(result.factors)
    titles = [wrap_text(figure_label(result, name), 50) for name in panels]
    figure, grid = make_panels(titles, 4.6, height=0.9 + 0.2 * min(factors, _MAX_BARS))
    for axes, (name, panel) in zip(grid.flat, panels.items(), strict=False):
        draw(result, axes, name, panel)
    put_title(figure, f"{result.name}: {title}")
    more = 0 if figures else len(find_varying_figures(result)) - len(panels)
    notes = [
        f"The {_MAX_BARS} strongest of {factors} factors." if factors > _MAX_BARS else "",
        f"{more} more figures vary." if more > 0 else "",
        note,
    ]
    handles = {label: Patch(color=color) for label, color in zip(labels, _OFFSETS, strict=True)}
    put_legend(figure, handles, " ".join(filter(None, notes)))
    return figure


def _draw_tornado(result: SweepResult, axes: "Axes", name: str, rows: Sequence[LocalSensitivity]) -> None:
    rows, factor = rows[:_MAX_BARS], display_of(result, name).factor
    nominal = factor * (rows[0].nominal or 0.0)
    for index, row in enumerate(rows):
        for value, (color, offset) in zip((row.low, row.high), _OFFSETS.items(), strict=True):
            if value is None:
                axes.plot([nominal], [index + offset], "x", color=color, markersize=5)
            else:
                axes.barh(index + offset, factor * value - nominal, 0.36, left=nominal, color=color)
    axes.axvline(nominal, color=GREY, linewidth=0.8)
    _name_bars(axes, [row.factor for row in rows])
    axes.use_sticky_edges = False
    axes.margins(x=0.05)
    if is_truth(result, name):
        put_levels(axes.xaxis, ["no", "yes"])
    else:
        scale(axes, axes.xaxis, np.array([factor * v for row in rows for v in row[1:] if v is not None]))


def _draw_sobol(_: SweepResult, axes: "Axes", name: str, indices: SobolIndices) -> None:
    from matplotlib.ticker import MultipleLocator

    order = np.argsort(-indices.total, kind="stable")[:_MAX_BARS]
    bars = (indices.first, indices.first_confidence), (indices.total, indices.total_confidence)
    for (values, confidence), (color, offset) in zip(bars, _OFFSETS.items(), strict=True):
        axes.barh(
            np.arange(len(order)) + offset,
            values[order],
            0.36,
            xerr=confidence[order],
            color=color,
            error_kw={"elinewidth": 0.8, "capsize": 1.5, "ecolor": "#333333"},
        )
    _name_bars(axes, [indices.factors[i] for i in order])
    low, high = axes.get_xlim()
    axes.set_xlim(max(min(low, 0.0), -0.5), min(max(high, 1.0), 1.5))  # clip huge confidence intervals
    axes.xaxis.set_major_locator(MultipleLocator(0.5))


def _name_bars(axes: "Axes", factors: list[str]) -> None:
    put_levels(axes.yaxis, factors, _MAX_LETTERS)
    axes.set_ylim(len(factors) - 0.4, -0.6)
    tidy_axes(axes)
