"""The page inside the FMU of a system: what it contains, and how it steps."""

from collections.abc import Sequence

from fmublock.documentation import html_page

from ..system.model import System
from .drawing import draw_system
from .plan import ContainerPlan
from .variables import ContainerVariable


def render_page(
    plan: ContainerPlan, name: str, description: str, variables: Sequence[ContainerVariable], system: System
) -> str:
    """Return the documentation as HTML."""
    lines = [f"# {_escape_text(name)}", "", _escape_text(description), ""]
    lines += [
        f"The system has {len(plan.parts)} components, which exchange values every {plan.times.step:.12g} s. "
        "The communication step of the host must be a whole number of these steps. An input that is set at a "
        "communication point acts from the next step on.",
        "",
        "## Components",
        "",
        "| Component | FMU | |",
        "|---|---|---|",
    ]
    for part in plan.parts:
        library = plan.libraries[part.library]
        inside = "compiled in" if library.source else "its library is in the resources"
        lines.append(
            _format_row(
                _format_code(part.name), _escape_text(str(library.file.description.modelName)), inside
            )
        )
    models = {p.name: str(plan.libraries[p.library].file.description.modelName) for p in plan.parts}
    # a `div` keeps the picture out of Markdown
    for title, picture in draw_system(models, system.connections):
        lines += ["", *([f"### {_escape_text(title)}", ""] if title else []), f"<div>{picture}</div>"]
    for heading, causality in (("Inputs", "input"), ("Outputs", "output"), ("Parameters", "parameter")):
        selected = [v for v in variables if v.causality == causality]
        if selected:
            lines += ["", f"## {heading}", "", "| Name | Unit | Start | Meaning |", "|---|---|---|---|"]
            lines += [_format_variable_row(v) for v in selected]
    lines += ["", "## Connections", "", "| From | To |", "|---|---|"]
    lines += [
        _format_row(_format_code(f"{x.source}.{x.output}"), _format_code(f"{x.target}.{x.input}"))
        for x in system.connections
    ]
    return html_page("\n".join([*lines, ""]), name)


def _escape_text(text: str) -> str:
    """Return a text from outside so that it is neither HTML nor Markdown."""
    return "".join(c if c.isalnum() or c in " .,-" else f"&#{ord(c)};" for c in " ".join(text.split()))


def _format_code(text: str) -> str:
    return f"<code>{_escape_text(text)}</code>"


def _format_row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _format_variable_row(variable: ContainerVariable) -> str:
    declared = variable.origin.declaredType
    unit = variable.origin.unit or (declared.unit if declared is not None else None) or ""
    start = "" if variable.start is None or variable.causality == "output" else str(variable.start)
    texts = (str(unit), start, str(variable.origin.description or ""))
    return _format_row(_format_code(variable.name), *map(_escape_text, texts))
