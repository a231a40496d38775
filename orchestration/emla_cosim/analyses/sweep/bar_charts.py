"""Draw bars for each factor: tornado of local sensitivities, and Sobol indices."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.errors import CommandError
from ...views.plots.style import BLUE, GREY, ORANGE, tidy_axes
from .columns import display_of, find_varying_figures, is_truth, nothing_varies_error
from .labels import (
    figure_label,
    new_panels,
    put_legend,
    put_levels,
    put_title,
    scale,
    wrap_text,
)
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
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .result import SweepResult

_MOST_PANELS, _MOST_BARS = 12, 12
_NAME = 38
"""Most characters of a factor's name."""


def draw_tornado(result: "SweepResult", figures: Sequence[str] = ()) -> "Figure":
    """Draw a panel for each figure with its change when a factor alone is low or high.

    The largest effect comes first. A cross marks a missing figure. Figures that the nominal variant does not
    have are omitted.
    """
    check_sampling(result, ONE_AT_A_TIME, "local sensitivities")
    found = _panels(result, figures, local_sensitivities)
    drawable = {name: rows for name, rows in found.items() if rows and rows[0].nominal is not None}
    if not drawable:
        raise CommandError(
            f"the nominal variant of the sweep '{result.name}' has none of the figures; there is no tornado."
        )
    figure = _figure(result, drawable, lambda axes, name, rows: _draw_tornado(axes, result, name, rows))
    put_title(figure, f"{result.name}: each factor alone")
    note = _note(result, 0 if figures else len(find_varying_figures(result)) - len(drawable))
    put_legend(figure, _handles({BLUE: "factor low", ORANGE: "factor high"}), note)
    return figure


def draw_sobol(result: "SweepResult", figures: Sequence[str] = ()) -> "Figure":
    """Draw a panel for each figure: first-order and total indices, 95 % confidence, largest total first."""
    check_sampling(result, SALTELLI, "Sobol indices")
    found = _panels(result, figures, sobol_indices)
    figure = _figure(result, found, lambda axes, name, indices: _draw_sobol(axes, indices))
    put_title(figure, f"{result.name}: Sobol indices")
    notes = [_note(result, 0 if figures else len(find_varying_figures(result)) - len(found))]
    if biased := sum(indices.left_out > 0 for indices in found.values()):
        notes.append(f"Biased, as base samples are left out: {biased} of {len(found)}.")
    put_legend(figure, _handles({BLUE: "first order", ORANGE: "total"}), " ".join(filter(None, notes)))
    return figure


def _panels(
    result: "SweepResult", figures: Sequence[str], found: Callable[["SweepResult", str], Any]
) -> dict[str, Any]:
    """Compute panels for these figures, by default the first that vary. Raise CommandError without any."""
    if figures:
        return {name: found(result, name) for name in figures}
    panels, problem = {}, None
    for name in find_varying_figures(result):
        try:
            panels[name] = found(result, name)
        except CommandError as error:  # more variants may have the next figure
            problem = error
        if len(panels) == _MOST_PANELS:
            break
    if not panels:
        raise problem or nothing_varies_error(result, "figure")
    return panels


def _figure(
    result: "SweepResult", panels: Mapping[str, Any], draw: Callable[["Axes", str, Any], None]
) -> "Figure":
    bars = min(len(result.factors), _MOST_BARS)
    titles = [wrap_text(figure_label(result, name), 50) for name in panels]
    figure, grid = new_panels(titles, 4.6, height=0.9 + 0.2 * bars)
    for axes, (name, found) in zip(grid.flat, panels.items(), strict=False):
        draw(axes, name, found)
    return figure


def _note(result: "SweepResult", more: int) -> str:
    notes = []
    if len(result.factors) > _MOST_BARS:
        notes.append(f"The {_MOST_BARS} strongest of {len(result.factors)} factors.")
    if more > 0:
        notes.append(f"{more} more figures vary.")
    return " ".join(notes)


def _draw_tornado(axes: "Axes", result: "SweepResult", name: str, rows: Sequence[LocalSensitivity]) -> None:
    rows, factor = rows[:_MOST_BARS], display_of(result, name).factor
    nominal = factor * (rows[0].nominal or 0.0)
    for place, row in enumerate(rows):
        for value, color, offset in ((row.low, BLUE, -0.18), (row.high, ORANGE, 0.18)):
            if value is None:
                axes.plot([nominal], [place + offset], "x", color=color, markersize=5)
            else:
                axes.barh(place + offset, factor * value - nominal, 0.36, left=nominal, color=color)
    axes.axvline(nominal, color=GREY, linewidth=0.8)
    _finish_axes(axes, [row.factor for row in rows])
    known = np.array([factor * v for row in rows for v in row[1:] if v is not None])
    axes.use_sticky_edges = False
    axes.margins(x=0.05)
    if is_truth(result, name):
        put_levels(axes.xaxis, ["no", "yes"])
    else:
        scale(axes, axes.xaxis, known)


def _draw_sobol(axes: "Axes", indices: SobolIndices) -> None:
    from matplotlib.ticker import MultipleLocator

    order = np.argsort(-indices.total, kind="stable")[:_MOST_BARS]
    places = np.arange(len(order))
    bars: dict[str, tuple[Any, Any, float]] = {
        BLUE: (indices.first, indices.first_confidence, -0.18),
        ORANGE: (indices.total, indices.total_confidence, 0.18),
    }
    for color, (values, confidence, offset) in bars.items():
        axes.barh(
            places + offset,
            values[order],
            0.36,
            xerr=confidence[order],
            color=color,
            error_kw={"elinewidth": 0.8, "capsize": 1.5, "ecolor": "#333333"},
        )
    _finish_axes(axes, [indices.factors[i] for i in order])
    low, high = axes.get_xlim()
    axes.set_xlim(max(min(low, 0.0), -0.5), min(max(high, 1.0), 1.5))  # clip huge confidence intervals
    axes.xaxis.set_major_locator(MultipleLocator(0.5))


def _finish_axes(axes: "Axes", factors: list[str]) -> None:
    put_levels(axes.yaxis, factors, _NAME)
    axes.set_ylim(len(factors) - 0.4, -0.6)
    tidy_axes(axes)


def _handles(labels: Mapping[str, str]) -> "dict[str, Artist]":
    """Return legend handles from labels by colour."""
    from matplotlib.patches import Patch

    return {label: Patch(color=color) for color, label in labels.items()}
