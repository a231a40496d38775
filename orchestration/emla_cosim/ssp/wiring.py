"""The connections of nested systems: from every input of an FMU back to where its values come from."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import CommandError, listed
from ..fmu.interface import Interface, read_interface
from ..units import IDENTITY, LinearTransformation, Unit, conversion
from .structure import (
    Component,
    Connection,
    Connector,
    DictionaryReference,
    Element,
    SystemElement,
    TableTransformation,
)

Path_ = tuple[str, ...]
Node = tuple[Path_, str]
"""A connector: names of the elements from the root system inwards, and its own name."""

_GIVES = ("output", "calculatedParameter")
_TAKES = ("input", "parameter", "structuralParameter")


@dataclass(frozen=True)
class Fmu:
    """A component of the flat system."""

    path: Path_
    component: Component
    interface: Interface


@dataclass
class Wiring:
    """All connectors of a structure and who drives whom."""

    where: str
    fmus: dict[Path_, Fmu] = field(default_factory=dict)
    connectors: dict[Node, Connector] = field(default_factory=dict)
    drivers: dict[Node, tuple[Node, Connection]] = field(default_factory=dict)

    def fault(self, text: str) -> CommandError:
        """What is wrong with the structure."""
        return CommandError(f"'{self.where}': {text}")

    def unit(self, node: Node) -> Unit | None:
        """The unit of a connector: the one it declares, or that of the FMU's variable."""
        declared = self.connectors[node].unit if node in self.connectors else None
        return declared if declared is not None else self.fmu_unit(node)

    def fmu_unit(self, node: Node) -> Unit | None:
        """The unit of the FMU's variable behind a connector, if there is one."""
        path, name = node
        fmu = self.fmus.get(path)
        return fmu.interface.unit(name) if fmu is not None and name in fmu.interface.variables else None

    def chain(self, node: Node) -> Iterator[Node]:
        """A connector, what drives it, what drives that, and so on; CommandError if it goes in a circle."""
        seen = set()
        while True:
            yield node
            seen.add(node)
            if node not in self.drivers:
                return
            node = self.drivers[node][0]
            if node in seen:
                raise self.fault(f"the connections of {_text(node)} go in a circle.")

    def arriving(self, node: Node, origin: Node) -> LinearTransformation:
        """What makes the values of a variable of the values at `origin`, which is in its chain.

        At both ends values are in the unit of the FMU's variable, or of the connector if it has none.
        """
        nodes = list(self.chain(node))
        nodes = nodes[: nodes.index(origin) + 1]
        unit, total = self.unit(origin), IDENTITY
        if origin != node:
            total = self._converted(self.fmu_unit(origin), unit, origin)
        for target in reversed(nodes[:-1]):
            total, unit = self._passed(total, unit, target)
        return self._converted(unit, self.fmu_unit(node), node).after(total)

    def _passed(
        self, total: LinearTransformation, unit: Unit | None, target: Node
    ) -> tuple[LinearTransformation, Unit | None]:
        """What arrives at a connector through the connection that drives it."""
        _, connection = self.drivers[target]
        declared = self.unit(target)
        transformation = connection.transformation or IDENTITY
        if isinstance(transformation, TableTransformation):
            raise self.fault(
                f"the connection {connection} has a {transformation.kind}MappingTransformation; "
                "this master connects Reals."
            )
        if connection.suppress_unit_conversion:
            return transformation.after(total), declared
        converted = self._converted(unit, declared, target, connection)
        return transformation.after(converted.after(total)), declared if declared is not None else unit

    def _converted(
        self, source: Unit | None, target: Unit | None, node: Node, connection: Connection | None = None
    ) -> LinearTransformation:
        try:
            return conversion(source, target)
        except ValueError as error:
            if connection is not None:
                raise self.fault(f"the connection {connection} joins {error}.") from error
            raise self.fault(f"the connector and the variable of {_text(node)} have {error}.") from error


def wiring(root: SystemElement, where: str) -> Wiring:
    """Collect and check all elements and connections of a loaded structure.

    `where` is its name in messages. Raises CommandError for connectors and connections that do not fit.
    """
    result = Wiring(where)
    interfaces: dict[str, Interface] = {}
    _collect(result, root, (), interfaces)
    _connect(result, root, (), {})
    return result


def _collect(result: Wiring, element: Element, path: Path_, interfaces: dict[str, Interface]) -> None:
    if isinstance(element, Component):
        if element.source not in interfaces:
            interfaces[element.source] = read_interface(Path(element.source))
        result.fmus[path] = Fmu(path, element, interfaces[element.source])
    for connector in element.connectors:
        if (path, connector.name) in result.connectors:
            raise result.fault(f"there is a second connector {_text((path, connector.name))}.")
        result.connectors[path, connector.name] = connector
        if isinstance(element, Component):
            _check_variable(result, path, connector)
    if isinstance(element, SystemElement):
        for inside in element.elements:
            _collect(result, inside, (*path, inside.name), interfaces)


def _check_variable(result: Wiring, path: Path_, connector: Connector) -> None:
    fmu = result.fmus[path]
    variable = fmu.interface.variables.get(connector.name)
    name = _text((path, connector.name))
    if variable is None:
        raise result.fault(
            f"the connector {name} has no variable in the FMU '{Path(fmu.component.source).name}'."
        )
    if variable.causality != connector.kind and connector.kind in (*_GIVES, *_TAKES):
        raise result.fault(
            f"the connector {name} is of kind {connector.kind}, but the variable's causality is "
            f"{variable.causality}."
        )
    if connector.type not in (None, variable.type, *(("Float64",) if variable.type == "Real" else ())):
        raise result.fault(
            f"the connector {name} is of type {connector.type}, but the variable is of type {variable.type}."
        )


def _connect(result: Wiring, system: SystemElement, path: Path_, known: Mapping[str, Path_]) -> None:
    """Add the connections of a system and of those inside; `known` are signal dictionaries by name."""
    dictionaries = {**known, **{name: (*path, f"#{name}") for name in system.dictionaries}}
    elements = {e.name: e for e in system.elements}
    for connection in system.connections:
        ends = [
            _end(result, system, elements, path, dictionaries, element, name, connection)
            for element, name in (
                (connection.start_element, connection.start_connector),
                (connection.end_element, connection.end_connector),
            )
        ]
        source, target = _directed(result, connection, *ends)
        if target in result.drivers:
            other = result.drivers[target][1]
            raise result.fault(f"{_text(target)} is driven by two connections, {other} and {connection}.")
        result.drivers[target] = source, connection
    for element in system.elements:
        if isinstance(element, SystemElement):
            _connect(result, element, (*path, element.name), dictionaries)


@dataclass(frozen=True)
class _End:
    node: Node
    gives: bool
    takes: bool


def _end(
    result: Wiring,
    system: SystemElement,
    elements: Mapping[str, Element],
    path: Path_,
    dictionaries: Mapping[str, Path_],
    element: str | None,
    name: str,
    connection: Connection,
) -> _End:
    """One end of a connection, and whether it gives or takes values there."""
    if element is not None and element not in elements:
        raise result.fault(
            f"the connection {connection} names the element '{element}'; the system "
            f"'{system.name}' has {listed(elements) if elements else 'none'}."
        )
    owner = system if element is None else elements[element]
    names = [c.name for c in owner.connectors]
    if name not in names:
        has = listed(names) if names else "no connectors"
        raise result.fault(
            f"the connection {connection} names the connector '{name}'; '{owner.name}' has {has}."
        )
    kind = next(c.kind for c in owner.connectors if c.name == name)
    if isinstance(owner, DictionaryReference):
        if owner.dictionary not in dictionaries:
            raise result.fault(
                f"'{owner.name}' names the signal dictionary '{owner.dictionary}', which there is not."
            )
        return _End((dictionaries[owner.dictionary], name), True, True)
    inward = element is None  # a system's own input gives values to what is inside
    gives, takes = kind in _GIVES, kind in _TAKES
    node = (path if inward else (*path, owner.name), name)
    return _End(node, takes if inward else gives, gives if inward else takes)


def _directed(result: Wiring, connection: Connection, start: _End, end: _End) -> tuple[Node, Node]:
    """Who drives whom: that does not depend on which end is the start."""
    forward, backward = start.gives and end.takes, end.gives and start.takes
    if forward:
        return start.node, end.node
    if backward:
        return end.node, start.node
    raise result.fault(f"the connection {connection} does not lead from an output to an input.")


def _text(node: Node) -> str:
    path, name = node
    return ".".join((*path, name))
