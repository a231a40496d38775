"""Layout of the elements of a system: signals run from left to right, feedback runs below."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..documents.ssd_data import Connector, SsdConnection, SystemElement

Corners = tuple[float, float, float, float]

_FLOW = ("trajectory", "reference", "disturbance", "controller", "motor", "plant", "observer")
"""The parts of a control loop in the order of its signals."""

_WIDTH, _GAP_Y, _PITCH = 40.0, 12.5, 5.0
"""Lengths in mm: width of a box, gap between boxes, distance of lines."""


def add_coordinates(system: SystemElement) -> SystemElement:
    """Return the system with coordinates for its elements, connectors and connections."""
    if not system.elements:
        return system
    links = [
        (c.start_element, c.end_element)
        for c in system.connections
        if c.start_element is not None and c.end_element is not None
    ]
    kinds = {e.name: [c.kind for c in e.connectors] for e in system.elements}
    most = {
        name: max(connector_kinds.count("input"), connector_kinds.count("output"))
        for name, connector_kinds in kinds.items()
    }
    names = {e.name: e.id or e.name for e in system.elements}
    corners, row_edges = _place_elements(names, links, most)
    elements = tuple(
        replace(e, extent=corners[e.name], connectors=_position_connectors(e.connectors))
        for e in system.elements
    )
    placed = replace(system, elements=elements, connectors=_position_connectors(system.connectors))
    return replace(placed, connections=_route(placed, row_edges))


def _position_connectors(connectors: Sequence[Connector]) -> tuple[Connector, ...]:
    """Place inputs at the left side and outputs at the right side, evenly spaced."""
    count = {kind: sum(1 for c in connectors if c.kind == kind) for kind in ("input", "output")}
    positioned = {"input": 0, "output": 0}
    placed = []
    for connector in connectors:
        positioned[connector.kind] += 1
        y = 1.0 - positioned[connector.kind] / (count[connector.kind] + 1)
        placed.append(replace(connector, position=(0.0 if connector.kind == "input" else 1.0, round(y, 6))))
    return tuple(placed)


def _place_elements(
    names: Mapping[str, str], links: Sequence[tuple[str, str]], connectors: Mapping[str, int]
) -> tuple[dict[str, Corners], dict[str, float]]:
    """Return the corners x1, y1, x2, y2 of each element in mm, and the lowest edge of its row.

    Connected elements form a row, with each element to the right of its sources. Feedback runs below its row,
    and rows are stacked from top to bottom.

    Args:
        names: The full name of each element.
        links: Source and target of each connection.
        connectors: The number of connectors on the side with more of them, by element.
    """
    corners, row_edges = dict[str, Corners](), dict[str, float]()
    top = 0.0
    for group in _group_connected(list(names), links):
        # a loop of feedback has no other first element
        order = sorted(group, key=lambda e: _rank_in_flow(names[e]))
        columns = _assign_columns(order, links)
        column_edges = _position_columns(columns, links)
        filled = dict.fromkeys(columns.values(), top)
        for element in order:
            column, height = columns[element], _PITCH * (connectors[element] + 1)
            x, y = column_edges[column], filled[column]
            corners[element] = (x, y - height, x + _WIDTH, y)
            filled[column] = y - height - _GAP_Y
        row_edges |= dict.fromkeys(group, min(corners[e][1] for e in group))
        below = sum(1 for a, b in links if a in columns and not _is_adjacent(columns, a, b))
        top = min(filled.values()) - _PITCH * (below + 2)
    return corners, row_edges


def _route(system: SystemElement, row_edges: Mapping[str, float]) -> tuple[SsdConnection, ...]:
    """Return the connections of a placed system with the waypoints of their lines."""
    ends = {
        (e.name, c.name): _locate(e.extent, c.position)
        for e in system.elements
        for c in e.connectors
        if e.extent is not None and c.position is not None
    }
    lanes: dict[object, int] = {}  # lines that run side by side must not cover each other

    def lane(lane_group: object) -> float:
        lanes[lane_group] = lanes.get(lane_group, 0) + 1
        return _PITCH * lanes[lane_group]

    routed = []
    for connection in system.connections:
        start = ends.get((connection.start_element or "", connection.start_connector))
        end = ends.get((connection.end_element or "", connection.end_connector))
        if start is None or end is None:
            routed.append(connection)
            continue
        floor = row_edges[connection.start_element or ""]
        out = start[0] + lane(("right of", floor, start[0]))
        gap = end[0] - start[0]
        columns = (e.extent for e in system.elements if e.extent is not None)
        is_free = not any(start[0] < x1 and x2 < end[0] for x1, _, x2, _ in columns)
        if 0.0 < gap and is_free:
            points = ((out, start[1]), (out, end[1]))
        else:
            y = floor - lane(("below", floor))
            into = end[0] - lane(("left of", floor, end[0]))
            points = ((out, start[1]), (out, y), (into, y), (into, end[1]))
        routed.append(replace(connection, waypoints=points))
    return tuple(routed)


def _locate(extent: Corners, position: tuple[float, float]) -> tuple[float, float]:
    x1, y1, x2, y2 = extent
    return round(x1 + position[0] * (x2 - x1), 3), round(y1 + position[1] * (y2 - y1), 3)


def _rank_in_flow(name: str) -> int:
    role = name.rpartition(".")[2]
    return _FLOW.index(role) if role in _FLOW else len(_FLOW)


def _group_connected(elements: Sequence[str], links: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Return groups of connected elements; groups and members keep their order."""
    group = {e: [e] for e in elements}
    for a, b in links:
        if group[a] is not group[b]:
            joined = group[a] + group[b]
            group |= dict.fromkeys(joined, joined)
    order = {e: i for i, e in enumerate(elements)}
    return list({id(g): sorted(g, key=order.__getitem__) for g in group.values()}.values())


def _assign_columns(order: Sequence[str], links: Sequence[tuple[str, str]]) -> dict[str, int]:
    """Return columns in which connections forward in this order run to the right."""
    sources: dict[str, list[str]] = {}
    for a, b in links:
        sources.setdefault(b, []).append(a)
    columns: dict[str, int] = {}
    for element in order:
        before = [columns[a] for a in sources.get(element, ()) if a in columns]
        columns[element] = max(before, default=-1) + 1
    return columns


def _is_adjacent(columns: Mapping[str, int], a: str, b: str) -> bool:
    return columns[b] == columns[a] + 1


def _position_columns(columns: Mapping[str, int], links: Sequence[tuple[str, str]]) -> dict[int, float]:
    """Return the left edge of each column; gaps have room for all lines that begin or end there."""
    lines = dict.fromkeys(range(max(columns.values()) + 2), 0)
    for a, b in links:
        if a in columns:
            lines[columns[a] + 1] += 1
            lines[columns[b]] += not _is_adjacent(columns, a, b)
    edges, x = {}, 0.0
    for column in range(max(columns.values()) + 1):
        x += _PITCH * (lines[column] + 2) if column else 0.0
        edges[column] = x
        x += _WIDTH
    return edges
