"""Values that parameter bindings assign to variables of FMUs."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import Any

from ...base.faults import convert_documents_units
from ...base.units import IDENTITY, LinearTransformation
from ...fmu.elements import format_index, is_version_3
from ...fmu.parameters.parameter_sets import ParameterSet, SsvParameter
from ...fmu.variables import explain_fixed
from ...system.model import Value
from ..documents.ssd_data import (
    Element,
    MappingEntry,
    ParameterBinding,
    SystemElement,
    TableTransformation,
)
from .shapes import explain_shape
from .wiring import Node, Path_, Wiring, node_name


@dataclass(frozen=True)
class _BindingValue:
    """The last value for a connector or variable; `height` is that of the system with its binding."""

    parameter: SsvParameter
    entry: MappingEntry | None
    height: int


@dataclass(frozen=True)
class BoundValue:
    """The start value of a variable, in the unit of the variable.

    Attributes:
        value: The value.
        parameter: The parameter from which it was computed.
        entry: The entry in the mapping of the FMU's component, if there is one.
    """

    value: Value
    parameter: SsvParameter
    entry: MappingEntry | None


def resolve_bindings(
    root: SystemElement, wiring: Wiring, has_sizes: bool = True
) -> tuple[dict[Path_, dict[str, BoundValue]], list[str]]:
    """Return the start values of each FMU by path and variable, and notes about values without effect.

    A variable that is connected to an output gets no value. Of several values, the one from the highest
    system applies. Among values of one system it is the one at the source of the connections: a variable
    that is connected to a parameter always has its value, as in OMSimulator.

    Args:
        root: The root system.
        wiring: The FMUs, and the connections between them.
        has_sizes: Whether arrays have their sizes already; only then are the shapes of values checked.

    Raises:
        CommandError: If units or shapes do not match.
    """
    collected = _CollectedBindings(wiring, has_sizes)
    collected.add_element(root, ())
    values: dict[Path_, dict[str, BoundValue]] = {path: {} for path in wiring.fmus}
    overridden: list[str] = []
    for path, fmu in wiring.fmus.items():
        for name in fmu.interface.variables:
            if not fmu.interface.is_settable(name):
                continue
            chain = list(wiring.chain((path, name)))
            if chain[-1][0] in wiring.fmus and len(chain) > 1:
                continue  # connected to an output
            candidates = [
                (collected.values_by_node[node], node) for node in chain if node in collected.values_by_node
            ]
            if candidates:
                height = max(g.height for g, _ in candidates)
                highest = [pair for pair in candidates if pair[0].height == height]
                best, node = highest[-1]  # the chain ends at the source
                overridden += [
                    f"{node_name(n)} = {ignored.parameter.value} has no effect: it is connected to "
                    f"{node_name(node)}, which has a value too"
                    for ignored, n in highest[:-1]
                ]
                # other mappings are those of systems around the component
                entry = best.entry if best.height == -len(path) else None
                value = _compute_value(wiring, best, node, (path, name))
                values[path][name] = BoundValue(value, best.parameter, entry)
    return values, [*collected.describe_unused(), *overridden]


class _CollectedBindings:
    """All bindings of a structure, by connector or variable."""

    def __init__(self, wiring: Wiring, has_sizes: bool) -> None:
        self._wiring, self._has_sizes = wiring, has_sizes
        self.values_by_node: dict[Node, _BindingValue] = {}
        self._matched: dict[ParameterSet, set[str]] = {}
        self._reasons: dict[ParameterSet, dict[str, str]] = {}
        self._inside: dict[Path_, dict[str, tuple[int, Element]]] = {}
        self._names: dict[Any, tuple[Collection[str], set[str]]] = {}

    def add_element(self, element: Element, path: Path_) -> None:
        """Add the bindings of an element and its content; outer bindings override inner ones."""
        if isinstance(element, SystemElement):
            for inside in element.elements:
                self.add_element(inside, (*path, inside.name))
        # last, to replace values from inside
        for binding in element.bindings:
            self._add_binding(binding, element, path)

    def describe_unused(self) -> list[str]:
        """Return a note on each parameter that sets no variable, with the name of its set and the reason."""
        return list(
            dict.fromkeys(
                f"{s.name}: {p.document_name} {reasons[p.document_name]}"
                for (s, names), reasons in zip(self._matched.items(), self._reasons.values(), strict=True)
                for p in s.parameters
                if p.name not in names
            )
        )

    def _add_binding(self, binding: ParameterBinding, element: Element, path: Path_) -> None:
        """Store the values of a binding by target, in place of earlier ones, and why others have none."""
        values = binding.values
        assert isinstance(values, ParameterSet)  # the loader has replaced all files
        matched, reasons = self._matched.setdefault(values, set()), self._reasons.setdefault(values, {})
        targets = _index_targets(binding.mapping)
        for parameter in values.parameters:
            index = parameter.name.removeprefix(parameter.document_name)
            # the elements of an array are parameters, but its shape is checked once
            is_first = parameter.array is None or index == format_index([1] * len(parameter.array.sizes))
            name = f"{binding.prefix}{parameter.document_name}"
            reason = "matches no variable"
            if not targets(name):
                reason += ": the mapping leaves it out"
            for array, entry in targets(name):
                node = self._find_node(element, path, f"{array}{index}")
                if self._has_sizes and is_first and (node is None or parameter.array is not None):
                    self._check_shape(element, path, array, parameter)
                if node is not None:
                    matched.add(parameter.name)
                    self.values_by_node[node] = _BindingValue(parameter, entry, -len(path))
                else:
                    reason = self._explain_fixed(element, path, f"{array}{index}") or reason
            reasons.setdefault(parameter.document_name, reason)

    def _explain_fixed(self, element: Element, path: Path_, name: str) -> str | None:
        """Return why the variable of a hierarchical name cannot be set; None if it can, or does not exist."""
        for owner, inside in self._list_owners(element, path, name):
            fmu = self._wiring.fmus.get(owner)
            if fmu is not None and inside in fmu.interface.variables:
                reason = explain_fixed(fmu.interface, inside)
                return None if reason is None else f"does not set {node_name((owner, inside))}: {reason}"
        return None

    def _check_shape(self, element: Element, path: Path_, name: str, parameter: SsvParameter) -> None:
        """Raise CommandError if a parameter does not have the shape of its target, or this is left out."""
        for owner, inside in self._list_owners(element, path, name):
            fmu = self._wiring.fmus.get(owner)
            names, arrays = self._list_names(owner)
            target = node_name((owner, inside))
            if fmu is not None and inside in fmu.interface.without_value:
                raise self._wiring.fault(
                    f"the parameter '{parameter.document_name}' sets {target} of the type "
                    f"{fmu.interface.without_value[inside]}, which this master does not set.",
                    parameter.location,
                )
            if inside not in names and inside not in arrays:
                continue
            is_array = parameter.array is not None or (fmu and is_version_3(fmu.interface.description))
            if is_array and (difference := explain_shape(parameter, inside, names, target)) is not None:
                raise self._wiring.fault(difference, parameter.location)
            return

    def _list_owners(self, element: Element, path: Path_, name: str) -> Iterator[Node]:
        """Yield the elements that can have a connector or variable of a hierarchical name."""
        yield path, name
        if isinstance(element, SystemElement):
            for inside in self._find_elements(element, path, name):
                yield from self._list_owners(
                    inside, (*path, inside.name), name.removeprefix(f"{inside.name}.")
                )

    def _list_names(self, path: Path_) -> tuple[Collection[str], set[str]]:
        """Return the names of the connectors of a system or the variables of an FMU, and of their arrays."""
        fmu = self._wiring.fmus.get(path)
        # many components can have one FMU, and an FMU many variables
        key = path if fmu is None else (fmu.component.source, fmu.component.structure)
        if key not in self._names:
            names: Collection[str] = self._connectors.get(path, {})
            names = names if fmu is None else fmu.interface.variables
            bracket = {n: n.find("[", n.rfind(".") + 1) for n in names if n.endswith("]")}
            self._names[key] = names, {n[:i] for n, i in bracket.items() if i > 0}
        return self._names[key]

    @cached_property
    def _connectors(self) -> dict[Path_, dict[str, None]]:
        """Names of connectors by owner."""
        names: dict[Path_, dict[str, None]] = {}
        for owner, name in self._wiring.connectors:
            names.setdefault(owner, {})[name] = None
        return names

    def _find_node(self, element: Element, path: Path_, name: str) -> Node | None:
        """Return the connector or variable of a hierarchical name, relative to an element."""
        for owner, inside in self._list_owners(element, path, name):
            fmu = self._wiring.fmus.get(owner)
            is_connector = fmu is None and (owner, inside) in self._wiring.connectors
            if is_connector or (
                fmu is not None and inside in fmu.interface.variables and fmu.interface.is_settable(inside)
            ):
                return owner, inside
        return None

    def _find_elements(self, system: SystemElement, path: Path_, name: str) -> list[Element]:
        """Return the elements of a system whose name and a dot begin this name, in order."""
        if path not in self._inside:
            self._inside[path] = {e.name: (i, e) for i, e in enumerate(system.elements)}
        inside = self._inside[path]
        starts = (name[:i] for i, letter in enumerate(name) if letter == ".")
        return [e for _, e in sorted((inside[s] for s in starts if s in inside), key=itemgetter(0))]


def _index_targets(mapping: object) -> Callable[[str], Sequence[tuple[str, MappingEntry | None]]]:
    """Return a function from parameter names to names in the element; a mapping leaves out all others."""
    if not isinstance(mapping, tuple):
        return lambda name: [(name, None)]
    targets: dict[str, list[tuple[str, MappingEntry | None]]] = {}
    for entry in mapping:
        targets.setdefault(entry.source, []).append((entry.target, entry))
    return lambda name: targets.get(name, [])


def _compute_value(wiring: Wiring, bound: _BindingValue, node: Node, variable: Node) -> Value:
    """Return the value of a variable from a value of the variable or of a connector in its chain."""
    value = bound.parameter.value
    table = bound.entry.transformation if bound.entry is not None else None
    if isinstance(table, TableTransformation):
        return next((t for s, t in table.entries if s == value and type(s) is type(value)), value)
    if isinstance(value, (bool, str)):
        return value
    total = build_transformation(wiring, bound.parameter, bound.entry, node, variable)
    return value if total == IDENTITY else total(value)


def build_transformation(
    wiring: Wiring, parameter: SsvParameter, entry: MappingEntry | None, node: Node, variable: Node
) -> LinearTransformation:
    """Return the transformation from a parameter of a node to a variable behind it.

    Args:
        wiring: The connections.
        parameter: The parameter.
        entry: The entry in the mapping, without a table.
        node: A connector in the chain of the variable.
        variable: The variable.

    Raises:
        CommandError: If units do not match.
    """
    total, unit = IDENTITY, None
    if entry is None or not entry.suppress_unit_conversion:
        unit = parameter.unit
        try:
            total = convert_documents_units(node_name(node), unit, wiring.unit(node))
        except ValueError as error:
            raise wiring.fault(
                f"the parameter '{parameter.name}' and {node_name(node)} have {error}."
            ) from error
    if entry is not None and isinstance(entry.transformation, LinearTransformation):
        total = entry.transformation.after(total)
    return wiring.find_transformation(variable, node, unit).after(total)
