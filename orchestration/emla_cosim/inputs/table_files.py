"""Read tables from files and from Python: CSV, Parquet, measurement files, registered formats, frames."""

import codecs
import contextlib
import csv
import io
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import polars

from ..base.arrays import COLUMN_TYPES, SignalType, read_types
from ..base.errors import CommandError, join_names
from ..base.files import read_file
from ..base.wording import format_count
from ..recorders.registry import TABLES, format_of
from .csv_layout import NOT_FINITE, NUMBER, CsvLayout, bare_unit, find_layout, find_result_layout, is_list
from .data_tables import DataTable
from .headers import Header, is_same_unit, is_unit, read_metadata_units
from .measurement_files import TIME, ChannelGroup, choose_group, is_measurement_file, read_groups

_T = TypeVar("_T")

_PARQUET = b"PAR1"
_HEAD = 16
"""The number of bytes that identify a format."""


def read_table(file: Path, subject: str, columns: Sequence[str] = (), is_result: bool = False) -> DataTable:
    """Return the table of a CSV or Parquet file, a measurement file, or one in a registered format.

    Args:
        file: The file.
        subject: What error messages call it.
        columns: Names or patterns of columns to read; they choose the group of a measurement file.
        is_result: Whether a run wrote it: headers are names of signals, and the last line may be unfinished.

    Raises:
        CommandError: If it cannot be read as a table.
    """
    label = f"{subject} '{file}'"
    begin = read_file(file, subject, _HEAD)
    if (form := format_of(file)) not in ("csv", "parquet"):
        return _read_registered(label, form, file)
    if is_measurement_file(begin):  # those can be larger than the memory
        groups = call_reader(label, lambda: read_groups(file, begin, label))
        return _read_measurement(label, choose_group(groups, columns, label))
    if begin.startswith(_PARQUET) or file.suffix.lower() == ".parquet":
        return _read_parquet(label, file, is_result)
    return _read_csv(label, read_file(file, subject), is_result)


def call_reader(label: str, read: Callable[[], _T]) -> _T:
    """Return the result of `read`. Turn all its errors into a CommandError that begins with `label`."""
    try:
        return read()
    except CommandError:  # such as that of a package that is not installed
        raise
    except Exception as error:  # polars and the packages of measurement files raise errors of many types
        reason = getattr(error, "strerror", None) or (str(error) or type(error).__name__).splitlines()[0]
        raise CommandError(f"{label} cannot be read: {reason.rstrip('.')}.") from error


def _read_csv(label: str, content: bytes, is_result: bool = False) -> DataTable:
    """Return the table of a text of rows below a row of names.

    The delimiter is the semicolon, the tab or the comma. Where it is the semicolon or the tab, numbers may
    have a decimal comma. Lines that begin with # are comments. Other lines may precede the names, and a row
    of units may follow them.
    """
    content, encoding = _to_utf_8(content)
    if b"\0" in content:
        raise CommandError(f"{label} is not a text file; it must be CSV or Parquet.")
    # whole lines: a run may be writing the last one
    layout = find_result_layout(content[: content.rfind(b"\n") + 1]) if is_result else None
    if layout is not None:
        content = content[: content.rfind(b"\n") + 1]
    else:
        is_result = False
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in content else content
        content = content.rstrip()
        layout = find_layout(content)
    if layout is None:
        raise CommandError(f"{label} is empty.")
    if all(NUMBER.fullmatch(name) for name in layout.names):
        raise CommandError(f"{label} begins with numbers; its first row must have the names of the columns.")
    if len(layout.names) == 1 and layout.first and is_list(layout.first[0]):
        raise CommandError(f"{label} has columns separated by spaces; use commas, semicolons or tabs.")
    names = [f"column_{i}" for i in range(len(layout.names))]
    rows = content[layout.begin :]
    if rows.startswith(b"\n"):
        rows = rows.lstrip(b"\n")

    has_quotes = b'"' in rows

    def read(positions: Sequence[int], as_text: bool) -> Sequence[polars.Series]:
        first_error: Exception | None = None
        # polars panics for numbers that are a lone quote
        for kind in (polars.String,) if as_text or has_quotes else (polars.Float64, polars.String):
            try:
                frame = polars.read_csv(
                    io.BytesIO(rows),
                    has_header=False,
                    columns=[names[p] for p in positions],
                    schema=dict.fromkeys(names, polars.String) | {names[p]: kind for p in positions},
                    separator=layout.delimiter,
                    comment_prefix="#",
                )
                return [frame[names[p]] for p in positions]
            except polars.exceptions.NoDataError:
                return [polars.Series(dtype=kind) for _ in positions]
            except polars.exceptions.PolarsError as error:
                first_error = error
        raise CommandError(f"{label} {_describe_wrong_row(rows, layout)}.") from first_error

    first = dict(enumerate(layout.first)) if len(layout.first) == len(names) else {}
    lists = {i: len(cell.split()) for i, cell in first.items() if is_list(cell)}
    headers = _add_units(label, [_read_header(text, is_result) for text in layout.names], layout.units)
    types = {headers[i].name: SignalType(kind) for i, cell in first.items() if (kind := _find_kind(cell))}
    table = DataTable(label, headers, read, lists, layout.delimiter != ",", types)
    for count, where in ((layout.skipped, "before"), (layout.between, "below")):
        if count:
            are = "is" if count == 1 else "are"
            table.notes.append(f"has {format_count(count, 'line')} {where} its header, which {are} skipped")
    if encoding is not None:
        table.notes.append(f"is not UTF-8; it is read as {encoding}")
    return table


def _read_header(text: str, is_result: bool, unit: str | None = None) -> Header:
    return Header(text, text, unit) if is_result else Header.of(text, unit)


def _to_utf_8(content: bytes) -> tuple[bytes, str | None]:
    """Return a text in UTF-8, and its encoding if it is another one."""
    encoding = None
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        with contextlib.suppress(UnicodeDecodeError):
            content, encoding = content.decode("utf-16").encode(), "UTF-16"
    content = content.removeprefix(codecs.BOM_UTF8)
    try:
        content.decode()
    except UnicodeDecodeError:  # Latin-1 last: it decodes any bytes
        try:
            content, encoding = content.decode("cp1252").encode(), "Windows-1252 (Latin-1)"
        except UnicodeDecodeError:
            content, encoding = content.decode("latin-1").encode(), "Latin-1"
    return content, encoding


def _add_units(label: str, headers: Sequence[Header], units: Sequence[str]) -> Sequence[Header]:
    """Return headers with the units in the row of units, where they have none themselves."""
    if not units:
        return headers
    complete = []
    for header, unit in zip(headers, map(bare_unit, units), strict=True):
        is_written = header.unit is not None and is_unit(header.unit)
        if is_written and unit and not is_same_unit(header.unit or "", unit):
            raise CommandError(
                f"the column '{header.text}' of {label} has the unit '{unit}' in its row of units, and "
                "another one before."
            )
        name = header.name if is_written or header.unit is None else header.text.strip()
        complete.append(header if is_written else Header(header.text, name, unit))
    return complete


def _find_kind(cell: str) -> str | None:
    """Return the type of a column by its first cell, None for numbers."""
    if cell.lower() in ("true", "false"):
        return "Boolean"
    is_number = NUMBER.fullmatch(cell) or is_list(cell) or cell.lower() in NOT_FINITE
    return None if is_number or not cell else "String"


def _describe_wrong_row(content: bytes, layout: CsvLayout) -> str:
    """Return why a text cannot be read as a table, as a phrase that follows its label."""
    lines = io.StringIO(content.decode())
    rows = (line for line in lines if line.strip() and not line.startswith("#"))
    for number, row in enumerate(csv.reader(rows, delimiter=layout.delimiter), 1):
        if len(row) != len(layout.names):
            return f"has {len(row)} fields in row {number}, but its header has {len(layout.names)}"
    return "cannot be read as a table"


def _read_parquet(label: str, file: Path, is_result: bool) -> DataTable:
    """Return a Parquet file; its metadata can have units and types of its columns, as in results.parquet."""
    try:
        schema = polars.read_parquet_schema(file)
        metadata = polars.read_parquet_metadata(file)
        first = polars.scan_parquet(file).head(1).collect()
    except Exception as error:  # polars raises many types
        raise CommandError(f"{label} is not a Parquet file that can be read.") from error
    units, names = read_metadata_units(metadata), list(schema)
    # the first row decides; `DataTable` compares the others with it
    lists = {
        i: len(first[i][0])
        for i, kind in enumerate(schema.values())
        if isinstance(kind, polars.List | polars.Array) and len(first) and first[i][0] is not None
    }

    def read(positions: Sequence[int], _: bool) -> Sequence[polars.Series]:
        try:
            frame = polars.read_parquet(file, columns=[names[p] for p in positions])
        except Exception as error:  # polars raises many types
            columns = join_names([f"'{names[p]}'" for p in positions])
            raise CommandError(f"{label} cannot be read in {columns}: it is damaged.") from error
        return [frame[names[p]] for p in positions]

    kinds = {polars.String: "String", polars.Boolean: "Boolean"}
    plain = {name: SignalType(kinds[kind]) for name, kind in schema.items() if kind in kinds}
    types = plain | {n: t for n, t in read_types(metadata.get(COLUMN_TYPES)).items() if n in schema}
    return DataTable(
        label, [_read_header(n, is_result, units.get(n)) for n in names], read, lists, types=types
    )


def _read_registered(label: str, form: str, file: Path) -> DataTable:
    """Return a file in a registered format of `TABLES` other than CSV and Parquet."""
    table = TABLES[form](file)
    call_reader(label, table.open)
    names = list(table.names)

    def read(positions: Sequence[int], _: bool) -> Sequence[polars.Series]:
        columns = call_reader(label, lambda: table.read([names[p] for p in positions]))
        return [polars.Series(columns[names[p]]) for p in positions]

    return DataTable(label, [Header.of(name) for name in names], read, types=table.types)


def read_frame(label: str, frame: Any) -> DataTable:
    """Return columns from Python: a frame of polars or pandas, or a mapping of names to arrays."""
    names = list(frame) if isinstance(frame, Mapping) else list(frame.columns)
    if wrong := [name for name in names if not isinstance(name, str)]:
        raise CommandError(f"{label} has a column called {wrong[0]!r}; names must be texts.")

    def read(positions: Sequence[int], _: bool) -> Sequence[polars.Series]:
        return [_convert_array(label, names[p], np.asarray(frame[names[p]])) for p in positions]

    arrays = {i: np.shape(frame[n]) for i, n in enumerate(names) if isinstance(frame[n], np.ndarray)}
    lists = {i: shape[1] for i, shape in arrays.items() if len(shape) == 2}  # of shape (n, elements)
    return DataTable(label, [Header.of(name) for name in names], read, lists)


def _convert_array(label: str, name: str, column: np.ndarray) -> polars.Series:
    """Return an array as a column. Raise CommandError for one that is not of numbers, texts or times."""
    if column.ndim == 2 and column.dtype.kind in "biuf":
        return polars.Series(column.tolist())
    if column.ndim != 1:
        raise CommandError(f"the column '{name}' of {label} must have one number in a row.")
    if column.dtype.kind in "mM":
        return polars.Series(column.astype(f"{column.dtype.kind}8[ns]"))
    if column.dtype.kind in "OU" and all(isinstance(value, str) for value in column.tolist()):
        return polars.Series(column.tolist(), dtype=polars.String)
    try:
        return polars.Series(np.asarray(column, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise CommandError(f"the column '{name}' of {label} must be of numbers, texts or times.") from error


def _read_measurement(label: str, group: ChannelGroup) -> DataTable:
    """Return a group of channels of an MDF or TDMS file."""
    channels = group.channels

    @cache
    def group_times() -> np.ndarray:
        has_times = channels[0].name == TIME
        return call_reader(f"the times of {label}", channels[0].read)[0] if has_times else np.empty(0)

    def read_channel(position: int) -> polars.Series:
        """Return a channel. Raise CommandError if it was not sampled at the times of its group."""
        channel = channels[position]
        if position == 0 and channel.name == TIME:
            values, sampled = group_times(), None
        else:
            values, sampled = call_reader(f"the channel '{channel.name}' of {label}", channel.read)
        if values.ndim != 1 or values.dtype.kind not in "biufmM":
            raise CommandError(f"the column '{channel.name}' of {label} is not of numbers.")
        if sampled is not None and not np.array_equal(sampled, group_times()):
            raise CommandError(
                f"the column '{channel.name}' of {label} has {len(values)} samples that are not at the "
                f"{len(group_times())} times of its group; some may be marked as invalid."
            )
        kind = values.dtype.kind
        return polars.Series(values.astype(f"{kind}8[ns]") if kind in "mM" else values)

    headers = [Header.of(c.name, c.unit) for c in channels]
    return DataTable(label, headers, lambda positions, _: [read_channel(p) for p in positions])
