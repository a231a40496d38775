"""Times at which inputs jump or bend, and the distance between their rows, both known before a run."""

import contextlib
import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..system.fault import Fault
from .data_tables import read_data
from .input import Input
from .schedules import SCHEDULES

MOST = 100_000
"""The largest number of jumps of an input at which steps end."""


def input_events(
    sources: Sequence[Input], faults: Sequence[Fault], parameters: Mapping[str, float], stop: float
) -> list[float]:
    """Return the times at which inputs jump or bend, in s and in no order.

    Args:
        sources: The inputs. Held values jump at rows that differ from the row before.
        faults: The faults, which begin and end.
        parameters: All parameters by full name, for `SCHEDULES`.
        stop: The stop time in s.
    """
    found = [t for schedule in SCHEDULES for t in schedule(parameters)]
    for fault in faults:
        found += [fault.start, fault.start + (math.inf if fault.duration is None else fault.duration)]
    for source in sources:
        if source.interpolation == "held":
            found += _repeat_jumps(source, _jumps(source), stop)
        elif (times := _times(source)).size:
            found += [float(times[0]), float(times[-1])]
            if (events := times[1:][np.diff(times) == 0.0]).size:  # rows with the same time
                found += _repeat_jumps(source, events, stop)
    return [t for t in found if math.isfinite(t)]


def row_distance(sources: Sequence[Input]) -> float:
    """Return the smallest median distance of rows among the inputs in s; infinity without data."""
    distances = [np.diff(_times(source)) for source in sources if source.interpolation != "held"]
    return min((float(np.median(d[d > 0.0])) for d in distances if d.size), default=math.inf)


def _times(source: Input) -> Vector:
    return read_data(source).times(source.time)[1]


def _jumps(source: Input) -> Vector:
    """Return the times of rows that differ from the row before in a column of numbers."""
    data = read_data(source)
    position, times = data.times(source.time)
    differs = np.zeros(len(times), dtype=bool)
    for other in range(len(data.headers)):
        if other != position:
            with contextlib.suppress(CommandError):  # a column of texts drives nothing
                values = data.numbers(other)
                differs[1:] |= values[1:] != values[:-1]
    return times[differs]


def _repeat_jumps(source: Input, jumps: Vector, stop: float) -> list[float]:
    """Return the jumps and their repetitions up to the stop time, none if there are too many."""
    times = _times(source)
    period = float(times[-1] - times[0]) if len(times) > 1 else 0.0
    rounds = 0
    if source.end == "repeat" and period > 0.0 and stop > times[-1]:
        rounds = math.ceil((stop - float(times[-1])) / period)
    if (rounds + 1) * (len(jumps) + 1) > MOST:
        return []
    return [float(t) + k * period for k in range(rounds + 1) for t in (*jumps, times[-1])]
