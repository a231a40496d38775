"""The connections of nested systems, from each input of an FMU back to its source."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from ...base.errors import CommandError
from ...base.faults import convert_documents_units
from ...base.units import IDENTITY, LinearTransformation, SiUnit
from ...fmu.interface import Interface
from ..documents.ssd_data import ComponentElement, Connector, SsdConnection, TableTransformation

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

    def arriving(self, node: Node, origin: Node, default_unit: SiUnit | None = None) -> LinearTransformation:
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
