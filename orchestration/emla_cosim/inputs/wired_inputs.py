"""Tables in a system: their FMUs and connections."""

import zipfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from fmublock.errors import BuildError
from fmublock.table import TYPES, TableColumn, TableContent, TableOutput

from ..base.arrays import REAL, Vector
from ..base.errors import CommandError, RunError, join_names
from ..base.extras import explain_missing
from ..base.files import CacheError, temporary_folder
from ..base.output_files import OutputFile
from ..base.units import IDENTITY
from ..base.wording import find_free_name, list_few
from ..fmu.interface import Interface
from ..fmu.models import fmu_path, license_text, producer
from ..system.model import Component, Connection, System
from ..system.names import Names
from .column_bindings import ColumnBinding, bind_columns, find_column, match_columns
from .data_tables import DataTable
from .headers import parse_data_unit, rate_of
from .input import NAME, Column, Input
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
    path = _get_fmu_folder() / digest.hexdigest()[:24] / "DataTable.fmu"
    return path if path.is_file() else _build_fmu(content, path, platforms, table.source.label)


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
    return _build_fmu(content, path, platforms, table.source.label), notes


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
    """Return the columns and outputs of an FMU; bindings of one column share it.

    Raises:
        CommandError: A value is not one of the type of its signal, or too large.
    """
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
        _check_magnitudes(table.data, binding, columns[key].values)
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


def _build_fmu(content: TableContent, path: Path, platforms: Sequence[str], label: str) -> Path:
    """Return the path of the FMU that was built; raise RunError if this fails."""
    from fmublock.table import build_table  # slow to import, and few runs need it

    try:
        return build_table(content, path, platforms, producer(), license_text())
    except ImportError as error:
        raise explain_missing(error, f"the FMU of {label}") or error from error
    except (BuildError, CacheError) as error:
        raise RunError(f"the FMU of {label} could not be built: {error}") from error


def _is_table_fmu(path: Path) -> bool:
    """Return whether the file is an FMU of a table."""
    try:
        with zipfile.ZipFile(path) as archive:
            return _DATA in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _check_magnitudes(data: DataTable, binding: ColumnBinding, values: Vector) -> None:
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
def _get_fmu_folder() -> Path:
    """Return the folder of the tables' FMUs, which is removed when this process ends."""
    return _fmu_folders.enter_context(temporary_folder("tables"))


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
            raise CommandError(
                f"{binding.signal} is driven by two columns; remove one.", signal=binding.signal
            )
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
    """Return the system with a table for a component, whose inputs and start values are removed."""
    changed = replace(system.component(name), model="", fmu=fmu, parameters={}, aliases={})
    connections = tuple(x for x in system.connections if x.target != name)
    return replace(system.with_component(changed), connections=connections)


def _add_component(system: System, name: str, fmu: Path, bindings: Sequence[ColumnBinding]) -> System:
    """Return the system with a table as a further component, which drives the signals of the bindings."""
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
