"""The page of a run as one text, which needs nothing else."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.wording import counted
from ...run.result import Result
from ..pages.comparisons import compared
from ..pages.page import Plots, rendered
from ..telling import how_stepped
from . import pictures, signals, tables
from .diagram import diagrams, wires
from .heading import heading

_VALUES = 20_000_000
"""That are read at most; of longer results only every n-th row is drawn."""

_COMPARED = 60
"""Signals beside a reference that are shown."""


def page(result: Result, notes: Sequence[str] = ()) -> str:
    """The text of the page; `notes` are sentences on what was read. May raise OSError."""
    plots, record, data = Plots(), result.record, _data(result)
    components: Mapping[str, Any] = record.get("components", {})
    connections: Sequence[str] = record.get("connections", ())
    shown, left_out = pictures.shown(result, data, plots)
    first = sorted(result.comparisons, key=lambda one: one.inside)[:_COMPARED]
    return rendered(
        __package__ or "",
        "page.html",
        plots,
        heading=heading(result),
        record=record,
        notes=notes,
        figures=list(tables.figures(result)),
        pictures=shown,
        left_out=left_out,
        signals=signals.listed(result, data, plots),
        recorded=len(_names(result)),
        rows=len(data["time"]),
        comparisons=compared(first, plots),
        compared=len(result.comparisons),
        inside=sum(one.inside for one in result.comparisons),
        components=components,
        connections=connections,
        diagrams=diagrams(
            {n: str(c.get("fmu")) for n, c in components.items()}, wires(components, connections)
        ),
        settings=tables.settings(result),
        starts=tables.starts(result),
        stepped=list(how_stepped(result)),
        late=result.stepping.get("late_connections", ()),
        most=tables.MOST,
        counted=counted,
    )


def _names(result: Result) -> list[str]:
    """The signals that were kept; none where no table was."""
    return [] if result.table is None or result.steps == 0 else result.names


def _data(result: Result) -> Mapping[str, Vector]:
    """Time, and the signals that the page shows."""
    names = _names(result)
    if not names:
        return {"time": np.empty(0)}
    wanted = dict.fromkeys(["time", *names[: signals.MOST], *pictures.wanted(result)])
    return result.read(list(wanted), _VALUES // len(wanted))
