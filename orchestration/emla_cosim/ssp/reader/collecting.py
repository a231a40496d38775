"""Collection and checks of all connectors and connections of a structure."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...base.errors import CommandError, join_names
from ...base.faults import accept_if_lenient
from ...fmu.elements import declared_type
from ...fmu.interface import Interface
from ..documents.ssd_data import (
    ComponentElement,
    Connector,
    DictionaryReference,
    Element,
    SsdConnection,
    SystemElement,
)
from .wiring import Fmu, Node, Path_, Wiring, node_name

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
    _Elements(wiring, interface).add(root, ())
    _Level(wiring, root, (), {}).connect()
    return wiring


class _Elements:
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


class _Level:
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
                _Level(self._wiring, element, (*self._path, name), self._dictionaries).connect()

    def _find_direction(self, connection: SsdConnection) -> tuple[Node, Node]:
        """Return source and target of a connection; the start need not be the source."""
        start = self._find_end(connection, connection.start_element, connection.start_connector)
        end = self._find_end(connection, connection.end_element, connection.end_connector)
        if start.is_source and end.is_target:
            return start.node, end.node
        if end.is_source and start.is_target:
            return end.node, start.node
        raise self._fault(connection, "does not lead from an output to an input")

    def _find_end(self, connection: SsdConnection, element: str | None, name: str) -> _ConnectionEnd:
        if element is not None and element not in self._elements:
            has = join_names(self._elements) if self._elements else "none"
            text = f"names the element '{element}'; the system '{self._system.name}' has {has}"
            raise self._fault(connection, text)
        owner, connectors = self._owners[element], self._connectors[element]
        if name not in connectors:
            has = join_names(connectors) if connectors else "none"
            raise self._fault(connection, f"names the connector '{name}'; '{owner.name}' has {has}")
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
                raise self._fault(
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

    def _fault(self, connection: SsdConnection, text: str) -> CommandError:
        return self._wiring.fault(f"the connection {connection} {text}.", connection.location)
