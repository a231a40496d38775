"""Tables in a system: their FMUs and connections."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from fmublock.errors import BuildError
from fmublock.table import TYPES, TableColumn, TableContent, TableOutput

from ..base.arrays import Vector
from ..base.errors import CommandError, RunError
from ..base.files import CacheError, temporary_folder
from ..base.wording import find_free_name
from ..fmu.interface import Interface
from ..fmu.models import license_text, producer
from ..system.model import Component, Connection, System
from .column_bindings import ColumnBinding, bind_columns, check_single_binding
from .data_names import NAME
from .data_tables import DataTable
from .loaded_input import LoadedInput

_INTEGERS = -(2**31), 2**31 - 1
"""The smallest and the largest Integer of a table's FMU."""

_LARGEST = 1e100
"""The largest value of a signal; differences and slopes of greater ones can overflow."""


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
            fmus[name] = _build_table_fmu(table, [(one, one.variable) for one in part], platforms)
            system = _replace_component(system, name, fmus[name])
        for letter in dict.fromkeys(TYPES[one.type.kind] for one in rest):
            part = [one for one in rest if TYPES[one.type.kind] == letter]
            name = find_free_name(NAME, {x for c in system.components for x in (c.name, c.branch)})
            fmus[name] = _build_table_fmu(table, [(one, one.signal) for one in part], platforms)
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


def _build_table_fmu(
    table: LoadedInput, driven: Sequence[tuple[ColumnBinding, str]], platforms: Sequence[str]
) -> Path:
    """Return the FMU of a table, which is built if necessary.

    Args:
        table: The input.
        driven: The bindings, each with the name of its output.
        platforms: The platforms of the FMU.
    """
    from fmublock.table import build_table  # slow to import, and few runs need it

    types = {one.signal: one.type for one, _ in driven}
    usage = {one.signal: (one.column, _interpolation(table, one), repr(one.type)) for one, _ in driven}
    usages = {key: types[signal] for signal, key in usage.items()}
    columns = [
        TableColumn(table.data.values(position, kind, limits=_INTEGERS), interpolation)
        for (position, interpolation, _), kind in usages.items()
    ]
    order = list(usages)
    for one, _ in driven:
        _check_size(table.data, one, columns[order.index(usage[one.signal])].values)
    shown = [
        TableOutput(
            name,
            order.index(usage[one.signal]),
            one.order,
            one.transformation.factor,
            one.transformation.offset,
            one.unit,
            f"Column '{table.data.headers[one.column].text}'",
            one.type.kind,
            one.type.items,
        )
        for one, name in driven
    ]
    content = TableContent(table.times, columns, shown, table.source.end)
    kinds = [column.interpolation for column in columns]
    digest = sha256(repr((shown, table.source.end, kinds, sorted(platforms))).encode())
    for numbers in (table.times, *(c.values for c in columns)):
        digest.update(numbers.tobytes())
    path = _folder() / digest.hexdigest()[:24] / "DataTable.fmu"
    if path.is_file():
        return path
    try:
        return build_table(content, path, platforms, producer(), license_text())
    except (BuildError, CacheError) as error:
        raise RunError(f"the FMU of {table.source.label} could not be built: {error}") from error


def _interpolation(table: LoadedInput, one: ColumnBinding) -> str:
    """Return what is between two rows: a discrete variable has no values between them."""
    return "held" if one.is_discrete else table.source.interpolation


def _check_size(data: DataTable, one: ColumnBinding, values: Vector) -> None:
    """Raise CommandError for values so large that arithmetic could overflow."""
    unit = one.transformation
    with np.errstate(over="ignore"):
        beyond = ~(np.abs(unit.factor * values + unit.offset) <= _LARGEST)
    if beyond.any():
        row, header = int(beyond.argmax()) + 1, data.headers[one.column].text
        raise CommandError(
            f"{data.label} has {values[row - 1]:g} in row {row} of the column '{header}', which drives "
            f"{one.signal}; it must be within -{_LARGEST:g} and {_LARGEST:g} in the unit of the signal.",
            row=row,
            column=header,
        )


_fmu_folders = ExitStack()


@cache
def _folder() -> Path:
    """Return the folder of the tables' FMUs, which is removed when this process ends."""
    return _fmu_folders.enter_context(temporary_folder("tables"))
