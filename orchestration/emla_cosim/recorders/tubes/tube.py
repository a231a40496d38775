"""A tube around a reference: as wide as a result may be off in value, and in time."""

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Vector


@dataclass(frozen=True)
class Tube:
    """Size of the tube around a reference signal.

    Attributes:
        value: half height, in the unit of the signal.
        time: half width, in s.
    """

    value: float
    time: float

    def edges(self, time: Vector, reference_time: Vector, reference: Vector) -> tuple[Vector, Vector]:
        """The lower and the upper edge at `time`, without `value`: all that the reference is near it.

        The reference is linear between its points, and stays what it is before the first and after
        the last. Two points of one time are a jump.
        """
        low, high = time - self.time, time + self.time
        ends = np.concatenate([_at(low, reference_time, reference), _at(high, reference_time, reference)])
        at_low, at_high = np.split(ends, 2)
        first = np.searchsorted(reference_time, low, side="left")
        last = np.searchsorted(reference_time, high, side="right")
        lower, upper = np.minimum(at_low, at_high), np.maximum(at_low, at_high)
        some = last > first  # points of the reference lie between
        pairs = np.column_stack([first[some], last[some]]).ravel()
        padded = np.append(reference, np.nan)  # so that `last` is an index too
        if some.any():
            lower[some] = np.minimum(lower[some], np.fmin.reduceat(padded, pairs)[::2])
            upper[some] = np.maximum(upper[some], np.fmax.reduceat(padded, pairs)[::2])
        return lower, upper


def _at(time: Vector, reference_time: Vector, reference: Vector) -> Vector:
    return np.interp(time, reference_time, reference)
