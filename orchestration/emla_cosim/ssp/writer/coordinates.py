"""Coordinates of systems, elements, connectors and connections."""

from collections.abc import Sequence
from dataclasses import replace

from ..documents.ssd_data import Connector, Element, SystemElement
from .layout import layout, route


def add_coordinates(system: SystemElement) -> SystemElement:
    """Return the system with coordinates for its elements, connectors and connections."""
    if not system.elements:
        return system
    links = [
        (c.start_element, c.end_element)
        for c in system.connections
        if c.start_element is not None and c.end_element is not None
    ]
    sides = {e.name: _sides(e) for e in system.elements}
    names = {e.name: e.id or e.name for e in system.elements}
    corners = layout(list(sides), names, links, {n: max(map(len, s)) for n, s in sides.items()})
    elements = tuple(
        replace(e, extent=corners[e.name], connectors=_position_connectors(e.connectors))
        for e in system.elements
    )
    placed = replace(system, elements=elements, connectors=_position_connectors(system.connectors))
    return replace(placed, connections=route(placed))


def _sides(element: Element) -> tuple[list[str], list[str]]:
    inputs = [c.name for c in element.connectors if c.kind == "input"]
    return inputs, [c.name for c in element.connectors if c.kind == "output"]


def _position_connectors(connectors: Sequence[Connector]) -> tuple[Connector, ...]:
    """Place inputs at the left side and outputs at the right side, evenly spaced."""
    count = {kind: sum(1 for c in connectors if c.kind == kind) for kind in ("input", "output")}
    seen = {"input": 0, "output": 0}
    placed = []
    for connector in connectors:
        seen[connector.kind] += 1
        y = 1.0 - seen[connector.kind] / (count[connector.kind] + 1)
        placed.append(replace(connector, position=(0.0 if connector.kind == "input" else 1.0, round(y, 6))))
    return tuple(placed)
