"""Where the names, the units and the numbers of a text file begin, and what separates its columns."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from .clock_times import is_clock
from .headers import Header, is_dimensionless, is_unit

NUMBER = re.compile(r"\s*[-+]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?\s*")
DELIMITERS = ";\t,"
TIME_NAMES = (("time",), ("t",), ("zeit", "uhrzeit", "zeitstempel", "timestamp", "datetime"))
"""Names of the column of times in lower case; earlier ones take precedence."""

NOT_FINITE = ("nan", "inf", "-inf")
"""Numbers that are not finite, in lower case."""

_WORDS = ("", "true", "false", *NOT_FINITE)
"""Texts that a row of numbers may have."""

_QUOTED = 20
"""The number of lines that a name may have."""

_SEARCHED = 1000
"""The number of lines among which the first row of numbers is searched."""


@dataclass(frozen=True)
class CsvLayout:
    """The layout of a text file.

    Attributes:
        names: The names of the columns.
        units: The cells of the row of units; empty without such a row.
        first: The cells of the first row of numbers; empty without rows.
        delimiter: What separates the columns.
        begin: The position of the first row of numbers.
        skipped: The number of lines before the header.
        between: The number of lines between the header with its units and the numbers.
    """

    names: Sequence[str]
    units: Sequence[str]
    first: Sequence[str]
    delimiter: str
    begin: int
    skipped: int = 0
    between: int = 0


@dataclass(frozen=True)
class _Line:
    text: str
    end: int


def find_layout(content: bytes) -> CsvLayout | None:
    """Return the layout of a text; None if it has no line.

    The header is the line above the first row of numbers, or above its row of units. A text without such a
    row has its header in the first line.

    Args:
        content: UTF-8, with line ends of one character.
    """
    lines = _first_lines(content)
    if not lines:
        return None
    for row in range(1, len(lines)):
        for delimiter in DELIMITERS:
            cells = _split(lines[row].text, delimiter)
            if len(cells) > 1 and _is_row(cells):
                return _layout_above(lines, row, delimiter, cells) or _first_line_layout(lines)
    return _first_line_layout(lines)


def find_result_layout(content: bytes) -> CsvLayout | None:
    """Return the layout of a table that a run wrote; None for another one.

    Its names are kept as they are, with blanks and line ends.

    Args:
        content: Whole lines.
    """
    lines = _first_lines(content) if content.startswith(b"time,") else []
    names = _cells(lines[0].text, ",") if lines else []
    if len(names) < 2:
        return None
    first = _split(lines[1].text, ",") if len(lines) > 1 else ()
    return CsvLayout(names, (), first, ",", lines[0].end)


def is_list(cell: str) -> bool:
    """Return whether a cell has several numbers, separated by spaces: the elements of an array."""
    numbers = cell.split()
    return len(numbers) > 1 and all(NUMBER.fullmatch(number) for number in numbers)


def is_time_name(header: Header, names: Sequence[str]) -> bool:
    """Return whether a header is one of the names of times, with a unit in any form."""
    end = header.unit_like_end
    return header.name.lower() in names or (end is not None and end[0].lower() in names)


def bare_unit(cell: str) -> str:
    """Return a cell of the row of units without brackets."""
    cell = cell.strip()
    return cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()") else cell


def _first_line_layout(lines: Sequence[_Line]) -> CsvLayout:
    """Return the layout of a text whose first line is the header."""
    header = lines[0].text
    delimiter = next((d for d in DELIMITERS if d in header), DELIMITERS[-1])
    names, units, end = _split(header, delimiter), list[str](), lines[0].end
    rows = [_split(line.text, delimiter) for line in lines[1:3]]
    if rows and len(rows[0]) == len(names) and _is_units(rows[0]):
        units, end, rows = rows[0], lines[1].end, rows[1:]
    return CsvLayout(names, units, rows[0] if rows else (), delimiter, end)


def _layout_above(lines: Sequence[_Line], row: int, delimiter: str, first: Sequence[str]) -> CsvLayout | None:
    """Return the layout whose first row of numbers is this one; None if there is no header above it."""
    above = []
    while len(above) < row:
        cells = _split(lines[row - len(above) - 1].text, delimiter)
        if len(cells) != len(first) or any(NUMBER.fullmatch(c) or is_clock(c) for c in cells):
            break
        above.append(cells)
    if not above:
        return None
    names = [name for group in TIME_NAMES for name in group]
    times = [i for i, cells in enumerate(above) if any(is_time_name(Header.of(c), names) for c in cells)]
    header = times[0] if len(times) == 1 else int(len(above) > 1 and _is_units(above[0]))
    has_units = header > 0 and _is_units(above[header - 1])
    units = above[header - 1] if has_units else ()
    end, skipped = lines[row - 1].end, row - 1 - header
    return CsvLayout(above[header], units, first, delimiter, end, skipped, header - has_units)


def _is_row(cells: Sequence[str]) -> bool:
    """Return whether cells are those of a row of numbers, of which some may be missing."""
    return bool(cells[0] or cells[1]) and all(
        NUMBER.fullmatch(c) or c.lower() in _WORDS or is_clock(c) or is_list(c) for c in cells
    )


def _is_units(cells: Sequence[str]) -> bool:
    """Return whether cells are those of a row of units: at least one is, and none is a number."""
    bare = [bare_unit(c) for c in cells]
    # a letter or a sign of a unit: "1" and "-" are units of numbers without one, but also data
    return any(is_unit(c) for c in bare if any(x.isalpha() or x in "°%" for x in c)) and not any(
        NUMBER.fullmatch(c) and not is_dimensionless(c) for c in bare
    )


def _split(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in _cells(line, delimiter, skips_blanks=True)]


def _cells(line: str, delimiter: str, skips_blanks: bool = False) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=skips_blanks), [])
    except csv.Error:  # a cell of more than 128 KiB, or a line end without quotes
        return []


def _first_lines(content: bytes) -> list[_Line]:
    """Return the first lines that are neither blank nor comments; a line break in quotes ends no line."""
    lines: list[_Line] = []
    begin = 0
    while begin < len(content) and len(lines) < _SEARCHED:
        end = _end_of_line(content, begin)
        line = content[begin:end]
        # an odd number of quotes: a name with a line break, or inches
        if line.count(b'"') % 2 and (last := _end_of_quotes(content, begin)):
            end, line = last, content[begin:last]
        if line.strip() and not line.startswith(b"#"):
            lines.append(_Line(line.rstrip(b"\r\n").decode(), end))
        begin = end
    return lines


def _end_of_line(content: bytes, begin: int) -> int:
    return content.find(b"\n", begin) + 1 or len(content)


def _end_of_quotes(content: bytes, begin: int) -> int | None:
    """Return the end of the line in which quotes end, None if they do not: they may be inches."""
    end = begin
    for _ in range(_QUOTED):
        end = _end_of_line(content, end)
        if content[begin:end].count(b'"') % 2 == 0:
            return end
    return None
