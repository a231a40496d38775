"""Draw percentile bands over time of the recorded signals."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import polars

from ...base.arrays import Vector
from ...base.errors import CommandError, check_choice
from ...base.wording import format_count
from ...views.plots.style import BLUE, tidy_axes
from ..variants.data import VARIANT
from .columns import LARGEST
from .labels import label_with_unit, make_panels, put_legend, put_title, wrap_text
from .result import SweepResult

if TYPE_CHECKING:
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
