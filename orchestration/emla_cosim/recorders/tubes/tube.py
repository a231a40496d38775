"""A tube around a reference: the allowed deviations in value and in time."""

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
        """Return the smallest and the largest value of the reference within the tube's `time`.

        The reference is linear between its points, and constant before the first and after the last.
        Two points at the same time are a jump.

        Args:
            time: Times in s at which to compute the edges, shape (n,).
            reference_time: Times of the reference in s, shape (m,).
            reference: The reference, shape (m,).

        Returns:
            Lower and upper edge without `value`, each of shape (n,).
        """
        low, high = time - self.time, time + self.time
        ends = np.concatenate([_at(low, reference_time, reference), _at(high, reference_time, reference)])
        at_low, at_high = np.split(ends, 2)
        first = np.searchsorted(reference_time, low, side="left")
        last = np.searchsorted(reference_time, high, side="right")
        lower, upper = np.minimum(at_low, at_high), np.maximum(at_low, at_high)
        some = last > first  # the reference has points within the tube's time
        pairs = np.column_stack([first[some], last[some]]).ravel()
        padded = np.append(reference, np.nan)  # so that `last` is a valid index
        if some.any():
            lower[some] = np.minimum(lower[some], np.fmin.reduceat(padded, pairs)[::2])
            upper[some] = np.maximum(upper[some], np.fmax.reduceat(padded, pairs)[::2])
        return lower, upper


def _at(time: Vector, reference_time: Vector, reference: Vector) -> Vector:
    return np.interp(time, reference_time, reference)
