"""Inputs with their data: the times that these cover, and those at which they jump or bend."""

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.units import find_unit
from ..system.fault import Fault
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
from .input import SHIFT_TO_START, Input
from .schedules import SCHEDULES
from .table_files import read_frame, read_table

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
    position = _find_time_column(table, column)
    times = _read_clock_times(table, position)
    if times is None:
        times = _read_number_times(table, position, column, start, is_raw)
    if len(times) < least:
        raise CommandError(f"{table.label} has {'fewer than two' if least > 1 else 'no'} rows.")
    if len(times):
        _check_order(table, times, least)
    return position, times


def _find_time_column(table: DataTable, column: str | None) -> int:
    """Return the position of the column of times; raise CommandError if it is not exactly one."""
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


def _read_number_times(
    table: DataTable, position: int, column: str | None, start: float, is_raw: bool
) -> Vector:
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
    """Raise CommandError for times that decrease, are too large, or are all equal although two are needed."""
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


def read_data(source: Input) -> DataTable:
    """Return the table of an input.

    Raises:
        CommandError: If its file cannot be read as a table.
    """
    if source.file is None:
        return read_frame(source.label, source.data)
    names = [_parse_channel_name(column.column) for column in source.signals.values()]
    names += [] if source.time is None else [Header.of(source.time).name]
    return read_table(source.file, "the input", [*names, *source.columns])


def _parse_channel_name(text: str) -> str:
    """Return the name of the column in a text such as `der(x [mm])`."""
    text = text.strip()
    while text.startswith("der(") and text.endswith(")"):
        text = text[4:-1].strip()
    return Header.of(text).name


@dataclass(frozen=True)
class LoadedInput:
    """An input with its data.

    Attributes:
        source: The input.
        data: Its table.
        time: The position of the column of times.
        times: The times in s.
    """

    source: Input
    data: DataTable
    time: int
    times: Vector

    @classmethod
    def of(cls, source: Input, start: float = 0.0) -> "LoadedInput":
        """Read the data of an input.

        Args:
            source: The input.
            start: The start of the run in s.

        Raises:
            CommandError: If they cannot be read.
        """
        data = read_data(source)
        time, times = read_times(data, source.time, start, source.shift not in (None, SHIFT_TO_START))
        return cls(source, data, time, source.shift_times(times, start))


@dataclass(frozen=True)
class DataSpan:
    """The first and the last time of an input in s, and whether the user has shifted them."""

    label: str
    first: float
    last: float
    end: str
    is_shifted: bool

    @classmethod
    def of(cls, source: Input, start: float) -> "DataSpan":
        """Read the span of an input; `start` is that of the run in s."""
        times = LoadedInput.of(source, start).times
        return cls(source.label, float(times[0]), float(times[-1]), source.end, source.shift is not None)

    def check_overlap(self, start: float, stop: float) -> None:
        """Raise CommandError if the data are all before or all after a run: it would have one value only."""
        remedy = f"shift={SHIFT_TO_START}"
        if not self.is_shifted:
            remedy += f" or a time such as 'shift={start - self.first:.9g} s'"
        if self.first >= stop:
            side = "after"
        elif self.last <= start and self.end != "repeat":
            side = "before"
            remedy += ", or repeat them with end=repeat"
        else:
            return
        raise CommandError(
            f"{self.label} has data from {self.first:.9g} to {self.last:.9g} s, {side} the run, from "
            f"{start:.9g} to {stop:.9g} s; shift them with {remedy}."
        )

    def describe_held(self, start: float, stop: float, step: float) -> str | None:
        """Return a remark if values hold for more than a step before or after the data; times in s."""
        sentences = []
        if self.first > start + step:
            sentences.append(f"the first values hold until {self.first:.9g} s")
        if self.last < stop - step and self.end == "hold":
            sentences.append(f"the last values hold after {self.last:.9g} s")
        if not sentences:
            return None
        return (
            f"{self.label} does not cover the run, {start:.9g} to {stop:.9g} s: {', and '.join(sentences)} "
            "(shift= moves the data)."
        )


def find_data_end(sources: Sequence[Input], start: float) -> float | None:
    """Return the earliest end in s of inputs that stop the run, which starts at `start`; None without one."""
    ends = [float(LoadedInput.of(s, start).times[-1]) for s in sources if s.end == "stop"]
    return min(ends, default=None)


MOST = 100_000
"""The largest number of jumps of an input at which steps end."""


def input_events(
    sources: Sequence[Input],
    faults: Sequence[Fault],
    parameters: Mapping[str, float],
    start: float,
    stop: float,
) -> list[float]:
    """Return the times at which inputs jump or bend, in s and in no order.

    Args:
        sources: The inputs. Held values jump at rows that differ from the row before.
        faults: The faults, which begin and end.
        parameters: All parameters by full name, for `SCHEDULES`.
        start: The start time in s.
        stop: The stop time in s.
    """
    events = [t for schedule in SCHEDULES for t in schedule(parameters)]
    for fault in faults:
        events += [fault.start, fault.start + (math.inf if fault.duration is None else fault.duration)]
    for source in sources:
        input_data = LoadedInput.of(source, start)
        times = input_data.times
        if source.interpolation == "held":
            events += _repeat_jumps(source, times, _find_jumps(input_data), stop)
        else:
            events += [float(times[0]), float(times[-1])]
            if (jumps := times[1:][np.diff(times) == 0.0]).size:  # rows with the same time
                events += _repeat_jumps(source, times, jumps, stop)
    return [t for t in events if math.isfinite(t)]


def row_distance(sources: Sequence[Input]) -> float:
    """Return the smallest median distance of rows among the inputs in s; infinity without data."""
    distances = [np.diff(LoadedInput.of(s).times) for s in sources if s.interpolation != "held"]
    return min((float(np.median(d[d > 0.0])) for d in distances), default=math.inf)


def _find_jumps(input_data: LoadedInput) -> Vector:
    """Return the times of rows that differ from the row before in a column of numbers."""
    differs = np.zeros(len(input_data.times), dtype=bool)
    with contextlib.suppress(CommandError):  # a column that cannot be read is left out below
        input_data.data.load(range(len(input_data.data.headers)))
    for position in range(len(input_data.data.headers)):
        if position != input_data.time:
            with contextlib.suppress(CommandError):  # a column of texts drives nothing
                values = input_data.data.numbers(position)
                differs[1:] |= values[1:] != values[:-1]
    return input_data.times[differs]


def _repeat_jumps(source: Input, times: Vector, jumps: Vector, stop: float) -> list[float]:
    """Return the jumps and their repetitions up to the stop time, none if there are too many."""
    period, rounds = float(times[-1] - times[0]), 0
    if source.end == "repeat" and stop > times[-1]:
        rounds = math.ceil((stop - float(times[-1])) / period)
    if (rounds + 1) * (len(jumps) + 1) > MOST:
        return []  # steps that end at every row of a long recording would take too long
    return [float(t) + k * period for k in range(rounds + 1) for t in (*jumps, times[-1])]
