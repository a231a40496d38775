"""Assignment of data columns to signals, with the conversion of their units."""

import dataclasses
import difflib
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from fmublock.table import TYPES

from ..base.arrays import REAL, SignalType
from ..base.errors import CommandError, join_names
from ..base.units import IDENTITY, LinearTransformation, SiUnit
from ..base.wording import matches_pattern
from ..system.model import System
from ..system.names import NamedVariable, Names
from ..system.structure import find_indices
from .data_tables import DataTable
from .headers import Header, is_same_unit, is_unit
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
    source: Input, data: DataTable, time: int, system: System, names: Names
) -> tuple[list[ColumnBinding], list[str]]:
    """Return the bindings of a table, and the names of its columns that drive nothing.

    The columns of the table get the names of array elements, see `DataTable.match_names`.

    Args:
        source: The input.
        data: Its table.
        time: The position of the column of times.
        system: The system.
        names: Its names.

    Raises:
        CommandError: If a signal or column does not exist, units do not fit, or there are no bindings.
    """
    # the main component can be left out in names, as in options
    main = f"{system.main_name}."
    allowed_names = dict.fromkeys([*names.all, *(name.removeprefix(main) for name in names.all)])
    data.match_names(allowed_names)
    columns: dict[str, Column] = {}
    for signal, column in source.signals.items():
        columns |= _split_list(signal, column, data, allowed_names)
    idle = []
    for name, column in match_columns(source, data, time).items():
        if name in columns:
            continue
        end = Header(name, name, column.unit).unit_like_end
        if _can_be_driven(name, system, names):
            columns[name] = column
        elif end is not None and _can_be_driven(end[0], system, names):
            signal, unit = end
            raise CommandError(
                f"the column '{name}' of {data.label} ends like the unit '{unit}'; write its name as "
                f"'{signal} [{unit}]', or declare it with '{signal}={name} [{unit}]'.",
                signal=signal,
            )
        elif indices := find_indices(name, allowed_names):
            raise data.wrong_count(name, 1, name, len(indices))
        else:
            idle.append(name)
    if not columns and source.columns:
        raise CommandError(
            f"{source.label} drives no signal: no connected signal is called {join_names(idle[:8])}."
        )
    if not columns:
        raise CommandError(f"{source.label} drives no signal: {_explain_unmatched(idle, names)}")
    return [_bind_column(source, s, column, data, system, names) for s, column in columns.items()], idle


def match_columns(source: Input, data: DataTable, time: int) -> dict[str, Column]:
    """Return the columns that belong to signals of the same name, if there are such signals.

    Without explicit columns and signals these are all but that of the times.

    Raises:
        CommandError: If a pattern has no match.
    """
    headers = [h for i, h in enumerate(data.headers) if i != time]
    patterns = source.columns or ([] if source.signals else ["*"])
    for pattern in source.columns:
        if not any(matches_pattern(h.name, pattern) for h in headers):
            raise data.no_column(pattern)
    return {
        h.name: Column(h.name, h.unit)
        for h in headers
        if h.name and any(matches_pattern(h.name, pattern) for pattern in patterns)
    }


def find_column(source: Input, data: DataTable, column: Column) -> tuple[int, Column]:
    """Return the position of a column, and its unit and order separate from its name.

    Raises:
        CommandError: If there is no such column, or its unit contradicts the header.
    """
    text, order, unit = column.column.strip(), column.derivative, column.unit
    position = data.find(text)
    # the whole text first: results of an FMU have columns called der(x)
    while position is None and text.startswith("der(") and text.endswith(")"):
        text, order = text[4:-1].strip(), order + 1
        position = data.find(text)
    header = Header.of(text)
    if position is None:
        position, unit = data.find(header.name), unit if unit is not None else header.unit
    if position is None:
        raise data.no_column(header.name)
    if order > 0 and source.interpolation != "cubic":
        raise CommandError(
            f"a derivative of '{header.name}' of {data.label} needs cubic interpolation; "
            'set interpolation = "cubic".'
        )
    header = data.headers[position]
    unit = header.unit if unit is None else unit
    if header.unit is not None and is_unit(header.unit) and not is_same_unit(unit or "", header.unit):
        raise CommandError(
            f"the column '{header.text}' of {data.label} is declared to be in {unit}; its header says "
            "otherwise."
        )
    return position, dataclasses.replace(column, unit=unit, derivative=order)


def _split_list(
    signal: str, column: Column, data: DataTable, allowed_names: Collection[str]
) -> dict[str, Column]:
    """Return the columns of the elements by signal if a column has lists, otherwise the column itself.

    Raises:
        CommandError: If the array has another number of elements.
    """
    header = Header.of(column.column)
    columns = data.find_list(column.column) or data.find_list(header.name)
    indices = find_indices(signal, allowed_names)
    if not columns and len(indices) < 2:
        return {f"{signal}{''.join(indices)}": column}
    if len(columns) != len(indices):
        raise data.wrong_count(column.column, len(columns), signal, len(indices))
    unit = column.unit if column.unit is not None else header.unit
    return {
        f"{signal}{index}": dataclasses.replace(column, column=name, unit=unit)
        for index, name in zip(indices, columns, strict=True)
    }


def _can_be_driven(name: str, system: System, names: Names) -> bool:
    """Return whether a name is that of a signal that data can drive."""
    variable = names.get(name)
    if variable is None or variable.variable.type not in TYPES:
        return False
    causality = variable.variable.causality
    return causality == "input" or (causality == "output" and _is_connected(variable, system))


def _is_connected(output: NamedVariable, system: System) -> bool:
    return any(x.ends[0] == output.end for x in system.out_of(output.component.name))


def _explain_unmatched(columns: Sequence[str], names: Names) -> str:
    """Return the end of a message on columns that drive nothing: their names, and what to do."""
    signals = [n for n, v in names.all.items() if v.variable.causality in ("input", "output")]
    # of the first columns only: each comparison with all signals takes time
    near = [s for name in columns[:20] for s in difflib.get_close_matches(name, signals, n=1, cutoff=0.6)]
    advice = (
        f"did you mean {join_names(near[:3])}?"
        if near
        else "set `signals` to the columns that drive signals."
    )
    if not columns:
        return f"it has only a column of times; {advice}"
    return f"its columns are called {join_names(columns[:8])}; {advice}"


def _bind_column(
    source: Input, signal: str, column: Column, data: DataTable, system: System, names: Names
) -> ColumnBinding:
    """Return the binding of a column to a signal; raise CommandError if data cannot drive it like this."""
    position, column = find_column(source, data, column)
    target = names.find(signal)
    variable, interface, name = target.variable, target.interface, target.fmu_name
    if variable.causality not in ("input", "output"):
        raise CommandError(
            f"{signal} is a {variable.causality}; data can drive an input or replace an output.",
            signal=signal,
        )
    if variable.type not in TYPES:
        raise CommandError(
            f"{signal} is of the type {variable.type}; data can drive {join_names(TYPES)}.", signal=signal
        )
    output, is_real = variable.causality == "output", variable.type == "Real"
    if output and not _is_connected(target, system):
        raise CommandError(f"{signal} is not connected, so data for it would have no effect.", signal=signal)
    if column.derivative and target.is_discrete:
        raise CommandError(f"{signal} is discrete; a derivative cannot drive it.", signal=signal)
    if not is_real and (column.unit or data.headers[position].unit):
        raise CommandError(f"{signal} is of the type {variable.type}, which has no unit.", signal=signal)
    unit, transformation, is_assumed = None, IDENTITY, False
    if is_real:
        unit = interface.unit(name)
        transformation, is_assumed = data.conversion(position, signal, unit, column.unit, column.derivative)
    return ColumnBinding(
        signal,
        *target.end,
        output,
        position,
        column.derivative,
        transformation,
        unit,
        is_assumed,
        target.is_discrete,
        interface.signal_type(name),
    )
