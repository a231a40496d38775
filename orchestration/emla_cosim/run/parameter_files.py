"""Start values from files: SSP parameter sets, and tables with columns for scalars and arrays."""

import difflib
import re
from collections.abc import Collection, Mapping
from itertools import count, takewhile
from pathlib import Path

from ..base.errors import CommandError
from ..base.faults import convert_documents_units
from ..base.files import read_file
from ..base.quantities import Quantity
from ..base.units import SiUnit
from ..base.wording import format_count
from ..fmu.interface import Interface
from ..fmu.variables import convert_start_value
from ..inputs.data_tables import DataTable
from ..inputs.headers import parse_data_unit
from ..inputs.input import table_endings
from ..inputs.table_files import read_table
from ..ssp.documents.parameter_sets import parse_parameter_set
from ..ssp.reader.shapes import explain_shape
from ..system.model import Component, System, Value
from ..system.structure import is_structural

_INDEX = re.compile(r"\[[0-9]+\]$")
_ONE = SiUnit("1", (0,) * 8)


def file_values(file: Path, system: System, interfaces: Mapping[str, Interface]) -> dict[str, Value]:
    """Read start values from a table (CSV, Parquet, a registered format) or a parameter set (SSV).

    Returns:
        Values by full name, in the units of the system's variables.

    Raises:
        CommandError: If the file cannot be read, or a value does not fit its variable.
    """
    if file.name.lower().endswith(table_endings()):
        return _read_table_values(read_table(file, "the parameter table"), system, interfaces)
    return _read_parameter_set(file, system, interfaces)


def structural_file_values(
    file: Path, system: System, interfaces: Mapping[str, Interface]
) -> dict[str, Value]:
    """Read the values of structural parameters only, by full name; `file_values` checks all others.

    Args:
        file: The file.
        system: The system.
        interfaces: The model descriptions of the components with structural parameters.

    Raises:
        CommandError: If the file cannot be read, or a value does not fit its variable.
    """
    if not file.name.lower().endswith(table_endings()):
        content = read_file(file, "the parameter set")
        parameters = parse_parameter_set(content, str(file)).parameters
        return {p.name: p.value for p in parameters if is_structural(system, interfaces, p.name)}
    data, values = read_table(file, "the parameter table"), dict[str, Value]()
    for position, header in enumerate(data.headers):
        if is_structural(system, interfaces, header.name):
            values |= _read_column_values(data, position, system, interfaces)
    return values


def _read_table_values(
    data: DataTable, system: System, interfaces: Mapping[str, Interface]
) -> dict[str, Value]:
    values: dict[str, Value] = {}
    for position in range(len(data.headers)):
        for name, value in _read_column_values(data, position, system, interfaces).items():
            if name in values:
                raise CommandError(f"{data.label} has a second value for {name}.", name=name)
            values[name] = value
    return values


def _read_column_values(
    data: DataTable, position: int, system: System, interfaces: Mapping[str, Interface]
) -> dict[str, Value]:
    """Read the value of a scalar, or of the first elements of an array."""
    header = data.headers[position]
    label = f"the column '{header.text}' of {data.label}"
    name = header.name
    try:
        component, own = system.split(name)
    except CommandError as error:
        raise CommandError(f"{label}: {error}", name=name) from error
    interface = interfaces[component.name]
    elements = _elements(component, own, interface, label)
    numbers = data.numbers(position, padded=True)
    if not len(numbers):
        raise CommandError(f"{label} has no number.", name=header.name)
    if len(numbers) > len(elements):
        raise CommandError(
            f"{label} has a value in row {len(numbers)}, but {header.name} has "
            f"{format_count(len(elements), 'element')}.",
            name=header.name,
        )
    given, found = parse_data_unit(header.unit, label), dict[str, Value]()
    for row, (element, number) in enumerate(zip(elements, numbers.tolist(), strict=False), 1):
        value = Quantity(number, given).in_unit(_unit(component, element, interface, given), label)
        try:
            found[f"{component.name}.{element}"] = _check_value(component, element, interface, value)
        except CommandError as error:
            raise CommandError(f"{label}, row {row}: {error}", row=row, **error.fields) from error
    return found


def _elements(component: Component, name: str, interface: Interface, label: str) -> list[str]:
    """Return a variable, or the elements of an array. Raise CommandError for an unknown name."""
    known: Collection[str] = {*component.aliases, *interface.variables}
    if name in known:
        return [name]
    found = list(takewhile(known.__contains__, (f"{name}[{i}]" for i in count(1))))
    if not found:
        names = dict.fromkeys(_INDEX.sub("", n) for n in known)
        near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
        meant = f"; did you mean {' or '.join(near)}?" if near else "."
        raise CommandError(f"{label}: {component.name} has no variable '{name}'{meant}", name=name, near=near)
    return found


def _unit(component: Component, name: str, interface: Interface, given: SiUnit | None) -> SiUnit | None:
    """Return the unit of a variable in the system, or dimensionless if it has none and the file gives one."""
    alias = component.alias(name)
    return alias.unit or interface.unit(alias.variable) or (None if given is None else _ONE)


def _check_value(component: Component, name: str, interface: Interface, value: float) -> Value:
    """Return the value if the variable can have it. Raise CommandError otherwise."""
    alias = component.alias(name)
    variable = interface.variables[alias.variable]
    plain = value if variable.type == "Real" or not value.is_integer() else int(value)
    convert_start_value(
        component.name, interface, variable, alias.transformation(plain) if component.aliases else plain
    )
    return plain


def _read_parameter_set(file: Path, system: System, interfaces: Mapping[str, Interface]) -> dict[str, Value]:
    values: dict[str, Value] = {}
    content = read_file(file, "the parameter set")
    for parameter in parse_parameter_set(content, str(file)).parameters:
        component, name = system.split(parameter.name)
        interface = interfaces[component.name]
        array = name.removesuffix(parameter.name.removeprefix(parameter.document_name))
        if parameter.array is not None and not component.aliases:
            target = f"{component.name}.{array}"
            if differ := explain_shape(parameter, array, interface.variables, target):
                raise CommandError(f"{parameter.place}: {differ}")
        unit = interface.unit(name) if name in interface.variables else None
        if name in component.aliases:
            unit = component.aliases[name].unit
        value = parameter.value
        if parameter.unit is not None and unit is not None:
            try:
                value = convert_documents_units(str(file), parameter.unit, unit)(float(value))
            except ValueError as error:
                raise CommandError(f"'{parameter.name}' of '{file}' has {error}.") from error
        values[parameter.name] = value
    return values
