"""The self-contained page of an analysis."""

from base64 import b64encode
from collections.abc import Mapping

from ...pages.page import Plots, render_template
from .report import Report


def render_page(report: Report, pictures: Mapping[str, bytes]) -> bytes:
    """Return the page of a report, with its pictures (PNG) by file name."""
    images = {name: f"data:image/png;base64,{b64encode(png).decode()}" for name, png in pictures.items()}
    page = render_template(__package__ or "", "page.html", Plots(), report=report, pictures=images)
    return page.encode("utf-8", "replace")
