"""Self-contained pages: a template with the styles, scripts and plots of all pages."""

import json
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ..base import colors
from .bokeh_plots import build_figure, serialize_figure
from .panels import Plot
from .text import format_number, make_visible, shorten_text

_POINTS = 800
"""Most points of a line, unless a page sets another number."""


class Plots:
    """The plots of one page. Plots of one subject and part of the time zoom together.

    `figures` are Bokeh figures and `subjects` their subjects, both by the ids of the plots.
    """

    def __init__(self) -> None:
        self.figures: dict[str, Any] = {}
        self.subjects: dict[str, str] = {}

    def new_subject(self) -> str:
        """Return a subject that no other plot of the page has."""
        return f"plot {len(self.figures)}"

    def add(self, plot: Plot, most: int = _POINTS) -> str:
        """Add a plot with at most about `most` points for each line, and return its id."""
        subject = f"{plot.column}: {plot.part}" if plot.column else self.new_subject()
        return self.add_figure(build_figure(plot, most), subject)

    def add_figure(self, figure: Any, subject: str) -> str:
        """Add a Bokeh figure and return its id."""
        name = f"plot-{len(self.figures) + 1}"
        self.figures[name], self.subjects[name] = figure, subject
        return name

    def content(self, name: str) -> Markup:
        """Return a figure as JSON for a script element, which no text in it can end."""
        content = json.dumps(serialize_figure(self.figures[name]), separators=(",", ":"))
        # JSON reads the escape as the same letter
        return Markup(content.replace("<", "\\u003c"))

    def library(self) -> Markup:
        """Return the script elements with the library of the plots."""
        from bokeh.resources import Resources

        inline = Resources(mode="inline", components=["bokeh"], minified=True, log_level="error")
        return Markup(inline.render_js())


def render_template(package: str, name: str, plots: Plots, **context: Any) -> str:
    """Render a template of our packages that extends `base.html`.

    Texts in `context` may come from untrusted files. They are escaped, and cannot hide or run anything.
    """
    return _make_environment(package).get_template(name).render(plots=plots, colors=colors, **context)


@cache
def _make_environment(package: str) -> Environment:
    """Return the environment of a package's templates; it escapes texts and makes hidden letters visible."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader(__package__ or "", "assets")]),
        autoescape=True,
        # a wrong name in a template is an error, not an empty text
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_make_visible,
    )
    environment.filters |= {
        "number": format_number,
        "brief": lambda text, most=160: shorten_text(make_visible(text), most),
    }
    environment.globals["asset"] = _read_asset
    return environment


def _make_visible(value: Any) -> Any:
    """Make invisible characters in the texts of a template visible."""
    return value if isinstance(value, (Markup, int, float)) else make_visible(value)


def _read_asset(name: str) -> Markup:
    """Return a style sheet or script of this package."""
    return Markup((files(__package__ or "") / "assets" / name).read_text(encoding="utf-8"))
