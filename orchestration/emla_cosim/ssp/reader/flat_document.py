"""Conversion of an SSP to a flat system of FMUs."""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from ...base.errors import CommandError
from ...base.faults import is_lenient
from ...base.units import IDENTITY, find_conversion
from ...fmu.interface import KINDS, Interface, read_interface
from ...fmu.parameters.parameter_sets import ParameterSet, SsvParameter
from ...fmu.variables import convert_structure
from ...system.model import Alias, Component, Connection, System
from ..documents.ssd_data import (
    ComponentElement,
    Element,
    ParameterBinding,
    Structure,
    SystemElement,
    TableTransformation,
    parse_id,
)
from .binding import BoundValue, build_transformation, resolve_bindings
from .shapes import expand_vectors
from .structure_loader import Package, load_structure, open_package
from .wiring import Fmu, Node, Path_, Wiring, collect_wiring


@dataclass(frozen=True)
class SspDocument:
    """The content of an SSP: the flat system, and how to run it.

    Attributes:
        name: The name of the structure.
        description: Its description.
        system: The flat system.
        start_time: The start time in s, if specified.
        stop_time: The stop time in s, if specified.
        step_size: The step size in s, if specified.
        notes: Messages on content that has no effect.
        unpacked: The temporary folder of the unpacked FMUs; None if nothing was unpacked.
    """

    name: str
    description: str
    system: System
    start_time: float | None
    stop_time: float | None
    step_size: float | None
    notes: list[str]
    unpacked: Path | None


@contextlib.contextmanager
def read_ssp(path: Path) -> Iterator[SspDocument]:
    """Read a package, a folder or an SSD. Unpacked FMUs exist until the end of the block.

    A component has the names of its elements with dots, such as `lift.plant` for `plant` in the system
    `lift`. A top-level element `lift_plant` with the id `lift.plant` is also called `lift.plant`; see
    `identifiers`.

    Raises:
        CommandError: If something is invalid, missing or not supported.
    """
    with contextlib.ExitStack() as stack:
        package = stack.enter_context(open_package(path))
        try:
            document = _make_document(load_structure(package, stack), package)
        except (AttributeError, TypeError, ValueError, KeyError) as error:
            if not is_lenient():  # otherwise a document that violates the schema lacks something
                raise
            raise CommandError(f"'{path}' cannot be read: it violates the schema of SSP.") from error
        yield document


def _make_document(structure: Structure, package: Package) -> SspDocument:
    """Return the flat system of a loaded structure, with notes on content that has no effect."""

    @cache  # many components can have one FMU
    def read(source: str, structure: tuple[tuple[str, int], ...]) -> Interface:
        return read_interface(Path(source), dict(structure))

    def interface(component: ComponentElement) -> Interface:
        return read(component.source, component.structure)

    # sizes first: connectors of arrays become one for each element
    root = _set_structures(structure.system, package.name, interface)
    root = expand_vectors(root, interface)
    wired = collect_wiring(root, package.name, interface)
    values, without_effect = resolve_bindings(root, wired)
    # the sizes were needed before the connections were known
    for path, fmu in wired.fmus.items():
        if _read_structure(fmu, values[path]) != fmu.interface.structure:
            raise wired.fault(
                f"a structural parameter of '{'.'.join(path)}' gets its value through a connector. Set it by "
                "its own name in a parameter binding."
            )
    names, samples = _name_components(wired), set(structure.samples)
    components = (
        replace(_make_component(wired, names[path], fmu, values[path]), samples=names[path] in samples)
        for path, fmu in wired.fmus.items()
    )
    connections = (_make_connection(wired, node, names) for node in wired.drivers if node[0] in wired.fmus)
    system = System(tuple(components), tuple(x for x in connections if x is not None), structure.bonds)
    return SspDocument(
        name=parse_id(structure.name, structure.id),
        description=structure.description,
        system=system,
        start_time=structure.start_time,
        stop_time=structure.stop_time,
        step_size=structure.step_size,
        notes=[
            *(f"the parameter {text}" for text in without_effect),
            *_describe_unknown_names(structure, system, wired.fmus.values()),
        ],
        unpacked=package.unpacked,
    )


def _set_structures(
    root: SystemElement, where: str, interface: Callable[[ComponentElement], Interface]
) -> SystemElement:
    """Return a system whose components have the values that bindings give structural parameters by name.

    Args:
        root: The root system.
        where: The name of the structure in error messages.
        interface: Returns the interface of a component's FMU.

    Raises:
        CommandError: A structural parameter does not accept its value.
    """
    fmus = {
        path: Fmu(path, component, interface(component)) for path, component in _list_components(root, ())
    }
    if not any(f.interface.is_structural(n) for f in fmus.values() for n in f.interface.variables):
        return root
    values, _ = resolve_bindings(root, Wiring(where, fmus), has_sizes=False)
    return _replace_structures(
        root, (), {path: _read_structure(fmu, values[path]) for path, fmu in fmus.items()}
    )


def _read_structure(fmu: Fmu, values: Mapping[str, BoundValue]) -> dict[str, int]:
    """Return the values of a component's structural parameters that differ from their start values."""
    return convert_structure(
        ".".join(fmu.path), fmu.interface, {name: bound.value for name, bound in values.items()}
    )


def _list_components(element: Element, path: Path_) -> Iterator[tuple[Path_, ComponentElement]]:
    """Yield all components in an element, with their paths."""
    if isinstance(element, ComponentElement):
        yield path, element
    if isinstance(element, SystemElement):
        for inside in element.elements:
            yield from _list_components(inside, (*path, inside.name))


def _replace_structures(
    system: SystemElement, path: Path_, structures: Mapping[Path_, Mapping[str, int]]
) -> SystemElement:
    """Return a system whose components have these values of structural parameters, by path."""

    def update(element: Element) -> Element:
        element_path = (*path, element.name)
        if isinstance(element, SystemElement):
            return _replace_structures(element, element_path, structures)
        if isinstance(element, ComponentElement):
            return replace(element, structure=tuple(structures[element_path].items()))
        return element

    return replace(system, elements=tuple(update(element) for element in system.elements))


def _describe_unknown_names(structure: Structure, system: System, fmus: Iterable[Fmu]) -> Iterator[str]:
    """Yield a note on each name in our annotation that nothing has, as after a component was renamed.

    The FMUs are those of the system's components.
    """
    by_component = {
        c.name: (c.aliases, fmu.interface) for c, fmu in zip(system.components, fmus, strict=True)
    }
    for name in structure.samples:
        if name not in by_component:
            yield f"the sampled component '{name}' does not exist"
    for name, bond in structure.bonds.items():
        for signal in (bond.effort, bond.flow):
            owners = {c: signal.removeprefix(f"{c}.") for c in by_component if signal.startswith(f"{c}.")}
            if not any(
                v in by_component[c][0] or v in by_component[c][1].variables for c, v in owners.items()
            ):
                yield f"the power bond '{name}' is not judged: the signal '{signal}' does not exist"


def _name_components(wired: Wiring) -> dict[Path_, str]:
    """Return the names of all components; raise CommandError for duplicates."""
    names: dict[Path_, str] = {}
    used: set[str] = set()
    for path, fmu in wired.fmus.items():
        name = parse_id(path[0], fmu.component.id) if len(path) == 1 else ".".join(path)
        if name in used:
            raise wired.fault(f"there are two components '{name}'.")
        used.add(name)
        names[path] = name
    return names


def _make_component(wired: Wiring, name: str, fmu: Fmu, values: dict[str, BoundValue]) -> Component:
    """Return a component with its values, by the names of its own mapping."""
    aliases = _find_aliases(wired, fmu, values)
    sources = {alias.variable: source for source, alias in aliases.items()}
    parameters = {}
    for variable, bound in values.items():
        if variable in sources and bound.entry is not None:
            parameters[sources[variable]] = bound.parameter.value
        else:
            parameters[variable] = bound.value
    kind = next((k for k, name in KINDS.items() if name == fmu.component.implementation), "")
    return Component(name, parameters=parameters, fmu=Path(fmu.component.source), aliases=aliases, kind=kind)


def _find_aliases(wired: Wiring, fmu: Fmu, values: dict[str, BoundValue]) -> dict[str, Alias]:
    """Return the names and units that the mappings of a component define for its variables.

    Only bindings of replaced components define them. Entries that are not the only name of one variable are
    left out; their value is set by the name of the FMU's variable.
    """
    variables = fmu.interface.variables
    renames = {
        (entry.source, entry.target): (entry, binding)
        for binding in fmu.component.bindings
        if binding.renames and isinstance(binding.mapping, tuple)
        for entry in binding.mapping
        if entry.target in variables
    }
    aliases = {}
    for (source, target), (entry, binding) in renames.items():
        is_unique = sum(1 for s, t in renames if s == source or t == target) == 1
        is_hidden = source != target and source in variables  # the name is that of another variable
        if not is_unique or is_hidden:
            continue
        bound, parameter = values.get(target), _find_parameter(binding, source)
        if bound is not None and bound.entry is not None:
            entry, parameter = bound.entry, bound.parameter
        if isinstance(entry.transformation, TableTransformation):
            continue  # results would need its inverse
        node = (fmu.path, target)
        linear = build_transformation(wired, parameter, entry, node, node)
        has_other_value = bound is not None and bound.entry is None
        if linear == IDENTITY:
            fits = source != target
        else:
            # results need the inverse, and only numbers can be scaled
            fits = linear.factor != 0.0 and variables[target].type == "Real"
            fits = fits and not (source == target and has_other_value)
        if fits:
            aliases[source] = Alias(target, linear, parameter.unit)
    return aliases


def _find_parameter(binding: ParameterBinding, name: str) -> SsvParameter:
    """Return the parameter of a binding by its name in the mapping, or one that is 0 and has no unit."""
    values = binding.values
    parameters = values.parameters if isinstance(values, ParameterSet) else ()
    matches = (p for p in parameters if f"{binding.prefix}{p.name}" == name)
    return next(matches, SsvParameter(name, "Real", 0.0))


def _make_connection(wired: Wiring, target: Node, names: dict[Path_, str]) -> Connection | None:
    """Return the connection to an input of an FMU through all systems between, None if there is none."""
    *_, source = wired.chain(target)
    if source[0] not in wired.fmus:
        return None
    transformation = wired.find_transformation(target, source)
    with contextlib.suppress(ValueError):  # the units cannot be converted
        if transformation == find_conversion(wired.fmu_unit(source), wired.fmu_unit(target)):
            transformation = None  # a run converts units itself
    return Connection(names[source[0]], source[1], names[target[0]], target[1], transformation)
