"""Tables of numbers over time, from files and from Python."""

import codecs
import contextlib
import csv
import io
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.errors import CommandError, join_names
from ..base.files import read_file
from ..base.signal_types import SignalType
from ..base.wording import format_count
from ..recorders.registry import TABLES, format_of
from ..recorders.stored import readable
from ..recorders.table import Table
from .clock_times import is_clock, read_clock, seconds_from_first
from .csv_layout import NUMBER, OTHER_TIME_NAMES, TIME_NAMES, bare_unit, find_layout
from .headers import Header, is_same_unit, read_metadata_units
from .input import Input
from .measurement_files import TIME, ChannelGroup, choose_group, is_measurement_file, read_groups

_LATEST = 1e100
"""The largest time in s; differences of greater ones can overflow."""

_PARQUET = b"PAR1"
_HEAD = 16
"""The number of bytes by which formats are told apart."""
_DECIMAL_COMMA = r"^([-+]?[0-9]*),([0-9]*(?:[eE][-+]?[0-9]+)?)$", "${1}.${2}"
"""A number with a decimal comma, and its replacement."""


class DataTable:
    """Columns of a table.

    Attributes:
        label: Its name in error messages.
        headers: The headers of its columns.
        notes: What users should know of how it was read; phrases that follow its name.
    """

    def __init__(self, label: str, names: Sequence[str], units: Mapping[str, str] | None = None) -> None:
        self.label = label
        self.notes: list[str] = []
        self.headers = [Header.of(name, (units or {}).get(name)) for name in names]

    def texts(self, position: int) -> polars.Series:
        """Return a column as in the source, with numbers or texts of numbers."""
        raise NotImplementedError

    def numbers(self, position: int, padded: bool = False) -> Vector:
        """Return a column as finite numbers.

        Args:
            position: The position of the column.
            padded: Whether to drop empty cells at its end.

        Raises:
            CommandError: If a cell is not a finite number; the message names row and column.
        """
        found = self.texts(position)
        return self._to_numbers(position, found.head(_count_filled(found)) if padded else found)

    def values(self, position: int, type_: SignalType) -> Vector:
        """Return a column as the numbers of values of a type.

        Booleans may be written as true and false, and values of an enumeration by their names.

        Raises:
            CommandError: If a cell is not a value of the type; the message names row and column.
        """
        if type_.kind == "Real":
            return self.numbers(position)
        words = {"true": 1, "false": 0} if type_.kind == "Boolean" else {n: v for v, n in type_.items.items()}
        texts = self.texts(position)
        if texts.dtype == polars.String and words:
            exact = {str(word): str(number) for word, number in words.items()}
            if type_.kind == "Boolean":
                texts = texts.str.to_lowercase()
            texts = texts.replace(exact)
        elif texts.dtype == polars.Boolean:
            texts = texts.cast(polars.Float64)
        numbers = self._to_numbers(position, texts)
        limit = {"Boolean": (0, 1)}.get(type_.kind, (-(2**31), 2**31 - 1))
        fits = (numbers == np.round(numbers)) & (numbers >= limit[0]) & (numbers <= limit[1])
        if type_.items:
            fits &= np.isin(numbers, list(type_.items))
        if not fits.all():
            row = int(np.argmin(fits)) + 1
            header = self.headers[position].text
            article = "an" if type_.kind[0] in "EI" else "a"
            raise CommandError(
                f"{self.label} has {numbers[row - 1]:g} in row {row} of the column '{header}', which is not "
                f"{article} {type_.kind}.",
                row=row,
                column=header,
            )
        return numbers

    def _to_numbers(self, position: int, found: polars.Series) -> Vector:
        """Return the texts of a column as numbers; raise CommandError as `numbers`."""
        if not (found.dtype.is_numeric() or found.dtype == polars.String):
            raise self._wrong(position, f"is of the type {found.dtype}; it must be of numbers")
        try:
            numbers = found.cast(polars.Float64, strict=False)
        except polars.exceptions.PolarsError as error:
            raise self._wrong(position, "cannot be read as numbers") from error
        bad = numbers.is_null() | ~numbers.is_finite()
        if (row := bad.arg_max()) is not None and bad[row]:
            raise self._bad(position, row, found[row])
        return numbers.to_numpy()

    def times(self, column: str | None) -> tuple[int, Vector]:
        """Return the position of the column of times, and the times in s.

        Clock times and dates become times from the first row. Rows with the same time are an event.

        Args:
            column: The name of the column; default: `time` or `t`.

        Raises:
            CommandError: If there is no such column, or the times decrease.
        """
        position = self._time_column(column)
        header = self.headers[position]
        texts = self.texts(position)
        times = self._clock_times(position, texts)
        if times is None:
            times = header.in_seconds(self._to_numbers(position, texts), column, self.label)
        if len(times) < 2:
            raise CommandError(f"{self.label} has fewer than two rows.")
        if max(abs(times[0]), abs(times[-1])) > _LATEST:
            raise CommandError(f"{self.label} has times beyond {_LATEST:g} s.")
        if (back := np.flatnonzero(~(np.diff(times) >= 0.0))).size:
            row = int(back[0]) + 1
            raise CommandError(
                f"{self.label} has the time {times[row]:.9g} s in row {row + 1}, after "
                f"{times[row - 1]:.9g} s; times must not decrease.",
                row=row + 1,
            )
        if not times[-1] > times[0]:
            raise CommandError(
                f"{self.label} has the time {times[0]:.9g} s in all rows; times must increase."
            )
        return position, times

    def find(self, name: str) -> int | None:
        """Return the position of a column by its whole header or by its name, None if there is none.

        Raises:
            CommandError: If several columns have the name.
        """
        for called in (_whole_text, _name, _name_before_unit):
            found = [i for i, header in enumerate(self.headers) if called(header) == name]
            if len(found) > 1:
                raise CommandError(
                    f"{self.label} has {len(found)} columns '{name}'; each needs its own name."
                )
            if found:
                return found[0]
        return None

    def _clock_times(self, position: int, column: polars.Series) -> Vector | None:
        """Return the times of a column of clock times, from the first row; None for one of numbers."""
        label = f"the time '{self.headers[position].text}' of {self.label}"
        if not len(column) or not (column.dtype.is_temporal() or is_clock(column[0])):
            return None
        if (missing := column.is_null()).any():
            raise self._bad(position, int(missing.arg_max() or 0), None)
        if not column.dtype.is_temporal():
            return read_clock(column, label)
        if column.dtype == polars.Date:
            raise self._wrong(position, "has dates without clock times")
        return seconds_from_first(column)

    def _time_column(self, column: str | None) -> int:
        if column is not None:
            wanted = Header.of(column)
            for name in (column, wanted.name):
                if (position := self.find(name)) is not None:
                    return position
            raise CommandError(f"{self.label} has no column '{column}'; it has {_join_few(self.headers)}.")
        found = self._called(TIME_NAMES) or self._called(OTHER_TIME_NAMES)
        if len(found) != 1:
            raise CommandError(
                f"{self.label} has {'no column' if not found else 'several columns'} called time or t, but "
                f'{_join_few(self.headers)}; name the column of times, as in time = "seconds".'
            )
        return found[0]

    def _called(self, names: Sequence[str]) -> list[int]:
        """Return the positions of the columns with one of these names."""
        return [
            i
            for i, h in enumerate(self.headers)
            if h.name.lower() in names or (h.suffix is not None and h.suffix.name.lower() in names)
        ]

    def _bad(self, position: int, row: int, value: Any) -> CommandError:
        what = "nothing" if value is None or str(value).strip() == "" else f"'{str(value)[:40]}'"
        hint = ""
        if row == 0 and isinstance(value, str) and not NUMBER.fullmatch(value):
            hint = " (write units in the header, as in 'Force [kN]')"
        return CommandError(
            f"{self.label} has {what} in row {row + 1} of the column '{self.headers[position].text}'; "
            f"it must be a finite number{hint}.",
            row=row + 1,
            column=self.headers[position].text,
        )

    def _wrong(self, position: int, problem: str) -> CommandError:
        return CommandError(f"the column '{self.headers[position].text}' of {self.label} {problem}.")


def _whole_text(header: Header) -> str:
    return header.text


def _name(header: Header) -> str:
    return header.name


def _name_before_unit(header: Header) -> str | None:
    return None if header.suffix is None else header.suffix.name


def _count_filled(column: polars.Series) -> int:
    """Return the number of cells up to the last one that is not empty."""
    empty = column.is_null()
    if column.dtype == polars.String:
        empty |= column.str.strip_chars() == ""
    filled = np.flatnonzero(~empty.to_numpy())
    return int(filled[-1]) + 1 if filled.size else 0


def _join_few(headers: Sequence[Header]) -> str:
    names = [f"'{h.name}'" for h in headers]
    return (
        join_names(names if len(names) <= 8 else [*names[:8], f"{len(names) - 8} more"]) if names else "none"
    )


class CsvTable(DataTable):
    """A text of rows below a row of names; the delimiter is the semicolon, the tab or the comma.

    Where it is the semicolon or the tab, numbers may have a decimal comma. Lines that
    begin with # are comments. Other lines may precede the names, and a row of units may follow them.
    """

    def __init__(self, label: str, content: bytes) -> None:
        text, encoding = _decode(content)
        if "\0" in text:
            raise CommandError(f"{label} is not a text file; it must be CSV or Parquet.")
        self._content = text.rstrip().replace("\r\n", "\n").replace("\r", "\n").encode()
        layout = find_layout(self._content)
        if layout is None:
            raise CommandError(f"{label} is empty.")
        self._begin, self._delimiter = layout.begin, layout.delimiter
        if all(NUMBER.fullmatch(name) for name in layout.names):
            raise CommandError(
                f"{label} begins with numbers; its first row must have the names of the columns."
            )
        super().__init__(label, layout.names)
        if layout.units:
            self._apply_units([bare_unit(cell) for cell in layout.units])
        if layout.skipped:
            lines = format_count(layout.skipped, "line")
            self.notes.append(f"has {lines} before its header, which {_are(layout.skipped)} skipped")
        if encoding is not None:
            self.notes.append(f"is not UTF-8; it is read as {encoding}")

    def _apply_units(self, units: Sequence[str]) -> None:
        """Use the row of units for columns without a unit in their header."""
        for position, (header, unit) in enumerate(zip(self.headers, units, strict=True)):
            if header.unit is not None and unit and not is_same_unit(header.unit, unit):
                raise self._wrong(
                    position, f"has the unit '{unit}' in its row of units, and another one before"
                )
            if header.unit is None and (unit or header.suffix is None):
                self.headers[position] = Header(header.text, header.name, unit)

    def texts(self, position: int) -> polars.Series:
        """Return a column of texts.

        Raises:
            CommandError: If a row has more fields than the header.
        """
        if not self._frame.width:
            return polars.Series(dtype=polars.String)
        found = self._frame[:, position].str.strip_chars()
        return found if self._delimiter == "," else found.str.replace(*_DECIMAL_COMMA)

    @cached_property
    def _frame(self) -> polars.DataFrame:
        names = [f"column_{i}" for i in range(len(self.headers))]
        try:
            return polars.read_csv(
                io.BytesIO(self._content[self._begin :]),
                has_header=False,
                schema=dict.fromkeys(names, polars.String),
                separator=self._delimiter,
                comment_prefix="#",
            )
        except polars.exceptions.NoDataError:
            return polars.DataFrame(schema=dict.fromkeys(names, polars.String))
        except polars.exceptions.PolarsError as error:
            raise CommandError(f"{self.label} {self._reason()}.") from error

    def _reason(self) -> str:
        """Return why it cannot be read as a table."""
        width = len(self.headers)
        for number, row in enumerate(csv.reader(self._rows(), delimiter=self._delimiter)):
            if len(row) != width:
                return f"has {len(row)} fields in row {number + 1}, but its header has {width}"
        return "cannot be read as a table"

    def _rows(self) -> Any:
        lines = io.StringIO(self._content[self._begin :].decode())
        return (line for line in lines if line.strip() and not line.startswith("#"))


def _decode(content: bytes) -> tuple[str, str | None]:
    """Return a text, and its encoding if it is not UTF-8."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        with contextlib.suppress(UnicodeDecodeError):
            return content.decode("utf-16"), "UTF-16"
    try:
        return content.decode("utf-8-sig"), None
    except UnicodeDecodeError:
        pass
    try:
        return content.decode("cp1252"), "Windows-1252 (Latin-1)"
    except UnicodeDecodeError:
        return content.decode("latin-1"), "Latin-1"


def _are(count: int) -> str:
    return "is" if count == 1 else "are"


class ParquetTable(DataTable):
    """A Parquet file; its metadata can have the units of its columns, as in results.parquet."""

    def __init__(self, label: str, content: bytes) -> None:
        self._content = content
        try:
            names = list(polars.read_parquet_schema(io.BytesIO(content)))
            metadata = polars.read_parquet_metadata(io.BytesIO(content))
        except Exception as error:  # polars raises many types
            raise CommandError(f"{label} is not a Parquet file that can be read.") from error
        super().__init__(label, names, read_metadata_units(metadata))
        self._names = names

    def texts(self, position: int) -> polars.Series:
        """Return a column.

        Raises:
            CommandError: If it is damaged.
        """
        try:
            return polars.read_parquet(io.BytesIO(self._content), columns=[position]).to_series()
        except Exception as error:  # polars raises many types
            raise self._wrong(position, "cannot be read") from error


class RegisteredData(DataTable):
    """A file in a registered format of `TABLES` other than CSV and Parquet."""

    def __init__(self, label: str, table: Table) -> None:
        self._table = table
        readable(label, table.open)
        super().__init__(label, table.names)

    def texts(self, position: int) -> polars.Series:
        """Return a column.

        Raises:
            CommandError: If it is damaged.
        """
        name = self.headers[position].text
        return polars.Series(readable(self.label, lambda: self._table.read([name])[name]))


class FrameTable(DataTable):
    """Columns from Python: a frame of polars or pandas, or a mapping of names to arrays."""

    def __init__(self, label: str, frame: Any) -> None:
        names = list(frame) if isinstance(frame, Mapping) else list(frame.columns)
        if wrong := [name for name in names if not isinstance(name, str)]:
            raise CommandError(f"{label} has a column called {wrong[0]!r}; names must be texts.")
        super().__init__(label, names)
        self._frame, self._names = frame, names

    def texts(self, position: int) -> polars.Series:
        """Return a column.

        Raises:
            CommandError: If it is not a list of numbers.
        """
        column = self._frame[self._names[position]]
        if np.asarray(column).dtype.kind in "mM":
            return polars.Series(np.asarray(column).astype(f"{np.asarray(column).dtype.kind}8[ns]"))
        try:
            values = np.asarray(column, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise self._wrong(position, "must be of numbers") from error
        if values.ndim != 1:
            raise self._wrong(position, "must have one number in a row")
        return polars.Series(values)


class MeasurementTable(DataTable):
    """A group of channels of an MDF or TDMS file."""

    def __init__(self, label: str, group: ChannelGroup) -> None:
        self._group = group
        units = {c.name: c.unit for c in group.channels if c.unit is not None}
        super().__init__(label, [c.name for c in group.channels], units)

    def texts(self, position: int) -> polars.Series:
        """Return a channel.

        Raises:
            CommandError: If it cannot be read, or was not sampled at the times of its group.
        """
        channel = self._group.channels[position]
        if position == 0 and channel.name == TIME:
            values, times = self._times, None
        else:
            values, times = readable(f"the channel '{channel.name}' of {self.label}", channel.read)
        if values.ndim != 1 or values.dtype.kind not in "biufmM":
            raise self._wrong(position, "is not of numbers")
        if times is not None and not np.array_equal(times, self._times):
            raise self._wrong(
                position,
                f"has {len(values)} samples that are not at the {len(self._times)} times of its group; some "
                "may be marked as invalid",
            )
        return polars.Series(
            values.astype(f"{values.dtype.kind}8[ns]") if values.dtype.kind in "mM" else values
        )

    @cached_property
    def _times(self) -> Vector:
        first = self._group.channels[0]
        values = readable(f"the times of {self.label}", first.read)[0]
        return values if first.name == TIME else np.empty(0)


def read_data(source: Input) -> DataTable:
    """Return the table of an input.

    Raises:
        CommandError: If its file cannot be read as a table.
    """
    if source.file is None:
        return FrameTable(source.label, source.data)
    names = [_channel_name(column.column) for column in source.signals.values()]
    names += [] if source.time is None else [Header.of(source.time).name]
    return read_table(source.file, "the input", [*names, *source.columns])


def _channel_name(text: str) -> str:
    """Return the name of the column in a text such as `der(x [mm])`."""
    text = text.strip()
    while text.startswith("der(") and text.endswith(")"):
        text = text[4:-1].strip()
    return Header.of(text).name


def read_table(file: Path, what: str, columns: Sequence[str] = ()) -> DataTable:
    """Return the table of a CSV or Parquet file, a measurement file, or one in a registered format.

    Args:
        file: The file.
        what: What error messages call it.
        columns: Names or patterns of columns to read; they choose the group of a measurement file.

    Raises:
        CommandError: If it cannot be read as a table.
    """
    label = f"{what} '{file}'"
    begin = read_file(file, what, _HEAD)
    if (form := format_of(file)) not in ("csv", "parquet"):
        return RegisteredData(label, TABLES[form](file))
    if is_measurement_file(begin):  # those can be larger than the memory
        return MeasurementTable(label, choose_group(read_groups(file, begin, label), columns, label))
    content = read_file(file, what)
    if content.startswith(_PARQUET) or file.suffix.lower() == ".parquet":
        return ParquetTable(label, content)
    return CsvTable(label, content)
