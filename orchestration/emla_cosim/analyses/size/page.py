"""A self-contained page of a sizing."""

from ...views.pages.page import Plots, render_template
from ...views.plots.style import embed
from .limits import format_percent, format_value
from .pictures import draw_joint
from .result import SizeResult
from .summary import list_figures


def render_page(result: SizeResult) -> str:
    """Return the text of the page."""
    pictures = {joint: embed(draw_joint(sizing)) for joint, sizing in result.joints.items()}
    figures = {
        id(sizing): list_figures(sizing) for one in result.candidates for sizing in one.joints.values()
    }
    return render_template(
        __package__ or "",
        "page.html",
        Plots(),
        result=result,
        pictures=pictures,
        figures=figures,
        id=id,
        shown=format_value,
        percent=format_percent,
    )
