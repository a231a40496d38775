"""What a person sees of an FMU: an HTML page with typeset equations, and an icon."""

import inspect
import io
import os
from html import escape

from latex2mathml.converter import convert
from markdown_it import MarkdownIt
from mdit_py_plugins.dollarmath import dollarmath_plugin

from .block import Block
from .cache import tool_environment
from .variables import Variable

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font-family: sans-serif; line-height: 1.5; max-width: 52rem; margin: 2rem auto; padding: 0 1rem; }}
table {{ border-collapse: collapse; margin: 1rem 0; }}
th, td {{ border-bottom: 1px solid #ccc; padding: 0.2rem 0.8rem; text-align: left; vertical-align: top; }}
pre {{ background: #f4f4f4; padding: 0.6rem; overflow-x: auto; }}
math {{ font-family: "Latin Modern Math", "STIX Two Math", "Cambria Math", "TeX Gyre Termes Math", math; }}
math[display="block"] {{ margin: 0.8rem 0; }}
mtd[columnalign="left"] {{ text-align: left; }}
mtd[columnalign="right"] {{ text-align: right; }}
</style>
</head>
<body>
{body}
</body>
</html>
"""


def html_page(markdown: str, title: str) -> str:
    """A Markdown text as one HTML page that needs nothing from elsewhere.

    Equations between $ or $$ become MathML, which browsers typeset by themselves.
    """

    def math(content: str, options: dict[str, bool]) -> str:
        return convert(content, display="block" if options["display_mode"] else "inline")

    parser = MarkdownIt("commonmark").enable("table").use(dollarmath_plugin, renderer=math)
    return _PAGE.format(title=escape(title), body=parser.render(markdown))


def docstring_page(block: Block) -> str:
    """The Markdown page of a block that has no other: its name and its docstring."""
    return f"# {type(block).__name__}\n\n{inspect.cleandoc(block.__doc__ or '')}\n"


def variable_table(block: Block) -> str:
    """The block's variables as a Markdown table: name, unit, start value, meaning."""
    layout = block.layout()
    lines: list[str] = []
    for heading, variables in (
        ("Inputs", layout.inputs),
        ("Outputs", (*layout.states, *layout.outputs)),
        ("Parameters", layout.parameters),
    ):
        if variables:
            lines += [f"\n## {heading}\n", "| Name | Unit | Start | Meaning |", "|---|---|---|---|"]
            lines += [_row(x) for x in variables]
    return "\n".join(lines) + "\n"


def _row(variable: Variable) -> str:
    elements = ",".join(f"1..{n}" for n in variable.shape)
    name = f"{variable.name}[{elements}]" if elements else variable.name
    starts = [f"{s.start:g}" for s in variable.scalars()]
    start = starts[0] if len(set(starts)) == 1 else ", ".join(starts)
    if variable.fmi_type == "Boolean":
        start = str(variable.start).lower()
    if variable.enumeration is not None:
        start = f"{variable.start.name.lower()} of {', '.join(m.name.lower() for m in variable.enumeration)}"
    unit = variable.unit or ""
    return f"| `{name}` | {unit} | {start} | {variable.description} |"


def icon(block: Block) -> bytes:
    """model.png: the block as a box with its inputs on the left and its outputs on the right."""
    os.environ.update(tool_environment())  # which matplotlib reads when it is imported
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    layout = block.layout()
    left = [x.name or "" for x in layout.inputs]
    right = [x.name or "" for x in (*layout.states, *layout.outputs)]
    rows = max(len(left), len(right), 3)
    figure = Figure(figsize=(4.0, 0.9 + 0.22 * rows), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, 1), ylim=(rows + 2.2, -0.4))
    axes.axis("off")
    axes.fill([0.08, 0.92, 0.92, 0.08], [0, 0, rows + 1.6, rows + 1.6], "#f3f6fa", ec="#2f5d8a", lw=1.5)
    axes.text(0.5, 0.7, type(block).__name__, ha="center", va="center", weight="bold", color="#2f5d8a")
    for names, edge, sign, align in ((left, 0.08, -1, "left"), (right, 0.92, 1, "right")):
        for i, name in enumerate(names):
            y = 1.7 + i * rows / max(len(names), 1)
            axes.plot([edge, edge + 0.05 * sign], [y, y], color="#2f5d8a", lw=1.5)
            axes.text(edge - 0.02 * sign, y, name, ha=align, va="center", size=8)
    png = io.BytesIO()
    FigureCanvasAgg(figure).print_png(png, metadata={"Software": None})
    return png.getvalue()
