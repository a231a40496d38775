"""Values that parameter bindings give to the variables of FMUs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter

from ...base.units import IDENTITY, LinearTransformation, find_conversion
from ...system.model import Value
from ..documents.ssd_data import (
    ComponentElement,
    Element,
    MappingEntry,
    ParameterBinding,
    ParameterSet,
    SsvParameter,
    SystemElement,
    TableTransformation,
)
from .wiring import Node, Path_, Wiring, node_name


@dataclass(frozen=True)
class _GivenValue:
    """A value for a connector or variable; of several, the one with the highest rank counts.

    The rank is the height of the system whose binding it is, and then its place in the file.
    """

    parameter: SsvParameter
    entry: MappingEntry | None
    rank: tuple[int, int]


@dataclass(frozen=True)
class BoundValue:
    """The start value of a variable, in its own unit, and the parameter that it was made of.

    `entry` is the one of the mapping that the FMU's component has for it, if there is one.
    """

    value: Value
    parameter: SsvParameter
    entry: MappingEntry | None


def resolve_bindings(
    root: SystemElement, wiring: Wiring
) -> tuple[dict[Path_, dict[str, BoundValue]], list[str]]:
    """Start values of every FMU by path and variable, and parameters that nobody has.

    A variable that an output drives gets none. Raises CommandError for units that do not fit.
    """
    collected = _CollectedBindings(wiring)
    collected.element(root, ())
    values: dict[Path_, dict[str, BoundValue]] = {path: {} for path in wiring.fmus}
    for path, fmu in wiring.fmus.items():
        for name in filter(fmu.interface.is_settable, fmu.interface.variables):
            chain = list(wiring.chain((path, name)))
            if chain[-1][0] in wiring.fmus and len(chain) > 1:
                continue  # an output drives it
            given = [(collected.given[node], node) for node in chain if node in collected.given]
            if given:
                best, node = max(given, key=lambda g: g[0].rank)
                own = best.entry if best.rank[0] == -len(path) else None
                value = _value(wiring, best, node, (path, name))
                values[path][name] = BoundValue(value, best.parameter, own)
    return values, collected.unused()


class _CollectedBindings:
    """All bindings of a structure, by the connector or variable that they are for."""

    def __init__(self, wiring: Wiring) -> None:
        self._wiring = wiring
        self.given: dict[Node, _GivenValue] = {}
        self._matched: dict[ParameterSet, set[str]] = {}
        self._inside: dict[Path_, dict[str, tuple[int, Element]]] = {}
        self._count = 0

    def element(self, element: Element, path: Path_) -> None:
        """Take the bindings of an element and of all inside; outer ones override inner ones."""
        if isinstance(element, SystemElement):
            for inside in element.elements:
                self.element(inside, (*path, inside.name))
        for binding in element.bindings:
            self._binding(binding, element, path)

    def unused(self) -> list[str]:
        """Parameters that matched nothing, each with its set."""
        return [
            f"{s.name}: {p.name}"
            for s, names in self._matched.items()
            for p in s.parameters
            if p.name not in names
        ]

    def _binding(self, binding: ParameterBinding, element: Element, path: Path_) -> None:
        values = binding.values
        if not isinstance(values, ParameterSet):
            raise TypeError("the structure is not loaded")
        matched = self._matched.setdefault(values, set())
        targets = _targets(binding.mapping)
        for parameter in values.parameters:
            for target, entry in targets(f"{binding.prefix}{parameter.name}"):
                node = self._node(element, path, target)
                if node is not None:
                    matched.add(parameter.name)
                    self._count += 1
                    self.given[node] = _GivenValue(parameter, entry, (-len(path), self._count))

    def _node(self, element: Element, path: Path_, name: str) -> Node | None:
        """What a hierarchical name means, seen from an element."""
        if isinstance(element, ComponentElement):
            interface = self._wiring.fmus[path].interface
            return (path, name) if name in interface.variables and interface.is_settable(name) else None
        if (path, name) in self._wiring.connectors:
            return path, name
        if isinstance(element, SystemElement):
            for inside in self._beginning(element, path, name):
                found = self._node(inside, (*path, inside.name), name.removeprefix(f"{inside.name}."))
                if found is not None:
                    return found
        return None

    def _beginning(self, system: SystemElement, path: Path_, name: str) -> list[Element]:
        """The elements of a system with whose name and a dot a name begins, in order."""
        if path not in self._inside:
            self._inside[path] = {e.name: (i, e) for i, e in enumerate(system.elements)}
        inside = self._inside[path]
        starts = (name[:i] for i, letter in enumerate(name) if letter == ".")
        return [e for _, e in sorted((inside[s] for s in starts if s in inside), key=itemgetter(0))]


def _targets(mapping: object) -> Callable[[str], Sequence[tuple[str, MappingEntry | None]]]:
    """What parameters of a set are called in the element: none of those that a mapping does not have."""
    if not isinstance(mapping, tuple):
        return lambda name: [(name, None)]
    targets: dict[str, list[tuple[str, MappingEntry | None]]] = {}
    for entry in mapping:
        targets.setdefault(entry.source, []).append((entry.target, entry))
    return lambda name: targets.get(name, [])


def _value(wiring: Wiring, given: _GivenValue, node: Node, variable: Node) -> Value:
    """The value for a variable that was given to it, or to a connector in its chain."""
    value = given.parameter.value
    table = given.entry.transformation if given.entry is not None else None
    if isinstance(table, TableTransformation):
        return next((t for s, t in table.entries if s == value and type(s) is type(value)), value)
    if isinstance(value, (bool, str)):
        return value
    total = build_transformation(wiring, given.parameter, given.entry, node, variable)
    return value if total == IDENTITY else total(value)


def build_transformation(
    wiring: Wiring, parameter: SsvParameter, entry: MappingEntry | None, node: Node, variable: Node
) -> LinearTransformation:
    """What makes the value of a variable of a parameter that was given to a node in its chain.

    `entry` is that of the mapping, with no table. Raises CommandError for units that do not fit.
    """
    total, unit = IDENTITY, None
    if entry is None or not entry.suppress_unit_conversion:
        unit = parameter.unit
        try:
            total = find_conversion(unit, wiring.unit(node))
        except ValueError as error:
            raise wiring.fault(
                f"the parameter '{parameter.name}' and {node_name(node)} have {error}."
            ) from error
    if entry is not None and isinstance(entry.transformation, LinearTransformation):
        total = entry.transformation.after(total)
    return wiring.arriving(variable, node, unit).after(total)
