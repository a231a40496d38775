"""FMUs of tables: those of a run, and those that `emla build` makes of data."""

import zipfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from fmublock.errors import BuildError
from fmublock.table import TableColumn, TableContent, TableOutput

from ..base.arrays import REAL, Vector
from ..base.errors import CommandError, RunError, join_names
from ..base.extras import explain_missing
from ..base.files import CacheError, temporary_folder
from ..base.output_files import OutputFile
from ..base.units import IDENTITY
from ..fmu.models import fmu_path, license_text, producer
from .column_bindings import ColumnBinding, find_column, match_columns
from .data_tables import DataTable
from .headers import parse_data_unit, rate_of
from .input import Column, Input
from .loaded_input import LoadedInput

_INTEGERS = -(2**31), 2**31 - 1
"""The smallest and the largest Integer of a table's FMU."""

_LARGEST = 1e100
"""The largest value of a signal; differences and slopes of greater ones can overflow."""

_DATA = "resources/table.bin"
"""The file that only the FMU of a table has."""


def build_cached_fmu(
    table: LoadedInput, driven: Sequence[tuple[ColumnBinding, str]], platforms: Sequence[str]
) -> Path:
    """Return the FMU of a table in a run, which is built if necessary.

    Args:
        table: The input.
        driven: The bindings, each with the name of its output.
        platforms: The platforms of the FMU.

    Raises:
        CommandError: If a column cannot drive its signal.
        RunError: If the FMU cannot be built.
    """
    content = _make_content(table, driven)
    kinds = [column.interpolation for column in content.columns]
    digest = sha256(repr((content.outputs, content.end, kinds, sorted(platforms))).encode())
    # by the numbers, not by the file: a changed comment or name must not build it again
    for numbers in (content.times, *(c.values for c in content.columns)):
        digest.update(numbers.tobytes())
    path = _folder() / digest.hexdigest()[:24] / "DataTable.fmu"
    return path if path.is_file() else _build(content, path, platforms, table.source.label)


def data_fmu_path(text: str, folder: Path) -> Path:
    """Return the path of the FMU of data: `NAME/NAME.fmu`, as that of a model."""
    file = Input.of_text(text).file
    return fmu_path("data" if file is None else file.stem, "native", folder)


def build_data_fmu(
    text: str, folder: Path, platforms: Sequence[str], overwrite: bool = False, fmi: int = 2
) -> tuple[Path, list[str]]:
    """Build an FMU whose outputs play the columns of a table.

    Args:
        text: An input as on the command line; with signals, `OUTPUT=COLUMN`, it has these outputs only.
        folder: The folder of FMUs.
        platforms: The platforms of the FMU.
        overwrite: Whether to replace a file that is not the FMU of a table.
        fmi: Version of FMI: 2 or 3.

    Returns:
        The FMU, and what users should know of how the data were read.

    Raises:
        CommandError: If the data cannot be read, or the file must not be replaced.
        RunError: If the FMU cannot be built.
    """
    table, path = LoadedInput.of(Input.of_text(text)), data_fmu_path(text, folder)
    columns = match_columns(table.source, table.data, table.time)
    bindings, texts = list[tuple[ColumnBinding, str]](), list[str]()
    for name, column in {**columns, **table.source.signals}.items():
        binding = _bind_output(name, column, table)
        if binding.type.is_text:
            texts.append(name)
        else:
            bindings.append((binding, name))
    if not bindings:
        raise CommandError(f"{table.source.label} has no column of numbers beside that of times.")
    booleans = [name for binding, name in bindings if binding.type.kind == "Boolean"]
    # the compiled table has one kind of outputs
    if 0 < len(booleans) < len(bindings):
        raise CommandError(
            f"{table.source.label} has Booleans ({join_names(booleans[:8])}) beside numbers, but an FMU of "
            f"data has outputs of one type; name them, as in '{table.source.file}:{booleans[0]}'."
        )
    if path.exists():
        OutputFile(path, "the FMU", _is_table_fmu, overwrite)
    notes = [f"{table.source.label} {note}." for note in table.data.notes]
    if texts:
        names = join_names(texts[:8])
        notes.append(f"{table.source.label} has columns of texts, which are left out: {names}.")
    content = replace(_make_content(table, bindings), name=path.stem, fmi=fmi)
    return _build(content, path, platforms, table.source.label), notes


def _bind_output(name: str, column: Column, table: LoadedInput) -> ColumnBinding:
    """Return the binding of an output, in the unit of its column."""
    position, column = find_column(table.source, table.data, column)
    header = table.data.headers[position]
    label = f"the column '{header.text}' of {table.data.label}"
    unit = rate_of(parse_data_unit(column.unit, label), column.derivative)
    type_ = table.data.types.get(header.name, REAL)
    order, is_discrete = column.derivative, type_ != REAL
    return ColumnBinding(
        name, "", name, True, position, order, IDENTITY, unit, is_discrete=is_discrete, type=type_
    )


def _make_content(table: LoadedInput, driven: Sequence[tuple[ColumnBinding, str]]) -> TableContent:
    """Return the columns and outputs of an FMU; bindings of one column share it."""
    columns: dict[tuple[int, str, str], TableColumn] = {}
    outputs = []
    table.data.load([binding.column for binding, _ in driven if binding.type.kind == "Real"])
    for binding, output in driven:
        # a discrete variable has no values between rows
        interpolation = "held" if binding.is_discrete else table.source.interpolation
        key = binding.column, interpolation, repr(binding.type)
        if key not in columns:
            values = table.data.values(binding.column, binding.type, limits=_INTEGERS)
            columns[key] = TableColumn(values, interpolation)
        _check_size(table.data, binding, columns[key].values)
        outputs.append(
            TableOutput(
                output,
                list(columns).index(key),
                binding.order,
                binding.transformation.factor,
                binding.transformation.offset,
                binding.unit,
                f"Column '{table.data.headers[binding.column].text}'",
                binding.type.kind,
                binding.type.items,
            )
        )
    return TableContent(table.times, list(columns.values()), outputs, table.source.end)


def _build(content: TableContent, path: Path, platforms: Sequence[str], label: str) -> Path:
    from fmublock.table import build_table  # slow to import, and few runs need it

    try:
        return build_table(content, path, platforms, producer(), license_text())
    except ImportError as error:
        raise explain_missing(error, f"the FMU of {label}") or error from error
    except (BuildError, CacheError) as error:
        raise RunError(f"the FMU of {label} could not be built: {error}") from error


def _is_table_fmu(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return _DATA in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _check_size(data: DataTable, binding: ColumnBinding, values: Vector) -> None:
    """Raise CommandError for values so large that arithmetic could overflow."""
    unit = binding.transformation
    with np.errstate(over="ignore"):
        beyond = ~(np.abs(unit.factor * values + unit.offset) <= _LARGEST)
    if beyond.any():
        row, header = int(beyond.argmax()) + 1, data.headers[binding.column].text
        raise CommandError(
            f"{data.label} has {values[row - 1]:g} in row {row} of the column '{header}', which drives "
            f"{binding.signal}; it must be within -{_LARGEST:g} and {_LARGEST:g} in the unit of the signal.",
            row=row,
            column=header,
        )


_fmu_folders = ExitStack()


@cache
def _folder() -> Path:
    """Return the folder of the tables' FMUs, which is removed when this process ends."""
    return _fmu_folders.enter_context(temporary_folder("tables"))
