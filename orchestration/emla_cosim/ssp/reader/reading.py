"""From an SSP to a flat system of FMUs."""

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from ...base.units import IDENTITY, conversion
from ...system.model import Alias, Component, Connection, System
from ..documents.structure import Parameter, ParameterBinding, ParameterSet, Structure, TableTransformation
from .binding import Bound, bound_values, transformation
from .collecting import collected
from .loading import loaded
from .package import Package, opened
from .wiring import Fmu, Node, Path_, Wiring


@dataclass(frozen=True)
class Document:
    """What an SSP says: the flat system, and how to run it where it does; times in s.

    `notes` are sentences on what was read but means nothing. FMUs of a package are in the folder
    `unpacked`.
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
def read_ssp(path: Path) -> Iterator[Document]:
    """Read a package, a folder or an SSD; FMUs that were packed are there until the end of the block.

    A component is called by the names of its elements with dots between, `lift.plant` for `plant` in
    the system `lift`; at the top level also `lift_plant` with the id `lift.plant` is. Raises
    CommandError for whatever is wrong, missing or not supported.
    """
    with contextlib.ExitStack() as held:
        package = held.enter_context(opened(path))
        structure = loaded(package, held)
        yield _document(structure, package)


def _document(structure: Structure, package: Package) -> Document:
    wired = collected(structure.system, package.name)
    values, unused = bound_values(structure.system, wired)
    names, samples = _names(wired), set(structure.samples)
    components = (
        replace(_component(wired, names[path], fmu, values[path]), samples=names[path] in samples)
        for path, fmu in wired.fmus.items()
    )
    connections = (_connection(wired, node, names) for node in wired.drivers if node[0] in wired.fmus)
    system = System(tuple(components), tuple(x for x in connections if x is not None), structure.bonds)
    return Document(
        name=structure.name,
        description=structure.description,
        system=system,
        start_time=structure.start_time,
        stop_time=structure.stop_time,
        step_size=structure.step_size,
        notes=[
            *(f"no variable is called as the parameter {name}" for name in unused),
            *_unknown_in_annotation(structure, system, wired.fmus.values()),
        ],
        unpacked=package.unpacked,
    )


def _unknown_in_annotation(structure: Structure, system: System, fmus: Iterable[Fmu]) -> Iterator[str]:
    """Yield a note on each name in our annotation that nothing has, as after a component was renamed.

    The FMUs are those of the system's components.
    """
    known = {c.name: (c.aliases, fmu.interface) for c, fmu in zip(system.components, fmus, strict=True)}
    for name in structure.samples:
        if name not in known:
            yield f"the sampled component '{name}' does not exist"
    for name, bond in structure.bonds.items():
        for signal in (bond.effort, bond.flow):
            owners = {c: signal.removeprefix(f"{c}.") for c in known if signal.startswith(f"{c}.")}
            if not any(v in known[c][0] or v in known[c][1].variables for c, v in owners.items()):
                yield f"the power bond '{name}' is not judged: the signal '{signal}' does not exist"


def _names(wired: Wiring) -> dict[Path_, str]:
    """The names of all components; CommandError for two of the same name."""
    names: dict[Path_, str] = {}
    taken: set[str] = set()
    for path, fmu in wired.fmus.items():
        id_ = fmu.component.id
        flat = len(path) == 1 and id_ is not None and id_.replace(".", "_") == path[0]
        name = id_ if flat and id_ is not None else ".".join(path)
        if name in taken:
            raise wired.fault(f"there are two components '{name}'.")
        taken.add(name)
        names[path] = name
    return names


def _component(wired: Wiring, name: str, fmu: Fmu, values: dict[str, Bound]) -> Component:
    """A component with its values, called as its own mapping calls them."""
    aliases = _aliases(wired, fmu, values)
    sources = {alias.variable: source for source, alias in aliases.items()}
    parameters = {}
    for variable, bound in values.items():
        if variable in sources and bound.entry is not None:
            parameters[sources[variable]] = bound.parameter.value
        else:
            parameters[variable] = bound.value
    return Component(name, parameters=parameters, fmu=Path(fmu.component.source), aliases=aliases)


def _aliases(wired: Wiring, fmu: Fmu, values: dict[str, Bound]) -> dict[str, Alias]:
    """Other names and units that the mappings of a component give to its variables.

    They are those of a replaced component, whose bindings say so. What is no other name for one
    variable is left out: its value is given to the FMU's variable.
    """
    variables = fmu.interface.variables
    found = {
        (entry.source, entry.target): (entry, binding)
        for binding in fmu.component.bindings
        if binding.renames and isinstance(binding.mapping, tuple)
        for entry in binding.mapping
        if entry.target in variables
    }
    aliases = {}
    for (source, target), (entry, binding) in found.items():
        single = sum(1 for s, t in found if s == source or t == target) == 1
        hidden = source != target and source in variables
        if not single or hidden:
            continue
        bound, parameter = values.get(target), _source(binding, source)
        if bound is not None and bound.entry is not None:
            entry, parameter = bound.entry, bound.parameter
        if isinstance(entry.transformation, TableTransformation):
            continue
        node = (fmu.path, target)
        linear = transformation(wired, parameter, entry, node, node)
        given_elsewhere = bound is not None and bound.entry is None
        if linear == IDENTITY:
            fits = source != target
        else:
            fits = linear.factor != 0.0 and variables[target].type == "Real"
            fits = fits and not (source == target and given_elsewhere)
        if fits:
            aliases[source] = Alias(target, linear, parameter.unit)
    return aliases


def _source(binding: ParameterBinding, name: str) -> Parameter:
    """The parameter of a binding that its mapping calls by this name; one without a unit if there is none."""
    values = binding.values
    parameters = values.parameters if isinstance(values, ParameterSet) else ()
    found = (p for p in parameters if f"{binding.prefix}{p.name}" == name)
    return next(found, Parameter(name, "Real", 0.0))


def _connection(wired: Wiring, target: Node, names: dict[Path_, str]) -> Connection | None:
    """What drives an input of an FMU, through all systems between; None if nothing does."""
    *_, source = wired.chain(target)
    if source[0] not in wired.fmus:
        return None
    transformation = wired.arriving(target, source)
    usual = _usual(wired, source, target)
    return Connection(
        names[source[0]],
        source[1],
        names[target[0]],
        target[1],
        None if transformation == usual else transformation,
    )


def _usual(wired: Wiring, source: Node, target: Node) -> object:
    """The transformation by units alone; None where there is none."""
    try:
        return conversion(wired.fmu_unit(source), wired.fmu_unit(target))
    except ValueError:
        return None
