"""The page inside the FMU of a system: what it contains, and how it steps."""

from collections.abc import Sequence

from fmublock.documentation import html_page

from ..system.model import System
from .plan import ContainerPlan
from .variables import ContainerVariable


def container_page(
    plan: ContainerPlan, name: str, description: str, variables: Sequence[ContainerVariable], system: System
) -> str:
    """Return the documentation as HTML."""
    lines = [f"# {name}", "", description, ""]
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
        lines.append(f"| `{part.name}` | {library.file.description.modelName} | {inside} |")
    for heading, causality in (("Inputs", "input"), ("Outputs", "output"), ("Parameters", "parameter")):
        shown = [v for v in variables if v.causality == causality]
        if shown:
            lines += ["", f"## {heading}", "", "| Name | Unit | Start | Meaning |", "|---|---|---|---|"]
            lines += [_row(v) for v in shown]
    lines += ["", "## Connections", "", "| From | To |", "|---|---|"]
    lines += [f"| `{x.source}.{x.output}` | `{x.target}.{x.input}` |" for x in system.connections]
    return html_page("\n".join([*lines, ""]), name)


def _row(variable: ContainerVariable) -> str:
    declared = variable.own.declaredType
    unit = variable.own.unit or (declared.unit if declared is not None else None) or ""
    start = "" if variable.start is None or variable.causality == "output" else variable.start
    cells = (f"`{variable.name}`", unit, str(start), variable.own.description or "")
    return f"| {' | '.join(str(c).replace('|', '/').replace(chr(10), ' ') for c in cells)} |"
