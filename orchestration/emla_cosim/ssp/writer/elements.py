"""Conversion of a system of FMUs to the elements of an SSP."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ...base.units import IDENTITY, SiUnit
from ...fmu.interface import KINDS, Interface
from ...fmu.parameters.ssp_xml import VERSION_1, VERSION_2
from ...system.model import Component, Connection, System
from ..documents import ssd_data as ssp
from ..documents.identifiers import format_id, make_identifiers
from .layout import add_coordinates
from .version_2 import join_arrays

_UNTYPED = ("Enumeration", "Clock")
"""Types that a connector does not name."""


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


def build_root_system(
    name: str, system: System, parts: Mapping[str, StructurePart], version: str = VERSION_1
) -> ssp.SystemElement:
    """Return the root system of a resolved system: one element per component, with an identifier as name.

    Args:
        name: The name of the root system.
        system: The resolved system.
        parts: The FMUs by component.
        version: The version of SSP; arrays are connectors with 2.0 only.
    """
    builder = _Builder(system, parts)
    root = builder.root(name)
    if version == VERSION_2:
        root = join_arrays(root, builder.interfaces)
    return add_coordinates(root)


class _Builder:
    def __init__(self, system: System, parts: Mapping[str, StructurePart]) -> None:
        self._system = system
        self._parts = parts
        self._names = make_identifiers(c.name for c in system.components)
        self._units = select_unambiguous(
            p.interface.unit(v) for p in parts.values() for v in p.interface.variables
        )

    @property
    def interfaces(self) -> dict[str, Interface]:
        """Model descriptions by element."""
        return {self._names[name]: part.interface for name, part in self._parts.items()}

    def root(self, name: str) -> ssp.SystemElement:
        """Return the root system."""
        elements = tuple(self._make_element(c) for c in self._system.components)
        connections = tuple(dict.fromkeys(self._make_connection(x) for x in self._system.connections))
        return ssp.SystemElement(name, elements=elements, connections=connections)

    def _make_element(self, component: Component) -> ssp.ComponentElement:
        part, wires = self._parts[component.name], self._system.connections
        used = {
            "input": {x.input for x in wires if x.target == component.name},
            "output": {x.output for x in wires if x.source == component.name},
        }
        connectors = tuple(
            self._make_connector(part.interface, kind, variable)
            for kind, names in used.items()
            for variable in part.interface.variables
            if variable in names
        )
        name = self._names[component.name]
        id_ = format_id(name, component.name)
        kind = KINDS.get(component.kind, "any")
        return ssp.ComponentElement(
            name, connectors, part.bindings, id=id_, source=part.source, implementation=kind
        )

    def _make_connector(self, interface: Interface, kind: str, variable: str) -> ssp.Connector:
        """Return a connector for a variable, with its unit if the document can define the unit.

        Enumerations have no type here, because the document would have to define them. SSP 1.0 has no
        Clocks.
        """
        type_, unit = str(interface.variables[variable].type), interface.unit(variable)
        return ssp.Connector(
            variable, kind, None if type_ in _UNTYPED else type_, unit if unit in self._units else None
        )

    def _make_connection(self, connection: Connection) -> ssp.SsdConnection:
        """Return a connection with an explicit transformation, for tools that do not convert units."""
        source, target = self._names[connection.source], self._names[connection.target]
        source_unit, target_unit = (
            self._parts[component].interface.unit(name) for component, name in connection.ends
        )
        converts = not (source_unit is None or target_unit is None or source_unit.measures_as(target_unit))
        # with a transformation, tools must not convert units once more
        explicit = None if connection.transformation == IDENTITY else connection.transformation
        return ssp.SsdConnection(
            source, connection.output, target, connection.input, explicit, converts or explicit is not None
        )


def select_unambiguous(units: Iterable[SiUnit | None]) -> set[SiUnit]:
    """Return the units that a document can define: those with a unique name and known exponents."""
    by_name: dict[str, set[SiUnit]] = {}
    for unit in units:
        if unit is not None:
            by_name.setdefault(unit.name, set()).add(unit)
    return {u for same in by_name.values() if len(same) == 1 for u in same if u.exponents is not None}
