"""Start values from files: SSP parameter sets, and tables with columns for scalars and arrays."""

from collections.abc import Mapping
from pathlib import Path

from ..base.errors import CommandError
from ..base.files import read_file
from ..base.quantities import Quantity
from ..base.units import SiUnit
from ..base.wording import format_count
from ..fmu.interface import Interface
from ..fmu.parameters.parameter_sets import convert_parameter, parse_parameter_set
from ..fmu.variables import convert_start_value
from ..inputs.data_tables import DataTable
from ..inputs.headers import parse_data_unit
from ..inputs.input import table_endings
from ..inputs.table_files import read_table
from ..ssp.reader.shapes import explain_shape
from ..system.model import System, Value
from ..system.names import NamedVariable, Names

_DIMENSIONLESS = SiUnit("1", (0,) * 8)


def file_values(
    file: Path, system: System, interfaces: Mapping[str, Interface], structural_only: bool = False
) -> dict[str, Value]:
    """Read start values from a table (CSV, Parquet, a registered format) or a parameter set (SSV).

    Args:
        file: The file.
        system: The system.
        interfaces: The model descriptions of its components.
        structural_only: Whether to read structural parameters only, without checking all others.

    Returns:
        Values by full name, in the units of the system's variables.

    Raises:
        CommandError: If the file cannot be read, or a value does not fit its variable.
    """
    names = Names(system, interfaces)
    if not file.name.lower().endswith(table_endings()):
        return _read_parameter_set(file, system, interfaces, names if structural_only else None)
    data, values = read_table(file, "the parameter table"), dict[str, Value]()
    for position, header in enumerate(data.headers):
        if structural_only and not names.is_structural(header.name):
            continue
        for name, value in _read_column_values(data, position, names).items():
            if name in values:
                raise CommandError(f"{data.label} has a second value for {name}.", name=name)
            values[name] = value
    return values


def _read_column_values(data: DataTable, position: int, names: Names) -> dict[str, Value]:
    """Return the values of a column by full name: of a scalar, or of the first elements of an array."""
    header = data.headers[position]
    label = f"the column '{header.text}' of {data.label}"
    try:
        elements = names.find_elements(header.name) or [names.find(header.name)]
    except CommandError as error:
        raise CommandError(f"{label}: {error}", **error.fields) from error
    numbers = data.numbers(position, padded=True)
    if not len(numbers):
        raise CommandError(f"{label} has no number.", name=header.name)
    if len(numbers) > len(elements):
        raise CommandError(
            f"{label} has a value in row {len(numbers)}, but {header.name} has "
            f"{format_count(len(elements), 'element')}.",
            name=header.name,
        )
    values = dict[str, Value]()
    for row, (element, number) in enumerate(zip(elements, numbers.tolist(), strict=False), 1):
        declared_unit = parse_data_unit(header.unit, label, element.unit)
        # a dimensionless value fits a variable without a unit
        value = Quantity(number, declared_unit).in_unit(
            element.unit or (None if declared_unit is None else _DIMENSIONLESS), label
        )
        try:
            values[element.full_name] = _convert_number(element, value)
        except CommandError as error:
            raise CommandError(f"{label}, row {row}: {error}", row=row, **error.fields) from error
    return values


def _convert_number(element: NamedVariable, value: float) -> Value:
    """Return the value, as an int if the variable is not a Real. Raise CommandError if it does not fit."""
    component, variable = element.component, element.variable
    # tables have floating-point numbers only, and other types refuse 2.0
    plain = value if variable.type == "Real" or not value.is_integer() else int(value)
    number = component.alias(element.name).transformation(plain) if component.aliases else plain
    convert_start_value(component.name, element.interface, variable, number)
    return plain


def _read_parameter_set(
    file: Path, system: System, interfaces: Mapping[str, Interface], structural: Names | None
) -> dict[str, Value]:
    """Read a parameter set; of structural parameters only if their names are passed."""
    parameters = parse_parameter_set(read_file(file, "the parameter set"), str(file)).parameters
    if structural is not None:
        return {p.name: p.value for p in parameters if structural.is_structural(p.name)}
    values: dict[str, Value] = {}
    for parameter in parameters:
        component, name = system.split(parameter.name)
        interface = interfaces[component.name]
        array = name.removesuffix(parameter.name.removeprefix(parameter.document_name))
        if parameter.array is not None and not component.aliases:
            target = f"{component.name}.{array}"
            if difference := explain_shape(parameter, array, interface.variables, target):
                raise CommandError(f"{parameter.location}: {difference}")
        unit = interface.unit(name) if name in interface.variables else None
        if name in component.aliases:
            unit = component.aliases[name].unit
        values[parameter.name] = convert_parameter(parameter, unit, str(file))
    return values
