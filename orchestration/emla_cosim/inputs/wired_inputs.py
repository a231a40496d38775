"""Tables in a system: their FMUs and connections."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fmublock.table import TYPES

from ..base.wording import find_free_name
from ..fmu.interface import Interface
from ..system.model import Component, Connection, System
from .column_bindings import ColumnBinding, bind_columns, check_single_binding
from .data_names import NAME
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
    found = [bind_columns(t.source, t.data, t.time, system, interfaces) for t in tables]
    check_single_binding([one for driven, _ in found for one in driven])
    fmus, notes = dict[str, Path](), list[str]()
    for table, (driven, idle) in zip(tables, found, strict=True):
        notes += [f"{table.source.label} {note}." for note in table.data.notes]
        if assumed := [one for one in driven if one.is_assumed]:
            notes.append(_describe_assumed(table, assumed))
        discrete = [
            one.signal
            for one in driven
            if one.is_discrete and one.type.kind == "Real" and table.source.interpolation != "held"
        ]
        if discrete:
            more = f" and {len(discrete) - 8} more" if len(discrete) > 8 else ""
            notes.append(
                f"{table.source.label} drives discrete variables, whose values hold between rows: "
                f"{', '.join(discrete[:8])}{more}."
            )
        if idle:
            more = f" and {len(idle) - 8} more" if len(idle) > 8 else ""
            notes.append(f"{table.source.label} has columns that drive nothing: {', '.join(idle[:8])}{more}.")
        if table.source.end == "stop":
            notes.append(
                f"the run stops where the data of {table.source.label} end, at t = {table.times[-1]:.9g} s."
            )
        places, rest = _places(system, driven)
        for name, part in places.items():
            fmus[name] = build_cached_fmu(table, [(one, one.variable) for one in part], platforms)
            system = _replace_component(system, name, fmus[name])
        for letter in dict.fromkeys(TYPES[one.type.kind] for one in rest):
            part = [one for one in rest if TYPES[one.type.kind] == letter]
            name = find_free_name(NAME, {x for c in system.components for x in (c.name, c.branch)})
            fmus[name] = build_cached_fmu(table, [(one, one.signal) for one in part], platforms)
            system = _add_component(system, name, fmus[name], part)
            notes += _describe_partly_replaced(name, part)
    return WiredInputs(system, fmus, notes)


def _places(
    system: System, driven: Sequence[ColumnBinding]
) -> tuple[dict[str, list[ColumnBinding]], list[ColumnBinding]]:
    """Return the bindings that replace whole components, by component, and the others."""
    outputs: dict[str, list[ColumnBinding]] = {}
    for one in driven:
        if one.output:
            outputs.setdefault(one.component, []).append(one)
    whole = {
        name: part
        for name, part in outputs.items()
        if {x.output for x in system.out_of(name)} <= {one.variable for one in part}
        and len({TYPES[one.type.kind] for one in part}) == 1
    }
    return whole, [one for one in driven if not (one.output and one.component in whole)]


def _replace_component(system: System, name: str, fmu: Path) -> System:
    """Replace a component by a table, without connections to its inputs and without start values."""
    changed = replace(system.component(name), model="", fmu=fmu, parameters={}, aliases={})
    kept = tuple(x for x in system.connections if x.target != name)
    return replace(system.with_component(changed), connections=kept)


def _add_component(system: System, name: str, fmu: Path, driven: Sequence[ColumnBinding]) -> System:
    """Add a table as a component of its own."""
    outputs = {(one.component, one.variable): one.signal for one in driven if one.output}
    inputs = {(one.component, one.variable): one.signal for one in driven if not one.output}
    connections = [
        replace(x, source=name, output=outputs[x.ends[0]]) if x.ends[0] in outputs else x
        for x in system.connections
        if x.ends[1] not in inputs
    ]
    connections += [Connection(name, signal, *end) for end, signal in inputs.items()]
    taken: dict[str, list[str]] = {}
    for component, variable in inputs:
        taken.setdefault(component, []).append(variable)
    components = [_drop_driven_values(c, taken.get(c.name, ())) for c in system.components]
    components = [Component(name, fmu=fmu), *components]
    return replace(system, components=tuple(components), connections=tuple(connections))


def _drop_driven_values(component: Component, driven: Iterable[str]) -> Component:
    """Return a component without start values of inputs that are connected now."""
    gone = set(driven)
    kept = {n: v for n, v in component.parameters.items() if component.alias(n).variable not in gone}
    return replace(component, parameters=kept)


def _describe_partly_replaced(name: str, driven: Sequence[ColumnBinding]) -> list[str]:
    """Return messages on outputs that are still computed but not used."""
    return [
        f"{one.component} still computes {one.signal}, but it is not used: {name}.{one.signal} provides "
        "the data instead."
        for one in driven
        if one.output
    ]


def _describe_assumed(table: LoadedInput, driven: Sequence[ColumnBinding]) -> str:
    """Return the message on columns that have the unit of their signal because they name none."""
    units = [f"'{table.data.headers[one.column].text}' in {one.unit}" for one in driven[:8]]
    more = f" and {len(driven) - 8} more" if len(driven) > 8 else ""
    return (
        f"{table.source.label} has columns without a unit, which are read in the unit of their signal: "
        f"{', '.join(dict.fromkeys(units))}{more}."
    )
