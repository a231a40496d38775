"""Conversion of a system of FMUs to the elements of an SSP."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from ...base.errors import CommandError
from ...base.units import IDENTITY, SiUnit
from ...fmu.interface import KINDS, Interface
from ...system.model import Component, Connection, System
from ..documents import ssd_data as ssp
from .coordinates import add_coordinates

_LETTERS = "A-Z_a-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u3001-\ud7ff"
"""The characters that an XML id can begin with, for a set of a regular expression."""


@dataclass(frozen=True)
class StructurePart:
    """The FMU of a component.

    Attributes:
        interface: The model description.
        source: The URI in the package.
        bindings: The parameter bindings.
    """

    interface: Interface
    source: str
    bindings: tuple[ssp.ParameterBinding, ...]


@dataclass(frozen=True)
class _ComponentPlace:
    """A component and its path: the names of its elements from the root inwards."""

    path: tuple[str, ...]
    component: Component


@dataclass(frozen=True)
class _PlacedConnection:
    """A connection with the paths of its ends."""

    source: tuple[str, ...]
    target: tuple[str, ...]
    connection: Connection


def order_system(system: System, nested: bool) -> System:
    """Return the system with components and connections in the order of the structure.

    Args:
        system: The system.
        nested: Whether the dots in component names create nested systems.
    """
    if not nested:
        return system
    first: dict[tuple[str, ...], int] = {}
    paths = {c.name: tuple(c.name.split(".")) for c in system.components}
    for number, path in enumerate(paths.values()):
        for depth in range(len(path)):
            first.setdefault(path[: depth + 1], number)

    def place(path: tuple[str, ...]) -> list[int]:
        return [first[path[: depth + 1]] for depth in range(len(path))]

    return replace(
        system,
        components=tuple(sorted(system.components, key=lambda c: place(paths[c.name]))),
        connections=tuple(sorted(system.connections, key=lambda x: place(paths[x.target][:-1]))),
    )


def build_root_system(
    name: str, system: System, parts: Mapping[str, StructurePart], nested: bool
) -> ssp.SystemElement:
    """Return the root system of a resolved system.

    In a flat structure, `lift.plant` is an element `lift_plant` with the id `lift.plant`; it keeps its name
    if that is not a valid id. In a nested structure, it is `plant` in a system `lift` with connectors for its
    connections.

    Args:
        name: The name of the root system.
        system: The resolved system.
        parts: The FMUs by component.
        nested: Whether the structure is nested.

    Raises:
        CommandError: If component names do not fit the structure.
    """
    paths = {c.name: tuple(c.name.split(".")) if nested else (_make_id(c.name),) for c in system.components}
    if len(set(paths.values())) < len(paths):
        raise CommandError(
            "two components have names that differ only in dots and underscores; export --nested."
        )
    _check_levels(paths.values())
    places = [_ComponentPlace(paths[c.name], c) for c in system.components]
    wires = [_PlacedConnection(paths[x.source], paths[x.target], x) for x in system.connections]
    return _Builder(parts).system(name, (), places, wires)


def _check_levels(paths: Iterable[tuple[str, ...]]) -> None:
    """Raise CommandError for elements with an empty name, or that are both a component and a system."""
    inner = {path[:depth]: path for path in paths for depth in range(1, len(path))}
    for path in paths:
        if "" in path:
            raise CommandError(
                f"the name of '{'.'.join(path)}' has an empty part before or after a dot; "
                "export without --nested."
            )
        if path in inner:
            outside, inside = ".".join(path), ".".join(inner[path])
            raise CommandError(f"'{inside}' is inside of the component '{outside}'; export without --nested.")


class _Builder:
    def __init__(self, parts: Mapping[str, StructurePart]) -> None:
        self._parts = parts
        self._units = select_unambiguous(
            p.interface.unit(v) for p in parts.values() for v in p.interface.variables
        )

    def _connector(self, name: str, kind: str, component: str, variable: str) -> ssp.Connector:
        """Return a connector for a variable, with its unit if the document can define the unit.

        Enumerations have no type here, because the document would have to define them.
        """
        interface = self._parts[component].interface
        type_, unit = str(interface.variables[variable].type), interface.unit(variable)
        return ssp.Connector(
            name, kind, None if type_ == "Enumeration" else type_, unit if unit in self._units else None
        )

    def system(
        self,
        name: str,
        path: tuple[str, ...],
        places: Sequence[_ComponentPlace],
        wires: Sequence[_PlacedConnection],
    ) -> ssp.SystemElement:
        """Return the system at a path, with its components and the connections inside it or to it."""
        depth = len(path)
        members: dict[tuple[str, ...], list[_ComponentPlace]] = {}
        for place in places:
            members.setdefault(place.path[: depth + 1], []).append(place)
        touching: dict[tuple[str, ...], list[_PlacedConnection]] = {}
        for wire in wires:
            for inside in dict.fromkeys((wire.source[: depth + 1], wire.target[: depth + 1])):
                touching.setdefault(inside, []).append(wire)
        elements = [self._element(inside, m, touching.get(inside, ())) for inside, m in members.items()]
        connections = dict.fromkeys(c for w in wires for c in self._connections(path, w))
        own = {c.name: c for w in wires for c in self._own_connectors(path, w)}
        return add_coordinates(
            ssp.SystemElement(
                name, tuple(own.values()), elements=tuple(elements), connections=tuple(connections)
            )
        )

    def _element(
        self, path: tuple[str, ...], places: Sequence[_ComponentPlace], wires: Sequence[_PlacedConnection]
    ) -> ssp.Element:
        """Return the element at a path: a component or a system."""
        if places[0].path == path:
            return self._component(places[0], wires)
        return self.system(path[-1], path, places, wires)

    def _component(self, place: _ComponentPlace, wires: Sequence[_PlacedConnection]) -> ssp.ComponentElement:
        part = self._parts[place.component.name]
        outputs = {w.connection.output for w in wires if w.source == place.path}
        inputs = {w.connection.input for w in wires if w.target == place.path}
        connectors = [
            self._connector(v, kind, place.component.name, v)
            for kind, used in (("input", inputs), ("output", outputs))
            for v in part.interface.variables
            if v in used
        ]
        (name,) = place.path[-1:]
        shortened = place.component.name != name and len(place.path) == 1
        return ssp.ComponentElement(
            name,
            tuple(connectors),
            part.bindings,
            id=place.component.name if shortened else None,
            source=part.source,
            implementation=KINDS.get(place.component.kind, "any"),
        )

    def _connections(self, path: tuple[str, ...], wire: _PlacedConnection) -> list[ssp.SsdConnection]:
        """Return the part of a connection between the elements of the system at a path, or to its border."""
        depth = len(path)
        leaves, arrives = wire.source[:depth] == path, wire.target[:depth] == path
        start_element, start = self._end(depth, wire.source, wire.connection.output, leaves, wire)
        end_element, end = self._end(depth, wire.target, wire.connection.input, arrives, wire)
        if leaves and arrives:
            if start_element == end_element and len(wire.source) > depth + 1:
                return []  # inside the element
            return [
                self._transformed(ssp.SsdConnection(start_element, start, end_element, end), wire.connection)
            ]
        return [ssp.SsdConnection(start_element, start, end_element, end)]

    def _end(
        self, depth: int, place: tuple[str, ...], variable: str, inside: bool, wire: _PlacedConnection
    ) -> tuple[str | None, str]:
        if not inside:  # the border's connector has the name of the inner end
            other, name = (
                (wire.target, wire.connection.input)
                if place == wire.source
                else (wire.source, wire.connection.output)
            )
            return None, ".".join((*other[depth:], name))
        return place[depth], ".".join((*place[depth + 1 :], variable))

    def _own_connectors(self, path: tuple[str, ...], wire: _PlacedConnection) -> list[ssp.Connector]:
        depth, x = len(path), wire.connection
        if wire.source[:depth] != path:
            name = ".".join((*wire.target[depth:], x.input))
            return [self._connector(name, "input", x.target, x.input)]
        if wire.target[:depth] != path:
            name = ".".join((*wire.source[depth:], x.output))
            return [self._connector(name, "output", x.source, x.output)]
        return []

    def _transformed(self, plain: ssp.SsdConnection, connection: Connection) -> ssp.SsdConnection:
        """Return the connection with an explicit transformation, for tools that do not convert units."""
        source = self._parts[connection.source].interface.unit(connection.output)
        target = self._parts[connection.target].interface.unit(connection.input)
        transformation = connection.transformation or IDENTITY
        if transformation != IDENTITY:
            return replace(plain, transformation=transformation, suppress_unit_conversion=True)
        return replace(plain, suppress_unit_conversion=not _same(source, target))


def _same(source: SiUnit | None, target: SiUnit | None) -> bool:
    return source is None or target is None or source.measures_as(target)


def select_unambiguous(units: Iterable[SiUnit | None]) -> set[SiUnit]:
    """Return the units that a document can define: those with a unique name and known exponents."""
    named: dict[str, set[SiUnit]] = {}
    for unit in units:
        if unit is not None:
            named.setdefault(unit.name, set()).add(unit)
    return {u for same in named.values() if len(same) == 1 for u in same if u.exponents is not None}


def _make_id(name: str) -> str:
    """Return a name without dots, if a valid id can preserve them."""
    is_id = re.fullmatch(f"[{_LETTERS}][{_LETTERS}0-9.-]*", name) is not None
    return name.replace(".", "_") if is_id else name
