"""Measured signals: times and values in the units of the system."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.units import SiUnit
from ..inputs.column_bindings import convert_column, find_column
from ..inputs.input import Column, Input
from ..inputs.wired_inputs import LoadedInput

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
        inside = (self.time >= start - 1e-9 * abs(start)) & (self.time <= stop + 1e-9 * abs(stop))
        return MeasuredSignal(self.signal, self.time[inside], self.values[inside], self.unit, self.label)


def read_measurements(
    sources: Sequence[Input], find_unit: Callable[[str], SiUnit | None], label: str
) -> tuple[list[MeasuredSignal], list[str]]:
    """Return the measured signals of an experiment, and what the user should know of how they were read.

    Args:
        sources: the measured data.
        find_unit: returns the unit of a signal, or raises CommandError for an unknown one.
        label: what messages call the experiment.

    Raises:
        CommandError: A file cannot be read, a column is missing, does not vary, or has another quantity.
    """
    found, notes = list[MeasuredSignal](), list[str]()
    for source in sources:
        loaded = LoadedInput.of(source)
        notes += [f"{source.label} {note}." for note in loaded.data.notes]
        if (gaps := _count_gaps(loaded.times)) > 0:
            notes.append(f"{source.label} has {gaps} gap{'s' if gaps > 1 else ''} in its times.")
        asked = dict(source.signals) or {
            h.name: Column(h.text) for i, h in enumerate(loaded.data.headers) if i != loaded.time
        }
        for signal, column in asked.items():
            position, column = find_column(source, loaded.data, column)
            unit = find_unit(signal)
            between, is_assumed = convert_column(loaded.data, position, column, signal, unit)
            text = f"the column '{loaded.data.headers[position].text}' of {source.label}"
            if is_assumed:
                notes.append(f"{text} has no unit and is read in {unit}.")
            values = between.factor * loaded.data.numbers(position) + between.offset
            if np.ptp(values) == 0.0:
                raise CommandError(f"{text} does not vary: it tells nothing of {signal}.", signal=signal)
            if any(one.signal == signal for one in found):
                raise CommandError(f"{label} has two columns for {signal}; remove one.", signal=signal)
            found.append(MeasuredSignal(signal, loaded.times, values, str(unit or ""), text))
    return found, notes


def _count_gaps(time: Vector) -> int:
    steps = np.diff(time)
    return int(np.sum(steps > _GAP * np.median(steps)))
