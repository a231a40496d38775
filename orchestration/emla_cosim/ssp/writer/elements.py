"""Conversion of a system of FMUs to the elements of an SSP, also those of SSP 2.0."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from fmpy.model_description import ModelVariable

from ...base.errors import CommandError
from ...base.units import IDENTITY, SiUnit
from ...fmu.elements import declared_type, list_indices
from ...fmu.interface import KINDS, Interface
from ...fmu.parameters.parameter_sets import ParameterArray, SsvParameter
from ...fmu.parameters.ssp_xml import VERSION_1, VERSION_2
from ...fmu.variables import convert_start_value
from ...system.model import Component, Connection, System
from ..diagram import add_coordinates
from ..documents import ssd_data as ssp
from ..documents.ssd_data import (
    Connector,
    Dimension,
    SsdConnection,
    SystemElement,
    format_id,
    make_identifiers,
)

_IN_VERSION_1 = ("Real", "Integer", "Boolean", "String", "Enumeration", "Float64", "Int32")
"""Types of variables whose values SSP 1.0 can have, by its own names or as Real and Integer."""


def select_version(system: System, interfaces: Mapping[str, Interface]) -> str:
    """Return the oldest version of SSP that has what connections and start values of a system need.

    Args:
        system: The resolved system.
        interfaces: The model descriptions by component.
    """
    ends = [end for x in system.connections for end in x.ends]
    ends += [(c.name, name) for c in system.components for name in c.parameters]
    variables = (interfaces[component].variables.get(name) for component, name in ends)
    is_new = (v is not None and (_find_array(v) or declared_type(v) not in _IN_VERSION_1) for v in variables)
    return VERSION_2 if any(is_new) else VERSION_1


def _find_array(variable: ModelVariable) -> ParameterArray | None:
    """Return the array of an element with FMI 3.0; None for a scalar, and for variables of FMI 2.0."""
    if not variable.shape:
        return None
    return ParameterArray(str(variable.name).rpartition("[")[0], tuple(variable.shape))


def join_arrays(root: SystemElement, interfaces: Mapping[str, Interface]) -> SystemElement:
    """Return a flat system with the types and arrays of FMI 3.0 in place of general types and elements.

    All elements of an array that are connected in the same way to one of the same shape are one connection.

    Args:
        root: The system, with a connector for each element.
        interfaces: The model descriptions by element.
    """
    arrays: dict[tuple[str, str], tuple[ParameterArray, tuple[int, ...]]] = {}
    elements = []
    for element in root.elements:
        interface = interfaces[element.name]
        connectors: dict[str, Connector] = {}
        for connector in element.connectors:
            variable = interface.variables[connector.name]
            # a connector without a type, such as an Enumeration, stays without one
            typed = replace(connector, type=connector.type and declared_type(variable))
            array = _find_array(variable)
            if array is None:
                connectors[connector.name] = typed
                continue
            dimensions = tuple(Dimension(size) for size in array.sizes)
            connectors[array.name] = replace(typed, name=array.name, dimensions=dimensions)
            index = connector.name[len(array.name) + 1 : -1]
            arrays[element.name, connector.name] = array, tuple(map(int, index.split(",")))
        elements.append(replace(element, connectors=tuple(connectors.values())))
    indexed = [_add_indices(x, arrays) for x in root.connections]
    return replace(
        root,
        elements=tuple(elements),
        connections=tuple(_join_connections(indexed, root.connections, arrays)),
    )


_Arrays = Mapping[tuple[str, str], tuple[ParameterArray, tuple[int, ...]]]
"""Array and indices of each element of an array, by element of the system and name."""


def _add_indices(x: SsdConnection, arrays: _Arrays) -> SsdConnection:
    """Return a connection of elements with the names of their arrays, and indices."""
    start = arrays.get((x.start_element or "", x.start_connector))
    end = arrays.get((x.end_element or "", x.end_connector))
    if start is not None:
        x = replace(x, start_connector=start[0].name, start_indices=start[1])
    if end is not None:
        x = replace(x, end_connector=end[0].name, end_indices=end[1])
    return x


def _join_connections(
    indexed: list[SsdConnection], plain: Iterable[SsdConnection], arrays: _Arrays
) -> Iterator[SsdConnection]:
    """Yield connections of whole arrays in place of those of all their elements."""
    groups: dict[SsdConnection, list[SsdConnection]] = {}
    shapes: dict[SsdConnection, set[tuple[int, ...] | None]] = {}
    for x, old in zip(indexed, plain, strict=True):
        whole_connection = replace(x, start_indices=(), end_indices=())
        ends = ((old.start_element or "", old.start_connector), (old.end_element or "", old.end_connector))
        groups.setdefault(whole_connection, []).append(x)
        shapes[whole_connection] = {arrays[end][0].sizes if end in arrays else None for end in ends}
    for whole_connection, members in groups.items():
        (sizes, *other_sizes) = shapes[whole_connection]
        is_whole = not other_sizes and sizes is not None
        is_whole = is_whole and all(x.start_indices == x.end_indices for x in members)
        if is_whole and sizes is not None and len(members) == len(list(list_indices(sizes))):
            yield whole_connection
        else:
            yield from members


def complete_arrays(
    parameters: Iterable[SsvParameter], component: str, interface: Interface
) -> list[SsvParameter]:
    """Return parameters with the types of FMI 3.0, and all elements of arrays of which one is set.

    The other elements have the start values of the FMU.

    Args:
        parameters: The parameters, by names of variables.
        component: The component, for error messages.
        interface: Its model description.

    Raises:
        CommandError: An element has no start value.
    """
    completed: dict[str, SsvParameter] = {}
    by_name = {p.name: p for p in parameters}
    for parameter in by_name.values():
        variable = interface.variables[parameter.name]
        typed = replace(parameter, type=declared_type(variable))
        array = _find_array(variable)
        if array is None:
            completed[parameter.name] = typed
            continue
        for index in list_indices(array.sizes):
            name = f"{array.name}{index}"
            value = by_name[name].value if name in by_name else _read_start_value(component, interface, name)
            completed[name] = replace(typed, name=name, value=value, array=array)
    return list(completed.values())


def _read_start_value(component: str, interface: Interface, name: str) -> float | int | bool | str:
    """Return the start value in the FMU. Raise CommandError without one."""
    variable = interface.variables[name]
    if variable.start is None:
        raise CommandError(
            f"{component}.{name} has no start value in the FMU; set it, because a parameter set has all "
            "values of an array."
        )
    return convert_start_value(component, interface, variable, variable.start)


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
