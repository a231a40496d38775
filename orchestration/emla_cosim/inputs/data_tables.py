"""Tables of values over time: their columns as numbers, in the units and types of signals."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars

from ..base.arrays import REAL, SignalType, Vector
from ..base.errors import CommandError, join_names, suggest_names
from ..base.quantities import resolve_conversion
from ..base.units import LinearTransformation, SiUnit
from ..base.wording import format_count, shorten_line
from ..system.structure import find_indices
from .csv_layout import NUMBER
from .headers import Header, parse_data_unit, rate_of

ReadColumns = Callable[[Sequence[int], bool], Sequence[polars.Series]]
"""Returns columns by position: numbers that are written as texts as numbers if possible, or as texts."""

_DECIMAL_COMMA = r"^([-+]?[0-9]*),([0-9]*(?:[eE][-+]?[0-9]+)?)$", "${1}.${2}"
"""A number with a decimal comma, and its replacement."""

_LETTERS = 60
"""Most letters of a name in a message."""

_MOST_NAMES = 8
"""Most columns that a message names."""


class DataTable:
    """Columns of a table.

    Args:
        label: Its name in error messages.
        headers: The headers of its columns.
        read: Returns columns of the source.
        lists: The number of elements in the cells of columns with lists, by position. Such a column is a
            column for each element.
        has_decimal_commas: Whether texts of numbers may have decimal commas.
        types: The types of its columns by name, as far as the source has them.

    Attributes:
        label: Its name in error messages.
        headers: The headers of its columns.
        notes: What users should know of how it was read; phrases that follow its name.
        types: The types of its columns by name.
    """

    def __init__(
        self,
        label: str,
        headers: Sequence[Header],
        read: ReadColumns,
        lists: Mapping[int, int] | None = None,
        has_decimal_commas: bool = False,
        types: Mapping[str, SignalType] | None = None,
    ) -> None:
        self.label = label
        self.notes: list[str] = []
        self.headers: list[Header] = []
        self.types = dict(types or {})
        self._sources: list[tuple[int, int | None]] = []
        for position, header in enumerate(headers):
            count = (lists or {}).get(position)
            for element in (None,) if count is None else range(count):
                index = "" if element is None else f"[{element + 1}]"
                self.headers.append(Header(header.text, f"{header.name}{index}", header.unit))
                self._sources.append((position, element))
        self._counts = lists or {}
        self._read, self._has_decimal_commas = read, has_decimal_commas
        self._columns: dict[tuple[int, bool], polars.Series] = {}

    def match_names(self, allowed: Collection[str], prefix: str = "") -> None:
        """Give columns the names of variables: columns of lists those of the elements of their array.

        A header that is the name of a variable has no unit.

        Args:
            allowed: The names of all variables.
            prefix: Text that these names have and the columns lack.

        Raises:
            CommandError: If the cells of a column have another number of elements than the array.
        """
        arrays = {name[: m.start()] for name in allowed for m in re.finditer(r"\[", name)}
        for position, header in enumerate(self.headers):
            source, element = self._sources[position]
            if element is None and header.text.strip() != header.name and prefix + header.text in allowed:
                header = self.headers[position] = Header(header.text, header.text)
            array = header.name if element is None else header.name.rpartition("[")[0]
            if prefix + array not in arrays or not (indices := find_indices(prefix + array, allowed)):
                continue
            if len(indices) != (count := self._counts.get(source, 1)):
                if element is None:
                    continue  # its numbers can drive another signal
                raise self.wrong_count(header.text, count, array, len(indices))
            self.headers[position] = replace(header, name=f"{array}{indices[element or 0]}")

    def find_list(self, name: str) -> list[str]:
        """Return the names of the columns that a column of lists consists of; none for other columns."""
        return [
            header.name
            for header, (_, element) in zip(self.headers, self._sources, strict=True)
            if element is not None and name in (header.text, header.name.rpartition("[")[0])
        ]

    def load(self, positions: Sequence[int]) -> None:
        """Read several columns of numbers at once: one by one, a text is parsed again for each."""
        columns = dict.fromkeys(self._sources[p][0] for p in positions)
        sources = [s for s in columns if s not in self._counts and (s, False) not in self._columns]
        for source, column in zip(sources, self._read(sources, False) if sources else (), strict=True):
            self._columns[source, False] = column

    def cells(self, position: int, as_text: bool = False) -> polars.Series:
        """Return a column as in the source: of numbers, or of texts, which may be of numbers.

        Args:
            position: The position of the column.
            as_text: Whether texts of numbers stay texts.

        Raises:
            CommandError: If the table cannot be read, or a row has another number of elements.
        """
        source, element = self._sources[position]
        key = source, as_text or element is not None
        if key not in self._columns:
            (column,) = self._read([source], key[1])
            # lists stay lists: their text would have to be parsed again
            as_written = not key[1] or column.dtype.is_nested()
            self._columns[key] = column if as_written else column.cast(polars.String)
        column = self._columns[key]
        if column.dtype == polars.String:
            column = column.str.strip_chars()
        if element is not None:
            column = self._parse_elements(position, column).list.get(element, null_on_oob=True)
        if column.dtype == polars.String and self._has_decimal_commas and not as_text:
            column = column.str.replace(*_DECIMAL_COMMA)
        return column

    def numbers(self, position: int, padded: bool = False, has_gaps: bool = False) -> Vector:
        """Return a column as numbers.

        Args:
            position: The position of the column.
            padded: Whether to drop empty cells at its end.
            has_gaps: Whether cells may be empty or not finite; empty ones are NaN.

        Raises:
            CommandError: If a cell is not a finite number; the message names row and column.
        """
        column = self.cells(position)
        if padded:
            filled = (column.cast(polars.String).fill_null("") != "").arg_true()
            column = column.head(filled[-1] + 1 if len(filled) else 0)
        return self._to_numbers(position, column, has_gaps)

    def values(
        self,
        position: int,
        type_: SignalType = REAL,
        has_gaps: bool = False,
        limits: tuple[float, float] = (-np.inf, np.inf),
    ) -> Any:
        """Return a column as the numbers of values of a type, or as texts for a String.

        Booleans may be written as true and false, and values of an enumeration by their names.

        Args:
            position: The position of the column.
            type_: The type.
            has_gaps: Whether cells may be empty or not finite; empty ones are NaN.
            limits: The smallest and the largest Integer.

        Raises:
            CommandError: If a cell is not a value of the type; the message names row and column.
        """
        if type_.kind == "Real":
            return self.numbers(position, has_gaps=has_gaps)
        if type_.is_text:
            return self.cells(position, as_text=True).fill_null("").to_numpy()
        column = self.cells(position)
        if column.dtype == polars.String:
            words = {name: str(number) for number, name in type_.items.items()}
            if type_.kind == "Boolean":
                words, column = {"true": "1", "false": "0"}, column.str.to_lowercase()
            column = column.replace(words)
        elif column.dtype == polars.Boolean:
            column = column.cast(polars.Float64)
        numbers = self._to_numbers(position, column, has_gaps, type_)
        low, high = (0, 1) if type_.kind == "Boolean" else limits
        fits = (numbers == np.round(numbers)) & (numbers >= low) & (numbers <= high)
        if type_.items:
            fits &= np.isin(numbers, list(type_.items))
        fits |= has_gaps & np.isnan(numbers)
        if not fits.all():
            row, header = int(np.argmin(fits)) + 1, self.headers[position].text
            article = "an" if type_.kind[0] in "EI" else "a"
            bounds = f" from {low:.0f} to {high:.0f}" if type_.kind == "Integer" and high < np.inf else ""
            raise CommandError(
                f"{self.label} has {numbers[row - 1]:g} in row {row} of the column '{header}', which is not "
                f"{article} {type_.kind}{bounds}.",
                row=row,
                column=header,
            )
        return numbers

    def conversion(
        self, position: int, signal: str, unit: SiUnit | None, declared: str | None = None, order: int = 0
    ) -> tuple[LinearTransformation, bool]:
        """Return the conversion of a column to the unit of a signal, and whether the column has no unit.

        Args:
            position: The position of the column.
            signal: The signal.
            unit: Its unit.
            declared: The unit that the user declares.
            order: The order of the time derivative of the column that is to have the unit.

        Raises:
            CommandError: If the units measure different things, or the header only seems to have a unit.
        """
        header = self.headers[position]
        label = f"the column '{header.text}' of {self.label}"
        target = rate_of(unit, -order)
        measured = parse_data_unit(declared or header.unit, label, target)
        if measured is None and header.name not in (signal, signal.partition(".")[2]):
            header.check_unit_like_end(target, label, signal, f"{signal}={header.text}")
        measured = rate_of(measured, order)
        between = resolve_conversion(measured, unit, f"{label} for {signal}")
        return between, measured is None and unit is not None

    def in_unit(
        self,
        position: int,
        signal: str,
        unit: SiUnit | None,
        declared: str | None = None,
        has_gaps: bool = False,
    ) -> tuple[Vector, bool]:
        """Return a column in the unit of a signal, and whether the column has no unit; see `conversion`."""
        between, is_assumed = self.conversion(position, signal, unit, declared)
        return between.factor * self.numbers(position, has_gaps=has_gaps) + between.offset, is_assumed

    def find(self, name: str) -> int | None:
        """Return the position of a column by its whole header or by its name, None if there is none.

        Raises:
            CommandError: If several columns have the name.
        """
        for texts in ([h.text for h in self.headers], [h.name for h in self.headers]):
            positions = [i for i, text in enumerate(texts) if text == name]
            if len(positions) > 1:
                raise CommandError(
                    f"{self.label} has {len(positions)} columns '{name}'; each needs its own name."
                )
            if positions:
                return positions[0]
        return None

    def _parse_elements(self, position: int, column: polars.Series) -> polars.Series:
        """Return lists of the elements in cells. Raise CommandError if a row has another number of them."""
        if column.dtype == polars.String:
            column = column.str.replace_all(r"\s+", " ").str.split(" ")
        elif isinstance(column.dtype, polars.Array):
            column = column.arr.to_list()
        count = self._counts[self._sources[position][0]]
        differs = column.list.len().fill_null(0) != count
        if (row := differs.arg_max()) is not None and differs[row]:
            raise self._make_cell_error(
                position, f"has {column.list.len()[row]} numbers in row {row + 1}, and {count} in row 1"
            )
        return column

    def _to_numbers(
        self, position: int, column: polars.Series, has_gaps: bool = False, type_: SignalType = REAL
    ) -> Vector:
        """Return the cells of a column as numbers; raise CommandError as `numbers`."""
        if not (column.dtype.is_numeric() or column.dtype in (polars.String, polars.Null)):
            raise self._make_cell_error(position, f"is of the type {column.dtype}; it must be of numbers")
        try:
            numbers = column.cast(polars.Float64, strict=False)
        except polars.exceptions.PolarsError as error:
            raise self._make_cell_error(position, "cannot be read as numbers") from error
        bad = numbers.is_null() | (~numbers.is_finite()).fill_null(True)
        if has_gaps:
            bad = numbers.is_null() & ~(column.is_null() | (column.cast(polars.String) == "").fill_null(True))
        if (row := bad.arg_max()) is not None and bad[row]:
            raise self.wrong_cell(position, row, self.cells(position, as_text=True)[row], type_)
        return numbers.fill_null(np.nan).to_numpy()

    def join_names(self) -> str:
        """Return the names of the first columns for a message."""
        names = [f"'{shorten_line(h.name, _LETTERS)}'" for h in self.headers if h.name]
        if len(names) > _MOST_NAMES:
            names = [*names[:_MOST_NAMES], f"{len(names) - _MOST_NAMES} more"]
        return join_names(names) if names else "none"

    def wrong_cell(self, position: int, row: int, value: Any, type_: SignalType = REAL) -> CommandError:
        """Return the error of a cell that is not a value of a type; rows count from 0."""
        text = "nothing" if value is None or str(value).strip() == "" else f"'{str(value)[:40]}'"
        values = {"Boolean": "true, false, 1 or 0", "Integer": "a whole number"}
        names = type_.items.values()
        right = f"one of {join_names(names)}" if names else values.get(type_.kind, "a finite number")
        if row == 0 and type_.kind == "Real" and isinstance(value, str) and not NUMBER.fullmatch(value):
            right += " (write units in the header, as in 'Force [kN]')"
        return CommandError(
            f"{self.label} has {text} in row {row + 1} of the column '{self.headers[position].text}'; "
            f"it must be {right}.",
            row=row + 1,
            column=self.headers[position].text,
        )

    def wrong_count(self, column: str, count: int, array: str, size: int) -> CommandError:
        """Return the error of a column whose cells have another number of elements than an array."""
        numbers, elements = format_count(max(count, 1), "number"), format_count(max(size, 1), "element")
        return CommandError(
            f"the column '{column}' of {self.label} has {numbers} in each cell, but {array} has {elements}.",
            signal=array,
        )

    def no_column(self, name: str) -> CommandError:
        """Return the error of a name that no column has."""
        suggestions = suggest_names(name, [h.name for h in self.headers], f"it has {self.join_names()}.")
        return CommandError(f"{self.label} has no column '{name}'; {suggestions}", name=name)

    def _make_cell_error(self, position: int, problem: str) -> CommandError:
        return CommandError(f"the column '{self.headers[position].text}' of {self.label} {problem}.")
