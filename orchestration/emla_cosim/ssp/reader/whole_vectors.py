"""Connectors and connections of vectors as a whole: one for each element."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace

from ...base.errors import CommandError
from ...base.wording import format_count
from ...fmu.interface import Interface
from ...system.vectors import find_indices
from ..documents.ssd_data import ComponentElement, Connector, Element, SsdConnection, SystemElement

_Shapes = dict[str, list[str]]
"""Indices of the elements of an element's vectors, by name."""

_Names = Mapping[str, Collection[str]]
"""Names of the connectors of each element."""


def expand_vectors(
    system: SystemElement, interface: Callable[[ComponentElement], Interface], where: str
) -> SystemElement:
    """Return a system with connectors and connections of elements in place of those of vectors.

    A connector is a vector if the FMU has the variables `x[1]`, `x[2]` and no variable `x`; that of a system
    is one if it is connected to a vector inside.

    Args:
        system: The system.
        interface: Returns the interface of a component's FMU.
        where: The name of the structure in error messages.

    Raises:
        CommandError: A connection joins different shapes.
    """
    return _expand(system, interface, where)[0]


def _expand(
    system: SystemElement, interface: Callable[[ComponentElement], Interface], where: str
) -> tuple[SystemElement, _Shapes]:
    elements: list[Element] = []
    shapes: dict[str | None, _Shapes] = {}
    for element in system.elements:
        if isinstance(element, SystemElement):
            element, shapes[element.name] = _expand(element, interface, where)
        elif isinstance(element, ComponentElement):
            known = interface(element).variables
            shapes[element.name] = {
                c.name: found for c in element.connectors if (found := find_indices(c.name, known))
            }
            element = replace(element, connectors=tuple(_connectors(element, shapes[element.name])))
        elements.append(element)
    names = {element.name: dict.fromkeys(c.name for c in element.connectors) for element in elements}
    own: _Shapes = {}
    for x in system.connections:
        for (inside, name), (outside, other) in (_ends(x), _ends(x)[::-1]):
            if outside is None and (found := _shape(inside, name, shapes, names)):
                own.setdefault(other, found)
    shapes[None] = own
    connections = [y for x in system.connections for y in _connections(x, shapes, names, where)]
    system = replace(system, elements=tuple(elements), connections=tuple(connections))
    return replace(system, connectors=tuple(_connectors(system, own))), own


def _ends(connection: SsdConnection) -> tuple[tuple[str | None, str], tuple[str | None, str]]:
    return (
        (connection.start_element, connection.start_connector),
        (connection.end_element, connection.end_connector),
    )


def _shape(element: str | None, name: str, shapes: Mapping[str | None, _Shapes], names: _Names) -> list[str]:
    """Return the indices of a vector: of a connector, or of connectors of its elements; empty for others."""
    if found := shapes.get(element, {}).get(name):
        return found
    return [] if element is None or element not in names else find_indices(name, names[element])


def _connectors(element: Element, shapes: _Shapes) -> Iterator[Connector]:
    declared = {c.name for c in element.connectors}
    for connector in element.connectors:
        if connector.name not in shapes:
            yield connector
            continue
        names = (f"{connector.name}{index}" for index in shapes[connector.name])
        yield from (replace(connector, name=name) for name in names if name not in declared)


def _connections(
    connection: SsdConnection, shapes: Mapping[str | None, _Shapes], names: _Names, where: str
) -> Iterator[SsdConnection]:
    start, end = (_shape(element, name, shapes, names) for element, name in _ends(connection))
    if not (start and end):
        yield connection
        return
    if start != end:
        sizes = f"{format_count(len(start), 'element')} and {format_count(len(end), 'element')}"
        differ = "" if len(start) != len(end) else " with other indices"
        raise CommandError(f"'{where}': the connection {connection} joins {sizes}{differ}.")
    for index in start:
        yield replace(
            connection,
            start_connector=f"{connection.start_connector}{index}",
            end_connector=f"{connection.end_connector}{index}",
        )
