"""The content of an FMU or a system as the output of a cell of a notebook."""

from collections.abc import Sequence
from typing import NamedTuple

from ..base.wording import format_count
from ..pages.page import Plots, render_template
from ..ssp.diagram import build_diagrams, group_connections
from ..views.notebook_cells import MOST, make_arrow_id
from .display_rows import DisplayRow, build_display_rows, list_fmu_facts
from .system_info import Info

_FEW = 12
"""Most rows of a table that is open at first."""

_GROUPS = {
    "input": ("input",),
    "output": ("output",),
    "parameter": ("parameter", "structuralParameter"),
    "other variable": (),
}
"""Headings of the tables of variables, and the causalities that they have; the last one has all others."""


class FmuRow(NamedTuple):
    """An FMU, and the components that use it."""

    model: str
    components: str
    path: str


class VariableGroup(NamedTuple):
    """Variables with a heading, such as the inputs."""

    heading: str
    rows: Sequence[DisplayRow]
    is_open: bool


def render_cell(content: Info) -> str:
    """Return the content as HTML for a cell, with the texts of `emla info`."""
    names: list[list[str]] = [[] for _ in content.fmus]
    for component in content.components:
        names[component.fmu].append(component.name)
    start, stop, step = content.start_time or 0.0, content.stop_time, content.step_size
    connections = [f"{c.output} -> {c.input}" for c in content.connections]
    components = {c.name: c.model for c in content.components}
    machine = content.machine
    is_fmu = len(components) == 1
    facts = [format_count(len(content.variables), "variable")]
    if not is_fmu:
        facts = [format_count(len(components), "component"), format_count(len(names), "FMU"), *facts]
    if machine is not None:
        facts.append(f"{format_count(len(machine.bodies), 'body', 'bodies')} in .machine")
    facts += [] if stop is None else [f"{start:g} s to {stop:g} s"]
    facts += [] if step is None else [f"step {step:g} s"]
    return render_template(
        __package__ or "",
        "info_cell.html",
        Plots(),
        content=content,
        facts=facts,
        fmu=list_fmu_facts(content.fmus[0]) if is_fmu else [],
        fmus=[
            FmuRow(fmu.model, ", ".join(used), fmu.path)
            for fmu, used in zip(content.fmus, names, strict=True)
        ],
        diagrams=[] if is_fmu else build_diagrams(components, group_connections(components, connections)),
        arrow=make_arrow_id(content.name),
        connections=connections,
        groups=_group_variables(content),
        most=MOST,
        counted=format_count,
    )


def _group_variables(content: Info) -> list[VariableGroup]:
    """Return the variables by causality, without groups that are empty."""
    groups: dict[str, list[DisplayRow]] = {heading: [] for heading in _GROUPS}
    headings = {causality: heading for heading, group in _GROUPS.items() for causality in group}
    for row in build_display_rows(content.variables):
        groups[headings.get(row.first.causality, "other variable")].append(row)
    return [
        VariableGroup(format_count(len(rows), heading), rows, len(rows) <= _FEW)
        for heading, rows in groups.items()
        if rows
    ]
