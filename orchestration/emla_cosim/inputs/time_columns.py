"""The column of times of a table."""

from collections.abc import Sequence

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.units import find_unit
from .csv_layout import (
    TIME_NAMES,
    describe_epoch,
    is_clock,
    is_epoch,
    is_time_name,
    read_clock,
    seconds_from_first,
)
from .data_tables import DataTable
from .headers import Header

_LATEST_EPOCH = 1e11
"""The largest first time in s: the year 5138 as seconds since 1970."""

_LATEST = 1e100
"""The largest time in s; differences of greater ones can overflow."""


def read_times(
    table: DataTable, column: str | None = None, start: float = 0.0, is_raw: bool = False, least: int = 2
) -> tuple[int, Vector]:
    """Return the position of the column of times, and the times in s.

    Clock times, dates and seconds since 1970 become times from the first row; a note of the table says so.
    Rows with the same time are an event.

    Args:
        table: The table.
        column: The name of the column; default: `time` or `t`.
        start: The start of the run in s; seconds since 1970 stay if it is one of them.
        is_raw: Whether all numbers stay as they are.
        least: The number of rows that are needed.

    Raises:
        CommandError: If there is no such column, or the times decrease.
    """
    position = _find_column(table, column)
    times = _read_clock_times(table, position)
    if times is None:
        times = _read_numbers(table, position, column, start, is_raw)
    if len(times) < least:
        raise CommandError(f"{table.label} has {'fewer than two' if least > 1 else 'no'} rows.")
    if len(times):
        _check_order(table, times, least)
    return position, times


def _find_column(table: DataTable, column: str | None) -> int:
    if column is not None:
        for name in (column, Header.of(column).name):
            if (position := table.find(name)) is not None:
                return position
        raise table.no_column(column)
    positions: Sequence[int] = ()
    # group by group: a file with `time` may have a column `t` that is something else
    for names in TIME_NAMES:
        positions = positions or [i for i, h in enumerate(table.headers) if is_time_name(h, names)]
    if len(positions) != 1:
        count = "several columns" if positions else "no column"
        raise CommandError(
            f"{table.label} has {count} called time or t, but {table.join_names()}; call the column of times "
            "'time' (for an input, you can also set time=NAME)."
        )
    return positions[0]


def _read_clock_times(table: DataTable, position: int) -> Vector | None:
    """Return the times of a column of clock times, from the first row; None for one of numbers."""
    cells, name = table.cells(position), table.headers[position].text
    is_text = len(cells) and cells.dtype == polars.String and is_clock(cells[0])
    if not (is_text or cells.dtype.is_temporal()) or not len(cells):
        return None
    if (missing := cells.is_null()).any():
        raise table.wrong_cell(position, int(missing.arg_max() or 0), None)
    label = f"the time '{name}' of {table.label}"
    times, meaning = read_clock(cells, label) if is_text else seconds_from_first(cells)
    table.notes.append(f"has {meaning} in '{name}'; t = 0 is {cells[0]}, the first row")
    return times


def _read_numbers(table: DataTable, position: int, column: str | None, start: float, is_raw: bool) -> Vector:
    """Return the times of a column of numbers in s."""
    header = table.headers[position]
    declared = Header.of(column).unit if column is not None and column != header.text else None
    times, _ = table.in_unit(position, "time", find_unit("s"), declared)
    if is_raw or not len(times):
        return times  # results of a run may start at any time
    if times[0] > _LATEST_EPOCH:
        raise CommandError(
            f"{table.label} has the time {times[0]:.13g} s in row 1; if these are milliseconds since 1970, "
            f"write the unit: '{header.name} [ms]'."
        )
    if is_epoch(float(times[0])) and not is_epoch(start):
        table.notes.append(describe_epoch(header.text, float(times[0])))
        return times - times[0]
    return times


def _check_order(table: DataTable, times: Vector, least: int) -> None:
    """Raise CommandError for times that decrease, or all of which are equal although two are needed."""
    if max(abs(times[0]), abs(times[-1])) > _LATEST:
        raise CommandError(f"{table.label} has times beyond {_LATEST:g} s.")
    if (back := np.flatnonzero(~(np.diff(times) >= 0.0))).size:
        row = int(back[0]) + 1
        raise CommandError(
            f"{table.label} has the time {times[row]:.9g} s in row {row + 1}, after {times[row - 1]:.9g} s; "
            "times must not decrease.",
            row=row + 1,
        )
    if least > 1 and not times[-1] > times[0]:
        raise CommandError(f"{table.label} has the time {times[0]:.9g} s in all rows; times must increase.")
