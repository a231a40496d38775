"""Where the names, the units and the numbers of a text file begin, and what separates its columns."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from .clock_times import is_date
from .headers import is_dimensionless, is_unit

NUMBER = re.compile(r"\s*[-+]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?\s*")
DELIMITERS = ";\t,"
TIME_NAMES = ("time", "t")
OTHER_TIME_NAMES = ("zeit", "uhrzeit", "zeitstempel", "timestamp", "datetime")

_SEARCHED = 1000
"""The number of lines among which the first row of numbers is searched."""


@dataclass(frozen=True)
class CsvLayout:
    """The layout of a text file.

    Attributes:
        names: The names of the columns.
        units: The cells of the row of units; empty without such a row.
        delimiter: What separates the columns.
        begin: The position of the first row of numbers.
        skipped: The number of lines before the header.
    """

    names: Sequence[str]
    units: Sequence[str]
    delimiter: str
    begin: int
    skipped: int = 0


@dataclass(frozen=True)
class _Line:
    text: str
    end: int


def find_layout(content: bytes) -> CsvLayout | None:
    """Return the layout of a text; None if it has no line.

    The header is the line above the first row of numbers, or above its row of units. A text without such a
    place has its header in the first line.

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
                return _layout_above(lines, row, delimiter, len(cells)) or _first_line_layout(lines)
    return _first_line_layout(lines)


def _first_line_layout(lines: Sequence[_Line]) -> CsvLayout:
    """Return the layout of a text whose first line is the header."""
    header = lines[0].text
    delimiter = next((d for d in DELIMITERS if d in header), DELIMITERS[-1])
    names, begin = _split(header, delimiter), lines[0].end
    if len(lines) > 1 and len(cells := _split(lines[1].text, delimiter)) == len(names) and _is_units(cells):
        return CsvLayout(names, cells, delimiter, lines[1].end)
    return CsvLayout(names, (), delimiter, begin)


def _layout_above(lines: Sequence[_Line], row: int, delimiter: str, width: int) -> CsvLayout | None:
    """Return the layout whose first row of numbers is this one; None if there is no header above it."""
    above = []
    while len(above) < row:
        cells = _split(lines[row - len(above) - 1].text, delimiter)
        if len(cells) != width or any(NUMBER.fullmatch(c) or is_date(c) for c in cells):
            break
        above.append(cells)
    if not above:
        return None
    has_units = len(above) > 1 and _is_units(above[0])
    place = 1 if has_units else 0
    times = [i for i, cells in enumerate(above) if any(_is_time_name(c) for c in cells)]
    if len(times) == 1:
        place = times[0]
        has_units = place == 1 and _is_units(above[0])
    header = row - 1 - place
    begin = lines[header + has_units].end
    return CsvLayout(above[place], above[0] if has_units else (), delimiter, begin, header)


def _is_time_name(cell: str) -> bool:
    return re.split(r"[\s\[(/,_]", cell.lower())[0] in (*TIME_NAMES, *OTHER_TIME_NAMES)


def _is_row(cells: Sequence[str]) -> bool:
    """Return whether cells are those of a row of numbers, of which some may be missing."""
    return bool(cells[0] or cells[1]) and all(not c or NUMBER.fullmatch(c) or is_date(c) for c in cells)


def _is_units(cells: Sequence[str]) -> bool:
    """Return whether cells are those of a row of units: at least one is, and none is a number."""
    bare = [bare_unit(c) for c in cells]
    return any(is_unit(c) for c in bare if any(x.isalpha() or x in "°%" for x in c)) and not any(
        NUMBER.fullmatch(c) and not is_dimensionless(c) for c in bare
    )


def bare_unit(cell: str) -> str:
    """Return a cell of the row of units without brackets."""
    cell = cell.strip()
    return cell[1:-1].strip() if cell[:1] + cell[-1:] in ("[]", "()", "<>") else cell


def _split(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _first_lines(content: bytes) -> list[_Line]:
    """Return the first lines that are neither blank nor comments."""
    found: list[_Line] = []
    begin = 0
    while begin < len(content) and len(found) < _SEARCHED:
        end = content.find(b"\n", begin)
        end = len(content) if end < 0 else end + 1
        line = content[begin:end].strip(b" \r\n\f\v")
        if line.strip() and not line.startswith(b"#"):
            found.append(_Line(line.decode(), end))
        begin = end
    return found
