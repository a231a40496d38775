"""Shapes of array connectors: those of FMUs' variables, and what documents declare."""

import math
from collections.abc import Collection, Iterator

from ...base.errors import CommandError
from ...base.wording import format_count
from ...fmu.elements import list_indices
from ...fmu.interface import Interface
from ...fmu.parameters.parameter_sets import SsvParameter
from ...system.vectors import find_indices, find_sizes, sort_indices
from ..documents.ssd_data import Connector, Element

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
    for dimension in connector.dimensions:
        if dimension.connector is not None and dimension.connector not in names:
            raise _make_fault(
                connector,
                f"the size of {element.name}.{connector.name} is that of the connector "
                f"'{dimension.connector}', which does not exist",
            )


def _make_fault(connector: Connector, text: str) -> CommandError:
    return CommandError(f"{connector.location}: {text}.")
