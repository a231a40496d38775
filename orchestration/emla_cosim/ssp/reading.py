"""From an SSP to a flat system of FMUs."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..system.model import Alias, Component, Connection, System
from ..units import IDENTITY, LinearTransformation, conversion
from .binding import Bound, bound_values
from .collecting import collected
from .loading import loaded
from .package import opened
from .structure import ParameterSet, Structure
from .wiring import Fmu, Node, Wiring


@dataclass(frozen=True)
class Document:
    """What an SSP says: the flat system, and how to run it where it does; times in s.

    `notes` are sentences on what was read but means nothing.
    """

    name: str
    description: str
    system: System
    start_time: float | None
    stop_time: float | None
    step_size: float | None
    notes: list[str]


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
        yield _document(structure, package.name)


def _document(structure: Structure, where: str) -> Document:
    wired = collected(structure.system, where)
    values, unused = bound_values(structure.system, wired)
    names = {path: _name(fmu) for path, fmu in wired.fmus.items()}
    components = tuple(_component(names[path], fmu, values[path]) for path, fmu in wired.fmus.items())
    connections = (_connection(wired, node, names) for node in wired.drivers if node[0] in wired.fmus)
    return Document(
        name=structure.name,
        description=structure.description,
        system=System(components, tuple(x for x in connections if x is not None)),
        start_time=structure.start_time,
        stop_time=structure.stop_time,
        step_size=structure.step_size,
        notes=[f"no variable is called as the parameter {name}" for name in unused],
    )


def _component(name: str, fmu: Fmu, values: dict[str, Bound]) -> Component:
    """A component with its values, called as its own mapping calls them."""
    aliases = dict(_aliases(fmu))
    parameters = {}
    for variable, bound in values.items():
        source = bound.entry.source if bound.entry is not None else variable
        if source in aliases:
            parameters[source] = bound.parameter.value
        else:
            parameters[variable] = bound.value
    return Component(name, parameters=parameters, fmu=Path(fmu.component.source), aliases=aliases)


def _aliases(fmu: Fmu) -> Iterator[tuple[str, Alias]]:
    """Variables that the mappings of a component give another name or value."""
    for binding in fmu.component.bindings:
        if not isinstance(binding.mapping, tuple) or not isinstance(binding.values, ParameterSet):
            continue
        units = {f"{binding.prefix}{p.name}": p.unit for p in binding.values.parameters}
        for entry in binding.mapping:
            transformation = entry.transformation or IDENTITY
            known = entry.target in fmu.interface.variables
            if not known or not isinstance(transformation, LinearTransformation):
                continue
            unit = units.get(entry.source)
            if not entry.suppress_unit_conversion:
                transformation = transformation.after(conversion(unit, fmu.interface.unit(entry.target)))
            if entry.source != entry.target or transformation != IDENTITY:
                yield entry.source, Alias(entry.target, transformation, unit)


def _name(fmu: Fmu) -> str:
    """The name of a component, unique because those of elements are."""
    id_ = fmu.component.id
    if len(fmu.path) == 1 and id_ is not None and id_.replace(".", "_") == fmu.path[0]:
        return id_
    return ".".join(fmu.path)


def _connection(wired: Wiring, target: Node, names: dict[tuple[str, ...], str]) -> Connection | None:
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
