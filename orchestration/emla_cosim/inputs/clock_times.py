"""Clock times and dates, as measurement computers write them, converted to seconds from the first row."""

import re
from datetime import date

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.errors import CommandError

_CLOCK = (
    r"(?i)^\s*(?:(?P<date>[0-9]{1,4}[-./][0-9]{1,2}[-./][0-9]{1,4})(?:\s*[T,;_ ]\s*))?"
    r"(?P<hour>[0-9]{1,2}):(?P<minute>[0-5][0-9]):(?P<second>[0-5][0-9])(?:[.,](?P<fraction>[0-9]{1,9}))?"
    r"\s*(?P<half>[ap]\.?m\.?)?\s*(?P<zone>Z|UTC|[-+][0-9]{2}:?[0-9]{2})?\s*$"
)
_CLOCK_TEXT = re.compile(_CLOCK.removeprefix("(?i)"), re.IGNORECASE)
_DATE = re.compile(r"([0-9]{1,4})([-./])([0-9]{1,2})\2([0-9]{1,4})")
_DATE_TEXT = re.compile(r"\s*[0-9]{1,4}([-./])[0-9]{1,2}\1[0-9]{2,4}\s*")

_DAY = 86_400_000_000_000
"""A day in ns."""


def is_date(text: str) -> bool:
    """Return whether a text is a date, or a clock time with or without one."""
    return bool(_CLOCK_TEXT.fullmatch(text) or _DATE_TEXT.fullmatch(text))


def is_clock(text: object) -> bool:
    """Return whether a text is a clock time, with or without a date."""
    return isinstance(text, str) and _CLOCK_TEXT.fullmatch(text) is not None


def read_clock(texts: polars.Series, label: str) -> Vector:
    """Return the times of a column of clock times in s, from the first row.

    Clock times without a date that go back by more than half a day continue on the next day.

    Args:
        texts: The cells.
        label: What error messages call the column.

    Raises:
        CommandError: If a cell is not a clock time, or a date can be read in two ways.
    """
    parts = texts.str.extract_groups(_CLOCK).struct.unnest()
    if (bad := parts["hour"].is_null()).any():
        row = int(bad.arg_max() or 0)
        raise CommandError(
            f"{label} has '{str(texts[row])[:40]}' in row {row + 1}; write clock times as 12:34:56.789, "
            "with or without a date such as 2026-05-03 or 03.05.2026.",
            row=row + 1,
        )
    hour, minute, second = (parts[name].cast(polars.Int64) for name in ("hour", "minute", "second"))
    afternoon = parts["half"].str.to_lowercase().str.starts_with("p")
    hour = (hour % 12 + 12 * afternoon.cast(polars.Int64)).zip_with(parts["half"].is_not_null(), hour)
    fraction = parts["fraction"].fill_null("0").str.pad_end(9, "0").cast(polars.Int64)
    moments = ((hour * 60 + minute) * 60 + second) * 1_000_000_000 + fraction
    found = moments.to_numpy().astype(np.int64)
    if (dated := parts["date"].is_not_null()).any():
        if not dated.all():
            row = int((~dated).arg_max() or 0)
            raise CommandError(f"{label} has no date in row {row + 1}, but in other rows.", row=row + 1)
        found = found + _days(parts["date"], label) * _DAY
    else:
        found = found + np.concatenate([[0], np.cumsum(np.diff(found) < -_DAY // 2)]) * _DAY
    zones = parts["zone"].fill_null("")
    offsets = {zone: _offset(zone) for zone in zones.unique().to_list()}
    found = found - zones.replace_strict(offsets, return_dtype=polars.Int64).to_numpy()
    return (found - found[0]) / 1e9


def seconds_from_first(column: polars.Series) -> Vector:
    """Return a column of dates, times or durations in s, from the first row."""
    physical = column.cast(polars.Datetime("ns")) if column.dtype == polars.Datetime else column
    if column.dtype == polars.Duration:
        physical = column.cast(polars.Duration("ns"))
    numbers = physical.to_physical().to_numpy().astype(np.int64)
    return (numbers - numbers[0]) / 1e9


def _offset(zone: str) -> int:
    """Return the offset of a time zone in ns."""
    if zone[:1] not in ("+", "-"):
        return 0
    minutes = 60 * int(zone[1:3]) + int(zone[-2:])
    return (-1 if zone[0] == "-" else 1) * minutes * 60_000_000_000


def _days(dates: polars.Series, label: str) -> np.ndarray:
    """Return the days of dates, from any day.

    Raises:
        CommandError: If a date does not exist, or day and month cannot be told apart.
    """
    different = dates.unique().to_list()
    if len(different) == 1:
        return np.zeros(len(dates), np.int64)
    found = {text: _DATE.fullmatch(text) for text in different}
    if wrong := next((text for text, match in found.items() if match is None), None):
        raise CommandError(f"{label} has the date '{wrong}'; write 2026-05-03 or 03.05.2026.")
    slashed = [(int(m[1]), int(m[3])) for m in found.values() if m and m[2] == "/" and len(m[1]) < 4]
    month_first = any(second > 12 for _, second in slashed)
    if slashed and month_first == any(first > 12 for first, _ in slashed):
        raise CommandError(
            f"{label} has dates such as '{different[0]}', whose day and month are ambiguous; write "
            "2026-05-03 or 03.05.2026."
        )
    days = {t: _day(m, month_first and m[2] == "/", label) for t, m in found.items() if m is not None}
    return dates.replace_strict(days, return_dtype=polars.Int64).to_numpy()


def _day(found: re.Match[str], month_first: bool, label: str) -> int:
    first, second, third = (int(found[i]) for i in (1, 3, 4))
    if len(found[1]) == 4:
        year, month, day = first, second, third
    else:
        year, month, day = third, *((first, second) if month_first else (second, first))
    try:
        return date(year + 2000 if year < 100 else year, month, day).toordinal()
    except ValueError as error:
        raise CommandError(f"{label} has the date '{found[0]}', which does not exist.") from error
