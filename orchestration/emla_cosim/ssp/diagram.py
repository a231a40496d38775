"""Draw a system as boxes and lines, and lay out its elements: signals from left to right."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from ..base.wording import format_count
from ..system.model import Connection
from .documents.ssd_data import Connector, Element, SsdConnection, SystemElement

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
    connector_counts = {
        name: max(connector_kinds.count("input"), connector_kinds.count("output"))
        for name, connector_kinds in kinds.items()
    }
    names = {e.name: e.id or e.name for e in system.elements}
    corners, row_edges = _place_elements(names, links, connector_counts)
    elements = tuple(
        replace(e, extent=corners[e.name], connectors=_position_connectors(e.connectors))
        for e in system.elements
    )
    placed = replace(system, elements=elements, connectors=_position_connectors(system.connectors))
    return replace(placed, connections=_add_waypoints(placed, row_edges))


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


def _add_waypoints(system: SystemElement, row_edges: Mapping[str, float]) -> tuple[SsdConnection, ...]:
    """Return the connections of a placed system with the waypoints of their lines."""
    ends = {
        (e.name, c.name): _compute_point(e.extent, c.position)
        for e in system.elements
        for c in e.connectors
        if e.extent is not None and c.position is not None
    }
    lanes: dict[object, int] = {}  # lines that run side by side must not cover each other

    def take_next_lane(lane_group: object) -> float:
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
        out = start[0] + take_next_lane(("right of", floor, start[0]))
        gap = end[0] - start[0]
        columns = (e.extent for e in system.elements if e.extent is not None)
        is_free = not any(start[0] < x1 and x2 < end[0] for x1, _, x2, _ in columns)
        if 0.0 < gap and is_free:
            points = ((out, start[1]), (out, end[1]))
        else:
            y = floor - take_next_lane(("below", floor))
            into = end[0] - take_next_lane(("left of", floor, end[0]))
            points = ((out, start[1]), (out, y), (into, y), (into, end[1]))
        routed.append(replace(connection, waypoints=points))
    return tuple(routed)


def _compute_point(extent: Corners, position: tuple[float, float]) -> tuple[float, float]:
    """Return the point x, y in mm of a position that is relative to the corners of an element."""
    x1, y1, x2, y2 = extent
    return round(x1 + position[0] * (x2 - x1), 3), round(y1 + position[1] * (y2 - y1), 3)


def _rank_in_flow(name: str) -> int:
    """Return the position of a component in `_FLOW` by the end of its name; others come last."""
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


_MOST_BOXES, _MOST_BOXES_OF_PART = 24, 100
"""Most boxes in one diagram. Parts of a larger system have diagrams of their own."""

_MOST_DIAGRAMS = 40

_COLORS = ("blue", "orange", "green", "red", "purple", "grey")
_MARGIN = 4.0
_LETTER_WIDTH, _LABEL_HEIGHT = 0.62, 2.6
"""Width of a letter relative to its height, and the height of labels in mm."""


@dataclass(frozen=True)
class ComponentLink:
    """All connections from one component to another. `signals` are pairs of an output and an input."""

    source: str
    target: str
    signals: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Box:
    """A component, or a part of a system. Lengths are in mm; `letters` is the height of its name."""

    x: float
    y: float
    width: float
    height: float
    above: str
    name: str
    letters: float
    color: str
    tooltip: str


@dataclass(frozen=True)
class DiagramLine:
    """A line between two boxes: SVG path, label at its beginning, and full description."""

    path: str
    color: str
    label: str
    x: float
    y: float
    tooltip: str


@dataclass(frozen=True)
class Diagram:
    """Boxes and lines; `view` is the view box of SVG."""

    title: str
    boxes: tuple[Box, ...]
    lines: tuple[DiagramLine, ...]
    view: tuple[float, float, float, float]


def link_components(connections: Iterable[Connection]) -> list[ComponentLink]:
    """Return the connections of a system, grouped by their components."""
    return _group_by_ends(((x.source, x.target), (x.output, x.input)) for x in connections)


def group_connections(components: Iterable[str], connections: Sequence[str]) -> list[ComponentLink]:
    """Return the connections in run.json between these components, without invalid entries."""
    # one component's name can begin with that of another one and a dot
    longest_first = sorted(components, key=len, reverse=True)
    ends = []
    for text in connections:
        source, _, target = text.partition(" -> ")
        a, b = _split_path(source, longest_first), _split_path(target.partition(" ")[0], longest_first)
        if a is not None and b is not None:
            ends.append(((a[0], b[0]), (a[1], b[1])))
    return _group_by_ends(ends)


def _group_by_ends(links: Iterable[tuple[tuple[str, str], tuple[str, str]]]) -> list[ComponentLink]:
    """Return one link for each pair of components, from pairs of components and of their signals."""
    signals: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for ends, signal in links:
        signals.setdefault(ends, []).append(signal)
    return [ComponentLink(*ends, tuple(grouped)) for ends, grouped in signals.items()]


def _split_path(path: str, components: Sequence[str]) -> tuple[str, str] | None:
    """Split a path into component and variable; None if it begins with no component.

    `components` are sorted by length, longest first.
    """
    name = next((c for c in components if path.startswith(f"{c}.")), None)
    return None if name is None else (name, path.removeprefix(f"{name}."))


def build_diagrams(components: Mapping[str, str], wires: Sequence[ComponentLink]) -> list[Diagram]:
    """Return the diagram of a system; for a large one, a diagram of its parts and one of each part.

    `components` has descriptions by name. A part is the name before the first dot. The list is empty if even
    the parts are too many to show.
    """
    parts: dict[str, dict[str, str]] = {}
    for name, tooltip in components.items():
        parts.setdefault(name.partition(".")[0], {})[name] = tooltip
    if 0 < len(components) <= (_MOST_BOXES if len(parts) < len(components) else _MOST_BOXES_OF_PART):
        return [_build_diagram("", components, wires)]
    diagrams = []
    if 0 < len(parts) <= _MOST_BOXES:
        tooltip = {part: format_count(len(inside), "component") for part, inside in parts.items()}
        diagrams.append(_build_diagram("Overview", tooltip, _link_parts(wires)))
    for part, inside in list(parts.items())[:_MOST_DIAGRAMS]:
        if 1 < len(inside) <= _MOST_BOXES_OF_PART:
            diagrams.append(
                _build_diagram(part, inside, [w for w in wires if {w.source, w.target} <= set(inside)])
            )
    return diagrams


def _link_parts(wires: Iterable[ComponentLink]) -> list[ComponentLink]:
    """Return the connections between different parts, grouped by these parts."""
    ends = [((w.source.partition(".")[0], w.target.partition(".")[0]), w.signals) for w in wires]
    return _group_by_ends((parts, x) for parts, signals in ends if parts[0] != parts[1] for x in signals)


def _build_diagram(title: str, components: Mapping[str, str], wires: Sequence[ComponentLink]) -> Diagram:
    """Return one diagram with a box per component; the box of the same part of each joint has one color."""
    system = add_coordinates(_build_structure(components, wires))
    elements = {e.name: e for e in system.elements}
    # the same part of each joint has the same color
    kinds = list(dict.fromkeys(name.rpartition(".")[2] for name in components))
    colors = {n: _COLORS[kinds.index(n.rpartition(".")[2]) % len(_COLORS)] for n in components}
    boxes = tuple(_build_box(e, components[name], colors[name]) for name, e in elements.items())
    lines = tuple(
        _build_line(c, wire, elements, colors[wire.source])
        for c, wire in zip(system.connections, wires, strict=True)
    )
    xs = [x for b in boxes for x in (b.x, b.x + b.width)]
    ys = [y for b in boxes for y in (b.y, b.y + b.height)]
    xs += [line.x + _LETTER_WIDTH * _LABEL_HEIGHT * len(line.label) for line in lines]
    for connection in system.connections:
        xs += [x for x, _ in connection.waypoints]
        ys += [-y for _, y in connection.waypoints]
    x_min, y_min = min(xs) - _MARGIN, min(ys) - _MARGIN
    return Diagram(title, boxes, lines, (x_min, y_min, max(xs) + _MARGIN - x_min, max(ys) + _MARGIN - y_min))


def _build_structure(components: Mapping[str, str], wires: Sequence[ComponentLink]) -> SystemElement:
    """Return the system with one connector for each end of a link at a component."""
    ends: dict[str, list[Connector]] = {name: [] for name in components}
    for wire in wires:
        ends[wire.source].append(Connector(f"to {wire.target}", "output"))
        ends[wire.target].append(Connector(f"from {wire.source}", "input"))
    return SystemElement(
        "",
        elements=tuple(Element(name, tuple(connectors)) for name, connectors in ends.items()),
        connections=tuple(
            SsdConnection(w.source, f"to {w.target}", w.target, f"from {w.source}") for w in wires
        ),
    )


def _build_box(element: Element, tooltip: str, color: str) -> Box:
    x1, y1, x2, y2 = element.extent or (0.0, 0.0, 0.0, 0.0)
    above, _, name = element.name.rpartition(".")
    letters = min(4.2, (x2 - x1 - 4.0) / (_LETTER_WIDTH * max(len(name), 1)))
    return Box(x1, -y2, x2 - x1, y2 - y1, above, name, max(letters, 1.0), color, f"{element.name}: {tooltip}")


def _build_line(
    connection: SsdConnection, wire: ComponentLink, elements: Mapping[str, Element], color: str
) -> DiagramLine:
    start = _locate_connector(elements[wire.source], connection.start_connector)
    end = _locate_connector(elements[wire.target], connection.end_connector)
    points = [start, *connection.waypoints, end]
    path = "M" + "L".join(f"{x:.1f} {-y:.1f}" for x, y in points)
    outputs = list(dict.fromkeys(output for output, _ in wire.signals))
    label = ", ".join(outputs) if len(", ".join(outputs)) <= 14 else format_count(len(outputs), "signal")
    tooltip = "\n".join(f"{wire.source}.{a} → {wire.target}.{b}" for a, b in wire.signals[:40])
    return DiagramLine(path, color, label, start[0] + 1.0, -start[1] - 0.9, tooltip)


def _locate_connector(element: Element, name: str) -> tuple[float, float]:
    x1, y1, x2, y2 = element.extent or (0.0, 0.0, 0.0, 0.0)
    connector = next(c for c in element.connectors if c.name == name)
    x, y = connector.position or (0.0, 0.0)
    return x1 + x * (x2 - x1), y1 + y * (y2 - y1)
