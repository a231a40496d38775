"""Self-contained pages: a template with the styles, scripts and plots of all pages."""

from functools import cache, cached_property
from importlib.resources import files
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ...base import colors
from ..panels import Plot
from .bokeh_plots import TimeAxis, build_figure, make_theme
from .text import format_number, make_visible, shorten_text

_POINTS = 800
"""Most points of a line, unless a page sets another number."""


class Plots:
    """The plots of one page. Plots of one subject and part of the time zoom together."""

    def __init__(self) -> None:
        self.figures: dict[str, Any] = {}
        """Bokeh figures by their ids."""
        self._subjects: dict[str, list[str]] = {}
        self._axes: dict[tuple[str, str], TimeAxis] = {}

    def new_subject(self) -> str:
        """Return a subject that no other plot of the page has."""
        return f"subject {len(self.figures)}"

    def add(self, plot: Plot, most: int = _POINTS) -> str:
        """Add a plot with at most about `most` points for each line.

        Returns:
            Its id for the macro `figure(plots, id, label)`.
        """
        subject = plot.column or self.new_subject()
        key = subject, plot.part
        if key not in self._axes:
            self._axes[key] = TimeAxis(line.time for line in plot.lines)
        return self.hold(subject, build_figure(plot, most, self._axes[key]))

    def hold(self, subject: str, figure: Any) -> str:
        """Add a Bokeh figure, which may share models with others of its subject, and return its id."""
        name = f"plot-{len(self.figures) + 1}"
        self.figures[name] = figure
        self._subjects.setdefault(subject, []).append(name)
        return name

    def figure(self, name: str) -> Markup:
        """Return the element of a plot."""
        return self._rendered[0][name]

    def scripts(self) -> Markup:
        """Return the scripts that draw all plots, with their library, or nothing without plots."""
        return self._rendered[1]

    @cached_property
    def _rendered(self) -> tuple[dict[str, Markup], Markup]:
        from bokeh.document import Document
        from bokeh.embed import components
        from bokeh.resources import Resources

        if not self.figures:
            return {}, Markup()
        elements, theme = dict[str, Markup](), make_theme()
        scripts = [
            Resources(mode="inline", components=["bokeh"], minified=True, log_level="error").render_js()
        ]
        for names in self._subjects.values():
            figures = {name: self.figures[name] for name in names}
            document = Document(theme=theme)
            with document.models.freeze():  # else Bokeh visits all models again for each figure
                for figure in figures.values():
                    document.add_root(figure)
            script, divisions = components(figures)
            scripts.append(script)
            elements |= {name: Markup(division) for name, division in divisions.items()}
        return elements, Markup("\n".join(scripts))


def render_template(package: str, name: str, plots: Plots, **context: Any) -> str:
    """Render a template of our packages that extends `base.html`.

    Texts in `context` may come from untrusted files. They are escaped, and cannot hide or run anything.
    """
    return _environment(package).get_template(name).render(plots=plots, colors=colors, **context)


@cache
def _environment(package: str) -> Environment:
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader(__package__ or "", "assets")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_make_visible,
    )
    environment.filters |= {
        "number": format_number,
        "brief": lambda text, most=160: shorten_text(make_visible(text), most),
    }
    environment.globals["asset"] = _asset
    return environment


def _make_visible(value: Any) -> Any:
    """Make invisible characters in the texts of a template visible."""
    return value if isinstance(value, (Markup, int, float)) else make_visible(value)


def _asset(name: str) -> Markup:
    """Return a style sheet or script of this package."""
    return Markup((files(__package__ or "") / "assets" / name).read_text(encoding="utf-8"))
