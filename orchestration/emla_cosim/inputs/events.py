"""Times at which inputs jump or bend, and the distance between their rows, both known before a run."""

import contextlib
import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..system.fault import Fault
from .input import Input
from .loaded_input import LoadedInput
from .schedules import SCHEDULES

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
            events += _repeat_jumps(source, times, _jumps(input_data), stop)
        else:
            events += [float(times[0]), float(times[-1])]
            if (jumps := times[1:][np.diff(times) == 0.0]).size:  # rows with the same time
                events += _repeat_jumps(source, times, jumps, stop)
    return [t for t in events if math.isfinite(t)]


def row_distance(sources: Sequence[Input]) -> float:
    """Return the smallest median distance of rows among the inputs in s; infinity without data."""
    distances = [np.diff(LoadedInput.of(s).times) for s in sources if s.interpolation != "held"]
    return min((float(np.median(d[d > 0.0])) for d in distances), default=math.inf)


def _jumps(input_data: LoadedInput) -> Vector:
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
