"""Collection and checks of connectors and connections, and the source of each input of an FMU."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from ...base.errors import CommandError, join_names
from ...base.faults import accept_if_lenient, convert_documents_units
from ...base.units import IDENTITY, LinearTransformation, SiUnit
from ...fmu.elements import declared_type
from ...fmu.interface import Interface
from ..documents.ssd_data import (
    ComponentElement,
    Connector,
    DictionaryReference,
    Element,
    SsdConnection,
    SystemElement,
    TableTransformation,
)

Path_ = tuple[str, ...]
Node = tuple[Path_, str]
"""A connector: the names of its elements from the root system inwards, and its own name."""


@dataclass(frozen=True)
class Fmu:
    """A component of the flat system."""

    path: Path_
    component: ComponentElement
    interface: Interface


@dataclass
class Wiring:
    """All connectors and connections of a structure.

    Attributes:
        where: The name of the structure in error messages.
        fmus: The components by path.
        connectors: The declared connectors.
        drivers: The source of each connected connector, and the connection.
    """

    where: str
    fmus: dict[Path_, Fmu] = field(default_factory=dict)
    connectors: dict[Node, Connector] = field(default_factory=dict)
    drivers: dict[Node, tuple[Node, SsdConnection]] = field(default_factory=dict)

    def fault(self, text: str, location: str = "") -> CommandError:
        """Return an error about the structure, or about a place in one of its files."""
        location = location or f"'{self.where}'"
        return CommandError(f"{location}: {text}")

    def unit(self, node: Node) -> SiUnit | None:
        """Return the unit of a connector: the declared one, that of the FMU's variable, or of all targets."""
        declared = self.connectors[node].unit if node in self.connectors else None
        if declared is not None:
            return declared
        if node[0] in self.fmus:
            return self.fmu_unit(node)
        inside = (target for target in self._targets_by_source.get(node, ()) if target[0][:-1] == node[0])
        units = {self.unit(target) for target in inside}
        return units.pop() if len(units) == 1 else None

    @cached_property
    def _targets_by_source(self) -> dict[Node, list[Node]]:
        """Return the targets of each connector; valid once all connections are collected."""
        targets: dict[Node, list[Node]] = {}
        for target, (source, _) in self.drivers.items():
            targets.setdefault(source, []).append(target)
        return targets

    def fmu_unit(self, node: Node) -> SiUnit | None:
        """Return the unit of the FMU's variable behind a connector, if there is one."""
        path, name = node
        fmu = self.fmus.get(path)
        return fmu.interface.unit(name) if fmu is not None and name in fmu.interface.variables else None

    def chain(self, node: Node) -> Iterator[Node]:
        """Yield a connector, its source, the source of that, and so on.

        Raises:
            CommandError: If the connections form a loop.
        """
        visited = set()
        while True:
            yield node
            visited.add(node)
            if node not in self.drivers:
                return
            node = self.drivers[node][0]
            if node in visited:
                raise self.fault(f"the connections of {node_name(node)} form a loop.")

    def find_transformation(
        self, node: Node, origin: Node, default_unit: SiUnit | None = None
    ) -> LinearTransformation:
        """Return the transformation from `origin` to a variable behind it.

        At both ends, values have the unit of the FMU's variable, or that of the connector if there is none.

        Args:
            node: The variable.
            origin: A connector in its chain.
            default_unit: The unit at `origin`, if it has none.

        Raises:
            CommandError: If a transformation is not supported, or units do not match.
        """
        nodes = list(self.chain(node))
        nodes = nodes[: nodes.index(origin) + 1]
        ends = self.fmu_unit(origin), self.fmu_unit(node)
        difference = any(end is not None and end.is_difference for end in ends)
        unit, total = self.unit(origin) or default_unit, IDENTITY
        if origin != node:
            total = self._convert_at(ends[0], unit, origin, difference)
        for target in reversed(nodes[:-1]):
            total, unit = self._follow_connection(total, unit, target, difference)
        return self._convert_at(unit, ends[1], node, difference).after(total)

    def _follow_connection(
        self, total: LinearTransformation, unit: SiUnit | None, target: Node, difference: bool
    ) -> tuple[LinearTransformation, SiUnit | None]:
        """Return transformation and unit behind the connection to a connector; see `_convert_at`."""
        _, connection = self.drivers[target]
        declared = self.unit(target)
        transformation = connection.transformation or IDENTITY
        if isinstance(transformation, TableTransformation):
            raise self.fault(
                f"the connection {connection} has a {transformation.kind}MappingTransformation, which this "
                "master does not support."
            )
        if connection.suppress_unit_conversion:  # the transformation has the conversion
            return transformation.after(total), declared
        converted = self._convert_at(unit, declared, target, difference, connection)
        return transformation.after(converted.after(total)), declared if declared is not None else unit

    def _convert_at(
        self,
        source: SiUnit | None,
        target: SiUnit | None,
        node: Node,
        difference: bool,
        connection: SsdConnection | None = None,
    ) -> LinearTransformation:
        """Return the conversion at a connector. Of a `difference`, units of connectors have no offset."""
        try:
            conversion = convert_documents_units(node_name(node), source, target)
            return LinearTransformation(conversion.factor) if difference else conversion
        except ValueError as error:
            if connection is not None:
                raise self.fault(f"the connection {connection} joins {error}.") from error
            raise self.fault(f"the connector and the variable of {node_name(node)} have {error}.") from error


def node_name(node: Node) -> str:
    """Return the name of a connector for error messages."""
    path, name = node
    return ".".join((*path, name))


_SOURCE_KINDS = ("output", "calculatedParameter")
_TARGET_KINDS = ("input", "parameter", "structuralParameter")
_FMI_3_NAMES = {"Real": "Float64", "Integer": "Int32"}
"""Types of FMI 2.0 with another name in FMI 3.0; SSP 2.0 has both."""
_NUMERIC_TYPES = {"Real", "Integer", "Enumeration", "Boolean"}
"""Types whose connectors some tools mix up: the variable's own type decides how values are converted."""


def collect_wiring(
    root: SystemElement, where: str, interface: Callable[[ComponentElement], Interface]
) -> Wiring:
    """Return the wiring of a loaded structure.

    Args:
        root: The root system.
        where: The name of the structure in error messages.
        interface: Returns the interface of a component's FMU.

    Raises:
        CommandError: If connectors or connections do not match.
    """
    wiring = Wiring(where)
    _ElementCollector(wiring, interface).add(root, ())
    _SystemConnections(wiring, root, (), {}).connect()
    return wiring


class _ElementCollector:
    """Adds elements and their connectors to a wiring."""

    def __init__(self, wiring: Wiring, interface: Callable[[ComponentElement], Interface]) -> None:
        self._wiring, self._interface = wiring, interface

    def add(self, element: Element, path: Path_) -> None:
        """Add an element and its content."""
        wiring = self._wiring
        if isinstance(element, ComponentElement):
            wiring.fmus[path] = Fmu(path, element, self._interface(element))
        for connector in element.connectors:
            node = (path, connector.name)
            if node in wiring.connectors:
                raise wiring.fault(f"there is a second connector {node_name(node)}.")
            if isinstance(element, ComponentElement) and not self._has_variable(connector, wiring.fmus[path]):
                continue
            wiring.connectors[node] = connector
        if isinstance(element, SystemElement):
            for inside in element.elements:
                self.add(inside, (*path, inside.name))

    def _has_variable(self, connector: Connector, fmu: Fmu) -> bool:
        """Return whether the FMU has the variable of a connector.

        Raises:
            CommandError: If they differ, or it has none. With `lenient`, another numeric type and a connector
                without a variable are accepted; a connection of such a connector is refused.
        """
        name = f"the connector {node_name((fmu.path, connector.name))}"
        variable = fmu.interface.variables.get(connector.name)
        if variable is None and connector.name in fmu.interface.without_value:
            return True  # a connection of it is refused
        if variable is None:
            fault = f"{name} has no variable in '{Path(fmu.component.source).name}'"
            accept_if_lenient(self._wiring.where, fault, f"{connector.location}: {fault}")
            return False
        if connector.kind in (*_SOURCE_KINDS, *_TARGET_KINDS) and connector.kind != variable.causality:
            raise self._wiring.fault(
                f"{name} is of kind {connector.kind}, but the variable's causality is {variable.causality}.",
                connector.location,
            )
        exact = declared_type(variable)
        if connector.type not in (None, variable.type, exact, _FMI_3_NAMES.get(exact)):
            fault = f"{name} is of type {connector.type}, but the variable is of type {exact}"
            if not {connector.type, variable.type} <= _NUMERIC_TYPES:
                raise self._wiring.fault(f"{fault}.", connector.location)
            accept_if_lenient(self._wiring.where, fault, f"{connector.location}: {fault}")
        return True


@dataclass(frozen=True)
class _ConnectionEnd:
    """One end of a connection: whether it provides or accepts values."""

    node: Node
    is_source: bool
    is_target: bool


class _SystemConnections:
    """The connections of one system; `dictionaries` are the signal dictionaries of outer systems, by name."""

    def __init__(
        self, wiring: Wiring, system: SystemElement, path: Path_, dictionaries: Mapping[str, Path_]
    ) -> None:
        self._wiring, self._system, self._path = wiring, system, path
        self._dictionaries = {**dictionaries, **{n: (*path, f"#{n}") for n in system.dictionaries}}
        self._elements = {e.name: e for e in system.elements}
        self._owners: dict[str | None, Element] = {None: system, **self._elements}
        self._connectors = {n: {c.name: c for c in o.connectors} for n, o in self._owners.items()}

    def connect(self) -> None:
        """Add the connections of the system and of inner systems."""
        drivers = self._wiring.drivers
        for connection in self._system.connections:
            source, target = self._find_direction(connection)
            if target in drivers:
                drivers_text = f"{drivers[target][1]} and {connection}"
                raise self._wiring.fault(
                    f"{node_name(target)} is driven by two connections, {drivers_text}.", connection.location
                )
            drivers[target] = source, connection
        for name, element in self._elements.items():
            if isinstance(element, SystemElement):
                _SystemConnections(self._wiring, element, (*self._path, name), self._dictionaries).connect()

    def _find_direction(self, connection: SsdConnection) -> tuple[Node, Node]:
        """Return source and target of a connection; the start need not be the source."""
        start = self._find_end(connection, connection.start_element, connection.start_connector)
        end = self._find_end(connection, connection.end_element, connection.end_connector)
        if start.is_source and end.is_target:
            return start.node, end.node
        if end.is_source and start.is_target:
            return end.node, start.node
        raise self._make_fault(connection, "does not lead from an output to an input")

    def _find_end(self, connection: SsdConnection, element: str | None, name: str) -> _ConnectionEnd:
        """Return an end of a connection. Raise CommandError if it does not exist or cannot be connected."""
        if element is not None and element not in self._elements:
            has = join_names(self._elements) if self._elements else "none"
            text = f"names the element '{element}'; the system '{self._system.name}' has {has}"
            raise self._make_fault(connection, text)
        owner, connectors = self._owners[element], self._connectors[element]
        if name not in connectors:
            has = join_names(connectors) if connectors else "none"
            raise self._make_fault(connection, f"names the connector '{name}'; '{owner.name}' has {has}")
        if isinstance(owner, DictionaryReference):
            if owner.dictionary not in self._dictionaries:
                raise self._wiring.fault(
                    f"'{owner.name}' names the signal dictionary '{owner.dictionary}', which is missing."
                )
            # all references to a dictionary share its signals
            node = self._dictionaries[owner.dictionary], name
            self._share_connector(node, connectors[name])
            return _ConnectionEnd(node, is_source=True, is_target=True)
        if isinstance(owner, ComponentElement):
            interface = self._wiring.fmus[(*self._path, owner.name)].interface
            if name in interface.without_value and name not in interface.variables:
                kind = interface.without_value[name]
                raise self._make_fault(
                    connection,
                    f"joins '{owner.name}.{name}' of the type {kind}, which this master does not connect",
                )
        kind = connectors[name].kind
        is_source, is_target = kind in _SOURCE_KINDS, kind in _TARGET_KINDS
        if element is None:  # inputs of a system are sources inside of it
            return _ConnectionEnd((self._path, name), is_source=is_target, is_target=is_source)
        return _ConnectionEnd(((*self._path, element), name), is_source, is_target)

    def _share_connector(self, node: Node, connector: Connector) -> None:
        """Use one connector for all references to a signal of a dictionary, and check that units agree."""
        shared = self._wiring.connectors.setdefault(node, connector)
        if shared.unit is None:
            self._wiring.connectors[node] = connector
        elif connector.unit not in (None, shared.unit):
            raise self._wiring.fault(
                f"the signal '{node[1]}' has the unit {shared.unit} in one reference and {connector.unit} "
                "in another one."
            )

    def _make_fault(self, connection: SsdConnection, text: str) -> CommandError:
        return self._wiring.fault(f"the connection {connection} {text}.", connection.location)
