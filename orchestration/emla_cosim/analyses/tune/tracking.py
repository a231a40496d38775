"""The tracking error: how far a joint is from its reference, also for a joint that is lost."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...recorders.metrics import METRICS, TRACKED, Figures, Metrics
from ...recorders.recorder import Outline

TRACKING_ERROR = "miss"
"""Mean of log10(1 + |x_L - x_d| / 1 µm) over all rows: 1 for 9 µm, 6 for a metre."""

_KIND = "tuning"
_SCALE = 1e-6
_WORST = 12.0
"""Value of a row that is not a number or is farther away than anything."""


class _TrackingErrorMetrics(Metrics):
    def __init__(self, columns: Mapping[str, tuple[int, int]]) -> None:
        self._columns = columns
        self._sums = dict.fromkeys(columns, 0.0)
        self._rows = 0

    def write(self, rows: Vector) -> None:
        """Take the next rows."""
        self._rows += len(rows)
        for joint, (position, reference) in self._columns.items():
            error = np.abs(rows[:, position] - rows[:, reference])
            logarithms = np.log10(1.0 + error / _SCALE)
            self._sums[joint] += float(
                np.nan_to_num(logarithms, nan=_WORST, posinf=_WORST).clip(0, _WORST).sum()
            )

    def figures(self) -> Figures:
        """Return the mean by joint."""
        return {joint: {TRACKING_ERROR: total / max(self._rows, 1)} for joint, total in self._sums.items()}

    def memory(self) -> Any:
        """Return sums by joint and the number of rows."""
        return {"sums": self._sums, "rows": self._rows}

    def remember(self, memory: Any) -> None:
        """Continue from a checkpoint."""
        self._sums, self._rows = dict(memory["sums"]), int(memory["rows"])


def tracking_error(outline: Outline) -> Metrics | None:
    """Return the metrics of all joints of a run; None if it has none."""
    column = {name: i + 1 for i, name in enumerate(outline.names)}
    found = {
        joint: (column[position], column[reference])
        for find in TRACKED.values()
        for joint, (position, reference) in find(column, outline.roles).items()
    }
    return _TrackingErrorMetrics(found) if found else None


@contextmanager
def record_tracking_error() -> Iterator[None]:
    """Record the tracking error meanwhile, here and on workers that start meanwhile."""
    METRICS[_KIND] = tracking_error
    try:
        yield
    finally:
        METRICS.pop(_KIND, None)
