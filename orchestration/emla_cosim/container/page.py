"""The page inside the FMU of a system: what it contains, and how it steps."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape

from fmublock.documentation import html_page

from ..ssp.diagram import Box, Diagram, DiagramLine, build_diagrams, link_components
from ..system.model import Connection, System
from .plan import ContainerPlan
from .variables import ContainerVariable

_COLORS = {
    "blue": "#2563eb",
    "orange": "#c2570c",
    "green": "#15803d",
    "red": "#b91c1c",
    "purple": "#7e22ce",
    "grey": "#4b5563",
}
_ARROW = (
    '<defs><marker id="arrow" viewBox="0 0 6 6" refX="5.5" refY="3" markerWidth="6" markerHeight="6" '
    'orient="auto"><path d="M0 0L6 3L0 6z" fill="#4b5563"/></marker></defs>'
)


def draw_system(components: Mapping[str, str], connections: Iterable[Connection]) -> list[tuple[str, str]]:
    """Return the diagrams of a system as pairs of a title and an SVG element on one line.

    Args:
        components: Descriptions of the components by name.
        connections: The connections.
    """
    diagrams = build_diagrams(components, link_components(connections))
    # one marker serves all diagrams of a page
    return [(d.title, _draw_diagram(d, _ARROW if d is diagrams[0] else "")) for d in diagrams]


def _draw_diagram(diagram: Diagram, definitions: str) -> str:
    x, y, width, height = diagram.view
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" viewBox="{x:.1f} {y:.1f} {width:.1f} '
        f'{height:.1f}" style="width: {1.05 * width:.0f}mm; max-width: 100%" font-family="sans-serif">',
        definitions,
        *map(_draw_wire, diagram.lines),
        *map(_draw_box, diagram.boxes),
        # last, so that no box or line covers them
        *(_draw_label(line.x, line.y, line.label, 2.6, "start", "#4b5563") for line in diagram.lines),
        "</svg>",
    ]
    return "".join(parts)


def _draw_wire(line: DiagramLine) -> str:
    return (
        f'<path d="{line.path}" fill="none" stroke="{_COLORS[line.color]}" stroke-width="0.5" '
        f'marker-end="url(#arrow)">{_make_title(line.tooltip)}</path>'
    )


def _draw_box(box: Box) -> str:
    color, x, middle = _COLORS[box.color], box.x + box.width / 2, box.y + box.height / 2
    texts = [_draw_label(x, middle - 1.2, box.above, 3.0, "middle", "#4b5563")] if box.above else []
    texts.append(
        _draw_label(x, middle + (3.6 if box.above else 1.4), box.name, box.letters, "middle", "#111827")
    )
    return (
        f'<g>{_make_title(box.tooltip)}<rect x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" '
        f'height="{box.height:.1f}" rx="1.5" fill="{color}" fill-opacity="0.1" stroke="{color}" '
        f'stroke-width="0.5"/>{"".join(texts)}</g>'
    )


def _draw_label(x: float, y: float, text: str, size: float, anchor: str, color: str) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:.2f}" text-anchor="{anchor}" fill="{color}">'
        f"{_escape_line(text)}</text>"
    )


def _make_title(text: str) -> str:
    return f"<title>{_escape_line(text)}</title>"


def _escape_line(text: str) -> str:
    """Return a text from outside on one line, without markup."""
    return escape("; ".join(" ".join(line.split()) for line in text.splitlines()))


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
