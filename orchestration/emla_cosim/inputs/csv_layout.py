"""Where names, units and numbers of a text file begin, what separates them, and clock times in it."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.errors import CommandError
from .headers import Header, is_dimensionless, is_unit

_CLOCK = (
    r"^\s*(?:(?P<date>[0-9]{1,4}[-./][0-9]{1,2}[-./][0-9]{1,4}|[0-9]{8})(?:\s*[T,;_ ]\s*|$))?"
    r"(?:(?P<hour>[0-9]{1,2}):?(?P<minute>[0-5][0-9])"
    r"(?::?(?P<second>[0-5][0-9])(?:[.,](?P<fraction>[0-9]{1,9}))?)?"
    r"\s*(?P<half>[ap]\.?m\.?)?\s*(?P<zone>Z|UTC|[-+][0-9]{2}:?[0-9]{2})?)?\s*$"
)
_CLOCK_TEXT = re.compile(_CLOCK, re.IGNORECASE)
_NUMBER = re.compile(r"\s*[0-9]*[.,]?[0-9]*\s*")
"""A number without a sign, or nothing; some could be read as a clock time or a date."""

_DAY = 86_400_000_000_000
"""A day in ns."""

_EPOCH = 1e9, 5e9
"""Times in s that are taken as seconds since 1970: those of the years 2001 to 2128."""


def is_clock(text: object) -> bool:
    """Return whether a text is a clock time, a date, or both; numbers are neither."""
    return isinstance(text, str) and not _NUMBER.fullmatch(text) and bool(_CLOCK_TEXT.fullmatch(text))


def is_epoch(time: float) -> bool:
    """Return whether a time in s is taken as seconds since 1970."""
    return _EPOCH[0] <= time < _EPOCH[1]


def describe_epoch(name: str, first: float) -> str:
    """Return the note on times that are taken as seconds since 1970."""
    moment = datetime.fromtimestamp(first, UTC).replace(tzinfo=None).isoformat(" ", "milliseconds")
    return (
        f"has seconds since 1970 in '{name}'; t = 0 is {first:.13g} s, {moment.removesuffix('.000')} UTC, "
        "the first row (for an input, shift=0 keeps them as they are)"
    )


def read_clock(texts: polars.Series, label: str) -> tuple[Vector, str]:
    """Return the times of a column of clock times in s, from the first row, and what they were read as.

    Clock times without a date that go back by more than half a day continue on the next day.

    Args:
        texts: The cells.
        label: What error messages call the column.

    Raises:
        CommandError: If a cell is not a clock time, or a date can be read in two ways.
    """
    parts = texts.str.extract_groups(f"(?i){_CLOCK}").struct.unnest()
    dated, timed = parts["date"].is_not_null(), parts["hour"].is_not_null()
    if not (fits := dated | timed).all():
        row = int((~fits).arg_max() or 0)
        raise CommandError(
            f"{label} has '{str(texts[row])[:40]}' in row {row + 1}; write clock times as 12:34 or "
            "12:34:56.789, with or without a date such as 2026-05-03 or 03.05.2026.",
            row=row + 1,
        )
    hour, minute, second = (parts[n].fill_null("0").cast(polars.Int64) for n in ("hour", "minute", "second"))
    afternoon = parts["half"].str.to_lowercase().str.starts_with("p")
    hour = (hour % 12 + 12 * afternoon.cast(polars.Int64)).zip_with(parts["half"].is_not_null(), hour)
    fraction = parts["fraction"].fill_null("0").str.pad_end(9, "0").cast(polars.Int64)
    # whole nanoseconds: doubles would round clock times of a day to about 10 ns
    moments = (((hour * 60 + minute) * 60 + second) * 1_000_000_000 + fraction).to_numpy().astype(np.int64)
    order = ""
    if dated.any():
        if not dated.all():
            row = int((~dated).arg_max() or 0)
            raise CommandError(f"{label} has no date in row {row + 1}, but in other rows.", row=row + 1)
        days, order = _parse_days(parts["date"], label)
        moments = moments + days * _DAY
    else:
        # a smaller step back is a mistake in the data, which `read_times` reports
        moments = moments + np.concatenate([[0], np.cumsum(np.diff(moments) < -_DAY // 2)]) * _DAY
    zones = parts["zone"].fill_null("")
    minutes = {  # Z, UTC and none are 0
        zone: int(f"{zone[0]}1") * (60 * int(zone[1:3]) + int(zone[-2:])) if zone[:1] in ("+", "-") else 0
        for zone in zones.unique().to_list()
    }
    moments = moments - zones.replace_strict(minutes, return_dtype=polars.Int64).to_numpy() * 60_000_000_000
    clock = "clock times" if parts["second"].is_not_null().any() else "hours and minutes"
    meaning = f"dates{order}" if not timed.any() else f"dates{order} and {clock}" if dated.any() else clock
    return (moments - moments[0]) / 1e9, meaning


def seconds_from_first(column: polars.Series) -> tuple[Vector, str]:
    """Return a column of dates, times or durations in s from the first row, and what they were read as."""
    kinds = {polars.Date: "dates", polars.Time: "clock times", polars.Duration: "durations"}
    meaning = kinds.get(column.dtype.base_type(), "dates and clock times")
    if column.dtype == polars.Duration:
        column = column.cast(polars.Duration("ns"))
    elif column.dtype != polars.Time:
        column = column.cast(polars.Datetime("ns"))
    numbers = column.to_physical().to_numpy().astype(np.int64)
    return (numbers - numbers[0]) / 1e9, meaning


def _parse_days(dates: polars.Series, label: str) -> tuple[np.ndarray, str]:
    """Return the days of dates, from any day, and the order of day and month if it was concluded.

    Raises:
        CommandError: If a date does not exist, or the order of day and month is ambiguous.
    """
    texts = dates.unique(maintain_order=True).to_list()
    if len(texts) == 1:  # any reading gives the same times, also an ambiguous one
        return np.zeros(len(dates), np.int64), ""
    parts = {t: re.split("([-./])", f"{t[:4]}-{t[4:6]}-{t[6:]}" if t.isdigit() else t) for t in texts}
    if wrong := next((text for text, part in parts.items() if part[1] != part[3]), None):
        raise CommandError(f"{label} has the date '{wrong}'; write 2026-05-03 or 03.05.2026.")
    slashed = [(int(p[0]), int(p[2])) for p in parts.values() if p[1] == "/" and len(p[0]) < 4]
    month_first = any(second > 12 for _, second in slashed)
    if slashed and month_first == any(first > 12 for first, _ in slashed):
        raise CommandError(
            f"{label} has dates such as '{texts[0]}', whose day and month are ambiguous; write "
            "2026-05-03 or 03.05.2026."
        )
    days = dict[str, int]()
    for text, (first, separator, second, _, third) in parts.items():
        day, month, year = first, second, third
        if len(first) == 4:
            day, year = third, first
        elif month_first and separator == "/":
            day, month = second, first
        try:
            days[text] = date(int(year) + 2000 * (int(year) < 100), int(month), int(day)).toordinal()
        except ValueError as error:
            raise CommandError(f"{label} has the date '{text}', which does not exist.") from error
    order = f" ({'month/day' if month_first else 'day/month'}/year)" if slashed else ""
    return dates.replace_strict(days, return_dtype=polars.Int64).to_numpy(), order


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
    lines = _read_first_lines(content)
    if not lines:
        return None
    for row in range(1, len(lines)):
        for delimiter in DELIMITERS:
            cells = _split_and_strip(lines[row].text, delimiter)
            if len(cells) > 1 and _is_number_row(cells):
                return _find_layout_above(lines, row, delimiter, cells) or _find_first_line_layout(lines)
    return _find_first_line_layout(lines)


def find_result_layout(content: bytes) -> CsvLayout | None:
    """Return the layout of a table that a run wrote; None for another one.

    Its names are kept as they are, with blanks and line ends.

    Args:
        content: Whole lines.
    """
    lines = _read_first_lines(content) if content.startswith(b"time,") else []
    names = _split_cells(lines[0].text, ",") if lines else []
    if len(names) < 2:
        return None
    first = _split_and_strip(lines[1].text, ",") if len(lines) > 1 else ()
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


def _find_first_line_layout(lines: Sequence[_Line]) -> CsvLayout:
    """Return the layout of a text whose first line is the header."""
    header = lines[0].text
    delimiter = next((d for d in DELIMITERS if d in header), DELIMITERS[-1])
    names, units, end = _split_and_strip(header, delimiter), list[str](), lines[0].end
    rows = [_split_and_strip(line.text, delimiter) for line in lines[1:3]]
    if rows and len(rows[0]) == len(names) and _is_unit_row(rows[0]):
        units, end, rows = rows[0], lines[1].end, rows[1:]
    return CsvLayout(names, units, rows[0] if rows else (), delimiter, end)


def _find_layout_above(
    lines: Sequence[_Line], row: int, delimiter: str, first: Sequence[str]
) -> CsvLayout | None:
    """Return the layout whose first row of numbers is this one; None if there is no header above it."""
    above = []
    while len(above) < row:
        cells = _split_and_strip(lines[row - len(above) - 1].text, delimiter)
        if len(cells) != len(first) or any(NUMBER.fullmatch(c) or is_clock(c) for c in cells):
            break
        above.append(cells)
    if not above:
        return None
    names = [name for group in TIME_NAMES for name in group]
    times = [i for i, cells in enumerate(above) if any(is_time_name(Header.of(c), names) for c in cells)]
    header = times[0] if len(times) == 1 else int(len(above) > 1 and _is_unit_row(above[0]))
    has_units = header > 0 and _is_unit_row(above[header - 1])
    units = above[header - 1] if has_units else ()
    end, skipped = lines[row - 1].end, row - 1 - header
    return CsvLayout(above[header], units, first, delimiter, end, skipped, header - has_units)


def _is_number_row(cells: Sequence[str]) -> bool:
    """Return whether cells are those of a row of numbers, of which some may be missing."""
    return bool(cells[0] or cells[1]) and all(
        NUMBER.fullmatch(c) or c.lower() in _WORDS or is_clock(c) or is_list(c) for c in cells
    )


def _is_unit_row(cells: Sequence[str]) -> bool:
    """Return whether cells are those of a row of units: at least one is, and none is a number."""
    bare = [bare_unit(c) for c in cells]
    # a letter or a sign of a unit: "1" and "-" are units of numbers without one, but also data
    return any(is_unit(c) for c in bare if any(x.isalpha() or x in "°%" for x in c)) and not any(
        NUMBER.fullmatch(c) and not is_dimensionless(c) for c in bare
    )


def _split_and_strip(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in _split_cells(line, delimiter, skips_blanks=True)]


def _split_cells(line: str, delimiter: str, skips_blanks: bool = False) -> list[str]:
    """Return the cells of a line; none if it cannot be parsed."""
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=skips_blanks), [])
    except csv.Error:  # a cell of more than 128 KiB, or a line end without quotes
        return []


def _read_first_lines(content: bytes) -> list[_Line]:
    """Return the first lines that are neither blank nor comments; a line break in quotes ends no line."""
    lines: list[_Line] = []
    begin = 0
    while begin < len(content) and len(lines) < _SEARCHED:
        end = _find_end_of_line(content, begin)
        line = content[begin:end]
        # an odd number of quotes: a name with a line break, or inches
        if line.count(b'"') % 2 and (last := _find_end_of_quotes(content, begin)):
            end, line = last, content[begin:last]
        if line.strip() and not line.startswith(b"#"):
            lines.append(_Line(line.rstrip(b"\r\n").decode(), end))
        begin = end
    return lines


def _find_end_of_line(content: bytes, begin: int) -> int:
    return content.find(b"\n", begin) + 1 or len(content)


def _find_end_of_quotes(content: bytes, begin: int) -> int | None:
    """Return the end of the line in which quotes end, None if they do not: they may be inches."""
    end = begin
    for _ in range(_QUOTED):
        end = _find_end_of_line(content, end)
        if content[begin:end].count(b'"') % 2 == 0:
            return end
    return None
