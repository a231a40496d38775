"""Connectors and connections of arrays as a whole, and of their elements: one for each element."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from ...base.errors import CommandError
from ...base.wording import format_count
from ...fmu.elements import format_index
from ...fmu.interface import Interface
from ...system.vectors import find_indices, find_sizes, sort_indices
from ..documents.ssd_data import (
    ComponentElement,
    Connector,
    DictionaryReference,
    Element,
    SsdConnection,
    SystemElement,
)
from .shapes import Shapes, component_shapes, declared_shapes

_Names = Mapping[str | None, Mapping[str, Connector]]
"""The connectors of each element, and of the system, by name."""


def expand_vectors(
    system: SystemElement, interface: Callable[[ComponentElement], Interface]
) -> SystemElement:
    """Return a system with connectors and connections of elements in place of those of arrays.

    A connector is an array if the FMU has the variables `x[1]`, `x[2]` and no variable `x`; that of a system
    is one if it is declared with sizes, or connected to an array inside.

    Args:
        system: The system.
        interface: Returns the interface of a component's FMU.

    Raises:
        CommandError: A connection joins different shapes, or a shape is not that of the FMU.
    """
    return _expand(system, interface)[0]


def _expand(
    system: SystemElement, interface: Callable[[ComponentElement], Interface]
) -> tuple[SystemElement, Shapes]:
    elements: list[Element] = []
    shapes: dict[str | None, Shapes] = {}
    for element in system.elements:
        if isinstance(element, SystemElement):
            element, shapes[element.name] = _expand(element, interface)
        elif isinstance(element, ComponentElement):
            shapes[element.name] = component_shapes(element, interface(element))
            element = replace(element, connectors=tuple(_expand_connectors(element, shapes[element.name])))
        elif isinstance(element, DictionaryReference):
            shapes[element.name] = declared_shapes(element)
            element = replace(element, connectors=tuple(_expand_connectors(element, shapes[element.name])))
        elements.append(element)
    owners: dict[str | None, Element] = {None: system, **{e.name: e for e in elements}}
    names = {name: {c.name: c for c in owner.connectors} for name, owner in owners.items()}
    system_shapes = declared_shapes(system)
    for x in system.connections:
        for (inside, name, index), (outside, system_name, system_index) in (_ends(x), _ends(x)[::-1]):
            is_whole = outside is None and inside is not None and not (index or system_index)
            if is_whole and (indices := _find_shape(inside, name, shapes, names)):
                system_shapes.setdefault(system_name, indices)  # a declared size has precedence
    shapes[None] = system_shapes
    connections = [y for x in system.connections for y in _expand_connection(x, shapes, names)]
    system = replace(system, elements=tuple(elements), connections=tuple(connections))
    return replace(system, connectors=tuple(_expand_connectors(system, system_shapes))), system_shapes


_End = tuple[str | None, str, tuple[int, ...]]
"""Element, connector and indices."""


def _ends(connection: SsdConnection) -> tuple[_End, _End]:
    return (
        (connection.start_element, connection.start_connector, connection.start_indices),
        (connection.end_element, connection.end_connector, connection.end_indices),
    )


def _find_shape(
    element: str | None, name: str, shapes: Mapping[str | None, Shapes], names: _Names
) -> list[str]:
    """Return the indices of an array: of a connector, or of connectors of its elements; empty for others."""
    if indices := shapes.get(element, {}).get(name):
        return indices
    return [] if element is None else sort_indices(find_indices(name, names.get(element, {})))


def _expand_connectors(element: Element, shapes: Shapes) -> Iterator[Connector]:
    declared = {c.name for c in element.connectors}
    for connector in element.connectors:
        if connector.name not in shapes:
            yield connector
            continue
        names = (f"{connector.name}{index}" for index in shapes[connector.name])
        yield from (replace(connector, name=name, dimensions=()) for name in names if name not in declared)


def _expand_connection(
    connection: SsdConnection, shapes: Mapping[str | None, Shapes], names: _Names
) -> Iterator[SsdConnection]:
    """Yield the connections of elements; the connection itself if it is of scalars or has unknown ends."""
    label, ends = f"{connection.location}: the connection {connection}", _ends(connection)
    end_shapes = [_find_shape(element, name, shapes, names) for element, name, _ in ends]
    if not all(
        f or name in names.get(element, {}) for f, (element, name, _) in zip(end_shapes, ends, strict=True)
    ):
        yield connection
        return
    for shape, (element, name, _) in zip(end_shapes, ends, strict=True):
        if not shape and names[element][name].dimensions:
            raise CommandError(
                f"{label} joins the array '{name}' of unknown size; give its dimensions a size, or connect "
                "it inside."
            )
    selected = [_select_indices(label, end, shape) for end, shape in zip(ends, end_shapes, strict=True)]
    are_whole = [bool(shape) and not index for shape, (_, _, index) in zip(end_shapes, ends, strict=True)]
    if any(are_whole) and (are_whole[0] != are_whole[1] or selected[0] != selected[1]):
        sizes = " and ".join(format_count(len(c), "element") for c in selected)
        if are_whole[0] != are_whole[1]:
            differ = (
                ", an array with a single value; select an element by startIndices or endIndices (SSP 2.0)"
            )
        else:
            differ = "" if len(selected[0]) != len(selected[1]) else " with other indices"
        raise CommandError(f"{label} joins {sizes}{differ}.")
    for start, end in zip(*selected, strict=True):
        yield replace(
            connection,
            start_connector=f"{connection.start_connector}{start}",
            end_connector=f"{connection.end_connector}{end}",
            start_indices=(),
            end_indices=(),
        )


def _select_indices(link: str, end: _End, shape: list[str]) -> list[str]:
    """Return the indices of the connected elements: all of an array, or the selected one; "" for a scalar."""
    _, name, index = end
    if not index:
        return shape or [""]
    sizes = find_sizes(shape)
    selects = f"{link} selects {name}{format_index(index)}"
    if not shape:
        raise CommandError(f"{selects}, but '{name}' is not an array.")
    if not sizes:
        raise CommandError(f"{selects}, but the FMU has other indices than 1 to n.")
    if len(index) != len(sizes):
        has = format_count(len(sizes), "dimension")
        raise CommandError(f"{selects}, but '{name}' has {has}; write one index for each.")
    if any(i > n for i, n in zip(index, sizes, strict=True)):
        raise CommandError(f"{selects}; the elements of '{name}' are {shape[0]} to {shape[-1]}.")
    position = 0
    for i, n in zip(index, sizes, strict=True):
        position = position * n + i - 1
    return [shape[position]]
