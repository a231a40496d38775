"""Keep some rows of a run, with which repeated steps are compared."""

from dataclasses import dataclass

import numpy as np

from ...base.arrays import Indices, Vector

POINTS = 4096
"""Largest number of rows from the whole run."""

WINDOW_VALUES, LONGEST_WINDOW = 200_000, 8192
"""Largest number of values, and of rows, that a window keeps of successive steps; of others it keeps a
`GROWTH`-th."""

GROWTH = 4
"""Ratio of the distances of rows in the series of one window."""


@dataclass
class _Series:
    """Rows at equal distances in steps."""

    first: int
    stride: int
    rows: Vector
    count: int = 0

    def add_rows(self, first: int, block: Vector, columns: Indices) -> None:
        """Add rows of the series from a block, whose first row is that of step `first`."""
        begin = self.first + self.count * self.stride - first
        if begin < len(block) and self.count < len(self.rows):
            selected = block[begin :: self.stride][: len(self.rows) - self.count, columns]
            self.rows[self.count : self.count + len(selected)] = selected
            self.count += len(selected)


class RowStore:
    """Rows of some signals: some from the whole run, and more of them in windows.

    Args:
        first: Step at which the run begins.
        last: Step at which it ends.
        windows: Steps at which windows begin.
        columns: Positions of the signals.
        is_coarse: Whether windows also keep rows at larger distances.
    """

    def __init__(self, first: int, last: int, windows: list[int], columns: Indices, is_coarse: bool) -> None:
        self.columns, self.first = columns, first
        self.stride = -(-(last - first) // POINTS)
        """Distance in steps of the rows from the whole run."""
        room = (last - first) // self.stride + 1
        self._run_series = _Series(first, self.stride, np.empty((room, len(columns))))
        self._series = [self._run_series]
        longest = max(min(LONGEST_WINDOW, WINDOW_VALUES // max(len(columns), 1)), 64)
        for begin in windows if self.stride > 1 else []:
            stride, most = 1, longest
            while True:
                room = min((last - begin) // stride, most) + 1
                self._series.append(_Series(begin, stride, np.empty((room, len(columns)))))
                if not is_coarse or stride * most >= last - begin:
                    break
                stride, most = stride * GROWTH, longest // GROWTH
        self._incomplete = list(self._series)

    def add_rows(self, first: int, block: Vector) -> None:
        """Add signals, shape (steps, signals), of successive steps from `first` on."""
        for series in self._incomplete:
            series.add_rows(first, block, self.columns)
        self._incomplete = [series for series in self._incomplete if series.count < len(series.rows)]

    def get(self, first: int, stride: int, most: int) -> Vector:
        """Return rows at steps first + stride, first + 2 stride and so on: at most `most`, maybe none."""
        best = np.empty((0, len(self.columns)))
        for s in self._series:
            index, remainder = divmod(first + stride - s.first, s.stride)
            if not remainder and stride % s.stride == 0 and 0 <= index < s.count:
                candidate = s.rows[index : s.count : stride // s.stride][:most]
                best = candidate if len(candidate) > len(best) else best
        return best

    @property
    def ranges(self) -> Vector:
        """Return the range of each signal over the run; 0 if it is only rounding errors."""
        rows = self._run_series.rows[: self._run_series.count]
        ranges, sizes = np.ptp(rows, axis=0), np.abs(rows).max(axis=0)
        return np.where(ranges > 1e-9 * sizes, ranges, 0.0)

    @property
    def path(self) -> Vector:
        """Return the path of each signal over the run, relative to its range."""
        return measure_path(self._run_series.rows[: self._run_series.count], self.ranges)


def measure_path(rows: Vector, ranges: Vector) -> Vector:
    """Return the sum of the absolute changes of each signal, relative to its range; 0 without a range."""
    with np.errstate(all="ignore"):
        path = np.abs(np.diff(rows, axis=0)).sum(axis=0) / ranges
    return np.where(ranges > 0.0, path, 0.0)
