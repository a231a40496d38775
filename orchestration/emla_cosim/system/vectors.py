"""Connections of vectors and matrices: one for each pair of elements."""

import itertools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from ..base.errors import CommandError
from ..base.wording import format_count
from .model import Connection, System


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
    connections = [y for x in system.connections for y in (_expand(x, names) if x.from_text else [x])]
    return replace(system, connections=tuple(connections))


def _expand(connection: Connection, names: Mapping[str, Collection[str]]) -> Iterator[Connection]:
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
