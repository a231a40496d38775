"""Draw percentile bands over time, tornado charts of local sensitivities, and Sobol indices."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import polars

from ...base.arrays import Vector
from ...base.errors import CommandError, check_choice
from ...base.wording import format_count
from ...views.plots.style import BLUE, tidy_axes
from ..variants.measures import VARIANT
from .columns import LARGEST, label_with_unit, make_panels, put_legend, put_title, wrap_text
from .result import SweepResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ...views.plots.style import GREY, ORANGE
from .columns import (
    display_of,
    figure_label,
    find_varying_figures,
    is_truth,
    nothing_varies_error,
    put_levels,
    scale,
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
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PERCENTILES = (5, 25, 50, 75, 95)
_MAX_TIMES = 400
_MAX_PANELS = 12
_MAX_ROWS = 1_000_000


@dataclass(frozen=True, eq=False)
class PercentileBands:
    """Percentiles of a signal over variants: a row of `values` for each of `PERCENTILES`, at `times` in s.

    NaN if no variant has a value.
    """

    times: Vector
    values: Vector


def compute_bands(result: SweepResult, signal: str) -> PercentileBands:
    """Return percentiles of a signal, at no more than 400 times of the variant that ran longest.

    Variants with other times are interpolated linearly, from their first row to their last. Variants are
    read in parts to limit memory.

    Raises:
        CommandError: The signal was not recorded.
    """
    if result.series is None or not result.signals:
        raise CommandError(f"the sweep '{result.name}' stored no signals over time.")
    series = result.series
    check_choice("stored signal", signal, result.signals)
    extents = (
        series.group_by(VARIANT)
        .agg(polars.len().alias("rows"), polars.col("time").max().alias("end"))
        .collect()
        .sort(VARIANT)
    )
    if extents.is_empty():
        raise CommandError(f"the sweep '{result.name}' stored no rows of signals.")
    longest = extents.sort(["end", "rows", VARIANT], descending=[True, True, False])[VARIANT][0]
    rows = series.filter(polars.col(VARIANT) == longest).select("time").collect()["time"]
    times = np.unique(rows.cast(polars.Float64).to_numpy())
    # evenly spaced rows, the first and the last among them
    times = times[np.unique(np.linspace(0, len(times) - 1, _MAX_TIMES).round().astype(int))]
    values = np.full((len(extents), len(times)), np.nan)
    row = 0
    for first, last in _split_variants(extents):
        part = series.filter(polars.col(VARIANT).is_between(first, last)).select(
            VARIANT, polars.col("time").cast(polars.Float64), polars.col(signal).cast(polars.Float64)
        )
        table = part.collect().sort(VARIANT, "time")
        variant, time, value = (table[name].to_numpy() for name in (VARIANT, "time", signal))
        value = np.where(np.abs(value) <= LARGEST, value, np.nan)
        cuts = np.flatnonzero(np.diff(variant)) + 1
        for variant_times, variant_values in zip(np.split(time, cuts), np.split(value, cuts), strict=True):
            values[row] = np.interp(times, variant_times, variant_values, left=np.nan, right=np.nan)
            row += 1
    percentiles = np.full((len(PERCENTILES), len(times)), np.nan)
    for column, at in zip(values.T, percentiles.T, strict=True):
        if len(finite := column[~np.isnan(column)]):  # no variant runs any more at the latest times
            at[:] = np.percentile(finite, PERCENTILES)
    return PercentileBands(times, percentiles)


def _split_variants(extents: polars.DataFrame) -> Iterator[tuple[int, int]]:
    """Yield the first and last variants of parts of limited size."""
    part = extents["rows"].cum_sum() // _MAX_ROWS
    for _, group in extents.group_by(part.alias("part"), maintain_order=True):
        yield group[VARIANT][0], group[VARIANT][-1]


def draw_bands(result: SweepResult, signals: Sequence[str] = ()) -> "Figure":
    """Draw a panel for each signal that has values; default: the first 12 recorded signals."""
    computed = [(name, compute_bands(result, name)) for name in signals or result.signals[:_MAX_PANELS]]
    panels = [(name, bands) for name, bands in computed if not np.isnan(bands.values).all()]
    if not panels:
        raise CommandError(f"the sweep '{result.name}' stored no signals over time that have values.")
    labels = [label_with_unit(name, result.units.get(name) or "") for name, _ in panels]
    figure, grid = make_panels([wrap_text(label, 54) for label in labels], 4.4)
    for axes, (_, bands) in zip(grid.flat, panels, strict=False):
        low, low_middle, median, high_middle, high = bands.values
        axes.fill_between(bands.times, low, high, color=BLUE, alpha=0.18, linewidth=0)
        axes.fill_between(bands.times, low_middle, high_middle, color=BLUE, alpha=0.35, linewidth=0)
        axes.plot(bands.times, median, color=BLUE, linewidth=1.2)
        tidy_axes(axes)
        axes.yaxis.get_offset_text().set_fontsize(8)
    for axes in grid.flat[max(len(panels) - grid.shape[1], 0) : len(panels)]:
        axes.set_xlabel("time / s", fontsize=8)
    put_title(figure, f"{result.name}: signals over time")
    _put_legend(figure, result, 0 if signals else len(result.signals) - len(panels))
    return figure


def _put_legend(figure: "Figure", result: SweepResult, left_out: int) -> None:
    """Put a legend, and a note on variants and signals, of which `left_out` have no panel."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    ended_early = len(result.variants) - int(result.is_done.sum())
    note = format_count(len(result.variants), "variant")
    if ended_early:
        note += f"; {ended_early} that ended early count up to their end"
    if left_out:
        note += f"; {left_out} more signals have no panel"
    handles = {
        "median": Line2D([], [], color=BLUE, linewidth=1.2),
        "25 to 75 %": Patch(color=BLUE, alpha=0.5, linewidth=0),
        "5 to 95 %": Patch(color=BLUE, alpha=0.18, linewidth=0),
    }
    put_legend(figure, handles, note)


_MAX_BAR_PANELS, _MAX_BARS = 12, 12
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
        if len(panels) == _MAX_BAR_PANELS:
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
