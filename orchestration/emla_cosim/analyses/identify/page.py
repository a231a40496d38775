"""A self-contained page of an identification."""

from ...views.pages.page import Plots, render_template
from ...views.plots.style import embed
from .pictures import draw_certainty, draw_fit
from .result import IdentificationResult
from .summary import describe_residuals, format_interval, format_step_change


def render_page(result: IdentificationResult) -> str:
    """Return the text of the page."""
    return render_template(
        __package__ or "",
        "page.html",
        Plots(),
        result=result,
        fit=embed(draw_fit(result)),
        certainty=embed(draw_certainty(result)),
        interval=format_interval,
        step_change=format_step_change,
        residuals=describe_residuals,
    )
