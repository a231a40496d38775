"""The connections of nested systems: from every input of an FMU back to where its values come from."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from ...base.errors import CommandError
from ...base.units import IDENTITY, LinearTransformation, SiUnit, find_conversion
from ...fmu.interface import Interface
from ..documents.ssd_data import (
    ComponentElement,
    Connector,
    SsdConnection,
    TableTransformation,
)

Path_ = tuple[str, ...]
Node = tuple[Path_, str]
"""A connector: names of the elements from the root system inwards, and its own name."""


@dataclass(frozen=True)
class Fmu:
    """A component of the flat system."""

    path: Path_
    component: ComponentElement
    interface: Interface


@dataclass
class Wiring:
    """All connectors of a structure and who drives whom."""

    where: str
    fmus: dict[Path_, Fmu] = field(default_factory=dict)
    connectors: dict[Node, Connector] = field(default_factory=dict)
    drivers: dict[Node, tuple[Node, SsdConnection]] = field(default_factory=dict)

    def fault(self, text: str) -> CommandError:
        """What is wrong with the structure."""
        return CommandError(f"'{self.where}': {text}")

    def unit(self, node: Node) -> SiUnit | None:
        """The unit of a connector: the one it declares, that of the FMU's variable, or of what it drives."""
        declared = self.connectors[node].unit if node in self.connectors else None
        if declared is not None:
            return declared
        return self.fmu_unit(node) if node[0] in self.fmus else self._unit_inside(node)

    def _unit_inside(self, node: Node) -> SiUnit | None:
        """The unit of all connectors inside a system that its own connector drives, if it is one."""
        inside = (target for target in self._driven.get(node, ()) if target[0][:-1] == node[0])
        units = {self.unit(target) for target in inside}
        return units.pop() if len(units) == 1 else None

    @cached_property
    def _driven(self) -> dict[Node, list[Node]]:
        """What each connector drives, when all connections are there."""
        found: dict[Node, list[Node]] = {}
        for target, (source, _) in self.drivers.items():
            found.setdefault(source, []).append(target)
        return found

    def fmu_unit(self, node: Node) -> SiUnit | None:
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
                raise self.fault(f"the connections of {node_name(node)} go in a circle.")

    def arriving(self, node: Node, origin: Node, given: SiUnit | None = None) -> LinearTransformation:
        """What makes the values of a variable of the values at `origin`, which is in its chain.

        At both ends values are in the unit of the FMU's variable, or of the connector if it has none.
        `given` is the unit at `origin` where that has none.
        """
        nodes = list(self.chain(node))
        nodes = nodes[: nodes.index(origin) + 1]
        unit, total = self.unit(origin) or given, IDENTITY
        if origin != node:
            total = self._converted(self.fmu_unit(origin), unit, origin)
        for target in reversed(nodes[:-1]):
            total, unit = self._passed(total, unit, target)
        return self._converted(unit, self.fmu_unit(node), node).after(total)

    def _passed(
        self, total: LinearTransformation, unit: SiUnit | None, target: Node
    ) -> tuple[LinearTransformation, SiUnit | None]:
        """What arrives at a connector through the connection that drives it."""
        _, connection = self.drivers[target]
        declared = self.unit(target)
        transformation = connection.transformation or IDENTITY
        if isinstance(transformation, TableTransformation):
            raise self.fault(
                f"the connection {connection} has a {transformation.kind}MappingTransformation, which this "
                "master does not do."
            )
        if connection.suppress_unit_conversion:
            return transformation.after(total), declared
        converted = self._converted(unit, declared, target, connection)
        return transformation.after(converted.after(total)), declared if declared is not None else unit

    def _converted(
        self,
        source: SiUnit | None,
        target: SiUnit | None,
        node: Node,
        connection: SsdConnection | None = None,
    ) -> LinearTransformation:
        try:
            return find_conversion(source, target)
        except ValueError as error:
            if connection is not None:
                raise self.fault(f"the connection {connection} joins {error}.") from error
            raise self.fault(f"the connector and the variable of {node_name(node)} have {error}.") from error


def node_name(node: Node) -> str:
    """A connector in messages."""
    path, name = node
    return ".".join((*path, name))
