"""Measured signals: times and values in the units of the system."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, join_names
from ...base.units import SiUnit
from ...base.wording import format_count, list_few
from ...inputs.column_bindings import find_column, match_columns
from ...inputs.input import Column, Input
from ...inputs.loaded_input import LoadedInput

FindSignal = Callable[[str], tuple[str, SiUnit | None]]
"""Function that returns full name and unit of a signal, or raises CommandError."""

EXACT = 1e-6
"""Residuals, as a part of the spread of the measurement, below which a prediction is exact."""

_GAP = 5.0
"""Multiple of the median sample time from which a gap is reported."""


@dataclass(frozen=True)
class MeasuredSignal:
    """A measured signal of an experiment.

    Attributes:
        signal: full name of the signal.
        time: times of the samples in s, shape (n,).
        values: values in `unit`, shape (n,).
        unit: unit of the signal.
        label: the column and its file.
    """

    signal: str
    time: Vector
    values: Vector
    unit: str
    label: str

    def between(self, start: float, stop: float) -> "MeasuredSignal":
        """Return the samples from start to stop, in s."""
        # times of files are rounded
        inside = (self.time >= start - 1e-9 * abs(start)) & (self.time <= stop + 1e-9 * abs(stop))
        return replace(self, time=self.time[inside], values=self.values[inside])


def read_measurements(
    sources: Sequence[Input], find_signal: FindSignal, label: str, start: float = 0.0
) -> tuple[list[MeasuredSignal], list[str]]:
    """Return the measured signals of an experiment, and notes on how they were read.

    Args:
        sources: the measured data.
        find_signal: returns full name and unit of a signal, or raises CommandError for an unknown one.
        label: what messages call the experiment.
        start: start of the run in s.

    Raises:
        CommandError: A file cannot be read, a column is missing, does not vary, or has another quantity.
    """
    measured, notes = list[MeasuredSignal](), list[str]()
    for source in sources:
        for name in ("interpolation", "end"):
            if (value := getattr(source, name)) != getattr(Input(data={}), name):
                raise CommandError(
                    f"{source.label} has {name}={value}, which only data for inputs have; remove it."
                )
        data = LoadedInput.of(source, start)
        notes += [f"{source.label} {note}." for note in data.data.notes]
        steps = np.diff(data.times)
        if (gaps := int(np.sum(steps > _GAP * np.median(steps)))) > 0:
            notes.append(f"{source.label} has {format_count(gaps, 'gap')} in its times.")
        columns, idle = _find_columns(source, data, find_signal)
        if idle:
            notes.append(f"{source.label} has columns that were not compared: {list_few(idle)}.")
        for name, column in columns.items():
            signal, unit = find_signal(name)
            position, column = find_column(source, data.data, column)
            if column.derivative:
                raise CommandError(
                    f"{source.label} has a derivative for {signal}; compare the column itself.", signal=signal
                )
            values, is_assumed = data.data.in_unit(position, signal, unit, column.unit)
            text = f"the column '{data.data.headers[position].text}' of {source.label}"
            if is_assumed:
                notes.append(f"{text} has no unit and is read in {unit}.")
            # the spread of a measurement is the scale of its residuals
            if np.ptp(values) == 0.0:
                raise CommandError(f"{text} does not vary: it has no information on {signal}.", signal=signal)
            if any(earlier.signal == signal for earlier in measured):
                raise CommandError(f"{label} has two columns for {signal}; remove one.", signal=signal)
            measured.append(MeasuredSignal(signal, data.times, values, str(unit or ""), text))
    return measured, notes


def _find_columns(
    source: Input, data: LoadedInput, find_signal: FindSignal
) -> tuple[dict[str, Column], list[str]]:
    """Return the columns by signal, and the names of the columns that no signal has."""
    columns, idle = dict(source.signals), list[str]()
    for name, column in match_columns(source, data.data, data.time).items():
        if name in columns:
            continue
        try:
            find_signal(name)
        except CommandError:
            idle.append(name)
        else:
            columns[name] = column
    if not columns:
        raise CommandError(
            f"{source.label} has no column with the name of a signal; write "
            f"FILE:SIGNAL=COLUMN. Its columns are called {join_names(idle[:8])}."
        )
    return columns, idle


def read_drivers(sources: Sequence[Input], start: float = 0.0) -> dict[str, tuple[Vector, Vector]]:
    """Return times and values of the columns of numbers that drive inputs; runs begin at `start` in s."""
    drivers = dict[str, tuple[Vector, Vector]]()
    for source in sources:
        data = LoadedInput.of(source, start)
        columns = match_columns(source, data.data, data.time)
        for signal, column in {**columns, **source.signals}.items():
            with suppress(CommandError):  # it drives nothing and may have texts
                position, _ = find_column(source, data.data, column)
                drivers[signal] = data.times, data.data.numbers(position)
    return drivers
