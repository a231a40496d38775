"""Tables of numbers over time, from files and from Python."""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.errors import CommandError, join_names
from ..base.files import read_file
from ..recorders.registry import TABLES, format_of
from ..recorders.stored import readable
from ..recorders.table import Table
from .headers import Header, read_metadata_units
from .input import Input

_LATEST = 1e100
"""The largest time in s; differences of greater ones can overflow."""

_PARQUET = b"PAR1"
_NUMBER = re.compile(r"\s*[-+]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?\s*")
_DECIMAL_COMMA = r"^([-+]?[0-9]*),([0-9]*(?:[eE][-+]?[0-9]+)?)$", "${1}.${2}"
"""A number with a decimal comma, and its replacement."""


class DataTable:
    """Columns of a table. `headers` are the headers of its columns, `label` is its name in error messages."""

    def __init__(self, label: str, names: Sequence[str], units: Mapping[str, str] | None = None) -> None:
        self.label = label
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
        if padded:
            found = found.head(_count_filled(found))
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

        Args:
            column: The name of the column; default: `time` or `t`.

        Raises:
            CommandError: If there is no such column, or the times do not increase.
        """
        position = self._time_column(column)
        header = self.headers[position]
        times = header.in_seconds(self.numbers(position), column, self.label)
        if len(times) < 2:
            raise CommandError(f"{self.label} has fewer than two rows.")
        if max(abs(times[0]), abs(times[-1])) > _LATEST:
            raise CommandError(f"{self.label} has times beyond {_LATEST:g} s.")
        if (still := np.flatnonzero(~(np.diff(times) > 0.0))).size:
            row = int(still[0]) + 1
            raise CommandError(
                f"{self.label} has the time {times[row]:.9g} s in row {row + 1}, after "
                f"{times[row - 1]:.9g} s; times must increase.",
                row=row + 1,
            )
        return position, times

    def find(self, name: str) -> int | None:
        """Return the position of a column by its whole header or by its name, None if there is none.

        Raises:
            CommandError: If several columns have the name.
        """
        for called in ([h.text for h in self.headers], [h.name for h in self.headers]):
            found = [i for i, text in enumerate(called) if text == name]
            if len(found) > 1:
                raise CommandError(
                    f"{self.label} has {len(found)} columns '{name}'; each needs its own name."
                )
            if found:
                return found[0]
        return None

    def _time_column(self, column: str | None) -> int:
        if column is not None:
            wanted = Header.of(column)
            for name in (column, wanted.name):
                if (position := self.find(name)) is not None:
                    return position
            raise CommandError(f"{self.label} has no column '{column}'; it has {_join_few(self.headers)}.")
        found = [i for i, h in enumerate(self.headers) if h.name.lower() in ("time", "t")]
        if len(found) != 1:
            raise CommandError(
                f"{self.label} has {'no column' if not found else 'several columns'} called time or t, but "
                f'{_join_few(self.headers)}; name the column of times, as in time = "seconds".'
            )
        return found[0]

    def _bad(self, position: int, row: int, value: Any) -> CommandError:
        what = "nothing" if value is None or str(value).strip() == "" else f"'{str(value)[:40]}'"
        hint = ""
        if row == 0 and isinstance(value, str) and not _NUMBER.fullmatch(value):
            hint = " (write units in the header, as in 'Force [kN]')"
        return CommandError(
            f"{self.label} has {what} in row {row + 1} of the column '{self.headers[position].text}'; "
            f"it must be a finite number{hint}.",
            row=row + 1,
            column=self.headers[position].text,
        )

    def _wrong(self, position: int, problem: str) -> CommandError:
        return CommandError(f"the column '{self.headers[position].text}' of {self.label} {problem}.")


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
    """A text of rows, the first one of names; the delimiter is the semicolon, the tab or the comma.

    Where it is the semicolon or the tab, numbers may have a decimal comma. Lines that
    begin with # are comments.
    """

    def __init__(self, label: str, content: bytes) -> None:
        try:
            content.decode("utf-8")
        except UnicodeDecodeError as error:
            raise CommandError(f"{label} is not a text in UTF-8; save it as such.") from error
        if b"\0" in content:
            raise CommandError(f"{label} is not a text file; it must be CSV or Parquet.")
        self._content = (
            content.removeprefix(b"\xef\xbb\xbf").rstrip().replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        )
        header = self._header()
        if not header.strip():
            raise CommandError(f"{label} is empty.")
        self._delimiter = next((d for d in ";\t" if d in header), ",")
        names = [name.strip() for name in next(csv.reader([header], delimiter=self._delimiter))]
        if all(_NUMBER.fullmatch(name) for name in names):
            raise CommandError(
                f"{label} begins with numbers; its first row must have the names of the columns."
            )
        super().__init__(label, names)

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

    def _header(self) -> str:
        """Return the first line that is neither blank nor a comment, and set `_begin` to the next line."""
        self._begin, end = 0, 0
        while end < len(self._content):
            self._begin = end
            end = self._content.find(b"\n", self._begin)
            end = len(self._content) if end < 0 else end + 1
            line = self._content[self._begin : end].strip()
            if line and not line.startswith(b"#"):
                self._begin = end
                return line.decode()
        return ""

    def _rows(self) -> Any:
        lines = io.StringIO(self._content[self._begin :].decode())
        return (line for line in lines if line.strip() and not line.startswith("#"))


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
        try:
            values = np.asarray(self._frame[self._names[position]], dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise self._wrong(position, "must be of numbers") from error
        if values.ndim != 1:
            raise self._wrong(position, "must have one number in a row")
        return polars.Series(values)


def read_data(source: Input) -> DataTable:
    """Return the table of an input.

    Raises:
        CommandError: If its file cannot be read as a table.
    """
    if source.file is None:
        return FrameTable(source.label, source.data)
    return read_table(source.file, "the input")


def read_table(file: Path, what: str) -> DataTable:
    """Return the table of a CSV or Parquet file, or of a file in a registered format.

    Args:
        file: The file.
        what: What error messages call it.

    Raises:
        CommandError: If it cannot be read as a table.
    """
    label = f"{what} '{file}'"
    content = read_file(file, what)
    if (form := format_of(file)) not in ("csv", "parquet"):
        return RegisteredData(label, TABLES[form](file))
    if content.startswith(_PARQUET) or file.suffix.lower() == ".parquet":
        return ParquetTable(label, content)
    return CsvTable(label, content)
