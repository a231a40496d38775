"""All signals of a run: their metrics, and a plot for each unit that shows the selected ones."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...base.arrays import REAL, SignalType, Vector
from ...pages.bokeh_plots import (
    add_legend,
    add_line,
    add_values,
    describe_line,
    describe_unit,
    new_figure,
)
from ...pages.page import Plots
from ...pages.panels import compact, condense_curves, mask_undrawable
from ...pages.text import make_visible
from ...recorders.metrics import NAMES
from ...run.result import Result
from ..plots.stacked import group_by_unit, make_numbered_line, name_values

MOST = 1000
"""Most signals of a page."""

_HEIGHT = 360
"""Height of a plot in pixels, with the legend of the selected signals."""

_POINTS, _MOST_POINTS = 150_000, 5000
"""Most points of all curves together, of about 11 bytes each, and of one curve."""


@dataclass(frozen=True)
class SignalRow:
    """A signal with its metrics; missing ones are None. `plot` is the id of its plot, empty without rows."""

    name: str
    unit: str
    plot: str
    minimum: float | None
    maximum: float | None
    rms: float | None
    final: float | None


def list_signal_rows(result: Result, data: Mapping[str, Vector], plots: Plots) -> list[SignalRow]:
    """Return the first signals in `data`, and add their plots to the page."""
    names = [name for name in data if name != "time"][:MOST]
    units = {name: str(result.units.get(name) or "") for name in names}
    plot_ids = _add_plots(names, units, data, result.types, plots) if len(data["time"]) else {}
    return [
        SignalRow(name, units[name], plot_ids.get(name, ""), **_read_figures(result.signals.get(name, {})))
        for name in names
    ]


def _add_plots(
    names: Sequence[str],
    units: Mapping[str, str],
    data: Mapping[str, Vector],
    types: Mapping[str, SignalType],
    plots: Plots,
) -> dict[str, str]:
    """Add a plot for each unit, whose curves are hidden at first. Return the id of the plot by signal."""
    from bokeh.models import ColumnDataSource, DataRange1d

    time = data["time"]
    row_numbers = _choose_rows(time, [data[name] for name in names])
    retained = dict(zip(names, row_numbers, strict=True))
    plot_ids = dict[str, str]()
    for group in group_by_unit(names, units, types):
        label = describe_unit(units[group[0]], name_values(types.get(group[0], REAL)))
        # hidden curves must not widen the axis
        figure = new_figure(label, [time], DataRange1d(only_visible=True))
        entries = []
        for number, name in enumerate(group):
            line = make_numbered_line(number, make_visible(name), time, data[name], types.get(name, REAL))
            columns = {"time": time, "value": mask_undrawable(data[name])}
            source = ColumnDataSource({n: compact(values[retained[name]]) for n, values in columns.items()})
            curve = add_line(figure, source, "time", "value", line, name=line.label, visible=False)
            entries.append((describe_line(line, ""), curve))
        curves = [curve for _, curve in entries]
        add_values(
            figure,
            curves,
            [("signal", "$name"), ("time / s", "@time"), (label or "value", "@value")],
            "mouse",
        )
        for name, item in zip(group, add_legend(figure, entries), strict=True):
            item.name, item.visible = f"legend-{names.index(name)}", False
        figure.height = _HEIGHT
        plot_ids |= dict.fromkeys(group, plots.add_figure(figure, "signals"))
    return plot_ids


def _choose_rows(time: Vector, curves: Sequence[Vector]) -> list[Any]:
    """Return the rows of each curve that are drawn. Smooth curves leave room for the others."""
    fair_share = _POINTS // (2 * len(curves))
    curves = [mask_undrawable(curve) for curve in curves]
    rows = [condense_curves(time, [curve], fair_share) for curve in curves]
    rough = [k for k, retained in enumerate(rows) if len(retained) >= fair_share]
    free_points = _POINTS - sum(map(len, rows))
    for k in rough:
        rows[k] = condense_curves(
            time, [curves[k]], min(fair_share + free_points // len(rough), _MOST_POINTS)
        )
    return rows


def _read_figures(figures: Mapping[str, float]) -> dict[str, float | None]:
    """Return the metrics of a signal; those that are not numbers are None."""
    return {name: value if math.isfinite(value := figures.get(name, math.nan)) else None for name in NAMES}
