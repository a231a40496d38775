"""Tables in a system: their FMUs and connections."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fmublock.table import TYPES

from ..base.errors import CommandError
from ..base.wording import find_free_name, list_few
from ..fmu.interface import Interface
from ..system.model import Component, Connection, System
from ..system.names import Names
from .column_bindings import ColumnBinding, bind_columns
from .input import NAME
from .loaded_input import LoadedInput
from .table_fmus import build_cached_fmu


@dataclass(frozen=True)
class WiredInputs:
    """A system in which tables drive signals.

    Attributes:
        system: The system.
        fmus: The FMUs of the tables by component.
        notes: Messages for the user.
    """

    system: System
    fmus: Mapping[str, Path]
    notes: Sequence[str]


def wire_inputs(
    system: System,
    tables: Sequence[LoadedInput],
    interfaces: Mapping[str, Interface],
    platforms: Sequence[str],
) -> WiredInputs:
    """Return the system with tables in it.

    A table replaces what drove an input before. Receivers of an output that a table replaces are connected to
    the table. If it replaces all connected outputs of a component, it replaces the component.

    Args:
        system: The system.
        tables: The inputs.
        interfaces: The model descriptions by component.
        platforms: The platforms of the tables' FMUs.

    Raises:
        CommandError: If a table does not fit the system.
        RunError: If an FMU cannot be built.
    """
    names = Names(system, interfaces)
    bound = [bind_columns(t.source, t.data, t.time, system, names) for t in tables]
    ends = set[tuple[str, str]]()
    for binding in (binding for bindings, _ in bound for binding in bindings):
        if (binding.component, binding.variable) in ends:
            raise CommandError(f"{binding.signal} is driven by two columns.", signal=binding.signal)
        ends.add((binding.component, binding.variable))
    fmus, notes = dict[str, Path](), list[str]()
    for table, (bindings, idle) in zip(tables, bound, strict=True):
        label = table.source.label
        notes += [f"{label} {note}." for note in table.data.notes]
        if assumed := [binding for binding in bindings if binding.is_assumed]:
            texts = [f"'{table.data.headers[b.column].text}' in {b.unit}" for b in assumed]
            notes.append(
                f"{label} has columns without a unit, which are read in the unit of their signal: "
                f"{list_few(texts)}."
            )
        discrete = [b.signal for b in bindings if b.is_discrete and b.type.kind == "Real"]
        if discrete and table.source.interpolation != "held":
            notes.append(
                f"{label} drives discrete variables, whose values hold between rows: {list_few(discrete)}."
            )
        if idle:
            notes.append(f"{label} has columns that drive nothing: {list_few(idle)}.")
        if table.source.end == "stop":
            notes.append(f"the run stops where the data of {label} end, at t = {table.times[-1]:.9g} s.")
        replaced, rest = _split_bindings(system, bindings)
        for name, part in replaced.items():
            fmus[name] = build_cached_fmu(table, [(binding, binding.variable) for binding in part], platforms)
            system = _replace_component(system, name, fmus[name])
        # the FMU of a table has outputs of one kind, so numbers and Booleans need one each
        for letter in dict.fromkeys(TYPES[binding.type.kind] for binding in rest):
            part = [binding for binding in rest if TYPES[binding.type.kind] == letter]
            name = find_free_name(NAME, {x for c in system.components for x in (c.name, c.branch)})
            fmus[name] = build_cached_fmu(table, [(binding, binding.signal) for binding in part], platforms)
            system = _add_component(system, name, fmus[name], part)
            notes += [
                f"{b.component} still computes {b.signal}, but it is not used: {name}.{b.signal} provides "
                "the data instead."
                for b in part
                if b.output
            ]
    return WiredInputs(system, fmus, notes)


def _split_bindings(
    system: System, bindings: Sequence[ColumnBinding]
) -> tuple[dict[str, list[ColumnBinding]], list[ColumnBinding]]:
    """Return the bindings that replace whole components, by component, and the others."""
    outputs: dict[str, list[ColumnBinding]] = {}
    for binding in bindings:
        if binding.output:
            outputs.setdefault(binding.component, []).append(binding)
    replaced = {
        name: part
        for name, part in outputs.items()
        if {x.output for x in system.out_of(name)} <= {binding.variable for binding in part}
        and len({TYPES[binding.type.kind] for binding in part}) == 1
    }
    return replaced, [b for b in bindings if not (b.output and b.component in replaced)]


def _replace_component(system: System, name: str, fmu: Path) -> System:
    """Replace a component by a table, without connections to its inputs and without start values."""
    changed = replace(system.component(name), model="", fmu=fmu, parameters={}, aliases={})
    connections = tuple(x for x in system.connections if x.target != name)
    return replace(system.with_component(changed), connections=connections)


def _add_component(system: System, name: str, fmu: Path, bindings: Sequence[ColumnBinding]) -> System:
    """Add a table as a component of its own."""
    ends = {(b.component, b.variable): b for b in bindings}
    outputs = {end: b.signal for end, b in ends.items() if b.output}
    inputs = {end: b.signal for end, b in ends.items() if not b.output}
    connections = [
        replace(x, source=name, output=outputs[x.ends[0]]) if x.ends[0] in outputs else x
        for x in system.connections
        if x.ends[1] not in inputs
    ]
    connections += [Connection(name, signal, *end) for end, signal in inputs.items()]
    components = []
    for c in system.components:  # an input that is connected now has no start value
        values = {n: v for n, v in c.parameters.items() if (c.name, c.alias(n).variable) not in inputs}
        components.append(replace(c, parameters=values))
    components = [Component(name, fmu=fmu), *components]
    return replace(system, components=tuple(components), connections=tuple(connections))
