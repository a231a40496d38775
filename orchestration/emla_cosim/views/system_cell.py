"""A system as the output of a cell of a notebook: its diagram, components, start values and connections."""

import zlib
from collections.abc import Sequence
from typing import NamedTuple

from ..base.wording import format_count
from ..pages.page import Plots, render_template
from ..ssp.diagram import build_diagrams, link_components
from ..system.model import Component, System, count_parts

MOST = 200
"""Most rows of a table in a cell."""

_MOST_STARTS = 6
"""Most start values of a component to show."""


class ComponentRow(NamedTuple):
    """A component, where its FMU comes from, and the start values that the system sets."""

    name: str
    source: str
    start_values: str


def render_system(
    system: System,
    title: str = "System",
    description: str = "",
    facts: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> str:
    """Return a system as HTML for a cell. Nothing is built or loaded.

    Args:
        system: The system.
        title: Title.
        description: One line on its purpose.
        facts: Short facts on its runs, such as "0 s to 1 s".
        notes: Notes without full stops.
    """
    return render_template(
        __package__ or "",
        "system_cell.html",
        Plots(),
        title=title,
        description=description,
        facts=[*count_parts(system), *facts],
        notes=notes,
        diagrams=build_diagrams(
            {c.name: _describe_source(c) for c in system.components}, link_components(system.connections)
        ),
        arrow=make_arrow_id(title),
        components=[ComponentRow(c.name, _describe_source(c), _list_starts(c)) for c in system.components],
        connections=[str(connection) for connection in system.connections],
        most=MOST,
        counted=format_count,
    )


def make_arrow_id(title: str) -> str:
    """Return an id for the arrows of a cell; of equal ids in a notebook, browsers use the first one only."""
    # of the title, so that the same cell has the same bytes
    return f"emla-arrow-{zlib.crc32(title.encode('utf-8', 'replace')):08x}-"


def _describe_source(component: Component) -> str:
    if component.fmu is not None:
        return component.fmu.name
    return component.model.__name__ if isinstance(component.model, type) else component.model


def _list_starts(component: Component) -> str:
    starts = [f"{name} = {value}" for name, value in component.parameters.items()]
    more = [f"and {len(starts) - _MOST_STARTS} more"] if len(starts) > _MOST_STARTS else []
    return ", ".join([*starts[:_MOST_STARTS], *more])
