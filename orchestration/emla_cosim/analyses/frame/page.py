"""The self-contained page of an analysis."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...views.pages.page import Plots, render_template
from ...views.plots.style import embed
from .report import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def render_page(report: Report, pictures: "Mapping[str, Figure]") -> str:
    """Return the page of a report, with its pictures by file name."""
    shown = {name: embed(figure) for name, figure in pictures.items()}
    return render_template(__package__ or "", "page.html", Plots(), report=report, pictures=shown)
