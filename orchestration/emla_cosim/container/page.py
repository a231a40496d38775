"""The page inside the FMU of a system: what it contains, and how it steps."""

from collections.abc import Sequence

from fmublock.documentation import html_page

from ..system.model import System
from .drawing import draw_system
from .plan import ContainerPlan
from .variables import ContainerVariable


def container_page(
    plan: ContainerPlan, name: str, description: str, variables: Sequence[ContainerVariable], system: System
) -> str:
    """Return the documentation as HTML."""
    lines = [f"# {_text(name)}", "", _text(description), ""]
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
        lines.append(_row(_code(part.name), _text(str(library.file.description.modelName)), inside))
    models = {p.name: str(plan.libraries[p.library].file.description.modelName) for p in plan.parts}
    for title, picture in draw_system(models, system.connections):
        lines += ["", *([f"### {_text(title)}", ""] if title else []), f"<div>{picture}</div>"]
    for heading, causality in (("Inputs", "input"), ("Outputs", "output"), ("Parameters", "parameter")):
        shown = [v for v in variables if v.causality == causality]
        if shown:
            lines += ["", f"## {heading}", "", "| Name | Unit | Start | Meaning |", "|---|---|---|---|"]
            lines += [_variable_row(v) for v in shown]
    lines += ["", "## Connections", "", "| From | To |", "|---|---|"]
    lines += [
        _row(_code(f"{x.source}.{x.output}"), _code(f"{x.target}.{x.input}")) for x in system.connections
    ]
    return html_page("\n".join([*lines, ""]), name)


def _text(text: str) -> str:
    """Return a text from outside so that it is neither HTML nor Markdown."""
    return "".join(c if c.isalnum() or c in " .,-" else f"&#{ord(c)};" for c in " ".join(text.split()))


def _code(text: str) -> str:
    return f"<code>{_text(text)}</code>"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _variable_row(variable: ContainerVariable) -> str:
    declared = variable.own.declaredType
    unit = variable.own.unit or (declared.unit if declared is not None else None) or ""
    start = "" if variable.start is None or variable.causality == "output" else str(variable.start)
    texts = (str(unit), start, str(variable.own.description or ""))
    return _row(_code(variable.name), *map(_text, texts))
