"""Render the self-contained page of a run."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...base.arrays import REAL, Vector
from ...base.wording import format_count
from ...pages.comparisons import build_comparison_rows
from ...pages.page import Plots, render_template
from ...run.result import Result
from ...ssp.diagram import build_diagrams, group_connections
from ..formatting import (
    describe_idealisations,
    describe_stepping,
    format_short,
    list_idealisations,
    list_overrides,
)
from . import picture_plots, signals, tables

_MOST_VALUES = 20_000_000
"""Most rows to read; of longer results only every n-th row is drawn."""

_MOST_COMPARED = 60
"""Most signals to show beside a reference."""


def render_page(result: Result, notes: Sequence[str] = ()) -> str:
    """Return the text of the page. `notes` are remarks without full stops. May raise OSError."""
    plots, record, data = Plots(), result.record, _read_data(result)
    components: Mapping[str, Any] = record.get("components", {})
    connections: Sequence[str] = record.get("connections", ())
    pictures, left_out = picture_plots.build_pictures(result, data, plots)
    verdict, sentences = tables.describe_ending(result)
    # those outside their tubes first
    compared = sorted(result.comparisons, key=lambda comparison: comparison.inside)[:_MOST_COMPARED]
    return render_template(
        __package__ or "",
        "page.html",
        plots,
        title=result.name,
        verdict=verdict,
        sentences=sentences,
        changed=[(name, format_short(value)) for name, value in list_overrides(result)],
        span=f"{result.times.start:g} s to {result.end_s:g} s",
        record=record,
        notes=notes,
        figures=[
            *tables.list_figure_tables(result),
            *tables.list_margin_tables(result),
            *tables.list_profile_tables(result),
        ],
        idealised=describe_idealisations(result),
        idealisations=list_idealisations(result),
        pictures=pictures,
        left_out=left_out,
        signals=signals.list_signal_rows(result, data, plots),
        recorded=len(_list_recorded_signals(result)),
        rows=len(data["time"]),
        comparisons=build_comparison_rows(compared, plots),
        compared=len(result.comparisons),
        inside=sum(comparison.inside for comparison in result.comparisons),
        components=components,
        connections=connections,
        diagrams=build_diagrams(
            {n: str(c.get("fmu")) for n, c in components.items()}, group_connections(components, connections)
        ),
        settings=tables.list_settings(result),
        starts=tables.list_start_values(result),
        stepped=list(describe_stepping(result)),
        late=result.stepping.get("late_connections", ()),
        most=tables.MOST,
        counted=format_count,
    )


def _list_recorded_signals(result: Result) -> list[str]:
    """Return the recorded signals, or none without a table."""
    return [] if result.table is None or result.steps == 0 else result.names


def _read_data(result: Result) -> Mapping[str, Vector]:
    """Return time and the signals that the page shows."""
    names = [n for n in _list_recorded_signals(result) if not result.types.get(n, REAL).is_text]
    if not names:
        return {"time": np.empty(0)}
    needed = dict.fromkeys(["time", *names[: signals.MOST], *picture_plots.list_signals(result)])
    return result.read(list(needed), _MOST_VALUES // len(needed))
