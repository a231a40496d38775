"""Self-contained pages: a template with the styles, scripts and plots of all pages."""

from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ...base import colors
from ..panels import Plot
from .bokeh_plots import library, template
from .plot_data import Shape, as_json, shape
from .text import format_number, make_visible, shorten_text


class Plots:
    """The plots of one page. The browser draws each when it becomes visible."""

    def __init__(self) -> None:
        self._found: list[tuple[Plot, int | None]] = []
        self._own: dict[str, str] = {}
        self._shapes: set[Shape] = set()

    def add(self, plot: Plot, points: int | None = None) -> str:
        """Add a plot and return its id for `{{ figure(id, label) }}`; for `points` see `as_json`."""
        self._found.append((plot, points))
        return f"plot-{len(self._found)}"

    def hold(self, name: str, content: str, shapes: Iterable[Shape]) -> None:
        """Add JSON for a script of the page, which makes plots of these shapes from it."""
        self._own[name] = content
        self._shapes.update(shapes)

    def scripts(self) -> Markup:
        """Return the elements with data, templates and library, or nothing without plots."""
        shapes = self._shapes.union(shape(plot) for plot, _ in self._found)
        if not shapes:
            return Markup()
        data = [_script(f"plot-{k}-data", as_json(*one)) for k, one in enumerate(self._found, 1)]
        data += [_script(name, content) for name, content in self._own.items()]
        figures = [_script(f"figure-{each}", template(each)) for each in sorted(shapes)]
        bokeh = Markup('<script type="text/plain" id="bokeh">\n{}\n</script>').format(Markup(library()))
        return Markup("\n").join([*data, *figures, bokeh])


def render_template(package: str, name: str, plots: Plots, **context: Any) -> str:
    """Render a template of our packages that extends `base.html`.

    Texts in `context` may come from untrusted files. They are escaped, and cannot hide or run anything.
    """
    asked = _environment(package).get_template(name)
    return asked.render(plots=plots, colors=colors, **context)


@cache
def _environment(package: str) -> Environment:
    loaders = [PackageLoader(package, "."), PackageLoader(__package__ or "", "assets")]
    made = Environment(
        loader=ChoiceLoader(loaders),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_make_visible,
    )
    made.filters |= {
        "number": format_number,
        "brief": lambda text, most=160: shorten_text(make_visible(text), most),
    }
    made.globals["asset"] = _asset
    return made


def _make_visible(value: Any) -> Any:
    """Make invisible characters in the texts of a template visible."""
    return value if isinstance(value, (Markup, int, float)) else make_visible(value)


def _asset(name: str) -> Markup:
    """Return a style sheet or script of this package."""
    return Markup((files(__package__ or "") / "assets" / name).read_text(encoding="utf-8"))


def _script(name: str, content: str) -> Markup:
    """Return a script element with JSON; no text in it can end the element."""
    safe = content.replace("<", "\\u003c")
    return Markup('<script type="application/json" id="{}">{}</script>').format(name, Markup(safe))
