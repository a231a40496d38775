"""The result of a run as the output of a cell of a notebook: verdict, metrics and a picture."""

from base64 import b64encode

from ...base.errors import CosimError
from ...base.wording import format_count
from ...pages.page import Plots, render_template
from ...run.result import Result
from ..formatting import describe_stepping, format_headline, list_signal_texts
from ..idealisations import describe_idealisations
from ..plots.overlay import plot_summary
from ..plots.style import to_png
from . import tables

_MOST_COLUMNS, _MOST_SIGNALS = 24, 20
"""Most objects of metrics, such as joints, and most signals with metrics to show."""


def render_cell(result: Result) -> str:
    """Return a result as HTML for a cell, with the texts and numbers that terminal and page show."""
    verdict, sentences = tables.describe_ending(result)
    picture, reason = _draw(result)
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


def _draw(result: Result) -> tuple[str, str]:
    """Return the address of a picture of the main signals, or why there is none."""
    try:
        picture = to_png(plot_summary(result))
    except (CosimError, OSError) as error:  # the file of the table may be deleted
        return "", str(error)
    return f"data:image/png;base64,{b64encode(picture).decode()}", ""
