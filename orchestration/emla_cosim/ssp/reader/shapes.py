"""Shapes of array connectors, and their connections as a whole and of their elements."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace

from ...base.errors import CommandError
from ...base.wording import format_count
from ...fmu.elements import format_index, list_indices
from ...fmu.interface import Interface
from ...fmu.parameters.parameter_sets import SsvParameter
from ...system.structure import find_indices, find_sizes, sort_indices
from ..documents.ssd_data import (
    ComponentElement,
    Connector,
    DictionaryReference,
    Element,
    SsdConnection,
    SystemElement,
)

Shapes = dict[str, list[str]]
"""Indices of the elements of an element's arrays in row-major order, by name."""

_LARGEST = 2**20
"""The largest number of elements of a declared array; as for arrays of FMUs."""


def component_shapes(element: Element, interface: Interface) -> Shapes:
    """Return the shapes of the array connectors of a component, from the variables of its FMU.

    Args:
        element: The component.
        interface: The interface of its FMU.

    Raises:
        CommandError: A declared dimension is not that of the variable.
    """
    shapes: Shapes = {}
    names = {c.name for c in element.connectors} | set(interface.variables)
    for connector in element.connectors:
        if indices := sort_indices(find_indices(connector.name, interface.variables)):
            shapes[connector.name] = indices
        if connector.dimensions and (indices or connector.name in interface.variables):
            _check_dimensions(connector, element, interface, names, indices)
    return shapes


def declared_shapes(element: Element) -> Shapes:
    """Return the shapes of the array connectors of an element whose dimensions all have a size.

    Args:
        element: A system, or the reference to a signal dictionary.

    Raises:
        CommandError: A dimension has the size of a connector that does not exist, or the array is too large.
    """
    shapes: Shapes = {}
    names = {c.name for c in element.connectors}
    for connector in element.connectors:
        _check_size_connectors(connector, names, element)
        sizes = [d.size for d in connector.dimensions if d.size is not None]
        if sizes and len(sizes) == len(connector.dimensions):
            if (count := math.prod(sizes)) > _LARGEST:
                name = f"{element.name}.{connector.name}"
                raise _make_fault(connector, f"the array {name} has {count} elements, more than {_LARGEST}")
            shapes[connector.name] = list(list_indices(sizes))
    return shapes


def explain_shape(parameter: SsvParameter, name: str, names: Collection[str], target: str) -> str | None:
    """Return why a parameter does not have the shape of its target; None if it does, or without a target.

    Args:
        parameter: The parameter, or the first element of its array.
        name: The name of the target.
        names: The names of all variables.
        target: What the message calls the target.
    """
    sizes = () if parameter.array is None else parameter.array.sizes
    indices = find_indices(name, names)
    if not indices and name not in names:
        return None
    if sorted(list_indices(sizes) if sizes else ()) == sorted(indices):
        return None
    stated = f"has the dimensions {_format_sizes(sizes)}" if sizes else "has one value and no dimensions"
    actual = find_sizes(sort_indices(indices))
    has = (
        f"the dimensions {_format_sizes(actual)}"
        if actual
        else "other indices than 1 to n"
        if indices
        else "no dimensions"
    )
    return f"the parameter '{parameter.document_name}' {stated}, but {target} has {has}."


def _format_sizes(sizes: tuple[int, ...]) -> str:
    return " x ".join(map(str, sizes))


def _check_dimensions(
    connector: Connector, element: Element, interface: Interface, names: set[str], indices: list[str]
) -> None:
    """Raise CommandError if a declared dimension is not that of the FMU's variable."""
    name = f"{element.name}.{connector.name}"
    _check_size_connectors(connector, names, element)
    sizes = find_sizes(indices)
    actual = "has other indices than 1 to n" if indices else "is a scalar"
    if sizes:
        actual = f"is an array of {_format_sizes(sizes)}" + (" elements" if len(sizes) == 1 else "")
    if len(sizes) != len(connector.dimensions):
        raise _make_fault(
            connector,
            f"{name} is declared with {format_count(len(connector.dimensions), 'dimension')}, but the "
            f"variable of the FMU {actual}",
        )
    for position, (size, declared) in enumerate(
        zip(sizes, _list_declared_sizes(connector, interface), strict=True), 1
    ):
        if declared not in (None, size):
            raise _make_fault(
                connector,
                f"dimension {position} of {name} is declared with the size {declared}, but the variable of "
                f"the FMU {actual}",
            )


def _list_declared_sizes(connector: Connector, interface: Interface) -> Iterator[int | None]:
    """Yield the declared size of each dimension; None if it is not known without the FMU."""
    for dimension in connector.dimensions:
        variable = interface.variables.get(dimension.connector or "")
        start = None if variable is None else variable.start  # of a structural parameter
        yield dimension.size if start is None else int(float(str(start)))


def _check_size_connectors(connector: Connector, names: set[str], element: Element) -> None:
    """Raise CommandError if a dimension has the size of a connector that does not exist."""
    for dimension in connector.dimensions:
        if dimension.connector is not None and dimension.connector not in names:
            raise _make_fault(
                connector,
                f"the size of {element.name}.{connector.name} is that of the connector "
                f"'{dimension.connector}', which does not exist",
            )


def _make_fault(connector: Connector, text: str) -> CommandError:
    return CommandError(f"{connector.location}: {text}.")


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
    """Return the system as `expand_vectors` does, and the shapes of its own array connectors."""
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
        for (inside, name, index), (outside, system_name, system_index) in (
            _split_ends(x),
            _split_ends(x)[::-1],
        ):
            is_whole = outside is None and inside is not None and not (index or system_index)
            if is_whole and (indices := _find_shape(inside, name, shapes, names)):
                system_shapes.setdefault(system_name, indices)  # a declared size has precedence
    shapes[None] = system_shapes
    connections = [y for x in system.connections for y in _expand_connection(x, shapes, names)]
    system = replace(system, elements=tuple(elements), connections=tuple(connections))
    return replace(system, connectors=tuple(_expand_connectors(system, system_shapes))), system_shapes


_End = tuple[str | None, str, tuple[int, ...]]
"""Element, connector and indices."""


def _split_ends(connection: SsdConnection) -> tuple[_End, _End]:
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
    """Yield a connector for each element of an array, unless it is declared itself; others unchanged."""
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
    label, ends = f"{connection.location}: the connection {connection}", _split_ends(connection)
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
            difference = (
                ", an array with a single value; select an element by startIndices or endIndices (SSP 2.0)"
            )
        else:
            difference = "" if len(selected[0]) != len(selected[1]) else " with other indices"
        raise CommandError(f"{label} joins {sizes}{difference}.")
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
