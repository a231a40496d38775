"""Assignment of data columns to signals, with the conversion of their units."""

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fmublock.table import TYPES

from ..base.errors import CommandError, join_names
from ..base.patterns import matches_pattern
from ..base.signal_types import REAL, SignalType
from ..base.units import IDENTITY, LinearTransformation, SiUnit
from ..base.wording import format_count
from ..fmu.interface import Interface
from ..fmu.variables import find_variable
from ..system.model import System
from ..system.vectors import find_indices
from .data_tables import DataTable
from .headers import Header
from .input import Column, Input


@dataclass(frozen=True)
class ColumnBinding:
    """A signal and the column that drives it.

    Attributes:
        signal: The full name of the signal.
        component: Its component.
        variable: The variable of the component's FMU.
        output: Whether the variable is an output.
        column: The position of the column.
        order: The order of the derivative that drives the signal.
        transformation: Converts the derivative to the unit of the signal.
        unit: The unit of the signal.
        is_assumed: Whether the column has no unit, so that the one of the signal applies.
        is_discrete: Whether the variable is discrete, so that its values hold between rows.
        type: The type of the variable.
    """

    signal: str
    component: str
    variable: str
    output: bool
    column: int
    order: int
    transformation: LinearTransformation
    unit: SiUnit | None
    is_assumed: bool = False
    is_discrete: bool = False
    type: SignalType = REAL


def bind_columns(
    source: Input, data: DataTable, time: int, system: System, interfaces: Mapping[str, Interface]
) -> tuple[list[ColumnBinding], list[str]]:
    """Return the bindings of a table, and the names of its columns that drive nothing.

    Args:
        source: The input.
        data: Its table.
        time: The position of the column of times.
        system: The system.
        interfaces: The model descriptions by component.

    Raises:
        CommandError: If a signal or column does not exist, units do not fit, or there are no bindings.
    """
    data.match_names(lambda name: _find_elements(name, system, interfaces))
    chosen: dict[str, tuple[int, Column]] = {}
    for signal, column in source.signals.items():
        for element, part in _split_list(signal, column, data, system, interfaces).items():
            chosen[element] = find_column(source, data, part)
    idle = []
    for position, header in match_headers(source, data, time):
        if header.name in chosen:
            continue
        if _is_driven(header.name, system, interfaces):
            data.find(header.name)  # raises CommandError if it is not unique
            chosen[header.name] = position, Column(header.name, header.unit)
        elif header.unit_like_end is not None and _is_driven(header.unit_like_end[0], system, interfaces):
            signal, unit = header.unit_like_end
            raise CommandError(
                f"the column '{header.text}' of {data.label} ends like the unit '{unit}'; write its name as "
                f"'{signal} [{unit}]', or declare it with '{signal}={header.text} [{unit}]'.",
                signal=signal,
            )
        elif header.name:
            idle.append(header.name)
    if not chosen and source.columns:
        raise CommandError(
            f"{source.label} drives no signal: no connected signal is called {join_names(idle[:8])}."
        )
    if not chosen:
        raise CommandError(_unmatched_error(source, data, time, system, interfaces))
    bindings = [
        _bind_column(signal, position, column, data, system, interfaces)
        for signal, (position, column) in chosen.items()
    ]
    return bindings, idle


def match_headers(source: Input, data: DataTable, time: int) -> list[tuple[int, Header]]:
    """Return the columns that belong to signals of the same name, if there are such signals.

    Without explicit columns and signals these are all but that of the times.

    Raises:
        CommandError: If a pattern has no match.
    """
    others = [(i, h) for i, h in enumerate(data.headers) if i != time]
    if not source.columns:
        return [] if source.signals else others
    for pattern in source.columns:
        if not any(matches_pattern(h.name, pattern) for _, h in others):
            raise _no_column(data, pattern)
    return [(i, h) for i, h in others if any(matches_pattern(h.name, p) for p in source.columns)]


def find_column(source: Input, data: DataTable, column: Column) -> tuple[int, Column]:
    """Return the position of a column, and its unit and order separate from its name.

    Raises:
        CommandError: If there is no such column, or its unit contradicts the header.
    """
    text, order, unit = column.column.strip(), column.derivative, column.unit
    position = data.find(text)
    while position is None and text.startswith("der(") and text.endswith(")"):
        text, order = text[4:-1].strip(), order + 1
        position = data.find(text)
    header = Header.of(text)
    if position is None:
        position, unit = data.find(header.name), unit if unit is not None else header.unit
    if position is None:
        raise _no_column(data, header.name)
    if order > 0 and source.interpolation != "cubic":
        raise CommandError(
            f"a derivative of '{header.name}' of {data.label} needs cubic interpolation; "
            'set interpolation = "cubic".'
        )
    return position, dataclasses.replace(column, unit=data.find_unit(position, unit), derivative=order)


def _no_column(data: DataTable, name: str) -> CommandError:
    near = difflib.get_close_matches(name, [h.name for h in data.headers], n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"it has {data.join_names()}."
    return CommandError(f"{data.label} has no column '{name}'; {hint}", name=name, near=near)


def _find_elements(name: str, system: System, interfaces: Mapping[str, Interface]) -> list[str] | None:
    """Return the indices of the elements of an array, none of a scalar; None for no variable."""
    try:
        component, variable = system.split(name)
    except CommandError:
        return None
    variables = interfaces[component.name].variables
    if variable in component.aliases or variable in variables:
        return []
    return find_indices(variable, variables) or None


def _split_list(
    signal: str, column: Column, data: DataTable, system: System, interfaces: Mapping[str, Interface]
) -> dict[str, Column]:
    """Return the columns of the elements by signal if a column has lists, otherwise the column itself.

    Raises:
        CommandError: If the array has another number of elements.
    """
    header = Header.of(column.column)
    names = data.find_list(column.column) or data.find_list(header.name)
    indices = _find_elements(signal, system, interfaces) or []
    if not names and len(indices) < 2:
        return {f"{signal}{indices[0]}" if indices else signal: column}
    if len(names) != len(indices):
        numbers = format_count(max(len(names), 1), "number")
        raise CommandError(
            f"the column '{column.column}' of {data.label} has {numbers} in each cell, but {signal} has "
            f"{format_count(max(len(indices), 1), 'element')}.",
            signal=signal,
        )
    unit = column.unit if column.unit is not None else header.unit
    return {
        f"{signal}{index}": dataclasses.replace(column, column=name, unit=unit)
        for index, name in zip(indices, names, strict=True)
    }


def _is_driven(name: str, system: System, interfaces: Mapping[str, Interface]) -> bool:
    """Return whether a name is that of a signal that data can drive."""
    try:
        component, variable = system.split(name)
    except CommandError:
        return False
    found = interfaces[component.name].variables.get(component.alias(variable).variable)
    if found is None or found.type not in TYPES:
        return False
    end = (component.name, found.name)
    return found.causality == "input" or (
        found.causality == "output" and any(x.ends[0] == end for x in system.out_of(component.name))
    )


def _unmatched_error(
    source: Input, data: DataTable, time: int, system: System, interfaces: Mapping[str, Interface]
) -> str:
    names = [h.name for i, h in enumerate(data.headers) if i != time and h.name]
    signals = [
        f"{c.name}.{v.name}"
        for c in system.components
        for v in interfaces[c.name].variables.values()
        if v.causality in ("input", "output")
    ]
    near = [s for name in names[:20] for s in difflib.get_close_matches(name, signals, n=1, cutoff=0.6)]
    meant = (
        f"did you mean {join_names(near[:3])}?"
        if near
        else "set `signals` to the columns that drive signals."
    )
    columns = f"its columns are called {join_names(names[:8])}" if names else "it has only a column of times"
    return f"{source.label} drives no signal: {columns}; {meant}"


def _bind_column(
    signal: str,
    position: int,
    column: Column,
    data: DataTable,
    system: System,
    interfaces: Mapping[str, Interface],
) -> ColumnBinding:
    component, name = system.split(signal)
    interface = interfaces[component.name]
    variable = find_variable(component.name, interface.variables, component.alias(name).variable)
    if variable.causality not in ("input", "output"):
        raise CommandError(
            f"{signal} is a {variable.causality}; data can drive an input or replace an output.",
            signal=signal,
        )
    if variable.type not in TYPES:
        raise CommandError(
            f"{signal} is of the type {variable.type}; data can drive {join_names(TYPES)}.", signal=signal
        )
    end, output = (component.name, str(variable.name)), variable.causality == "output"
    if output and not any(x.ends[0] == end for x in system.out_of(component.name)):
        raise CommandError(f"{signal} is not connected, so data for it would have no effect.", signal=signal)
    unit = interface.unit(end[1]) if variable.type == "Real" else None
    kind, is_discrete = interface.signal_type(end[1]), interface.is_discrete(end[1])
    if column.derivative and is_discrete:
        raise CommandError(f"{signal} is discrete; a derivative cannot drive it.", signal=signal)
    if variable.type != "Real" and (column.unit or data.headers[position].unit):
        raise CommandError(f"{signal} is of the type {variable.type}, which has no unit.", signal=signal)
    transformation, is_assumed = IDENTITY, False
    if variable.type == "Real":
        transformation, is_assumed = data.conversion(position, signal, unit, column.unit, column.derivative)
    return ColumnBinding(
        signal,
        *end,
        output,
        position,
        column.derivative,
        transformation,
        unit,
        is_assumed,
        is_discrete,
        kind,
    )


def check_single_binding(bindings: Sequence[ColumnBinding]) -> None:
    """Check that each signal has one binding.

    Raises:
        CommandError: If two columns drive the same signal.
    """
    seen: set[tuple[str, str]] = set()
    for binding in bindings:
        if (binding.component, binding.variable) in seen:
            raise CommandError(f"{binding.signal} is driven by two columns.", signal=binding.signal)
        seen.add((binding.component, binding.variable))
