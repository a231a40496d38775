"""Results and systems as the output of a cell of a notebook."""

import zlib
from base64 import b64encode
from collections.abc import Sequence
from typing import NamedTuple

from ..base.errors import CosimError
from ..base.wording import format_count
from ..pages.page import Plots, render_template
from ..run.result import Result
from ..ssp.diagram import build_diagrams, link_components
from ..system.model import Component, System, count_parts
from .formatting import describe_idealisations, describe_stepping, format_headline, list_signal_texts
from .plots.overlay import plot_summary
from .plots.style import to_png
from .run_page import tables

_MOST_COLUMNS, _MOST_SIGNALS = 24, 20
"""Most objects of metrics, such as joints, and most signals with metrics to show."""


def render_cell(result: Result) -> str:
    """Return a result as HTML for a cell, with the texts and numbers that terminal and page show."""
    verdict, sentences = tables.describe_ending(result)
    picture, reason = _draw_summary(result)
    has_metrics = any(result.metrics.values())
    names, rows = list_signal_texts(result, _MOST_SIGNALS)
    return render_template(
        __package__ or "",
        "result_cell.html",
        Plots(),
        title=format_headline(result),
        verdict=verdict,
        mark={"passed": "✓", "warning": "!", "failed": "✗"}[verdict],
        sentences=sentences,
        facts=[
            f"{result.times.start:g} s to {result.end_s:g} s",
            format_count(0 if result.table is None else len(result.names), "signal"),
            *describe_stepping(result),
        ],
        notes=result.notes,
        figures=list(tables.list_figure_tables(result)),
        signal_columns=names,
        # metrics say more than extremes of signals
        signals=[] if has_metrics else rows,
        more=len(result.signals) - _MOST_SIGNALS,
        idealised=describe_idealisations(result),
        compared=len(result.comparisons),
        inside=sum(comparison.inside for comparison in result.comparisons),
        picture=picture,
        reason=reason,
        most=_MOST_COLUMNS,
        counted=format_count,
    )


def _draw_summary(result: Result) -> tuple[str, str]:
    """Return the address of a picture of the main signals, and why there is none; one of both is empty."""
    try:
        picture = to_png(plot_summary(result))
    except (CosimError, OSError) as error:  # the file of the table may be deleted
        return "", str(error)
    return f"data:image/png;base64,{b64encode(picture).decode()}", ""


MOST = 200
"""Most rows of a table in a cell."""

_MOST_STARTS = 6
"""Most start values of a component to show."""


class ComponentRow(NamedTuple):
    """A component, where its FMU comes from, and the start values that the system sets."""

    name: str
    source: str
    start_values: str


def render_system(
    system: System,
    title: str = "System",
    description: str = "",
    facts: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """Return a system as HTML for a cell. Nothing is built or loaded.

    Args:
        system: The system.
        title: Title.
        description: One line on its purpose.
        facts: Short facts on its runs, such as "0 s to 1 s".
        notes: Notes without full stops.
    """
    return render_template(
        __package__ or "",
        "system_cell.html",
        Plots(),
        title=title,
        description=description,
        facts=[*count_parts(system), *facts],
        notes=notes,
        diagrams=build_diagrams(
            {c.name: _describe_source(c) for c in system.components}, link_components(system.connections)
        ),
        arrow=make_arrow_id(title),
        components=[ComponentRow(c.name, _describe_source(c), _format_starts(c)) for c in system.components],
        connections=[str(connection) for connection in system.connections],
        most=MOST,
        counted=format_count,
    )


def make_arrow_id(title: str) -> str:
    """Return an id for the arrows of a cell; of equal ids in a notebook, browsers use the first one only."""
    # of the title, so that the same cell has the same bytes
    return f"emla-arrow-{zlib.crc32(title.encode('utf-8', 'replace')):08x}-"


def _describe_source(component: Component) -> str:
    if component.fmu is not None:
        return component.fmu.name
    return component.model.__name__ if isinstance(component.model, type) else component.model


def _format_starts(component: Component) -> str:
    starts = [f"{name} = {value}" for name, value in component.parameters.items()]
    more = [f"and {len(starts) - _MOST_STARTS} more"] if len(starts) > _MOST_STARTS else []
    return ", ".join([*starts[:_MOST_STARTS], *more])
