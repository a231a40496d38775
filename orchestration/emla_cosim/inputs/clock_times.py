"""Clock times and dates, as measurement computers write them, converted to seconds from the first row."""

import re
from datetime import UTC, date, datetime

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.errors import CommandError

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
        days, order = _days(parts["date"], label)
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


def _days(dates: polars.Series, label: str) -> tuple[np.ndarray, str]:
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
