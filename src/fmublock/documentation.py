"""Documentation inside an FMU: an HTML page with typeset equations, and an icon."""

import inspect
import io
import os
from html import escape

from latex2mathml.converter import convert
from markdown_it import MarkdownIt
from mdit_py_plugins.dollarmath import dollarmath_plugin

from .block import Block
from .cache import tool_environment
from .variables import Access, Output, StartTime, Variable

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font-family: sans-serif; line-height: 1.5; max-width: 52rem; margin: 2rem auto; padding: 0 1rem; }}
table {{ border-collapse: collapse; margin: 1rem 0; }}
th, td {{ border-bottom: 1px solid #ccc; padding: 0.2rem 0.5rem; text-align: left; vertical-align: top; }}
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
    """Convert Markdown to one self-contained HTML page.

    Equations between $ or $$ become MathML, which browsers can typeset.
    """

    def math(content: str, options: dict[str, bool]) -> str:
        return convert(content, display="block" if options["display_mode"] else "inline")

    parser = MarkdownIt("commonmark").enable("table").use(dollarmath_plugin, renderer=math)
    return _PAGE.format(title=escape(title), body=parser.render(markdown))


def docstring_page(block: Block, is_brief: bool = False) -> str:
    """Return the default Markdown page of a block: its name and its docstring, or the first line of it."""
    text = inspect.cleandoc(block.__doc__ or "")
    page_text = text.splitlines()[0] if is_brief and text else text
    return f"# {type(block).__name__}\n\n{page_text}\n"


def variable_table(block: Block | type[Block]) -> str:
    """Return the block's variables as Markdown tables: symbol, name, unit, start value, range, meaning."""
    layout = block.layout()
    by_access = {access: [p for p in layout.parameters if p.access is access] for access in Access}
    lines: list[str] = []
    for heading, variables in (
        ("Inputs", layout.inputs),
        ("Outputs", (*layout.states, *layout.outputs)),
        ("Parameters", by_access[Access.SETTABLE]),
        ("Constants", by_access[Access.FIXED]),
        ("Discrete states", layout.discrete_states),
    ):
        if variables:
            lines += [f"\n### {heading}\n", *_HEADING, *map(_format_row, variables)]
    return "\n".join(lines) + "\n"


_HEADING = ["| Symbol | Name | Unit | Start | Range | Meaning |", "|---|---|---|---|---|---|"]

_START_MARK, _END_MARK = "<!-- variables begin -->", "<!-- variables end -->"
"""The table of variables is between these marks."""


def with_variables(page: str, block: Block | type[Block]) -> str:
    """Insert the block's table of variables into a Markdown page: between the marks, or at the end."""
    before, start, remainder = page.partition(_START_MARK)
    _, end, after = remainder.partition(_END_MARK)
    if not (start and end):
        return f"{page}\n## Variables\n{variable_table(block)}"
    return f"{before}{start}\n{variable_table(block).strip()}\n{end}{after}"


def _format_row(variable: Variable) -> str:
    elements = ",".join(f"1..{n}" for n in variable.shape)
    name = f"{variable.name}[{elements}]" if elements else variable.name
    symbol = f"${variable.symbol}$" if variable.symbol else ""
    cells = (
        symbol,
        f"`{name}`",
        variable.unit or "",
        _format_start(variable),
        _format_range(variable),
        variable.description,
    )
    return f"| {' | '.join(cells).replace(chr(10), ' ')} |"


def _format_start(variable: Variable) -> str:
    """Return the start as text: a value, one for each element, or a parameter."""
    if variable.start_parameter is not None:
        is_hidden = variable.start_parameter.access is Access.HIDDEN
        return "" if is_hidden else f"`{variable.start_parameter.name}`"
    if isinstance(variable, Output):
        return ""
    if isinstance(variable, StartTime):
        return "start time"
    if variable.fmi_type == "Boolean":
        return str(variable.start).lower()
    if variable.enumeration is not None:
        return f"`{variable.start.name.lower()}`"
    starts = [_format_number(s.start) for s in variable.scalars()]
    if len(set(starts)) == 1:
        return starts[0]
    return ", ".join(starts[:_MAX_STARTS]) + (", ..." if len(starts) > _MAX_STARTS else "")


_MAX_STARTS = 9
"""Most start values shown for an array whose elements differ."""


def _format_range(variable: Variable) -> str:
    """Return the range as text; empty if any value is allowed."""
    if variable.enumeration is not None:
        return ", ".join(f"`{member.name.lower()}`" for member in variable.enumeration)
    low, high = (None if x is None else _format_number(x) for x in (variable.minimum, variable.maximum))
    if low is not None and high is not None:
        return f"{low} to {high}"
    return f"≥ {low}" if low is not None else f"≤ {high}" if high is not None else ""


def _format_number(value: float) -> str:
    """Format a number with few digits; a whole number, such as a seed, with all of them."""
    text = f"{value:.9g}"
    return str(int(value)) if float(value).is_integer() and float(text) != value else text


def icon(block: Block) -> bytes:
    """Draw model.png: the block as a box with its inputs on the left and its outputs on the right."""
    os.environ.update(tool_environment())  # matplotlib reads them when it is imported
    # without pyplot, which would choose a backend for the whole process
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    layout = block.layout()
    input_names = [x.name or "" for x in layout.inputs]
    output_names = [x.name or "" for x in (*layout.states, *layout.outputs)]
    rows = max(len(input_names), len(output_names), 3)
    figure = Figure(figsize=(4.0, 0.9 + 0.22 * rows), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, 1), ylim=(rows + 2.2, -0.4))
    axes.axis("off")
    axes.fill([0.08, 0.92, 0.92, 0.08], [0, 0, rows + 1.6, rows + 1.6], "#f3f6fa", ec="#2f5d8a", lw=1.5)
    axes.text(0.5, 0.7, type(block).__name__, ha="center", va="center", weight="bold", color="#2f5d8a")
    for names, edge, sign, align in ((input_names, 0.08, -1, "left"), (output_names, 0.92, 1, "right")):
        for i, name in enumerate(names):
            y = 1.7 + i * rows / max(len(names), 1)
            axes.plot([edge, edge + 0.05 * sign], [y, y], color="#2f5d8a", lw=1.5)
            axes.text(edge - 0.02 * sign, y, name, ha=align, va="center", size=8)
    png = io.BytesIO()
    # without the version of matplotlib, on which the bytes would depend
    FigureCanvasAgg(figure).print_png(png, metadata={"Software": None})
    return png.getvalue()
