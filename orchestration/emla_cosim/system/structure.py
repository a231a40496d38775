"""Arrays in a system: structural parameters of its components, and connections of vectors and matrices."""

import itertools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..base.errors import CommandError
from ..base.wording import format_count
from ..fmu.elements import ElementVariable
from ..fmu.interface import Interface, read_interface, read_interfaces
from ..fmu.variables import convert_structure
from .model import Component, Connection, System, Value
from .names import Names
from .resolution import convert_to_fmu_terms


def find_changed_sizes(component: Component, interface: Interface) -> dict[str, int]:
    """Return the values of a component's structural parameters that differ from their start values.

    Raises:
        CommandError: If one does not accept its value.
    """
    return convert_structure(component.name, interface, convert_to_fmu_terms(component).parameters)


def read_sized_interfaces(system: System, fmus: Mapping[str, Path]) -> dict[str, Interface]:
    """Return the model descriptions by component, with the sizes that follow from structural parameters.

    Args:
        system: The system.
        fmus: The FMU files by component.

    Raises:
        CommandError: As for `read_interface`, or if a structural parameter does not accept its value.
    """
    return set_structure(system, fmus, read_interfaces(fmus), {})[1]


def set_structure(
    system: System, fmus: Mapping[str, Path], interfaces: Mapping[str, Interface], values: Mapping[str, Value]
) -> tuple[System, dict[str, Interface]]:
    """Set values of structural parameters, on which names and sizes of arrays depend.

    Args:
        system: The system.
        fmus: The FMU files by component.
        interfaces: The model descriptions by component, with their own sizes.
        values: Start values by full name; only those of structural parameters are set.

    Returns:
        The changed system, and the model descriptions with the sizes that follow.

    Raises:
        CommandError: If a structural parameter does not accept its value, or single elements of an array that
            changes its size are connected already.
    """
    names = Names(system, interfaces)
    sizes: dict[str, Any] = {n: v for n, v in values.items() if names.is_structural(n)}
    changed, sized = system.with_parameters(sizes), dict(interfaces)
    for name, interface in interfaces.items():
        before, after = (find_changed_sizes(s.component(name), interface) for s in (system, changed))
        if before != after:
            _refuse_connected_elements(system, name, interface, {*before, *after})
        if after:
            # the elements of arrays are variables, so other sizes make another description
            sized[name] = read_interface(fmus[name], after)
    return changed, sized


def _refuse_connected_elements(system: System, name: str, interface: Interface, structural: set[str]) -> None:
    """Raise CommandError if arrays that get other sizes are connected element by element.

    Connections of a package were made for the sizes that it has itself; those from texts are made later.
    """
    sized = {
        str(v.name).rpartition("[")[0]
        for v in interface.variables.values()
        if isinstance(v, ElementVariable)
        and any(d.variable is not None and d.variable.name in structural for d in v.dimensions)
    }
    for x in (*system.into(name), *system.out_of(name)):
        for component, variable in x.ends:
            array = variable.rpartition("[")[0]
            if component == name and array in sized and not x.from_text:
                raise CommandError(
                    f"{name}.{min(structural)} cannot change the size of {name}.{array}: "
                    f"its elements are connected one by one, as {x}. Set it where they are connected.",
                    connection=str(x),
                )


def connect_elements(system: System, names: Mapping[str, Collection[str]]) -> System:
    """Return the system with connections of elements in place of connections of vectors and matrices.

    Args:
        system: The system. Only connections written as texts, such as `mass.x -> link.x`, can be of vectors.
        names: The names of variables by component.

    Raises:
        CommandError: If the two ends do not have the same elements.
    """
    if not any(x.from_text for x in system.connections):
        return system
    connections = [
        y for x in system.connections for y in (_expand_connection(x, names) if x.from_text else [x])
    ]
    return replace(system, connections=tuple(connections))


def _expand_connection(connection: Connection, names: Mapping[str, Collection[str]]) -> Iterator[Connection]:
    """Yield the connections of the elements, or the connection itself if it is not of vectors."""
    indices = [find_indices(name, names[component]) for component, name in connection.ends]
    if not (indices[0] and indices[1]):
        yield connection  # not of vectors, or an error that resolving the connection raises
        return
    if indices[0] != indices[1]:
        ends = [
            f"{c}.{n} has {format_count(len(i), 'element')}"
            for (c, n), i in zip(connection.ends, indices, strict=True)
        ]
        differ = "" if len(indices[0]) != len(indices[1]) else " with other indices"
        raise CommandError(
            f"the connection {connection} joins different shapes: {ends[0]}, {ends[1]}{differ}.",
            connection=str(connection),
        )
    for index in indices[0]:
        yield replace(
            connection,
            output=f"{connection.output}{index}",
            input=f"{connection.input}{index}",
            from_text=False,
        )


def find_indices(name: str, names: Collection[str]) -> list[str]:
    """Return the indices of a vector, such as `[1]` or `[1,2]`; empty for a scalar.

    Args:
        name: The name of the vector.
        names: The names of all variables.
    """
    if name in names:
        return []
    return [
        n[len(name) :]
        for n in names
        if n.startswith(f"{name}[") and n.endswith("]") and "." not in n[len(name) :]
    ]


_INDEX = re.compile(r"(\[\d+(,\d+)*\])+")


def sort_indices(indices: Collection[str]) -> list[str]:
    """Return indices such as `[1,2]` in row-major order; unchanged if one is not made of numbers."""
    if not all(_INDEX.fullmatch(index) for index in indices):
        return list(indices)
    return sorted(indices, key=_parse_index)


def find_sizes(indices: Sequence[str]) -> tuple[int, ...]:
    """Return the size of each dimension of an array; empty if indices are missing or not numbers.

    Args:
        indices: The indices of all its elements in row-major order.
    """
    if not indices or not all(_INDEX.fullmatch(index) for index in indices):
        return ()
    # -1, so that indices of different lengths do not make a full array
    axes = [sorted(set(axis)) for axis in itertools.zip_longest(*map(_parse_index, indices), fillvalue=-1)]
    is_full = list(itertools.product(*axes)) == [_parse_index(index) for index in indices]
    return tuple(map(len, axes)) if is_full else ()


def _parse_index(index: str) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", index)))
