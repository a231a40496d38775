"""Assignment of data columns to signals, with the conversion of their units."""

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fmublock.table import TYPES

from ..base.errors import CommandError, join_names
from ..base.patterns import matches_pattern
from ..base.quantities import resolve_conversion
from ..base.signal_types import REAL, SignalType
from ..base.units import IDENTITY, LinearTransformation, SiUnit
from ..fmu.interface import Interface
from ..fmu.variables import find_variable
from ..system.model import System
from .data_tables import DataTable
from .headers import Header, is_same_unit, parse_data_unit, rate_of, read_suffix
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
    chosen = {signal: find_column(source, data, column) for signal, column in source.signals.items()}
    idle = []
    for position, header in match_headers(source, data, time):
        if header.name in chosen:
            continue
        names = [header.name] if header.suffix is None else [header.name, header.suffix.name]
        signal = next((name for name in names if _is_driven(name, system, interfaces)), None)
        if signal is not None:
            data.find(header.text)  # raises CommandError if it is not unique
            chosen[signal] = position, Column(header.text, header.unit)
        else:
            idle.append(header.name)
    if not chosen and source.columns:
        raise CommandError(
            f"{source.label} drives no signal: no connected signal is called {join_names(idle[:8])}."
        )
    if not chosen:
        raise CommandError(_unmatched_error(source, data, time, system, interfaces))
    found = [
        _bind_column(signal, position, column, source, data, system, interfaces)
        for signal, (position, column) in chosen.items()
    ]
    return found, idle


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
        if not any(_matches(h, pattern) for _, h in others):
            near = difflib.get_close_matches(pattern, [h.name for _, h in others], n=3, cutoff=0.5)
            meant = f"; did you mean {' or '.join(near)}?" if near else "."
            raise CommandError(f"{data.label} has no column '{pattern}'{meant}", name=pattern, near=near)
    return [(i, h) for i, h in others if any(_matches(h, p) for p in source.columns)]


def _matches(header: Header, pattern: str) -> bool:
    return matches_pattern(header.name, pattern) or (
        header.suffix is not None and matches_pattern(header.suffix.name, pattern)
    )


def find_column(source: Input, data: DataTable, asked: Column) -> tuple[int, Column]:
    """Return the position of a column, and its unit and order separate from its name.

    Raises:
        CommandError: If there is no such column, or its unit contradicts the header.
    """
    text, order, unit = asked.column.strip(), asked.derivative, asked.unit
    position = data.find(text)
    while position is None and text.startswith("der(") and text.endswith(")"):
        text, order = text[4:-1].strip(), order + 1
        position = data.find(text)
    named = Header.of(text)
    if position is None:
        position, unit = data.find(named.name), unit if unit is not None else named.unit
    if position is None:
        names = [h.name for h in data.headers]
        near = difflib.get_close_matches(named.name, names, n=3, cutoff=0.5)
        meant = f"did you mean {' or '.join(near)}?" if near else f"it has {join_names(names[:8])}."
        raise CommandError(f"{data.label} has no column '{named.name}'; {meant}", name=named.name, near=near)
    there = data.headers[position].unit
    if unit is not None and there is not None and not is_same_unit(unit, there):
        raise CommandError(
            f"the column '{data.headers[position].text}' of {data.label} is declared to be in {unit}; its "
            "header says otherwise."
        )
    if order > 0 and source.interpolation != "cubic":
        raise CommandError(
            f"a derivative of '{named.name}' of {data.label} needs cubic interpolation; "
            'set interpolation = "cubic".'
        )
    return position, dataclasses.replace(asked, unit=unit or there, derivative=order)


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
    names = [h.name for i, h in enumerate(data.headers) if i != time]
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
    source: Input,
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
    transformation, is_assumed = (
        convert_column(data, position, column, signal, unit) if variable.type == "Real" else (IDENTITY, False)
    )
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


def convert_column(
    data: DataTable, position: int, column: Column, signal: str, unit: SiUnit | None
) -> tuple[LinearTransformation, bool]:
    """Return the conversion of a column to the unit of a signal, and whether the column has no unit.

    Args:
        data: The table.
        position: The position of the column.
        column: The column as `find_column` returns it.
        signal: The signal.
        unit: Its unit.

    Raises:
        CommandError: If the units measure different things.
    """
    header = data.headers[position]
    label = f"the column '{header.text}' of {data.label}"
    target = rate_of(unit, -column.derivative)
    measured = parse_data_unit(column.unit, label, target)
    if measured is None and header.suffix is not None and header.name != signal:
        measured = read_suffix(header.suffix, target, label, header.text)
    given = rate_of(measured, column.derivative)
    transformation = resolve_conversion(given, unit, f"{label} for {signal}")
    return transformation, given is None and unit is not None


def check_single_binding(found: Sequence[ColumnBinding]) -> None:
    """Check that each signal has one binding.

    Raises:
        CommandError: If two columns drive the same signal.
    """
    seen: set[tuple[str, str]] = set()
    for one in found:
        if (one.component, one.variable) in seen:
            raise CommandError(f"{one.signal} is driven by two columns.", signal=one.signal)
        seen.add((one.component, one.variable))
